"""What a person prefers, fitted: radial basis functions (eq. rbf, eq. QP-pref) and Gaussian processes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import starmap
from threading import local
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf, dtrtrs
from scipy.special import ndtr

from prefcal_env.qp import PIQPSolver

from .lessons import Preferences

# --- The surrogate Ĵ: radial basis functions φ(εd) and their sum around the samples (eq. rbf).
#
# All φ are smooth in u = (εd)², so value and slope are functions of u; the chain rule then needs no
# division by a distance.

Array = Float[np.ndarray, "..."]
_TINY = 1e-300  # keeps log(u) finite at a center


@dataclass(frozen=True, slots=True)
class RadialFunction:
    """φ as a function of u = (εd)²: `value` is φ, `slope` is dφ/du, both elementwise."""

    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]


RADIAL_FUNCTIONS: Mapping[str, RadialFunction] = MappingProxyType(
    {
        "inverse_quadratic": RadialFunction(lambda u: 1 / (1 + u), lambda u: -1 / (1 + u) ** 2),
        "gaussian": RadialFunction(lambda u: np.exp(-u), lambda u: -np.exp(-u)),
        "thin_plate_spline": RadialFunction(
            lambda u: 0.5 * u * np.log(np.maximum(u, _TINY)),
            lambda u: 0.5 * (np.log(np.maximum(u, _TINY)) + 1),
        ),
    }
)
"""Radial functions of the paper by name."""


def squared_distances(a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "m N"]:
    """Return d of eq. distance between all rows of `a` and all of `b`, shape (m, N).

    Differences are taken before squaring: near the optimum samples lie within 1e-6 of each
    other, where |a|² + |b|² - 2ab has no correct digit.
    """
    d = np.zeros((len(a), len(b)))
    for k in range(a.shape[1]):
        difference = a[:, k, None] - b[:, k]
        d += difference * difference
    return d


@dataclass(frozen=True, slots=True)
class Shape:
    """The shape of φ(εd): ε, and the weight of each knob in d."""

    epsilon: float  # width parameter ε of eq. rbf, above 0, in the unit cube
    # Factor on each coordinate before computing distances, shape (n,), with geometric mean 1; all 1 is eq.
    # distance
    scales: tuple[float, ...]
    rbf: str = "inverse_quadratic"  # name of φ, a key of `RADIAL_FUNCTIONS`

    def rescale(self, knob: int, factor: float) -> "Shape | None":
        """Return the shape in which `knob` counts `factor` as much; None if too far from others."""
        scales = np.array(self.scales)
        scales[knob] *= factor
        # With a geometric mean of 1: otherwise the factor would also change ε for all other knobs.
        scales /= np.exp(np.mean(np.log(scales)))
        if scales.max() > 16.0 * scales.min():  # beyond this a knob would hardly count at all
            return None
        return replace(self, scales=tuple(map(float, scales)))

    def distances(self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "m N"]:
        """Return d between the scaled points, shape (m, N).

        Source: eq. distance.
        Deviation: knobs that matter more count more (scales other than 1), because one ε for all
        knobs, as in the paper, wastes experiments on knobs that hardly matter.
        """
        scales = np.array(self.scales)
        return squared_distances(a * scales, b * scales)

    def basis(self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "m N"]:
        """Return φ(εd) of eq. rbf between all rows of `a` and all of `b`, shape (m, N)."""
        return self.bases(a, b, (self.epsilon,))[0]

    def bases(
        self, a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"], epsilons: Sequence[float]
    ) -> list[Float[np.ndarray, "m N"]]:
        """Return φ(εd) as `basis` does, for each of `epsilons` instead of the own ε."""
        d, value = self.distances(a, b), RADIAL_FUNCTIONS[self.rbf].value
        return [np.asarray(value((epsilon * d) ** 2)) for epsilon in epsilons]


@dataclass(frozen=True, slots=True)
class Surrogate:
    """The surrogate Ĵ of eq. rbf: N centers in the unit cube, weights β and the shape of φ."""

    centers: Float[np.ndarray, "N n"]
    beta: Float[np.ndarray, " N"]
    shape: Shape

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return Ĵ at the rows of `z`, shape (m, n), unit cube, as shape (m,)."""
        return np.asarray(self.shape.basis(z, self.centers) @ self.beta)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return Ĵ and ∂Ĵ/∂z at one point of the cube, shape (n,)."""
        shape, away = self.shape, z - self.centers
        squared_scales = np.array(shape.scales) ** 2
        d = (away * away) @ squared_scales
        u, phi = (shape.epsilon * d) ** 2, RADIAL_FUNCTIONS[shape.rbf]
        # du/dz = ε² 2d ∂d/dz and ∂d/dz = 2 scales² (z - center).
        slope = ((4 * shape.epsilon**2 * self.beta * phi.slope(u) * d) @ away) * squared_scales
        return float(phi.value(u) @ self.beta), np.asarray(slope)

    @property
    def spread(self) -> float:
        """Return ΔĴ, the range of Ĵ over the samples, which normalizes eq. acquisition."""
        return float(np.ptp(self(self.centers)))


# --- Learn the weights β of the surrogate: the QP that reproduces the preferences.
#
# Source: eq. RBF-pref and eq. QP-pref. Everything here is divided by σ: with β = σ β' and slacks in units
# of σ the margin is 1 and λ becomes λσ. The solution stays the same, without numbers near 1e-6.

_SHORTEST = 1e-12  # a shorter row (two samples that φ cannot tell apart) counts as this long
_NOBODY = -1  # owner of a row that holds for any answer
_SOLVERS = local()  # one solver for each thread, since agents may compute at the same time


@dataclass(frozen=True, slots=True)
class Learning:
    """How β is learned.

    Source: section IV of the paper for σ. λσ = 1e-6 keeps all preferences that can be kept.
    Deviation: λ is above 0; with λ = 0 eq. QP-pref would be a linear program.
    """

    # σ of eq. RBF-pref, above 0: smallest difference between a better and a worse sample.
    sigma: float = 1e-6
    lam: float = 1.0  # λ of eq. QP-pref, above 0.
    margin_power: float = 0.0  # See `margins`; 0 is eq. RBF-pref.


@dataclass(frozen=True, slots=True)
class Constraints:
    """Eq. RBF-pref as rows · β' >= margins - slack: one row per strict preference, two per tie."""

    rows: Float[np.ndarray, "R N"]  # shape (R, N)
    margins: Float[np.ndarray, " R"]  # shape (R,), above 0 for a strict preference, -1 for both rows of a tie
    weights: Float[np.ndarray, " R"]  # c_h, shape (R,)
    # The comparison that each row belongs to, shape (R,); -1: none, it always holds
    owner: Int[np.ndarray, " R"]

    @classmethod
    def of(
        cls, preferences: Preferences, phi: Float[np.ndarray, "N P"], margin: Float[np.ndarray, " M"]
    ) -> "Constraints":
        """Make the rows of M comparisons, each with its margin in units of σ.

        `phi` holds what is weighted, at all samples: N functions φ, or p KPIs.
        """
        # Eq. RBF-pref: a strict preference asks for worse minus better, and a tie for |Ĵ(θ1) - Ĵ(θ2)| <= σ,
        # which takes one row for each side.
        difference = phi[preferences.first] - phi[preferences.second]
        strict, tie = np.flatnonzero(preferences.b), np.flatnonzero(preferences.b == 0)
        owner = np.concatenate([strict, tie, tie])
        signs = np.concatenate([preferences.b[strict], np.ones(len(tie)), -np.ones(len(tie))])
        return cls(
            rows=difference[owner] * signs[:, None],
            margins=np.concatenate([margin[strict], -np.ones(2 * len(tie))]),
            weights=preferences.weights[owner],
            owner=owner,
        )

    def nonnegative(self) -> "Constraints":
        """Add a row for each of the P weights that keeps it at 0 or more, whatever is answered."""
        count = self.rows.shape[1]
        return Constraints(
            rows=np.vstack([self.rows, np.eye(count)]),
            margins=np.append(self.margins, np.zeros(count)),
            weights=np.append(self.weights, np.ones(count)),
            owner=np.append(self.owner, np.full(count, _NOBODY)),
        )

    def without(self, left_out: Bool[np.ndarray, " M"]) -> "Constraints":
        """Return the rows of the comparisons that are not left out."""
        # Rows that hold for any answer are not evidence, so no fold leaves them out.
        kept = (self.owner == _NOBODY) | ~left_out[self.owner]
        return Constraints(self.rows[kept], self.margins[kept], self.weights[kept], self.owner[kept])


