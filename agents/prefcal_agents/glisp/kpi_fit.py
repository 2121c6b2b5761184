"""What GLISp learns from KPIs: draws of what the person wants, updated after each answer."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.history.lessons import Memory, cube_of, kpis_of
from prefcal_agents.history.stages import Stages
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.correction import corrected
from prefcal_agents.utility.explained import AFTER, explains
from prefcal_agents.utility.posterior import DRAWS, Lessons, updated
from prefcal_agents.utility.utilities import Scale, Utilities
from prefcal_env.preferences.history import History
from prefcal_env.preferences.kpis import Outcome

_JUDGES = 256
"""Number of draws that judge θ: in each, KPIs have their own values where no experiment ran."""
_SHOWN, _AT_ONCE = 64, 1000
"""Number of draws behind a drawn value, and of θ judged at once."""
_DOUBT = 0.5
"""Probability of being better than the best above which a sample is compared with it."""
_FEWEST = 3
"""Smallest number of experiments with a KPI to learn from it."""
_STREAM = 3
"""Stream of random numbers."""
_MOST = 100
"""Number of answers after which ten are learned from at once, so that a long study opens soon."""


@dataclass(frozen=True, eq=False, slots=True)
class KPIFit:
    """What is known about a person who judges by KPIs.

    Args:
        bank: KPIs of all experiments, a row for each θ.
        kept: Rows of the experiments that KPIs are modeled through, see `Memory`, shape (K,).
        scale: How KPIs are measured; without names if there is no KPI to learn from.
        utilities: Draws of what the person wants.
    """

    bank: Bank
    kept: Int[np.ndarray, " K"]
    scale: Scale
    utilities: Utilities

    def row(self, theta: Sequence[float]) -> int:
        """Return the place among the kept experiments of that with a physical θ, shape (n,)."""
        return int(np.flatnonzero(self.kept == self.bank.find(theta))[0])

    def costs(
        self, z: Float[np.ndarray, "m n"], rng: np.random.Generator, draws: int = _JUDGES
    ) -> Float[np.ndarray, "d all"]:
        """Return the costs of the kept experiments, then of new θ, in each draw, shape (d, K + m).

        Args:
            z: New points of the cube, shape (m, n).
            rng: Generator of the KPIs that they may have.
            draws: Number d of draws.
        """
        some = self.utilities.take(np.arange(0, len(self.utilities), len(self.utilities) // draws))
        points, rows = np.vstack([self.bank.z[self.kept], z]), np.arange(len(self.kept))
        known = self.scale(self.bank, self.kept.tolist())
        return some.costs(corrected(points, None, rows, known, len(some), rng))

    def beaten_by(self, z: Float[np.ndarray, "m n"], seed: int) -> Float[np.ndarray, " m"]:
        """Return the expected share of the kept experiments that are better than new θ, (m,)."""
        found = []
        for part in np.array_split(z, len(z) // _AT_ONCE + 1):
            costs = self.costs(part, np.random.default_rng(seed), _SHOWN)
            known, new = costs[:, : len(self.kept)], costs[:, len(self.kept) :]
            pairs = zip(np.sort(known), new, strict=True)
            found.append(np.mean([np.searchsorted(row, c) for row, c in pairs], axis=0))
        return np.concatenate(found) / len(self.kept)

    @property
    def teaches(self) -> bool:
        """Return whether there is a KPI to learn from."""
        return bool(self.scale.names)

    def explains(self, history: History) -> bool:
        """Return whether KPIs predict the answers of `history` about as well as θ does."""
        return explains(Memory.of(history).history, self.bank, self.scale, self.utilities)

    def doubted(self, history: History) -> tuple[int, int] | None:
        """Return the best sample and one that is probably better; None if there is none.

        A wrong answer, or a difference too small to notice, can have cost it the lead. A pair that
        was asked before is left out. The later sample comes first. Ten answers are needed to tell.
        """
        best = history.incumbent
        if best is None or len(history.lessons()) < AFTER:
            return None
        costs = self._of_samples(history)
        doubt = np.mean(costs < costs[:, [best]], axis=0)
        doubt[[best, *history.unsafe(), *history.cut_short()]] = 0.0
        for rival in map(int, np.argsort(-doubt, kind="stable")):
            if doubt[rival] <= _DOUBT:
                return None
            if not history.asked(best, rival):
                return max(best, rival), min(best, rival)
        return None

    def values(self, history: History) -> Float[np.ndarray, " N"]:
        """Return the expected rank of each sample among all, shape (N,), 1 is the best."""
        from scipy.stats import rankdata  # takes a third of a second to import

        return np.asarray(rankdata(self._of_samples(history), axis=1).mean(axis=0))

    def _of_samples(self, history: History) -> Float[np.ndarray, "s N"]:
        """Return the cost of each sample in each draw, shape (s, N)."""
        rows = [self.bank.find(s.theta) for s in history.samples[: history.answered]]
        return self.utilities.costs(self.scale(self.bank, rows))


def kpi_fits(seed: int) -> Stages[KPIFit]:
    """Return the fits of a study, by its record; `seed` is that of all randomness."""
    return Stages(partial(_first, seed), partial(_following, seed), _MOST)


def _first(seed: int) -> KPIFit:
    bank = Bank.of(np.zeros((0, 0)), np.zeros((0, 0)), [])
    scale = Scale.of(bank, np.arange(0))
    return KPIFit(bank, np.arange(0), scale, Utilities.drawn(scale, DRAWS, _rng(seed, History())))


def _following(seed: int, past: History, before: History, fit: KPIFit) -> KPIFit:
    """Return the fit after `past`, given that after `before`, a step earlier."""
    bank, rng, utilities = _experiments(past), _rng(seed, past), fit.utilities
    scale, part = Scale.of(bank, np.arange(len(bank))), Memory.of(past).history
    if scale.names != fit.scale.names:  # a KPI was always the same before: begin again
        before, utilities = History(), Utilities.drawn(scale, DRAWS, rng)
    if scale.names and (past.lessons() or past.unsafe()):
        old, new = (Lessons.of(bank, scale, each) for each in (Memory.of(before).history, part))
        utilities = updated(utilities, old, new, scale, rng)
    kept = np.unique([bank.find(sample.theta) for sample in part.samples])
    return KPIFit(bank, kept, scale, utilities)


def _experiments(history: History) -> Bank:
    """Return the KPIs of all experiments; a missing one is that of the nearest θ that has it."""
    z, known = cube_of(history), kpis_of(history)
    thetas = np.array([s.theta for s in history.samples[: history.answered]], dtype=float)
    names = sorted({name for kpis in known for name in kpis})
    columns = {name: _filled(z, known, name) for name in names}
    kept = {name: values for name, values in columns.items() if values is not None}
    rows = [Outcome({name: float(v[i]) for name, v in kept.items()}) for i in range(len(z))]
    return Bank.of(z, thetas.reshape(z.shape), rows)


def _filled(
    z: Float[np.ndarray, "N n"], known: Sequence[Mapping[str, float]], name: str
) -> Float[np.ndarray, " N"] | None:
    """Return one KPI of all experiments, shape (N,); None if too few have it."""
    values = np.array([kpis.get(name, np.nan) for kpis in known], dtype=float)
    missing = np.isnan(values)
    there = np.flatnonzero(~missing)
    if len(there) < _FEWEST:
        return None
    apart = np.sum((z[missing][:, None] - z[there]) ** 2, axis=2)
    values[missing] = values[there[np.argmin(apart, axis=1)]]
    return values


def _rng(seed: int, past: History) -> np.random.Generator:
    return np.random.default_rng([seed, past.answered, len(past.follow_ups), _STREAM])
