"""What GLISp learns from KPIs: draws of what the person wants, updated after each answer."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.acquisition.expected_improvement import ExpectedImprovement
from prefcal_agents.history.lessons import Memory, cube_of, kpis_of
from prefcal_agents.history.stages import Stages
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.explained import AFTER, explains
from prefcal_agents.utility.posterior import Lessons, updated
from prefcal_agents.utility.utilities import Scale, Utilities
from prefcal_env.preferences.history import History
from prefcal_env.preferences.kpis import Outcome

_DRAWS = 256
"""Number of draws that stand for what is known."""
_JUDGES = 16
"""Number of draws whose costs are modeled over θ: each has a process of its own."""
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
        kept: Rows of the experiments that costs are modeled through, see `Memory`, shape (K,).
        scale: How KPIs are measured; without names if there is no KPI to learn from.
        utilities: Draws of what the person wants.
    """

    bank: Bank
    kept: Int[np.ndarray, " K"]
    scale: Scale
    utilities: Utilities

    @property
    def improvement(self) -> ExpectedImprovement:
        """Return the expected improvement of the cost, over some of the draws."""
        rows = np.arange(0, len(self.utilities), len(self.utilities) // _JUDGES)
        costs = self.utilities.take(rows).costs(self.scale(self.bank, self.kept.tolist()))
        return ExpectedImprovement.of(self.bank.z[self.kept], costs)

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
        """Return the expected rank of each sample among all, shape (N,), lower is better."""
        costs = self._of_samples(history)
        return np.asarray(np.argsort(np.argsort(costs, axis=1), axis=1).mean(axis=0))

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
    return KPIFit(bank, np.arange(0), scale, _drawn(scale, _rng(seed, History())))


def _following(seed: int, past: History, before: History, fit: KPIFit) -> KPIFit:
    """Return the fit after `past`, given that after `before`, a step earlier."""
    bank, rng, utilities = _experiments(past), _rng(seed, past), fit.utilities
    scale, part = Scale.of(bank, np.arange(len(bank))), Memory.of(past).history
    if scale.names != fit.scale.names:  # a KPI was always the same before: begin again
        before, utilities = History(), _drawn(scale, rng)
    if scale.names and (past.lessons() or past.unsafe()):
        old, new = (Lessons.of(bank, scale, each) for each in (Memory.of(before).history, part))
        utilities = updated(utilities, old, new, scale, rng)
    kept = np.unique([bank.find(sample.theta) for sample in part.samples])
    return KPIFit(bank, kept, scale, utilities)


def _drawn(scale: Scale, rng: np.random.Generator) -> Utilities:
    """Return draws before any answer. Orders are left out: a process cannot follow their steps."""
    return Utilities.drawn(scale, _DRAWS, rng, np.zeros(_DRAWS, dtype=np.bool_))


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