def margins(preferences: Preferences, power: float) -> Float[np.ndarray, " M"]:
    """Return the margin of each comparison in units of σ, in (0, 1], shape (M,).

    Source: eq. RBF-pref has the same margin σ everywhere, as `power` 0 does.
    Deviation: a continuous index differs little between close samples, yet one margin for
    all makes Ĵ as steep as their distance is small, and the following samples overshoot. So the
    margin grows with (distance / √n)^power, up to σ at a distance of 0.3 √n of the cube.
    """
    if power == 0:
        return np.ones(len(preferences))
    apart = preferences.samples[preferences.first] - preferences.samples[preferences.second]
    share = np.sqrt(np.mean(apart**2, axis=1)) / 0.3
    return np.asarray(np.clip(share, 1e-9, 1.0) ** power)  # above 0: a preference is no tie


def fit(constraints: Constraints, learning: Learning) -> Float[np.ndarray, " N"]:
    """Return the weights β of eq. QP-pref, shape (N,); zero where nothing is known.

    The dual is solved, in one multiplier α per row, 0 <= α <= c_h / (λσ). It has no slacks, so
    fewer than half the variables of the primal, and β' = rowsᵀα. (The rows of a tie share their
    slack; they are never both at their bound, so each may have the full c_h.)

    Source: eq. QP-pref.
    Deviation: none; see `margins` for what the margins may be.
    """
    return _fits([constraints], learning)[0]


