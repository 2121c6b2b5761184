"""Explain a record of a plant by models, and say how well each does.

A model is a gain, up to three lags, perhaps an integrator and a zero, and dead time. Its response to the
logged input is exact, for an input that is held between samples; the record may have an offset, a drift and
noise that lasts. What the record leaves open is a sample of models from their distribution given the record.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

# --- Models: a transfer function with dead time, in units of people.


@dataclass(frozen=True, slots=True)
class Model:
    """A transfer function from one input to one output, with dead time."""

    family: str  # name of its family, see `FAMILIES`
    num: tuple[float, ...]  # coefficients of the numerator, the highest power of s first
    den: tuple[float, ...]  # coefficients of the denominator, likewise
    delay: float  # dead time

    @property
    def integrates(self) -> bool:
        """Return whether the output never settles after a step of the input."""
        return self.den[-1] == 0.0

    @property
    def gain(self) -> float:
        """Return the gain: the output's final change, or rate if it integrates, for 1 of the input."""
        return self.num[-1] / (self.den[-2] if self.integrates else self.den[-1])

    @property
    def lags(self) -> tuple[float, ...]:
        """Return the magnitudes of the time constants, the longest first."""
        poles = np.roots(self.den[:-1] if self.integrates else self.den)
        return tuple(sorted((1 / np.abs(poles)).tolist(), reverse=True))

    @property
    def numbers(self) -> Mapping[str, float]:
        """Return the gain, lags, oscillation, zero and dead time by name; only those that the model has.

        What means something else has another name: lags beside an integrator, and 1/ω of an oscillation.
        """
        poles = np.roots(self.den[:-1] if self.integrates else self.den)
        swinging = np.abs(poles.imag) > 1e-6 * np.abs(poles)
        lags = np.sort(1 / np.abs(poles[~swinging]))[::-1].tolist()
        found = {"rate" if self.integrates else "gain": self.gain}
        found |= {f"{'lag' if self.integrates else 'time constant'} {k + 1}": T for k, T in enumerate(lags)}
        if swinging.any():
            pole = poles[swinging][0]
            found |= {"1/ω": float(1 / np.abs(pole)), "damping": float(-pole.real / np.abs(pole))}
        if len(self.num) > 1:
            found["zero's time constant"] = self.num[0] / self.num[-1]
        return found | {"dead time": self.delay}

    def step(self, t: ArrayLike) -> Float[np.ndarray, " K"]:
        """Return the output after a unit step of the input at 0, at equally spaced times from 0 on."""
        at = np.asarray(t, dtype=float)
        return respond(self, float(at[1] - at[0]), np.ones(len(at)))


def respond(model: Model, h: float, u: Float[np.ndarray, " K"]) -> Float[np.ndarray, " K"]:
    """Return the output, shape (K,), to inputs that are held for `h` each, from rest."""
    unit = unit_responses(np.array(model.den), model.delay, h, u, len(model.num))
    return np.asarray(np.array(model.num[::-1]) @ unit)


def unit_responses(
    den: Float[np.ndarray, " m"], delay: float, h: float, u: Float[np.ndarray, " K"], count: int
) -> Float[np.ndarray, "count K"]:
    """Return the exact responses of s^k / den, k = 0, 1, ..., to a held input that acts later by `delay`."""
    # Imported here, since both take a while.
    from scipy.linalg import expm
    from scipy.signal import lfilter

    n, whole = len(den) - 1, int(delay / h)
    if whole >= len(u):
        return np.zeros((count, len(u)))
    # In companion form state n - k is s^k / den: the first row is the highest derivative, and the input is
    # one more state, which stays.
    rates = np.eye(n + 1, k=-1)
    rates[0, :n], rates[0, n], rates[n] = -den[1:] / den[0], 1 / den[0], 0.0
    # Within a period the input of the period before acts first, for the part of the dead time in it.
    part = delay / h - whole
    late, now = expm(rates * np.array([part * h, (1 - part) * h])[:, None, None])[:, :n]
    F, old, new = now[:, :n] @ late[:, :n], now[:, :n] @ late[:, n], now[:, n]
    # Faddeev and LeVerrier: (z - F)^-1 = (z^(n-1) M_1 + ... + M_n) / characteristic polynomial.
    poly, M, numerators = [1.0], np.eye(n), np.zeros((n, n + 2))
    for k in range(1, n + 1):
        numerators[:, k] += M @ new
        numerators[:, k + 1] += M @ old
        poly.append(-float(np.trace(F @ M)) / k)
        M = F @ M + poly[-1] * np.eye(n)
    moved = np.concatenate([np.zeros(whole), u[: len(u) - whole]])
    return np.array([lfilter(numerators[n - 1 - k], poly, moved) for k in range(count)])


