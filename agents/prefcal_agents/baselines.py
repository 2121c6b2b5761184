"""Baselines: GLIS, which learns from a known score, and agents that learn little or nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.arrays import number
from prefcal_env.errors import SettingsError
from prefcal_env.preferences.history import History, KPIValues

from .agent import Agent, Settings, choice
from .lessons import cube_of, normalize, scores_of
from .people import Bank
from .screening.bank import Simulating
from .search import Tried, latin_hypercube, new_minimum, random_points, step_length
from .surrogate import RADIAL_FUNCTIONS, squared_distances

POSITIVE_DEFINITE = ("gaussian", "inverse_quadratic")
"""Radial functions with a positive definite matrix over all pairs of samples."""

_DECIDING = 100  # maximum number of samples that choose ε; with 400 it took 0.1 s
_RIDGE = 1e-10  # relative to φ(0) = 1: far below any relevant value, but above rounding


@dataclass(frozen=True, slots=True)
class Interpolant:
    """The interpolant Σ β_i φ(ε |z - z_i|) + offset, with N centers.

    Source: Bemporad 2020, equation 3; φ takes the distance there, its square in eq. rbf.
    """

    centers: Float[np.ndarray, "N n"]  # centers, shape (N, n)
    beta: Float[np.ndarray, " N"]  # weights β, shape (N,)
    offset: float  # mean of the values, predicted far from all samples
    epsilon: float  # width parameter ε
    rbf: str  # name of φ, one of `POSITIVE_DEFINITE`

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the values at the rows of `z`, shape (m,)."""
        u = self.epsilon**2 * squared_distances(z, self.centers)
        return np.asarray(self.offset + RADIAL_FUNCTIONS[self.rbf].value(u) @ self.beta)

    def gradient(self, z: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the gradient at one point, shape (n,)."""
        away = z - self.centers
        slope = RADIAL_FUNCTIONS[self.rbf].slope(self.epsilon**2 * np.sum(away**2, axis=1))
        return np.asarray((2 * self.epsilon**2 * self.beta * slope) @ away)


def interpolate(
    samples: Float[np.ndarray, "N n"], values: Float[np.ndarray, " N"], epsilon: float, rbf: str
) -> tuple[Interpolant, float]:
    """Return the interpolant of `values` at `samples`, and its error.

    The error is the root mean square difference between each value and its prediction from the
    others. One factorization gives all of them: S. Rippa, Advances in Computational Mathematics
    11 (1999), equation 13.
    """
    column = values[:, None]
    offset = column.mean(axis=0)
    phi = RADIAL_FUNCTIONS[rbf].value(epsilon**2 * squared_distances(samples, samples))
    # One decomposition gives the weights and the diagonal of the inverse, which leave-one-out needs.
    eigenvalues, vectors = np.linalg.eigh(phi)
    # Close samples give eigenvalues that rounding makes negative.
    inverse = 1 / (np.maximum(eigenvalues, 0.0) + _RIDGE * len(values))
    beta = vectors @ (inverse[:, None] * (vectors.T @ (column - offset)))
    left_out = beta / ((vectors**2) @ inverse)[:, None]
    error = np.sqrt(np.mean(left_out**2, axis=0))
    return Interpolant(samples, beta[:, 0], float(offset[0]), epsilon, rbf), float(error[0])


def best_interpolant(
    samples: Float[np.ndarray, "N n"], values: Float[np.ndarray, " N"], epsilons: Sequence[float], rbf: str
) -> Interpolant:
    """Return the interpolant with the ε of `epsilons` that predicts left-out values best.

    With many samples, only the last ones choose ε.
    """
    # The latest ones lie near the best, where the interpolant matters most.
    last = slice(max(len(samples) - _DECIDING, 0), None)
    tries = [interpolate(samples[last], values[last], epsilon, rbf) for epsilon in epsilons]
    best = min(tries, key=lambda each: each[1])[0]
    if len(samples) <= _DECIDING:
        return best
    return interpolate(samples, values, best.epsilon, rbf)[0]


# --- Compute the acquisition of GLIS, which rewards low, uncertain and distant points.
#
# Source: A. Bemporad, "Global optimization via inverse distance weighting and radial basis functions",
# Computational Optimization and Applications 77 (2020), equations 7 to 10.

_ON_SAMPLE = 1e-30  # squared distance below which a point counts as a sample
_FLAT = 1e-12  # a deviation below this has no slope worth following


@dataclass(frozen=True, slots=True)
class Weights:
    """The weights w_i = exp(-d_i)/d_i of N samples at m points, with squared distances d."""

    share: Float[np.ndarray, "m N"]  # shares v_i = w_i / Σ w_j, shape (m, N); rows sum to 1
    largest: Float[np.ndarray, " m"]  # weight w of the nearest sample, shape (m,); infinite on a sample
    total: Float[np.ndarray, " m"]  # sum Σ w_j / largest, shape (m,), 1 or more

    @classmethod
    def of(cls, d: Float[np.ndarray, "m N"]) -> "Weights":
        """Return the weights for squared distances `d`, shape (m, N)."""
        nearest = d.min(axis=1, keepdims=True)
        safe = np.maximum(d, _ON_SAMPLE)
        # Relative to the nearest sample, whose own weight may overflow.
        relative = np.exp(nearest - safe) * (np.maximum(nearest, _ON_SAMPLE) / safe)
        total = relative.sum(axis=1)
        with np.errstate(divide="ignore"):
            largest = np.exp(-nearest[:, 0]) / np.where(nearest <= _ON_SAMPLE, 0.0, nearest)[:, 0]
        return cls(relative / total[:, None], largest, total)

    def variance(
        self, values: Float[np.ndarray, " N"], predicted: Float[np.ndarray, " m"]
    ) -> Float[np.ndarray, " m"]:
        """Return the IDW variance s², the weighted mean of (f_i - predicted)², shape (m,).

        It is 0 on a sample.
        """
        return np.asarray(np.sum(self.share * (values - predicted[:, None]) ** 2, axis=1))

    @property
    def distance(self) -> Float[np.ndarray, " m"]:
        """Return the IDW distance z = 2/π arctan(1 / Σ w_i), in [0, 1), (m,); 0 on a sample."""
        return np.asarray(2 / np.pi * np.arctan(1 / (self.largest * self.total)))


@dataclass(frozen=True, slots=True)
class ValueAcquisition:
    """The acquisition a = f - α s - δ z over the box scaled to [-1, 1]; f interpolates scores.

    Source: equation 10, divided by its ΔF: the range of the scores is 1 here.
    """

    interpolant: Interpolant  # interpolant f, with centers in [-1, 1]
    # Scores of the N samples, shape (N,), between 0 and 1; f goes through them
    values: Float[np.ndarray, " N"]
    alpha: float  # weight α of the IDW deviation s, 0 or more
    delta: float  # weight δ of the IDW distance z, 0 or more

    def __call__(self, z: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return a at the rows of `z`, shape (m, n), unit cube, as shape (m,)."""
        # Bemporad's equations are for the box [-1, 1]^n, so distances and ε are measured there.
        x = 2 * z - 1
        weights, f = Weights.of(squared_distances(x, self.interpolant.centers)), self.interpolant(x)
        s = np.sqrt(weights.variance(self.values, f))
        return np.asarray(f - self.alpha * s - self.delta * weights.distance)

    def value_and_gradient(self, z: Float[np.ndarray, " n"]) -> tuple[float, Float[np.ndarray, " n"]]:
        """Return a and ∂a/∂z at one point of the cube, shape (n,); s and z are flat on a sample."""
        x, centers = 2 * z - 1, self.interpolant.centers
        d = squared_distances(x[None], centers)
        weights, f = Weights.of(d), self.interpolant(x[None])
        s, slope = np.sqrt(weights.variance(self.values, f)), self.interpolant.gradient(x)
        value = float((f - self.alpha * s - self.delta * weights.distance)[0])
        # There s has a corner, and z is flat: only f has a slope to follow.
        if d.min() <= _ON_SAMPLE:
            return value, np.asarray(2 * slope)
        v, largest, total = weights.share[0], weights.largest[0], weights.total[0]
        of_logs = -2 * (1 + 1 / d[0])[:, None] * (x - centers)  # ∂ log w_i / ∂x, shape (N, n)
        of_s: float | Float[np.ndarray, " n"] = 0.0
        if s[0] > _FLAT:
            error = self.values - f[0]
            of_shares = v[:, None] * (of_logs - v @ of_logs)
            of_s = (error**2 @ of_shares - 2 * (v @ error) * slope) / (2 * float(s[0]))
        of_sum = total * (v @ of_logs)  # of Σ w_i, over the largest
        of_z = -2 / np.pi * of_sum / (1 / largest + largest * total**2)
        return value, np.asarray(2 * (slope - self.alpha * of_s - self.delta * of_z))


@dataclass(frozen=True, slots=True, kw_only=True)
class GLISSettings(Settings):
    """Configure how GLIS chooses the next experiment.

    Source: Bemporad 2020, sections 3 and 4.
    Deviation: α and δ are smaller than 0.8 and 0.5, which waste experiments far from the best
    (median of 6 seeds after 50 experiments: hartman6 0.08 against 0.20, camel 2e-5 against 6e-5,
    branin 3e-4 against 2e-3). ε is chosen at every step by leave-one-out errors, not fixed.
    Scores far above the median are capped (`ceiling`): an interrupted run costs a thousand times
    as much as a good one, and an interpolant through both cannot tell good ones apart
    (CSTR, median of 8 seeds: 0.695 with a ceiling of 2, 0.718 without).

    Args:
        alpha: Weight α of the IDW deviation, 0 or more; larger explores more.
        delta: Weight δ of the distance from all samples, 0 or more; larger explores more.
        rbf: Name of φ, one of `POSITIVE_DEFINITE`.
        epsilons: Values of ε to choose from, above 0, for the box scaled to [-1, 1].
        ceiling: A score counts as at most this many times (median - best) above the median.

    Raises:
        SettingsError: If a value is not valid.
    """

    alpha: float = 0.4
    delta: float = 0.2
    rbf: str = "inverse_quadratic"
    epsilons: tuple[float, ...] = (0.1, 0.18, 0.32, 0.56, 1.0, 1.8, 3.2)
    ceiling: float = 2.0

    def __post_init__(self) -> None:
        number("alpha", self.alpha)
        number("delta", self.delta)
        choice("rbf", self.rbf, POSITIVE_DEFINITE)
        number("ceiling", self.ceiling, strict=True)
        if not isinstance(self.epsilons, tuple) or not self.epsilons:
            raise SettingsError(f"epsilons must be a tuple of numbers, got {self.epsilons!r}")
        for epsilon in self.epsilons:
            number("each of epsilons", epsilon, strict=True)


@final
class GLIS(Agent):
    """Optimize a score that is known after every experiment; a baseline for preferences.

    The first `n_init` samples are a Latin hypercube. Then the scores are interpolated, and the
    acquisition of `ValueAcquisition` is minimized.

    Source: Bemporad 2020 (see `value_acquisition`); section IV-A of the paper compares with it.
    Deviation: see `GLISSettings`; in addition, a multistart descent instead of a particle swarm.

    Arguments and errors are those of `Agent`; `settings` are `GLISSettings`.
    """

    version: ClassVar[int] = 1
    options = GLISSettings
    by_value = True

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point: of the start, or a minimum of the acquisition."""
        index, space, settings = history.answered, self.space, self.settings
        rng = np.random.default_rng([self.setup.seed, index])
        tried = Tried(space, history)
        if index < self.setup.n_init:
            return tried.fresh(latin_hypercube(space, self.setup.n_init, self.setup.seed)[index], rng)
        # All runs of the start may have failed to give a score: then nothing can be interpolated.
        if not len(scores_of(history)[0]):
            return tried.fresh(random_points(space, 1, rng)[0], rng)
        interpolant, values = self._interpolant(history)
        acquisition = ValueAcquisition(interpolant, values, settings.alpha, settings.delta)
        return new_minimum(acquisition, space, history, rng)

    def _interpolant(self, history: History) -> tuple[Interpolant, Float[np.ndarray, " K"]]:
        scored, values = scores_of(history)
        # The range becomes 1, which is ΔF of equation 10.
        values = normalize(values, self.settings.ceiling)
        x = 2 * cube_of(history)[scored] - 1
        return best_interpolant(x, values, self.settings.epsilons, self.settings.rbf), values

    @property
    def settings(self) -> GLISSettings:
        """Return all settings."""
        settings: GLISSettings = self.setup.settings
        return settings

    def surrogate(self, thetas: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
        """Return the interpolated score at physical `thetas`, shape (m, n): shape (m,), no unit.

        The best sample has 0 and the worst 1 (scores above the ceiling of `settings` count as the
        worst). The values are all 0 while nothing is known.

        Raises:
            KnobError: If `thetas` has another shape or leaves the box.
        """
        z = self.space.encode_all(thetas)
        if not len(scores_of(self.history)[0]):
            return np.zeros(len(z))
        return self._interpolant(self.history)[0](2 * z - 1)


@final
class EqualWeights(Simulating):
    """Simulate a Latin hypercube and show the best of it, all KPIs counting the same.

    Answers only decide which of those shown is kept. It is what `Screening` has to beat.

    Arguments and errors are those of `Simulating`; n_max experiments take n_max - 1 comparisons.
    """

    version: ClassVar[int] = 1

    @property
    def bank(self) -> Bank:
        """Return the simulated θ; it simulates them if needed."""
        simulations = self.simulations  # there may be none
        # All at once and spread evenly: it has no use for θ near what answers prefer.
        z, thetas = self.space.proposals(latin_hypercube(self.space, self.n_simulated, self.setup.seed))
        return Bank.of(z, thetas, KPIValues.of(simulations(thetas)))

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the simulated point of the lowest mean rank that did not run."""
        bank = self.bank
        ranked = bank.z[by_mean_rank(bank.kpis)]
        z = Tried(self.space, history).first_new(ranked)
        return np.asarray(ranked[0] if z is None else z)


def by_mean_rank(kpis: Float[np.ndarray, "m k"]) -> Int[np.ndarray, " m"]:
    """Return the rows from the lowest mean rank over all KPIs to the highest, shape (m,).

    Equal values share the mean of their ranks; rows with the same mean keep their order.
    """
    # Ranks, since KPIs have no common unit; an infinite value is only the last.
    columns = [_ranks(column) for column in kpis.T]
    # Without a KPI the sum is a number, not an array: the zeros give it its shape.
    return np.argsort(np.sum(columns, axis=0) + np.zeros(len(kpis)), kind="stable")


def _ranks(values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
    """Return the rank of each value, from 1; equal values share their mean rank."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(counts) - (counts - 1) / 2)[places])


@final
class LatinHypercube(Agent):
    """Spread all `n_max` samples as one Latin hypercube, drawn from `seed` alone.

    Arguments and errors are those of `Agent`; `n_init` has no effect.
    """

    version: ClassVar[int] = 1

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return the next point of the design."""
        design = latin_hypercube(self.space, self._most(history), self.setup.seed)
        return np.asarray(design[history.answered])


@final
class RandomSearch(Agent):
    """Draw each sample uniformly from the cube; sample i depends on `(seed, i)` alone.

    Arguments and errors are those of `Agent`; `n_init` has no effect.
    """

    version: ClassVar[int] = 1

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return a random point of the searched part of the cube."""
        rng = np.random.default_rng([self.setup.seed, history.answered])
        return Tried(self.space, history).fresh(self.space.scaled(rng.random((1, len(self.space))))[0], rng)


@final
class StepSearch(Agent):
    """Evolution strategy with one parent, as in docs/own_agent.py, which explains it.

    After `n_init` uniform samples each one is a normal step away from the best so far. Steps grow
    after a success and shrink after a failure.

    Arguments and errors are those of `Agent`.
    """

    version: ClassVar[int] = 1

    def propose(self, history: History) -> Float[np.ndarray, " n"]:
        """Return a step from the best so far, or a random point of the start."""
        rng, n = np.random.default_rng([self.setup.seed, history.answered]), len(self.space)
        if history.answered < self.setup.n_init:
            z = rng.random(n)
        else:
            parent = np.array(history.samples[history.incumbent or 0].z)
            z = parent + step_length(history, self.setup.n_init) * rng.standard_normal(n)
        return Tried(self.space, history).fresh(np.clip(z, 0.0, 1.0), rng)
