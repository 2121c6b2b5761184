"""What KPIs may be on the plant, given what was measured, and a simulation if there is one.

Each KPI is a Gaussian process over θ, on the scale on which KPIs are judged. A simulation of
another plant than the one that runs is a rough model of it, a twin: then the process is the
difference between both. How far the twin is trusted follows from the measured values: with some
probability, which they decide, a KPI is predicted without the twin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.special import softmax

from prefcal_agents.history.lessons import kpis_of
from prefcal_agents.models.gaussian_process import matern, squares
from prefcal_agents.utility.bank import Bank, columns_of
from prefcal_env.preferences.history import History
from prefcal_env.preferences.reading import Reading

_TRUST = 0.5
"""Probability, before anything is measured, that a KPI follows the twin's."""
_OFF = 0.3
"""How far off the twin then is, in standard deviations of the KPI over random θ."""
_OFFSET = {True: 0.5, False: 2.0}
"""Variance of what is the same for all θ, over that of the process: with the twin and without."""
_LENGTHS = (0.3, 0.6, 1.2)
"""Lengths of the processes in the cube, over the square root of the number of knobs."""
_NUGGET = 1e-3
"""Variance of what θ does not explain, such as noise, over that of the process."""
_FEATURES = 200
"""Number of random cosines that a draw of a process is made of."""
_BEYOND = 0.5
"""Logarithm of how much worse than all finite values an infinite one counts."""
_SAME = 1e-9
"""Relative difference up to which a measured KPI is the simulated one."""


@dataclass(frozen=True, eq=False, slots=True)
class Measured:
    """KPIs that were measured on the plant.

    Args:
        rows: Rows of the bank whose θ have run, shape (r,).
        outcomes: Their KPIs.
        reading: How people read them.
    """

    rows: Int[np.ndarray, " r"]
    outcomes: tuple[Mapping[str, float], ...]
    reading: Reading

    @classmethod
    def of(cls, bank: Bank, history: History, reading: Reading) -> "Measured":
        """Return the KPIs that the answers of `history` tell; none if all read as simulated."""
        cut = history.cut_short()  # their KPIs are bounds
        told = {i: kpis for i, kpis in enumerate(kpis_of(history)) if kpis and i not in cut}
        rows = bank.rows([history.samples[index].theta for index in told])
        found = cls(rows, tuple(told.values()), reading)
        same = np.isclose(found.on(bank).kpis, bank.kpis, rtol=_SAME, atol=0.0)
        return cls(np.array([], dtype=np.int64), (), reading) if same.all() else found

    def __len__(self) -> int:
        return len(self.rows)

    def on(self, bank: Bank) -> Bank:
        """Return the bank with what was measured in place of what was simulated."""
        if not self.outcomes:
            return bank
        kpis = bank.kpis.copy()
        measured = columns_of(self.outcomes)
        for column, name in enumerate(bank.names):
            values = measured.get(name, np.full(len(self), np.nan))
            kpis[self.rows, column] = np.where(np.isnan(values), kpis[self.rows, column], values)
        kpis[self.rows] = self.reading.table(bank.names, kpis[self.rows])
        return replace(bank, kpis=kpis)


def corrected(
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
    beliefs = [_Belief.of(z, rows, length, twin) for length in _LENGTHS for twin in trusts]
    for kpi, real in enumerate(measured.T):
        twin = real if simulated is None else simulated[:, kpi]
        known = np.concatenate([twin, real])
        known = known[np.isfinite(known)]
        cap = (known.max() if len(known) else 0.0) + _BEYOND
        values = _drawn(beliefs, np.minimum(twin, cap), np.minimum(real, cap), rows, draws, rng)
        values[:, rows] = real
        found[:, :, kpi] = np.where(values > cap - _BEYOND / 2, np.inf, values)
    return found


def _drawn(
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
    """A Gaussian process for what is added to the twin, or for all of a KPI.

    Args:
        twin: Whether the twin is trusted.
        rows: Rows of the points with values, shape (r,).
        inner: Covariance K of the values, over the variance of the process, shape (r, r).
        outer: That of all points with them, shape (m, r).
        features: Random cosines, whose normal combinations are draws of the process, shape (m, f).
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
        prior = (spread * (_OFF if self.twin else 1.0)) ** 2
        alpha = np.linalg.solve(self.inner, values)
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