# --- Families of models, in units of the record: time in its span, input and output in their ranges.

Shape = Float[np.ndarray, " m"]
"""What of a model acts nonlinearly: ln T, ln damping, ln share of the third lag, as far as the family has
them, and last the dead time."""
_SHORTEST, _LONGEST = 0.002, 5.0  # time constants, in the span
_DAMPING = (0.1, 4.0)
_THIRD = (0.03, 1.0)  # third lag, as a share of the time constant of the other two
_LOGS = np.log([(_SHORTEST, _LONGEST), _DAMPING, _THIRD])


@dataclass(frozen=True, slots=True)
class Family:
    """Models of one form."""

    name: str  # for people
    lags: int
    integrates: bool = False
    zero: bool = False

    @property
    def terms(self) -> int:
        """Return the number of coefficients of the numerator."""
        return 1 + self.zero

    def box(self, latest: float) -> tuple[Shape, Shape]:
        """Return the lowest and the highest values of the shape."""
        low, high = _LOGS[: self.lags].T
        return np.append(low, 0.0), np.append(high, latest)

    def den(self, shape: Shape) -> Float[np.ndarray, " order"]:
        """Return the denominator."""
        T = float(np.exp(shape[0])) if self.lags else 0.0
        den = np.array([1.0])
        if self.lags == 1:
            den = np.array([T, 1.0])
        if self.lags > 1:
            den = np.array([T**2, 2 * np.exp(shape[1]) * T, 1.0])
        if self.lags > 2:
            den = np.convolve(den, [np.exp(shape[2]) * T, 1.0])
        return np.append(den, 0.0) if self.integrates else den

    def scale(self, shape: Shape) -> float:
        """Return the usual time of a zero."""
        return float(np.exp(shape[0]))


FAMILIES = (
    Family("a lag", 1),
    Family("two lags", 2),
    Family("two lags and a zero", 2, zero=True),
    Family("three lags", 3),
    Family("three lags and a zero", 3, zero=True),
    Family("an integrator", 0, integrates=True),
    Family("an integrator and a lag", 1, integrates=True),
    Family("an integrator, a lag and a zero", 1, integrates=True, zero=True),
    Family("an integrator and two lags", 2, integrates=True),
)

# --- How well a model explains the record.

_DRIFT = 0.1  # usual drift over the record, as a share of the output's range
COUNTS = 0.7  # how much of a row counts, since no plant is quite like a model: else too little stays open
FLOOR = 0.002  # error of any model, as a share of the output's range: no plant is quite linear
_GAIN, _ZERO, _OFFSET = 3.0, 1.0, 10.0
"""Usual sizes in the units of the record; of a zero relative to the time constant."""


@dataclass(frozen=True, slots=True)
class Explained:
    """What of the linear coefficients follows from the record."""

    evidence: float  # logarithm of the density of the record, but for a constant
    own: Float[np.ndarray, " k"]  # means of coefficients that are independent, root.T times ours
    root: Float[np.ndarray, "k k"]  # Cholesky's, of their precision in units of the variance of the noise
    rest: float  # sum of squares that is left, as far as rows count

    @property
    def mean(self) -> Float[np.ndarray, " k"]:
        """Return the mean of the coefficients."""
        return np.linalg.solve(self.root.T, self.own)


@dataclass(frozen=True, slots=True, eq=False)
class Scaled:
    """The record in units of its own ranges, and what is assumed of its noise."""

    h: float
    u: Float[np.ndarray, " K"]
    y: Float[np.ndarray, " K"]
    latest: float  # longest dead time that the record can show
    lasting: float = 0.0  # correlation of neighboring errors
    variance: float = 1e-3  # of the errors that are new in a sample

    def rows(self, family: Family, shape: Shape) -> Float[np.ndarray, "k K"]:
        """Return what the linear coefficients multiply: responses, offset, drift."""
        rows = np.ones((family.terms + 2, len(self.y)))
        rows[:-2] = unit_responses(family.den(shape), float(shape[-1]), self.h, self.u, family.terms)
        if family.zero:
            rows[1] *= family.scale(shape)
        rows[-1] = np.linspace(-0.5, 0.5, len(self.y))
        return rows

    def white(self, rows: Float[np.ndarray, "... K"]) -> Float[np.ndarray, "... N"]:
        """Return differences whose errors are independent of each other."""
        return np.asarray(rows[..., 1:] - self.lasting * rows[..., :-1])

    def explained(self, family: Family, shape: Shape) -> Explained:
        """Return how well a shape explains the record.

        Source: Bishop (2006), Pattern Recognition and Machine Learning, eq. (3.118) of exercise 3.23: the
        evidence of the linear model with its normal-gamma prior, the variance of the noise integrated out.
        Deviation: the prior knows the sizes of the coefficients, so their precision in units of the noise
        is that of an estimate, `variance`; a row counts as `COUNTS` of one; a_0 is 0, b_0 half of a floor.
        """
        X, y = (COUNTS**0.5 * self.white(each) for each in (self.rows(family, shape), self.y))
        n = COUNTS * len(y)
        floor = n * FLOOR**2 * (1 - self.lasting) ** 2
        # Any record may drift. To allow none at all as well would make slow lags of small drifts.
        wide = self.variance / np.array([*[_GAIN, _ZERO][: family.terms], _OFFSET, _DRIFT]) ** 2
        root = np.linalg.cholesky(X @ X.T + np.diag(wide))
        own = np.linalg.solve(root, X @ y)
        rest = max(float(y @ y - own @ own) + floor, floor)
        volume = 2 * np.log(root.diagonal()).sum() - np.log(wide).sum()
        return Explained(float(-0.5 * volume - 0.5 * n * np.log(rest)), own, root, rest)

    def density(self, family: Family, shape: Shape) -> float:
        """Return the logarithm of the density of a shape given the record, -inf outside of the family."""
        low, high = family.box(self.latest)
        if not (np.all(low <= shape) and np.all(shape <= high)):
            return -np.inf
        # Lags are as probable in each decade; so is dead time above a fiftieth of the record.
        prior = -np.log(high[:-1] - low[:-1]).sum() - np.log(shape[-1] + 0.02)
        return float(self.explained(family, shape).evidence + prior)


