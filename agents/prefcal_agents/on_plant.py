"""What KPIs may be on the plant, given what was measured, and a simulation if there is one.

Each KPI is a Gaussian process over θ, on the scale on which KPIs are judged. A simulation of another
plant than the one that runs is a rough model of it, a twin: then the process is the difference between
both. How far the twin is trusted follows from the measured values: with some probability, which they
decide, a KPI is predicted without the twin.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import softmax

from prefcal_env.preferences.answer import Reading
from prefcal_env.preferences.history import History, KPIValues

from .people import Bank
from .surrogate import matern, squares

_TRUST = 0.5  # probability, before anything is measured, that a KPI follows the twin's
_OFFSET = {True: 0.5, False: 2.0}
"""Variance of what is the same for all θ, over that of the process: with the twin and without."""
_NUGGET = 1e-3  # variance of what θ does not explain, such as noise, over that of the process
_FEATURES = 200  # number of random cosines that a draw of a process is made of
_INFINITE = 0.5  # logarithm of how much worse than all finite values an infinite one counts


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """KPIs that were measured on the plant.

    Args:
        rows: Rows of the bank whose θ have run, shape (r,).
        kpis: Their KPIs.
        reading: How people read them.
    """

    rows: Int[np.ndarray, " r"]
    kpis: KPIValues
    reading: Reading

    @classmethod
    def of(cls, bank: Bank, history: History, reading: Reading) -> "Measured":
        """Return the KPIs that the answers of `history` tell; none if all read as simulated."""
        names, values = history.kpis
        known = ~np.isnan(values).all(axis=1)
        known[[*history.cut_short]] = False  # their KPIs are bounds
        rows = bank.rows([history.samples[index].theta for index in np.flatnonzero(known)])
        found = cls(rows, KPIValues(names, values[known]), reading)
        # What was stored and read again may differ in the last digit.
        same = np.isclose(found.on(bank).kpis, bank.kpis, rtol=1e-9, atol=0.0)
        return cls(rows[:0], KPIValues((), np.zeros((0, 0))), reading) if same.all() else found

    def __len__(self) -> int:
        return len(self.rows)

    def on(self, bank: Bank) -> Bank:
        """Return the bank with what was measured in place of what was simulated."""
        if not len(self):
            return bank
        kpis = bank.kpis.copy()
        for name, values in zip(self.kpis.names, self.kpis.values.T, strict=True):
            if name in bank.names:
                column = bank.names.index(name)
                kpis[self.rows, column] = np.where(np.isnan(values), kpis[self.rows, column], values)
        kpis[self.rows] = self.reading.table(bank.names, kpis[self.rows])
        return replace(bank, kpis=kpis)


def draw_on_plant(
    z: Float[np.ndarray, "m n"],
    simulated: Float[np.ndarray, "m k"] | None,
    rows: Int[np.ndarray, " r"],
    measured: Float[np.ndarray, "r k"],
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "d m k"]:
    """Return draws of what each KPI may be on the plant, shape (d, m, k).

    Source: M. C. Kennedy, A. O'Hagan, "Predicting the output from a complex computer code when fast
    approximations are available" (2000): the plant is the simulation plus a Gaussian process.
    Deviation: the simulation can be left out. Scales are averaged over analytically.

    Args:
        z: Points of the cube, shape (m, n).
        simulated: Log distances of the simulated KPIs, infinite where a KPI is, shape (m, k); None
            without a simulation.
        rows: Rows that were measured, shape (r,).
        measured: Their measured log distances, shape (r, k).
        draws: Number d of draws.
        rng: Generator of the draws.
    """
    found = np.empty((draws, len(z), measured.shape[1]))
    trusts = (False,) if simulated is None else (True, False)
    # Lengths in units of √n: from a fraction of the cube to hardly any change across it.
    beliefs = [_Belief.of(z, rows, length, twin) for length in (0.3, 0.6, 1.2) for twin in trusts]
    for kpi, real in enumerate(measured.T):
        twin = real if simulated is None else simulated[:, kpi]
        known = np.concatenate([twin, real])
        known = known[np.isfinite(known)]
        cap = (known.max() if len(known) else 0.0) + _INFINITE
        values = _draw_kpi(beliefs, np.minimum(twin, cap), np.minimum(real, cap), rows, draws, rng)
        # What was measured is exact, whatever its noise: a person judged these values.
        values[:, rows] = real
        # Infinite KPIs entered as slightly worse than all others; drawn values nearer to that are infinite
        # again.
        found[:, :, kpi] = np.where(values > cap - _INFINITE / 2, np.inf, values)
    return found


def _draw_kpi(
    beliefs: Sequence["_Belief"],
    twin: Float[np.ndarray, " t"],
    real: Float[np.ndarray, " r"],
    rows: Int[np.ndarray, " r"],
    draws: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "d m"]:
    """Return draws of one KPI, each by one of the beliefs, as likely as the values make it.

    `twin` are all simulated values or, without a simulation, the measured ones.
    """
    spread, count = float(twin.std()) + 1e-9, len(beliefs[0].outer)
    bases = [twin if belief.twin else np.full(count, twin.mean()) for belief in beliefs]
    fits = [belief.fit(real - base[rows], spread) for belief, base in zip(beliefs, bases, strict=True)]
    # Averaged over beliefs instead of choosing the likeliest: after two or three runs none is sure.
    chosen = rng.choice(len(beliefs), draws, p=softmax([fit.evidence for fit in fits]))
    found = np.empty((draws, count))
    for k in np.unique(chosen):
        mine = np.flatnonzero(chosen == k)
        found[mine] = bases[k] + beliefs[k].paths(fits[k], len(mine), rng)
    return found


class _Fit(NamedTuple):
    """A process given values: log evidence, K⁻¹ times the values, and its variance."""

    evidence: float
    alpha: Float[np.ndarray, " r"]
    variance: float


@dataclass(frozen=True, eq=False, slots=True)
class _Belief:
    """A Gaussian process for what is added to the twin, if it is trusted, or for all of a KPI.

    `rows` are the points with values, `inner` is their covariance over the variance of the process,
    `outer` that of all points with them. Normal combinations of `features` are draws of the process.
    """

    twin: bool
    rows: Int[np.ndarray, " r"]
    inner: Float[np.ndarray, "r r"]
    outer: Float[np.ndarray, "m r"]
    features: Float[np.ndarray, "m f"]

    @classmethod
    def of(
        cls, z: Float[np.ndarray, "m n"], rows: Int[np.ndarray, " r"], share: float, twin: bool
    ) -> "_Belief":
        """Return the process with this length, in units of √n."""
        knobs = z.shape[1]
        length = share * np.sqrt(knobs)
        outer = matern(squares(z, z[rows]) / length**2)[0] + _OFFSET[twin]
        # Always the same cosines: then draws differ by their weights alone, for all lengths and KPIs.
        rng = np.random.default_rng(_FEATURES)
        # The spectrum of the kernel is Student's t distribution with five degrees of freedom.
        tails = np.sqrt(rng.chisquare(5.0, (_FEATURES, 1)) / 5.0)
        waves = rng.standard_normal((_FEATURES, knobs)) / tails / length
        phases = rng.uniform(0.0, 2.0 * np.pi, _FEATURES)
        cosines = np.sqrt(2.0 / _FEATURES) * np.cos(z @ waves.T + phases)
        constant = np.full((len(z), 1), np.sqrt(_OFFSET[twin]))
        return cls(
            twin, rows, outer[rows] + _NUGGET * np.eye(len(rows)), outer, np.hstack([cosines, constant])
        )

    def fit(self, values: Float[np.ndarray, " r"], spread: float) -> _Fit:
        """Fit to what was measured; its variance has an inverse gamma distribution before.

        Args:
            values: Measured values less the mean of the process, shape (r,).
            spread: Standard deviation of the KPI over random θ.
        """
        # A twin that is trusted is off by 0.3 of what the KPI varies over random θ, before anything is known.
        prior = (spread * (0.3 if self.twin else 1.0)) ** 2
        alpha = np.linalg.solve(self.inner, values)
        # Inverse gamma with shape 1 and scale `prior`: the variance can be integrated out in closed form.
        half, shape = float(values @ alpha) / 2, 1.0 + len(values) / 2
        factor = np.linalg.cholesky(self.inner)
        evidence = np.log(_TRUST if self.twin else 1.0 - _TRUST) - shape * np.log1p(half / prior)
        evidence -= len(values) / 2 * np.log(prior) + np.log(np.diag(factor)).sum()
        return _Fit(float(evidence), alpha, (prior + half) / shape)

    def paths(self, fit: _Fit, count: int, rng: np.random.Generator) -> Float[np.ndarray, "c m"]:
        """Return draws of the process at all points, given the values, shape (c, m).

        Source: J. T. Wilson et al., "Efficiently sampling functions from Gaussian process
        posteriors" (2020): a draw before the values, plus what they change.
        """
        drawn = self.features @ rng.standard_normal((self.features.shape[1], count))
        noise = np.sqrt(_NUGGET) * rng.standard_normal((len(self.rows), count))
        changed = self.outer @ np.linalg.solve(self.inner, drawn[self.rows] + noise)
        paths = np.sqrt(fit.variance) * (drawn - changed) + (self.outer @ fit.alpha)[:, None]
        return np.asarray(paths.T)
