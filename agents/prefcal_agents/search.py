"""Find the next θ: feasible points, initial designs, what is minimized, and the search."""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from math import prod
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist

from prefcal_env.errors import KnobError, ProtocolError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.history import History

from .lessons import MOST, Marks, Preferences, cube_of
from .surrogate import RADIAL_FUNCTIONS, PreferenceGP, Surrogate, squared_distances

_COUNTED = 100_000  # spaces with at most this many θ are checked against the constraints
_MANY = 10**6  # a knob with more values counts as having no step


def capacity(space: KnobSpace) -> float:
    """Return the number of different θ to search; infinite if a knob has no step.

    In a small space, θ that the constraints refuse are not counted.

    Raises:
        KnobError: If the space is small and the constraints allow no θ.
    """
    counts = [_count(knob, *part) for knob, part in zip(space, space.within, strict=True)]
    # Beyond this it would take too long to ask the constraints about every θ, and no study runs that many.
    total = prod(counts)
    if not space.constraints or total > _COUNTED:
        return float(total)
    values = [knob.choices(*part) for knob, part in zip(space, space.within, strict=True)]
    every = np.meshgrid(*values, indexing="ij")
    allowed = np.count_nonzero(space.allows(np.stack(every, axis=-1).reshape(-1, len(space))))
    if not allowed:
        names = [constraint.name for constraint in space.constraints]
        raise KnobError(f"the constraints {names} allow none of the {total:.0f} θ of the space")
    return float(allowed)


def _count(knob: Knob, low: float, high: float) -> float:
    if low == high:
        return 1
    if knob.resolution == 0:
        return np.inf
    first, last = knob.steps(np.array([low, high]))
    return np.inf if last - first > _MANY else len(knob.choices(low, high))


# --- Find points in the part of the unit cube that the constraints allow.

_BLOCKS = (300, 1_000, 4_000, 16_000)  # numbers of random points to check, block by block
_LEADERS = 20  # points to search from if no random point is allowed
_AROUND = 30  # points to try around each of them at each step size
_STEPS = np.geomspace(0.3, 1e-5, 40)  # in units of the cube