# --- Search the best shape of each family, then weigh shapes around it until they are a fair sample.

_SCANNED, _STARTS = 250, 4  # shapes that are tried, and how many of the best are improved
_ROUGH, _FINE = (40, 0.3), (150, 0.01)  # most steps of an improvement, and the logarithm at which it ends
_DROPPED = 40.0  # as `_HOPELESS`, before a family's best shape is found to the last digit
_HOPELESS = 8.0  # logarithm of the probability, relative to the best family, below which one is left out
_ROUNDS, _DRAWN = (3, 10), 250  # fewest and most rounds of weighing, and shapes in each
_ENOUGH = 80.0  # effective number of shapes with which weighing ends
_APART = 4.0  # logarithm by which the mean of the shapes may be behind the most probable one
_TAIL = 5.0  # degrees of freedom of the proposals: their tails must be wider than what they explore


def _improved(
    record: Scaled, family: Family, starts: Sequence[Shape], ends: tuple[int, float]
) -> list[Shape]:
    """Return the best shapes near some, the best one first."""
    from scipy.optimize import minimize

    low, high = family.box(record.latest)
    found = []
    for start in starts:
        inward = np.where(start > (low + high) / 2, -0.04, 0.04) * (high - low)
        simplex = np.vstack([start, start + np.diag(inward)])
        options = {"initial_simplex": simplex, "xatol": np.inf, "fatol": ends[1], "maxiter": ends[0]}
        made = minimize(
            lambda shape: -record.density(family, shape),
            start,
            method="Nelder-Mead",
            bounds=np.column_stack([low, high]),
            options=options,
        )
        found.append((float(made.fun), made.x))
    return [shape for _, shape in sorted(found, key=lambda each: each[0])]


def _scanned(record: Scaled, family: Family, rng: np.random.Generator) -> list[Shape]:
    """Return the best of many shapes all over the family, at some distance from each other."""
    low, high = family.box(record.latest)
    shares = rng.random((_SCANNED, len(low)))
    # A third is almost without dead time, which is a corner of the box that few would meet.
    shares[::3, -1] *= 0.02
    shares[1::3, -1] *= 0.3
    shapes = low + shares * (high - low)
    order = np.argsort([-record.density(family, shape) for shape in shapes])
    chosen: list[int] = []
    for i in order.tolist():
        if all(np.abs(shares[i] - shares[j]).max() > 0.1 for j in chosen):
            chosen.append(i)
        if len(chosen) == _STARTS:
            break
    return [shapes[i] for i in chosen]


def _spread(record: Scaled, family: Family, shape: Shape) -> Float[np.ndarray, "m m"]:
    """Return about the covariance of shapes beside the best one, by how fast the density falls."""
    low, high = family.box(record.latest)
    top, sizes = record.density(family, shape), np.empty(len(shape))
    for i in range(len(shape)):
        size = (high[i] - low[i]) / 8
        while size > 1e-7 * (high[i] - low[i]):
            sides = (shape + side * size * np.eye(len(shape))[i] for side in (-1, 1))
            if max(record.density(family, side) for side in sides) > top - 2.0:
                break
            size /= 2
        sizes[i] = size
    return np.diag(sizes**2)


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """Shapes of a family and their weights, which sum to 1."""

    family: Family
    typical: Shape  # their mean; the most probable one where the mean explains the record clearly worse
    shapes: Float[np.ndarray, "N m"]
    weights: Float[np.ndarray, " N"]
    evidence: float  # logarithm of the density of the record given the family
    share: float = 1.0  # probability of the family


