"""Minimize the acquisition over the θ that have not run, by a search from several starts.

It searches the unit cube or a box in it, respects integer knobs and constraints, and takes the best
sample as one of its starts. Of the points it found, it returns the one with the lowest objective
whose θ is new.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from prefcal_agents.history.lessons import cube_of
from prefcal_agents.space.capacity import capacity
from prefcal_agents.space.feasible import Region, random_points
from prefcal_env.errors import ProtocolError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

Corners = tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]

_SCALES = (1e-4, 0.3)  # smallest and largest step around the incumbent, in units of the cube
_APART = 0.1  # minimum distance between two starts of a descent, in the cube
_DRAWS = 200  # random points to check before an integer space is searched completely
_ANCHORS = 20  # random allowed points to search from if no sample is one
_SAME = 0.4  # steps; points that are closer in every knob to a θ that ran round to that θ


@runtime_checkable
class Objective(Protocol):
    """A function to minimize: many values at once, and value and gradient at one point."""

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`."""

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the value and the gradient at one point."""


@dataclass(frozen=True, slots=True)
class Domain:
    """Region to search: a box in the unit cube, its fixed coordinates, and how points snap.

    Args:
        fixed: Mask of coordinates that a descent must not move (integer knobs), shape (n,).
        snap: Function that moves the rows of an array (m, n) to points that can run.
        start: Point to start from (the incumbent), shape (n,).
        corners: Lower and upper corner of the box to search, each of shape (n,).
    """

    fixed: Bool[np.ndarray, " n"]
    snap: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, "m n"]] = field(repr=False)
    start: Float[np.ndarray, " n"]
    corners: Corners

    @classmethod
    def of(cls, space: KnobSpace, history: History) -> "Domain":
        """Return the domain in which to minimize an acquisition: the searched part of the cube.

        Frozen knobs stay fixed. Points that constraints refuse move to the edge of the region, so
        a search can ignore the constraints and still finds optima at the edge. It starts at the
        best sample.
        """
        lower, upper = space.corners
        start = np.clip(np.array(history.samples[history.incumbent or 0].z), lower, upper)
        fixed = space.integers | (lower == upper)
        if not space.constraints:
            return cls(fixed, space.snap_all, start, (lower, upper))
        region, anchors = Region(space), _anchors(space, history)
        return cls(fixed, lambda z: region.repaired(z, anchors), start, (lower, upper))


def new_minimum(
    objective: Objective, space: KnobSpace, history: History, rng: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Return the point of the cube with the lowest objective whose θ has not run, shape (n,).

    Raises:
        ProtocolError: If every θ of the space has been tried.
        KnobError: If none was found that the constraints allow.
    """
    domain, tried = Domain.of(space, history), Tried(space, history)
    z = tried.first_new(multistart(objective, domain, rng))
    return tried.fresh(domain.start, rng) if z is None else z


def multistart(
    objective: Objective,
    domain: Domain,
    rng: np.random.Generator,
    *,
    draws: int = 900,
    starts: int = 3,
    iterations: int = 40,
) -> Float[np.ndarray, "m n"]:
    """Sample the cube and the neighborhood of the incumbent, then descend from the best few.

    Source: none; it solves eq. xNp1 for every agent here.
    Deviation: L-BFGS-B with analytic gradients from sampled starts instead of the paper's particle
    swarm, also in `GLISp.paper`. Measured in docs/deviations.md.
    """
    points = _sampled(domain, rng, draws)
    values = objective(points)
    order = np.argsort(values, kind="stable")
    points, values = points[order], values[order]
    chosen = _apart(points, starts)
    descended = domain.snap(np.array([_descend(objective, domain, points[k], iterations) for k in chosen]))
    everything = np.vstack([descended, points])
    values = np.concatenate([objective(descended), values])
    return np.asarray(everything[np.argsort(values, kind="stable")])


def _sampled(domain: Domain, rng: np.random.Generator, draws: int) -> Float[np.ndarray, "m n"]:
    n, near = len(domain.start), draws // 3
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
        far = np.flatnonzero(nearest > _APART**2)
        if not len(far):
            break
        chosen.append(int(far[0]))
        nearest = np.minimum(nearest, np.sum((points - points[far[0]]) ** 2, axis=1))
    return chosen


def _descend(
    objective: Objective, domain: Domain, z: Float[np.ndarray, " n"], iterations: int
) -> Float[np.ndarray, " n"]:
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
        options={"maxiter": iterations},
    )
    return np.asarray(np.clip(result.x, low, high))


class Tried:
    """The θ that ran: none runs again, nor one that differs by less than a step in every knob.

    Args:
        space: The knobs.
        history: Samples and answers.
    """

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
            close &= np.abs(here[:, None] - there) < _SAME
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
    return random_points(space, _ANCHORS, np.random.default_rng(history.answered))