@dataclass(frozen=True, slots=True)
class Region:
    """The points of the cube that the constraints of `space` allow, after snapping integers."""

    space: KnobSpace

    def allows(self, z: Float[np.ndarray, "m n"]) -> Bool[np.ndarray, " m"]:
        """Return whether the θ of each row of `z` is allowed, shape (m,)."""
        return np.asarray(self.space.allows(self._thetas(z)))

    def _thetas(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
        return self.space.decode_all(self.space.snap_all(z, only_integers=True))

    def draw(self, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count n"]:
        """Return random points of the region, shape (count, n); uniform unless it is tiny.

        Raises:
            KnobError: If no allowed point was found.
        """
        n = len(self.space)
        found = np.zeros((0, n))
        # Blocks grow: most regions need a few hundred points, and a thin one is known as such only after
        # many.
        for size in _BLOCKS:
            block = self.space.scaled(rng.random((max(size, count), n)))
            found = np.vstack([found, block[self.allows(block)]])
            if len(found) >= count:
                return np.asarray(found[:count])
        if not len(found):
            found = self._search(rng)
        for _ in range(3):
            # Points beside points: after a few rounds little of where the search happened to arrive is left.
            found = np.vstack([found, self._beside(found, count, rng)])
        return found[-count:]

    def _beside(
        self, anchors: Float[np.ndarray, "a n"], count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "count n"]:
        """Return points by hit and run: from random anchors part of the way to the edge."""
        start = anchors[rng.integers(len(anchors), size=count)]
        edge = self._toward(start, self.space.scaled(rng.random((count, start.shape[1]))))
        inside = start + rng.random((count, 1)) * (edge - start)
        # The region need not be convex, so what lies between may be refused although both ends are allowed.
        return np.where(self.allows(inside)[:, None], inside, start)

    def _search(self, rng: np.random.Generator) -> Float[np.ndarray, "a n"]:
        """Return allowed points, found by reducing the violation of the constraints."""
        leaders = self.space.scaled(rng.random((_BLOCKS[-1], len(self.space))))
        # Constraints have units of their own: each is measured by its median, or the largest would hide the
        # rest.
        sizes = np.nan_to_num(np.abs(self.space.excess(self._thetas(leaders))))
        scale = np.median(sizes, axis=0)
        order = np.argsort(self._violation(leaders, scale), kind="stable")
        leaders = leaders[order[:_LEADERS]]
        for step in _STEPS:
            shifts = step * rng.standard_normal((_LEADERS, _AROUND, len(self.space)))
            tries = np.concatenate([leaders[:, None], leaders[:, None] + shifts], axis=1)
            tries = np.clip(tries, *self.space.corners)
            flat = tries.reshape(-1, len(self.space))
            allowed = self.allows(flat)
            if allowed.any():
                return np.asarray(flat[allowed])
            violation = self._violation(flat, scale).reshape(_LEADERS, -1)
            leaders = tries[np.arange(_LEADERS), np.argmin(violation, axis=1)]
        raise KnobError(self._nothing(leaders[np.argmin(self._violation(leaders, scale))]))

    def _violation(
        self, z: Float[np.ndarray, "m n"], scale: Float[np.ndarray, " c"]
    ) -> Float[np.ndarray, " m"]:
        excess = self.space.excess(self._thetas(z)) / np.where(scale > 0, scale, 1.0)
        return np.asarray(np.sum(np.maximum(np.nan_to_num(excess, nan=1e9), 0.0), axis=1))

    def _nothing(self, nearest: Float[np.ndarray, " n"]) -> str:
        theta = self._thetas(nearest[None])
        excess = self.space.excess(theta)[0]
        violated = ", ".join(
            f"{constraint.name!r} is {g:g}"
            for constraint, g in zip(self.space.constraints, excess, strict=True)
            if not g <= 0
        )
        tries = sum(_BLOCKS) + _LEADERS * _AROUND * len(_STEPS)
        return (
            f"no θ was found that the constraints allow, in {tries} tries; each must be 0 or "
            f"less, but at the closest point, {self.space.named(theta[0])}, {violated}"
        )

    def repaired(
        self, z: Float[np.ndarray, "m n"], anchors: Float[np.ndarray, "a n"]
    ) -> Float[np.ndarray, "m n"]:
        """Return the rows of `z` snapped; rows that are not allowed move to the region's edge.

        They move toward the nearest of the anchors, which are allowed points, shape (a, n).
        """
        snapped = self.space.snap_all(z)
        out = np.flatnonzero(~self.allows(snapped))
        if len(out):
            nearest = anchors[np.argmin(cdist(snapped[out], anchors, "sqeuclidean"), axis=1)]
            edge = self._toward(nearest, snapped[out])
            # Points at the edge are not rounded, since rounding could leave the region.
            snapped[out] = self.space.snap_all(edge, only_integers=True)
        return snapped

    def _toward(
        self, start: Float[np.ndarray, "m n"], end: Float[np.ndarray, "m n"]
    ) -> Float[np.ndarray, "m n"]:
        """Return the last allowed point on each line from `start`, which is allowed, to `end`."""
        allowed, refused = np.zeros((len(start), 1)), np.ones((len(start), 1))
        allowed[self.allows(end)] = 1.0
        for _ in range(14):  # to 1/16,000 of the way, finer than the step of most knobs
            middle = (allowed + refused) / 2
            good = self.allows(start + middle * (end - start))[:, None]
            # Only `allowed` is returned, so the point is on the safe side of the edge, however few
            # bisections.
            allowed, refused = np.where(good, middle, allowed), np.where(good, refused, middle)
        return np.asarray(start + allowed * (end - start))


def random_points(space: KnobSpace, count: int, rng: np.random.Generator) -> Float[np.ndarray, "count n"]:
    """Return random points of the searched space that the constraints allow, shape (count, n).

    Raises:
        KnobError: If no allowed point was found.
    """
    if space.constraints:
        return Region(space).draw(count, rng)
    return space.scaled(rng.random((count, len(space))))


# --- Step away from the best so far, as an evolution strategy with one parent does.


def step_length(history: History, n_init: int) -> float:
    """Return the standard deviation of the next step, in the unit cube, above 0 and at most 0.5.

    Steps grow where one succeeded, since a longer one may do better still, and shrink where one
    failed. "About the same" says nothing of the length. Answers to follow-up questions count, too.

    Source: I. Rechenberg, "Evolutionsstrategie" (1973): the rule that one step in five succeeds.

    Args:
        n_init: Number of samples of the start, which are no steps.
    """
    b = Preferences.of(history).b[n_init - 1 :]
    # The first step is 0.2, the largest 0.5. 1.5 · 0.9⁴ is 0.98: with one success in five, the length stays.
    return float(min(0.2 * 1.5 ** np.sum(b == -1) * 0.9 ** np.sum(b == 1), 0.5))


# --- Create the initial design: a Latin hypercube.


def latin_hypercube(space: KnobSpace, count: int, seed: int) -> Float[np.ndarray, "N n"]:
    """Return `count` space-filling points of the cube, shape (count, n).

    Source: section IV of the paper: the start of GLISp.
    Deviation: a plain design, one point in each stratum. The paper's lhsdesign takes the best of
    five such designs by their smallest distance between two points. Measured in docs/deviations.md.
    """
    # The same points as scipy.stats.qmc.LatinHypercube, which takes 0.4 s to import.
    rng = np.random.default_rng([seed, 0]).spawn(1)[0]
    within = rng.uniform(size=(count, len(space)))
    strata = np.array([rng.permutation(count) for _ in range(len(space))]).T
    points = space.scaled((strata + 1 - within) / count)
    return _move_inside(points, space, seed) if space.constraints else points


def _move_inside(points: Float[np.ndarray, "N n"], space: KnobSpace, seed: int) -> Float[np.ndarray, "N n"]:
    """Replace each point that the constraints refuse by an allowed one far from all others."""
    region = Region(space)
    refused = np.flatnonzero(~region.allows(points))
    if len(refused):
        # Twenty for each one chosen, and 200 at least, so that the farthest of them is far.
        pool = region.draw(max(200, 20 * len(refused)), np.random.default_rng([seed, 0, 1]))
        nearest = cdist(pool, np.delete(points, refused, axis=0), "sqeuclidean").min(axis=1, initial=np.inf)
        for index in refused:
            farthest = int(np.argmax(nearest))
            points[index] = pool[farthest]
            nearest = np.minimum(nearest, cdist(pool, pool[farthest, None], "sqeuclidean")[:, 0])
    return points


# --- Minimize the acquisition over the θ that have not run, by a search from several starts.
#
# It searches the unit cube or a box in it, respects integer knobs and constraints, and takes the best
# sample as one of its starts. Of the points it found, it returns the one with the lowest objective whose
# θ is new.

_SCALES = (1e-4, 0.3)  # smallest and largest step around the incumbent, in units of the cube
_DRAWS = 200  # random points to check before an integer space is searched completely


@runtime_checkable
class Objective(Protocol):
    """A function to minimize: many values at once, and value and gradient at one point."""

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`."""

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the value and the gradient at one point."""


@dataclass(frozen=True, slots=True)
class Domain:
    """Region to search: a box in the unit cube, its fixed coordinates, and how points snap."""

    # Mask of coordinates that a descent must not move (integer knobs), shape (n,)
    fixed: Bool[np.ndarray, " n"]
    # Function that moves the rows of an array (m, n) to points that can run
    snap: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, "m n"]] = field(repr=False)
    start: Float[np.ndarray, " n"]  # point to start from (the incumbent), shape (n,)
    # Lower and upper corner of the box to search, each of shape (n,)
    corners: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]

    @classmethod
    def of(cls, space: KnobSpace, history: History) -> "Domain":
        """Return the domain in which to minimize an acquisition: the searched part of the cube.

        Frozen knobs stay fixed. Points that constraints refuse move to the edge of the region, so
        a search can ignore the constraints and still finds optima at the edge. It starts at the
        best sample.
        """
        lower, upper = space.corners
        start = np.clip(np.array(history.samples[history.incumbent or 0].z), lower, upper)
        # The gradient of a rounded knob is that of a value that cannot run: only draws move integer knobs.
        fixed = space.integers | (lower == upper)
        if not space.constraints:
            return cls(fixed, space.snap_all, start, (lower, upper))
        region, anchors = Region(space), _anchors(space, history)
        return cls(fixed, lambda z: region.repaired(z, anchors), start, (lower, upper))


def new_minimum(
    objective: Objective, space: KnobSpace, history: History, rng: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Return the point of the cube with the lowest objective whose θ has not run, shape (n,): GLISp, rule 5.

    Raises:
        ProtocolError: If every θ of the space has been tried.
        KnobError: If none was found that the constraints allow.
    """
    domain, tried = Domain.of(space, history), Tried(space, history)
    z = tried.first_new(multistart(objective, domain, rng))
    return tried.fresh(domain.start, rng) if z is None else z


def multistart(objective: Objective, domain: Domain, rng: np.random.Generator) -> Float[np.ndarray, "m n"]:
    """Sample the cube and the neighborhood of the incumbent, then descend from the best few.

    Source: none; it solves eq. xNp1 for every agent here.
    Deviation: L-BFGS-B with analytic gradients from sampled starts instead of the paper's particle
    swarm, also in `GLISp.paper`. Measured in docs/deviations.md.
    """
    points = _sample(domain, rng, 900)
    values = objective(points)
    order = np.argsort(values, kind="stable")
    points, values = points[order], values[order]
    chosen = _apart(points, 3)
    # Values are computed again after snapping: rounding to a dial can lose more than the descent gained.
    descended = domain.snap(np.array([_descend(objective, domain, points[k]) for k in chosen]))
    everything = np.vstack([descended, points])
    values = np.concatenate([objective(descended), values])
    return np.asarray(everything[np.argsort(values, kind="stable")])


def _sample(domain: Domain, rng: np.random.Generator, draws: int) -> Float[np.ndarray, "m n"]:
    n, near = len(domain.start), draws // 3
    # Log-uniform: late steps are far shorter than early ones, and the search does not know which it needs.
    steps = np.exp(rng.uniform(np.log(_SCALES[0]), np.log(_SCALES[1]), size=(near, 1)))
    around = domain.start + steps * rng.standard_normal((near, n))
    low, high = domain.corners
    wide = low + (high - low) * rng.random((draws - near, n))
    return domain.snap(np.clip(np.vstack([domain.start[None], around, wide]), low, high))


def _apart(points: Float[np.ndarray, "m n"], count: int) -> list[int]:
    """Return the indices of the first `count` points that are far enough from each other."""
    chosen = [0]
    nearest = np.sum((points - points[0]) ** 2, axis=1)
    while len(chosen) < count:
        far = np.flatnonzero(nearest > 0.1**2)  # nearer starts would likely descend to one minimum
        if not len(far):
            break
        chosen.append(int(far[0]))
        nearest = np.minimum(nearest, np.sum((points - points[far[0]]) ** 2, axis=1))
    return chosen


def _descend(objective: Objective, domain: Domain, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the result of L-BFGS-B from `z`, shape (n,); fixed coordinates stay."""
    if domain.fixed.all():
        return z
    from scipy.optimize import minimize  # a third of a second to import

    low, high = (np.where(domain.fixed, z, corner) for corner in domain.corners)
    result = minimize(
        objective.value_and_gradient,
        z,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 40},
    )
    return np.asarray(np.clip(result.x, low, high))


class Tried:
    """The θ that ran: none runs again, nor one that differs by less than a step in every knob."""

    def __init__(self, space: KnobSpace, history: History) -> None:
        self._space = space
        tried = [sample.theta for sample in history.samples[: history.answered]]
        self._thetas = np.array(tried, dtype=float).reshape(-1, len(space))

    def is_free(self, theta: Float[np.ndarray, " n"]) -> bool:
        """Return whether physical θ, shape (n,), is a new one that the constraints allow."""
        return bool(self._space.allows(theta)) and not self._space.close(theta, self._thetas).any()

    def may_run(self, z: Float[np.ndarray, " n"]) -> bool:
        """Return whether the θ that `z`, shape (n,), is rounded to may run."""
        return self.is_free(self._space.decode(self._space.snap(z)))

    def first_new(self, points: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " n"] | None:
        """Return the first row of `points` that may run, shape (n,); None if there is none."""
        if self.may_run(points[0]):
            return np.asarray(points[0])
        # Near an optimum hundreds of rows round to a θ that ran: skip them together.
        for z in points[~self._surely_tried(points)]:
            if self.may_run(z):
                return np.asarray(z)
        return None

    def _surely_tried(self, points: Float[np.ndarray, "m n"]) -> Bool[np.ndarray, " m"]:
        close = np.ones((len(points), len(self._thetas)), dtype=np.bool_)
        thetas = self._space.decode_all(points)
        for k, knob in enumerate(self._space):
            if knob.resolution == 0:
                return np.zeros(len(points), dtype=np.bool_)
            there, here = knob.steps(self._thetas[:, k]), knob.steps(thetas[:, k])
            # Half a step rounds to the θ that ran; 0.4, so that no rounding can put one on the other side.
            close &= np.abs(here[:, None] - there) < 0.4
        return np.asarray(close.any(axis=1))

    def fresh(self, z: Float[np.ndarray, " n"], rng: np.random.Generator) -> Float[np.ndarray, " n"]:
        """Return `z`, shape (n,), or another point if its θ ran already or is not allowed.

        The other point is a random one of the searched part.

        Raises:
            ProtocolError: If every θ of the space has been tried.
            KnobError: If none was found that the constraints allow.
        """
        if self.may_run(z):
            return z
        candidate = self.first_new(random_points(self._space, _DRAWS, rng))
        if candidate is not None:
            return candidate
        if not np.isfinite(capacity(self._space)):
            raise ProtocolError(f"no new θ was found in {_DRAWS} random draws")
        return self._first_free()

    def _first_free(self) -> Float[np.ndarray, " n"]:
        # Few θ are left, so the space is small: at most a few times the number of samples.
        values = [knob.choices(*part) for knob, part in zip(self._space, self._space.within, strict=True)]
        for theta in product(*values):
            z = self._space.encode(np.array(theta, dtype=float))
            if self.may_run(z):
                return z
        raise ProtocolError(f"every one of the {len(self._thetas)} θ of the space has been tried")


def _anchors(space: KnobSpace, history: History) -> Float[np.ndarray, "a n"]:
    """Return allowed points to search from: the samples there, or random points without any."""
    tried = cube_of(history)
    lower, upper = space.corners
    inside = tried[np.all((tried >= lower) & (tried <= upper), axis=1)]
    if len(inside):
        return np.asarray(inside)
    return random_points(space, 20, np.random.default_rng(history.answered))


# --- Score candidates: low values of the surrogate are good, and so is distance from all samples.

_NEAREST = 1e-75  # squares to 1e-150: the sum of inverses stays finite on a sample


def exploration(d: Float[np.ndarray, "m N"]) -> Float[np.ndarray, " m"]:
    """Return the IDW distance z from all samples: 0 on a sample, below π/2 elsewhere, in radians.

    Source: eq. IDW-distance with w = 1/d².
    Deviation: none.

    Args:
        d: Squared distances (eq. distance) of m points to the N samples, shape (m, N).
    """
    with np.errstate(over="ignore"):
        weights = np.sum(1 / np.maximum(d, _NEAREST) ** 2, axis=1)
    return np.asarray(np.where(np.any(d == 0, axis=1), 0.0, np.arctan(1 / weights)))


def exploration_and_gradient(
    z: Float[np.ndarray, " n"], samples: Float[np.ndarray, "N n"]
) -> tuple[float, Float[np.ndarray, " n"]]:
    """Return z of eq. IDW-distance and its gradient at one point of the cube; 0 on a sample."""
    away = z - samples
    d = np.sum(away * away, axis=1)
    nearest = d.min()
    if nearest < _NEAREST:
        return 0.0, np.zeros(len(z))
    # With s = Σ d⁻² and arctan(1/s): the slope is -1/(1 + s²) times ∂s = Σ -2 d⁻³ · 2 away.
    # Relative to the nearest sample, because d⁻³ and s² could overflow.
    ratio = nearest / d
    s = np.sum(ratio**2)
    slope = (4 * nearest / (nearest**4 + s**2)) * (ratio**3 @ away)
    return float(np.arctan(nearest**2 / s)), np.asarray(slope)


Learned = Surrogate | PreferenceGP


@dataclass(frozen=True, slots=True)
class Acquisition:
    """The acquisition a(θ) of eq. acquisition on the unit cube."""

    surrogate: Learned  # surrogate Ĵ
    delta: float  # weight δ of exploration, 0 or more
    spread: float  # range ΔĴ; 1 if the surrogate is flat (nothing is known, or only ties)
    tried: Float[np.ndarray, "N n"]  # samples that exploration stays away from, unit cube, shape (N, n)

    @classmethod
    def of(
        cls, surrogate: Learned, delta: float, tried: Float[np.ndarray, "N n"] | None = None
    ) -> "Acquisition":
        """Normalize `surrogate` by its range; `tried` may have more samples than it was fit to."""
        spread = surrogate.spread
        tried = surrogate.centers if tried is None else tried
        return cls(surrogate, delta, spread if spread > 0 else 1.0, tried)

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return a at the rows of `z`, shape (m, n), as shape (m,).

        Source: eq. acquisition.
        Deviation: none.
        """
        value = self.surrogate(z) / self.spread
        if not self.delta:
            return value
        d = squared_distances(z, self.tried)
        return np.asarray(value - self.delta * exploration(d))

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return a and ∂a/∂z at one point of the cube, shape (n,)."""
        value, slope = self.surrogate.value_and_gradient(z)
        value, slope = value / self.spread, slope / self.spread
        if not self.delta:
            return value, slope
        away, of_away = exploration_and_gradient(z, self.tried)
        return value - self.delta * away, np.asarray(slope - self.delta * of_away)


# --- Learn from the mark "unsafe", so that proposals avoid places that are likely unsafe.
#
# The mark "good enough" is recorded and reported but does not change proposals, since that brought no
# gain (docs/research/archive.md).
#
# Source: M. Zhu, D. Piga, A. Bemporad, "C-GLISp: Preference-based global optimization under unknown
# constraints with applications to controller calibration", IEEE Transactions on Control Systems
# Technology 30 (2022).

_RBF = RADIAL_FUNCTIONS["inverse_quadratic"]
_LENGTHS = (0.1, 0.2, 0.4, 0.8)  # candidate length scales of a mark, per knob
_JUDGED = 100  # number of latest samples that choose the length scale, for speed
_VARIANCE = 25.0  # variance of the log odds: after one mark, its label has about 90 %
POOL = 300  # random points to choose from when replacing a planned point that is likely unsafe


@dataclass(frozen=True, slots=True)
class SafetyModel:
    """The probability of a label over the cube, by a Gaussian process on the log odds.

    Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
    section 3.4: the mode of the posterior, whose log odds are Σ α_i φ + offset.
    Deviation: C-GLISp interpolates labels by inverse distances, which cannot see an edge beyond
    the samples: marks then prevented fewer unsafe experiments (docs/research/archive.md).
    """

    centers: Float[np.ndarray, "K n"]  # K labeled samples, shape (K, n)
    alpha: Float[np.ndarray, " K"]  # weights α, shape (K,)
    offset: float  # log odds far from all samples
    length: float  # length scale of a label, above 0, in units of the cube per knob

    @classmethod
    def of(cls, samples: Float[np.ndarray, "K n"], labels: Bool[np.ndarray, " K"]) -> "SafetyModel":
        """Learn from the labels of K samples, with the length scale that explains them best.

        With more than `MOST` samples, keep those with the rarer label and the latest others.
        """
        # Count one label of each kind more, so that labels of a single kind never mean certainty.
        offset = float(np.log((1 + np.sum(labels)) / (1 + np.sum(~labels))))
        if len(labels) > MOST:
            common = labels == (np.mean(labels) > 0.5)
            # The rare label is what an edge is learned from; the latest of the common one lie where proposals
            # are.
            kept = np.sort(np.lexsort((-np.arange(len(labels)), common))[:MOST])
            samples, labels = samples[kept], labels[kept]
        d = squared_distances(samples, samples) / samples.shape[1]
        last = slice(max(len(labels) - _JUDGED, 0), None)
        lengths = np.array(_LENGTHS)[:, None, None]
        fits = [_mode(phi, labels[last], offset) for phi in _kernel(d[last, last], lengths)]
        best = max(range(len(fits)), key=lambda k: fits[k][1])
        alpha, length = fits[best][0], _LENGTHS[best]
        if len(alpha) < len(labels):
            alpha = _mode(_kernel(d, length), labels, offset)[0]
        return cls(samples, _VARIANCE * alpha, offset, length)

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the probability at the rows of `z`, shape (m, n), as shape (m,)."""
        phi = _kernel(squared_distances(z, self.centers) / z.shape[1], self.length)
        return _logistic(self.offset + phi @ self.alpha)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the gradient at one point, shape (n,)."""
        p = self(z[None])[0]
        away = z - self.centers
        per = self.length**2 * len(z)
        slope = _RBF.slope(np.sum(away * away, axis=1) / per)
        return np.asarray(p * (1 - p) * (2 / per) * ((self.alpha * slope) @ away))


def _kernel(
    d: Float[np.ndarray, "m N"], length: float | Float[np.ndarray, "k 1 1"]
) -> Float[np.ndarray, "*k m N"]:
    """Return φ for one length scale, shape (m, N), or for each of several, shape (k, m, N)."""
    return np.asarray(_RBF.value(d / length**2))


def _logistic(x: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    return np.asarray(0.5 * (1 + np.tanh(0.5 * x)))


def _mode(
    phi: Float[np.ndarray, "K K"], labels: Bool[np.ndarray, " K"], offset: float
) -> tuple[Float[np.ndarray, " K"], float]:
    """Return the slopes of the log likelihood at the mode, shape (K,), and the log evidence.

    Source: Rasmussen and Williams, algorithm 3.1, started at 0.
    """
    kernel, sign = _VARIANCE * phi, np.where(labels, 1.0, -1.0)
    f, a = np.zeros(len(labels)), np.zeros(len(labels))
    for _ in range(30):  # about 7 are needed
        p = _logistic(offset + f)
        w = p * (1 - p)
        # Algorithm 3.1 factors 1 + W½ K W½, whose eigenvalues are 1 or more, however close samples are.
        root = np.sqrt(w)
        factor = cho_factor(np.eye(len(w)) + root[:, None] * kernel * root, lower=True)
        b = w * f + labels - p
        a = b - root * cho_solve(factor, root * (kernel @ b))
        before, f = f, kernel @ a
        if np.max(np.abs(f - before)) < 1e-6:
            break
    likelihood = -np.sum(np.logaddexp(0.0, -sign * (offset + f)))
    return a, float(likelihood - 0.5 * a @ f - np.sum(np.log(np.diag(factor[0]))))


@dataclass(frozen=True, slots=True)
class Penalty:
    """A penalty if the predicted `safety` is low: `weight` where it is 0, none from `least` on.

    It is flat where a place is likely safe, so that the acquisition alone decides there: any slope,
    however small, would keep the samples from converging to the optimum.
    """

    safety: SafetyModel
    least: float
    weight: float

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the penalty at the rows of `z`, shape (m,)."""
        return np.asarray(self.weight * np.maximum(1 - self.safety(z) / self.least, 0.0) ** 2)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return value and gradient at one point of the cube, shape (n,)."""
        lack = max(1 - self.safety(z[None])[0] / self.least, 0.0)
        slope = -2 * self.weight * lack / self.least * self.safety.gradient(z)
        return float(self(z[None])[0]), np.asarray(slope)


@dataclass(frozen=True, slots=True)
class Penalized:
    """An acquisition plus the penalty from unsafe marks.

    Source: the acquisition of C-GLISp, with its term for feasibility.
    Deviation: the term is squared beyond a threshold instead of linear, see `Penalty`; there is no
    term for satisfaction.
    """

    acquisition: Objective
    penalty: Penalty

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`, shape (m,)."""
        return np.asarray(self.acquisition(z) + self.penalty(z))

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return value and gradient at one point, shape (n,)."""
        value, slope = self.acquisition.value_and_gradient(z)
        extra, extra_slope = self.penalty.value_and_gradient(z)
        return value + extra, np.asarray(slope + extra_slope)


def unsafe_penalty(history: History, weight: float, least_safe: float) -> Penalty | None:
    """Return the cost of likely unsafe places after `history`; None without unsafe samples.

    Each unsafe sample among the latest ones halves the accepted risk.

    Args:
        weight: Penalty for a place that is certainly unsafe, 0 or more.
        least_safe: Minimum probability of being safe for no penalty.
    """
    if not weight or not history.unsafe:
        return None
    marks = Marks.of(history)
    # Of the latest 20 samples: caution rises for a while, and ends again.
    recent = np.count_nonzero(marks.unsafe[-20:])
    least = 1 - (1 - least_safe) * 0.5**recent
    return Penalty(SafetyModel.of(marks.samples, ~marks.unsafe), least, weight)


def replace_unsafe(
    planned: Float[np.ndarray, " n"],
    others: Float[np.ndarray, "m n"],
    pool: Float[np.ndarray, "k n"],
    penalty: Penalty,
) -> Float[np.ndarray, " n"]:
    """Return `planned`, or the best of `pool` if `planned` is likely unsafe, shape (n,).

    The best point is safe and far from all `others`, shape (m, n), as in the initial design.
    """
    # Whatever else is planned stays: the points of a design fill the space together.
    if penalty.safety(planned[None])[0] >= penalty.least:
        return planned
    apart = np.sqrt(squared_distances(pool, others).min(axis=1) / len(planned))
    return np.asarray(pool[np.argmax(apart + penalty.safety(pool))])