def _weighed(record: Scaled, family: Family, modes: Sequence[Shape], rng: np.random.Generator) -> Weighed:
    """Return shapes weighed by their density, drawn around the modes and then around what was found.

    Source: Cappé, Guillin, Marin, Robert (2004), Population Monte Carlo; proposals are mixtures of
    Student distributions, and all rounds count by what was drawn in all of them, as in
    Cornuet, Marin, Mira, Robert (2012), Adaptive multiple importance sampling.
    """
    from scipy.stats import multivariate_t

    proposals = [[multivariate_t(mode, _spread(record, family, mode), df=_TAIL, seed=rng) for mode in modes]]
    shapes, densities = np.empty((0, len(modes[0]))), np.empty(0)
    for k in range(_ROUNDS[1]):
        parts = rng.integers(len(proposals[-1]), size=_DRAWN)
        counts = np.bincount(parts, minlength=len(proposals[-1]))
        drawn = [p.rvs(c).reshape(c, -1) for p, c in zip(proposals[-1], counts, strict=True) if c]
        new = np.vstack(drawn)
        shapes = np.vstack([shapes, new])
        densities = np.append(densities, [record.density(family, shape) for shape in new])
        mixtures = [np.mean([p.pdf(shapes) for p in each], axis=0) for each in proposals]
        logs = densities - np.log(np.mean(mixtures, axis=0))
        weights = np.exp(logs - logs.max())
        evidence = float(logs.max() + np.log(weights.mean()))
        weights /= weights.sum()
        if k + 1 >= _ROUNDS[0] and 1 / (weights @ weights) > _ENOUGH:
            break
        proposals.append(_around(shapes, weights, rng))
    # The most probable shape often has no dead time at all: a tuning on it would rely on that.
    middle = weights @ shapes
    near = record.density(family, middle) > densities.max() - _APART
    return Weighed(family, middle if near else modes[0], shapes, weights, evidence)


def _around(
    shapes: Float[np.ndarray, "N m"], weights: Float[np.ndarray, " N"], rng: np.random.Generator
) -> list[Any]:
    """Return proposals around weighed shapes: one around all, and others around single ones."""
    from scipy.stats import multivariate_t

    middle = weights @ shapes
    away = shapes - middle
    C = (weights[:, None] * away).T @ away + 1e-12 * np.eye(len(middle))
    own = rng.choice(len(shapes), size=6, p=weights)
    made = [multivariate_t(middle, C, df=_TAIL, seed=rng, allow_singular=True)]
    return made + [multivariate_t(shapes[i], C / 4, df=_TAIL, seed=rng, allow_singular=True) for i in own]


def explain(record: Scaled, rng: np.random.Generator) -> tuple[Scaled, list[Weighed]]:
    """Return the record with what its noise is like, and the families that explain it, the best one first."""
    rough = {family: _improved(record, family, _scanned(record, family, rng), _ROUGH) for family in FAMILIES}
    record = _with_noise(record, rough)
    modes = {
        family: _improved(record, family, rough[family][:2], _FINE)
        for family in _likely(record, rough, _DROPPED)
    }
    found = [_weighed(record, family, modes[family], rng) for family in _likely(record, modes, _HOPELESS)]
    sizes = np.exp(np.array([each.evidence for each in found]) - max(each.evidence for each in found))
    made = [replace(each, share=share) for each, share in zip(found, sizes / sizes.sum(), strict=True)]
    return record, sorted(made, key=lambda each: -each.share)


def _likely(record: Scaled, modes: Mapping[Family, Sequence[Shape]], behind: float) -> list[Family]:
    """Return the families that are no further behind the best one, by the logarithm of their densities."""
    tops = {family: max(record.density(family, z) for z in each[:2]) for family, each in modes.items()}
    return [family for family, top in tops.items() if top > max(tops.values()) - behind]


def _with_noise(record: Scaled, modes: Mapping[Family, Sequence[Shape]]) -> Scaled:
    """Return the record with the noise that the best fit leaves, and how long it lasts."""
    family = max(modes, key=lambda each: record.density(each, modes[each][0]))
    found = record.explained(family, modes[family][0])
    left, n = record.y - found.mean @ record.rows(family, modes[family][0]), len(record.y)
    lasting = float(np.clip(left[1:] @ left[:-1] / max(left @ left, 1e-300), 0.0, 0.98))
    variance = max(found.rest / (COUNTS * n), FLOOR**2)
    return replace(record, lasting=lasting if lasting > 2 / np.sqrt(n) else 0.0, variance=variance)