def fits_without(
    preferences: Preferences,
    bases: Sequence[Float[np.ndarray, "N N"]],
    slices: Bool[np.ndarray, "K M"],
    learning: Learning,
) -> list[list[Float[np.ndarray, " N"]]]:
    """Return β of many fits: for each of E bases, K fits without the comparisons of one slice."""
    margin, systems = margins(preferences, learning.margin_power), []
    for phi in bases:
        constraints = Constraints.of(preferences, phi, margin)
        systems += [constraints.without(left_out) for left_out in slices]
    betas = _fits(systems, learning)
    return [betas[k : k + len(slices)] for k in range(0, len(betas), len(slices))]


def _fits(systems: Sequence[Constraints], learning: Learning) -> list[Float[np.ndarray, " N"]]:
    if not hasattr(_SOLVERS, "qp"):
        _SOLVERS.qp = PIQPSolver()
    duals = [_dual(system, learning) for system in systems]
    solutions = list(starmap(_SOLVERS.qp.solve_box, [box for box, _ in duals]))
    return [beta(z) for (_, beta), z in zip(duals, solutions, strict=True)]


def _dual(
    system: Constraints, learning: Learning
) -> tuple[tuple[Any, ...], Callable[[Float[np.ndarray, " R"] | None], Float[np.ndarray, " N"]]]:
    """Return min ½|rowsᵀα|² - margins·α subject to 0 <= α <= ceiling, and β at a solution of it.

    The problem is (P, q, upper): min ½zᵀPz + q·z subject to 0 <= z <= upper.

    Rows of close samples are short and their multipliers huge; unit rows even that out, so the
    variables are z = α · length / scale. Without a solution, β is zero.
    """
    rows, ceiling = system.rows, system.weights / (learning.lam * learning.sigma)
    length = np.maximum(np.sqrt(np.sum(rows * rows, axis=1)), _SHORTEST)
    unit = rows / length[:, None]
    gram = unit @ unit.T
    scale = 1 / float(length.min(initial=np.inf))
    symmetric = 0.5 * (gram + gram.T)
    # A ridge on the Gram matrix of unit rows: below any accuracy asked for, above rounding.
    symmetric.flat[:: len(gram) + 1] += 1e-11
    q, upper = -system.margins / (length * scale), ceiling * length / scale

    def beta(z: Float[np.ndarray, " R"] | None) -> Float[np.ndarray, " N"]:
        if z is None:
            return np.zeros(rows.shape[1])
        # An interior point leaves the box by its tolerance, which the scale magnifies.
        alpha = np.clip(z * scale / length, 0.0, ceiling)
        return np.asarray(learning.sigma * (alpha @ rows))

    return (symmetric, q, upper), beta


# --- Choose the shape of φ by K-fold cross-validation on the preferences themselves.
#
# Source: end of the section "Training a surrogate function from preferences" of the paper.

FOLDS = 3  # K of the cross-validation, as in section IV of the paper


@dataclass(frozen=True, slots=True)
class Validation:
    """Comparisons split into K slices, each left out once; all samples stay centers."""

    preferences: Preferences  # M comparisons
    learning: Learning  # how β is learned from the rest
    slices: Bool[np.ndarray, "K M"]  # which comparisons each of the K slices holds, shape (K, M)

    @classmethod
    def deal(cls, preferences: Preferences, learning: Learning, rng: np.random.Generator) -> "Validation":
        """Split at random into `FOLDS` slices, whose sizes differ by at most one comparison."""
        share = rng.permutation(len(preferences)) % FOLDS
        return cls(preferences, learning, share == np.arange(FOLDS)[:, None])

    def reproduce(self, shape: Shape, epsilons: Sequence[float]) -> list[int]:
        """Return how many left-out preferences `shape` predicts right with each ε."""
        known = self.preferences
        bases = shape.bases(known.samples, known.samples, epsilons)
        betas = fits_without(known, bases, self.slices, self.learning)
        return [self._right(phi, each) for phi, each in zip(bases, betas, strict=True)]

    def _right(self, phi: Float[np.ndarray, "N N"], betas: Sequence[Float[np.ndarray, " N"]]) -> int:
        known, right = self.preferences, 0
        for left_out, beta in zip(self.slices, betas, strict=True):
            values = phi @ beta
            gap = values[known.first[left_out]] - values[known.second[left_out]]
            b = known.b[left_out]
            # A strict answer only has to have its sign: it does not say by how much the other one is worse.
            agrees = np.where(b == 0, np.abs(gap) <= self.learning.sigma, b * gap > 0)
            right += int(np.count_nonzero(agrees))
        return right


def choose_epsilon(validation: Validation, shape: Shape, candidates: Sequence[float]) -> tuple[Shape, int]:
    """Return `shape` with the best ε of `candidates`, and how many preferences it reproduces.

    Among equally good ones (with a few dozen answers there are many), take the middle one.
    """
    scores = validation.reproduce(shape, candidates)
    best = max(scores)
    winners = [e for e, score in zip(candidates, scores, strict=True) if score == best]
    return replace(shape, epsilon=winners[len(winners) // 2]), best


def nearest(candidates: Sequence[float], epsilon: float, reach: int) -> Sequence[float]:
    """Return the candidate next to `epsilon`, and up to `reach` of them on either side."""
    middle = int(np.argmin(np.abs(np.log(np.array(candidates) / epsilon))))
    return candidates[max(middle - reach, 0) : middle + reach + 1]


def rescale_knob(
    shape: Shape, score: float, knob: int, judge: Callable[[Shape], tuple[Shape, float]]
) -> Shape:
    """Return `shape`, with `knob` counting twice or half as much if that is clearly better.

    Source: none.
    Deviation: the paper has one ε for all knobs.

    Args:
        shape: Shape in use; with a single knob, it stays.
        score: How well it predicts: a gain of 1 (one comparison, or one nat) may be chance.
        knob: Index of the knob.
        judge: Function that returns the best one of similar shapes, and its score.
    """
    for factor in (2.0, 0.5) if len(shape.scales) > 1 else ():
        changed = shape.rescale(knob, factor)
        if changed is not None:
            better, found = judge(changed)
            if found > score + 1:
                shape, score = better, found
    return shape


# --- Gaussian processes: their kernel, and fits to comparisons.
#
# `ExpectationPropagation` learns from answers, some of which may be wrong, and `PreferenceGP` is a
# process trained on comparisons only.

SHORTEST, LONGEST = 0.03, 10.0  # bounds of a length, in units of the cube
_ROOT5 = np.sqrt(5.0)
_DAMPING = 0.7  # share of each step to take, for all sites at once
_SHORT_ROW = 1e-12  # a shorter row counts as this long
_LEAST, _LARGEST = 1e-8, 1e8  # bounds of a site's precision
_FLAT = 1e-6  # precision of a site without information
_SURE = 1e-6  # smallest error rate, for rounding; that of rows that are not answers


def squares(a: Float[np.ndarray, "m n"], b: Float[np.ndarray, "N n"]) -> Float[np.ndarray, "n m N"]:
    """Return the squared differences of every knob."""
    return np.asarray((a.T[:, :, None] - b.T[:, None, :]) ** 2)


def matern(u: Float[np.ndarray, "n m N"]) -> tuple[Float[np.ndarray, "m N"], Float[np.ndarray, "m N"]]:
    """Return the kernel, and twice its slope in Σ u, for squared differences u scaled by 1/ℓ².

    Source: C. E. Rasmussen, C. K. I. Williams, "Gaussian Processes for Machine Learning" (2006),
    equation 4.17.
    """
    r = np.sqrt(np.sum(u, axis=0))
    decay = np.exp(-_ROOT5 * r)
    return (1 + _ROOT5 * r + 5 / 3 * r * r) * decay, -5 / 3 * (1 + _ROOT5 * r) * decay


@dataclass(frozen=True, slots=True)
class Sites:
    """Normal distributions that approximate R answers, over rows · β with rows of length 1."""

    precision: Float[np.ndarray, " R"]  # precision of each site, shape (R,)
    shift: Float[np.ndarray, " R"]  # precision times mean of each site, shape (R,)

    @classmethod
    def flat(cls, count: int) -> "Sites":
        """Return `count` sites without information."""
        return cls(np.full(count, _FLAT), np.zeros(count))

    def toward(self, other: "Sites") -> "Sites":
        """Return the sites after a damped step toward `other`."""
        return Sites(
            # All sites move at once: undamped, rows that say the same would each add the whole of it.
            self.precision + _DAMPING * (other.precision - self.precision),
            self.shift + _DAMPING * (other.shift - self.shift),
        )


@dataclass(frozen=True, slots=True)
class ExpectationPropagation:
    """A normal distribution of β, from answers that are each wrong with some probability.

    The prior of β is standard normal, which matches βᵀβ in eq. QP-pref. An answer is right with
    probability 1 - e: only the signs of rows · β count, not their margins. So an answer that all
    others contradict has little influence, whereas with the slack of eq. QP-pref a mistake pulls
    harder the worse it is.

    Source: expectation propagation for such a likelihood, Kim and Ghahramani, SSPR 2008.
    Deviation: replaces eq. QP-pref if answers contradict each other.
    """

    mean: Float[np.ndarray, " N"]  # mean of β, shape (N,)
    root: Float[np.ndarray, "N N"]  # lower Cholesky factor of the precision of β, shape (N, N)
    predicted: float  # sum of the log probabilities of the answers, each predicted from the others
    wrong: Float[np.ndarray, " R"]  # probability that each row is a mistake, shape (R,)
    evidence: float  # log probability of all rows together
    sites: Sites  # sites of the rows; a starting point for similar fits

    @classmethod
    def of(
        cls, constraints: Constraints, error_rate: float, start: Sites | None = None
    ) -> "ExpectationPropagation":
        """Fit to answers that are each wrong with probability `error_rate`; ties are ignored.

        Starting from the sites `start` is faster and gives the same result within tolerance.
        """
        # Ties are the rows with margin -1; the sign of a row says nothing about them.
        strict = constraints.margins >= 0
        unit = unit_rows(constraints.rows[strict])
        answered = constraints.owner[strict] >= 0
        e = np.where(answered, error_rate, _SURE)
        sites = Sites.flat(len(unit)) if start is None else start
        for _ in range(40):  # 20 to 30 are enough unless answers that are surely right contradict
            matched = _Rest.of(unit, sites).match(e)
            change = np.abs(matched.precision - sites.precision) / (1 + sites.precision)
            sites = sites.toward(matched)
            if change.max(initial=0.0) < 1e-2:  # relative change of a site's precision
                break
        rest = _Rest.of(unit, sites)
        mean, _ = dtrtrs(rest.root, rest.half, lower=1, trans=1)
        probability, right = rest.probability(e)
        return cls(
            mean=mean,
            root=rest.root,
            # By the cavities, so that no answer predicts itself: as good as leaving each out, in one fit.
            predicted=float(np.sum(np.log(probability[answered]))),
            wrong=np.asarray((e * (1 - right) / probability)[answered]),
            evidence=rest.evidence(sites, probability),
            sites=sites,
        )

    def deviations(self, rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, " R"]:
        """Return how many standard deviations each of rows · β is above 0, shape (R,)."""
        across, _ = dtrtrs(self.root, rows.T, lower=1)
        deviation = np.maximum(np.sqrt(np.sum(across * across, axis=0)), _SHORT_ROW)
        return np.asarray(rows @ self.mean / deviation)


@dataclass(frozen=True, slots=True)
class _Rest:
    """The posterior of β from all rows, and for each row the cavity: what the other rows say."""

    root: Float[np.ndarray, "N N"]
    half: Float[np.ndarray, " N"]
    m: Float[np.ndarray, " R"]
    precision: Float[np.ndarray, " R"]
    z: Float[np.ndarray, " R"]

    @classmethod
    def of(cls, unit: Float[np.ndarray, "R N"], sites: Sites) -> "_Rest":
        inner = (unit.T * sites.precision) @ unit
        # The prior of β is standard normal: its precision is added.
        inner.flat[:: len(inner) + 1] += 1.0
        root, _ = dpotrf(inner, lower=1, clean=1)
        across, _ = dtrtrs(root, unit.T, lower=1)
        variance = np.maximum(np.einsum("ij,ij->j", across, across), 1e-10)
        half = across @ sites.shift
        # Taking a site out of the posterior may leave less than nothing, by rounding.
        precision = np.maximum(1 / variance - sites.precision, _LEAST)
        m = (across.T @ half / variance - sites.shift) / precision
        return cls(root, half, m, precision, m * np.sqrt(precision))

    def probability(
        self, e: Float[np.ndarray, " R"]
    ) -> tuple[Float[np.ndarray, " R"], Float[np.ndarray, " R"]]:
        """Return the probability of each answer given the error rate, and that it is right."""
        right = ndtr(self.z)
        return np.maximum(e + (1 - 2 * e) * right, 1e-300), right

    def match(self, e: Float[np.ndarray, " R"]) -> Sites:
        """Return the sites that match the true mean and variance of each answer."""
        # Mean and variance of the cavity times the likelihood, which is a step from e to 1 - e at 0.
        z, v = self.z, 1 / self.precision
        density = np.exp(-z * z / 2) / np.sqrt(2 * np.pi * v)
        slope = (1 - 2 * e) * density / self.probability(e)[0]
        after = np.maximum(v - v * v * slope * (self.m / v + slope), 1e-12)
        # The step is not log-concave: an answer that the others contradict asks for a negative precision,
        # with which that of β might not be positive definite.
        target = np.minimum(np.maximum(1 / after - self.precision, _LEAST), _LARGEST)
        to = (self.m + v * slope) * (self.precision + target) - self.m * self.precision
        return Sites(target, to)

    def evidence(self, sites: Sites, probability: Float[np.ndarray, " R"]) -> float:
        """Return the log of the integral over β of prior and sites, scaled like the answers."""
        whole = self.precision + sites.precision
        pull = (self.m * self.precision + sites.shift) ** 2 / whole - self.m**2 * self.precision
        each = np.log(probability) + 0.5 * np.log(whole / self.precision) - 0.5 * pull
        together = 0.5 * self.half @ self.half - np.sum(np.log(np.diag(self.root)))
        return float(np.sum(each) + together)


def unit_rows(rows: Float[np.ndarray, "R N"]) -> Float[np.ndarray, "R N"]:
    """Return the rows scaled to length 1, which keeps the signs of rows · β."""
    length = np.sqrt(np.sum(rows * rows, axis=1))
    return np.asarray(rows / np.maximum(length, _SHORT_ROW)[:, None])


@dataclass(frozen=True, slots=True)
class PreferenceGP:
    """Mean of a Gaussian process, given comparisons of its values at N samples.

    Source: W. Chu, Z. Ghahramani, "Preference learning with Gaussian processes", ICML 2005, with
    expectation propagation (`ExpectationPropagation`) in place of their Laplace approximation.
    Deviation: replaces eq. QP-pref for some proposals (`is_process_turn`). That gives one
    Ĵ that reproduces the answers, by the smallest weights. This is the average of all functions
    that (nearly) reproduce them, in which smooth ones count more; the lengths show which knobs
    matter. It is trained on the last 100 samples that were compared. Measured in
    docs/research/archive.md.
    """

    centers: Float[np.ndarray, "N n"]  # samples in the unit cube, shape (N, n)
    lengths: Float[np.ndarray, " n"]  # length ℓ of each knob, shape (n,)
    alpha: Float[np.ndarray, " N"]  # vector K⁻¹ times the mean at the samples, shape (N,)

    @classmethod
    def of(cls, preferences: Preferences, error_rate: float = 0.0) -> "PreferenceGP":
        """Fit the process with the most likely lengths; at least one answer must not be a tie.

        Each answer is wrong with probability `error_rate`.
        """
        known = _StrictAnswers.of(preferences, max(error_rate, _SURE))
        lengths, start = known.likeliest()
        factor = known.factor(lengths)[0]
        posterior = known.posterior(factor, start)
        # The values are factor · β, so of K⁻¹ only one triangular solve is left.
        alpha = solve_triangular(factor, posterior.mean, lower=True, trans=1)
        return cls(known.centers, lengths, np.asarray(alpha))

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the mean at the rows of `z`, shape (m,), without unit; lower is better."""
        u = squares(z, self.centers) / self.lengths[:, None, None] ** 2
        return np.asarray(matern(u)[0] @ self.alpha)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return the mean and its gradient at one point of the cube, shape (n,)."""
        away = (z - self.centers) / self.lengths
        kernel, slope = (each[:, 0] for each in matern((away.T**2)[:, :, None]))
        return float(kernel @ self.alpha), np.asarray((self.alpha * slope) @ away / self.lengths)

    @property
    def spread(self) -> float:
        """Return the range of the mean over the samples."""
        return float(np.ptp(self(self.centers)))


def latest(preferences: Preferences) -> tuple[Int[np.ndarray, " K"], Int[np.ndarray, " R"]]:
    """Return the rows of the strict answers that a process learns from, and the samples that they compare."""
    strict = np.flatnonzero(preferences.b)
    first, second = preferences.first[strict], preferences.second[strict]
    # Reversed, so that the first place of a sample is that of its latest comparison.
    samples, at = np.unique(np.stack([first, second], 1).ravel()[::-1], return_index=True)
    recent = np.sort(samples[np.argsort(at)[:100]])  # the fit takes the cube of their number
    return strict[np.isin(first, recent) & np.isin(second, recent)], recent


def predicted(preferences: Preferences, error_rate: float) -> float:
    """Return how well a process over θ predicts each of the `latest` strict answers from the others.

    Args:
        preferences: One strict answer or more.
        error_rate: Probability that an answer is wrong.

    Returns:
        The sum of the logarithms of their probabilities.
    """
    known = _StrictAnswers.of(preferences, error_rate)
    lengths, start = known.likeliest()
    return float(known.posterior(known.factor(lengths)[0], start).predicted)


@dataclass(frozen=True, slots=True)
class _StrictAnswers:
    """R strict comparisons of N samples, each wrong with probability `error_rate`.

    Each row has a 1 at the losing sample and a -1 at the winning one.
    """

    centers: Float[np.ndarray, "N n"]
    constraints: Constraints
    apart: Float[np.ndarray, "n N N"]
    error_rate: float

    @classmethod
    def of(cls, preferences: Preferences, error_rate: float) -> "_StrictAnswers":
        """Return the comparisons of the last samples, without ties."""
        kept, recent = latest(preferences)
        # What is learned are the values themselves, not weights of φ: each sample is its own feature.
        one_each = np.eye(len(preferences.samples))[:, recent]
        centers = preferences.samples[recent]
        return cls(
            centers,
            Constraints.of(preferences.subset(kept), one_each, np.ones(len(kept))),
            squares(centers, centers),
            error_rate,
        )

    def factor(
        self, lengths: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "N N"], Float[np.ndarray, "n N N"], Float[np.ndarray, "N N"]]:
        """Return the Cholesky factor of the kernel, the scaled squares and the kernel's slope."""
        u = self.apart / lengths[:, None, None] ** 2
        kernel, slope = matern(u)
        # The process has variance 1: 1e-9 more lets close samples be factored, and changes nothing else.
        return np.linalg.cholesky(kernel + 1e-9 * np.eye(len(kernel))), u, slope

    def posterior(self, factor: Float[np.ndarray, "N N"], start: Sites | None) -> ExpectationPropagation:
        """Return the posterior of β, where the values at the samples are factor · β."""
        rows = self.constraints.rows @ factor
        return ExpectationPropagation.of(replace(self.constraints, rows=rows), self.error_rate, start)

    def likeliest(self) -> tuple[Float[np.ndarray, " n"], Sites | None]:
        """Return ℓ that maximizes evidence times a log-normal prior, and sites close to it."""
        from scipy.optimize import minimize

        n = len(self.apart)
        expected, sites = np.log(0.35 * np.sqrt(n)), None  # median of the prior of a length

        def loss(logs: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
            nonlocal sites  # each fit starts from the last sites
            factor, u, slope = self.factor(np.exp(logs))
            posterior = self.posterior(factor, sites)
            sites = posterior.sites
            # Without the prior, few answers would make a length infinite: one that does not matter yet.
            beyond = logs - expected  # in standard deviations of the prior: it is 1
            # ∂K/∂log ℓ_j = -slope u_j.
            gradient = 0.5 * np.einsum("mN,jmN->j", self._pull(factor, posterior) * slope, u)
            value = -posterior.evidence + 0.5 * beyond @ beyond
            return float(value), gradient + beyond

        found = minimize(
            loss,
            np.full(n, expected),
            jac=True,
            method="L-BFGS-B",
            bounds=[(np.log(SHORTEST), np.log(LONGEST))] * n,
            options={"maxiter": 10},
        )
        return np.asarray(np.exp(found.x)), sites

    def _pull(
        self, factor: Float[np.ndarray, "N N"], posterior: ExpectationPropagation
    ) -> Float[np.ndarray, "N N"]:
        """Return twice the slope of the evidence in the kernel, at fixed sites.

        Source: Rasmussen and Williams (2006), equation 5.27, for the differences of the values.
        """
        rows, sites = self.constraints.rows, posterior.sites
        length = np.sqrt(np.sum((rows @ factor) ** 2, axis=1))
        scaled, unit = rows / length[:, None], unit_rows(rows @ factor)
        weighted = sites.precision[:, None] * scaled
        ahead = scaled.T @ (sites.shift - sites.precision * (unit @ posterior.mean))
        across = solve_triangular(posterior.root, unit.T @ weighted, lower=True)
        return np.asarray(np.outer(ahead, ahead) - scaled.T @ weighted + across.T @ across)
