"""What GLISp learns from KPIs and proposes by them: draws of what the person wants."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from prefcal_agents.acquisition.penalty import Penalty
from prefcal_agents.history.lessons import Memory, cube_of, filled_kpis
from prefcal_agents.history.stages import Stages
from prefcal_agents.optimize.search import Tried
from prefcal_agents.space.feasible import random_points
from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.choice import expected_best
from prefcal_agents.utility.correction import corrected
from prefcal_agents.utility.posterior import AFTER, DRAWS, Lessons, explains, updated
from prefcal_agents.utility.utilities import Scale, Utilities
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

_JUDGES = 256
"""Number of draws that judge θ: in each, KPIs have their own values where no experiment ran."""
_SHOWN, _AT_ONCE = 64, 1000
"""Number of draws behind a drawn value, and of θ judged at once."""
_DOUBT = 0.5
"""Probability of being better than the best above which a sample is compared with it."""
_STREAM = 3
"""Stream of random numbers."""
_MOST = 100
"""Number of answers after which ten are learned from at once, so that a long study opens soon."""

_ANYWHERE, _NEAR = 300, 300
"""Number of random θ to choose from, and of steps from the best one so far."""
_STEPS = (0.003, 0.3)
"""Shortest and longest standard deviation of a step, in units of the cube."""
_MOVED = 0.2
"""Smallest share of the knobs that a step moves; the largest is 1."""


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
        rows = self.bank.rows([s.theta for s in history.samples[: history.answered]])
        return self.utilities.costs(self.scale(self.bank, rows))


def kpi_fits(seed: int) -> Stages[KPIFit]:
    """Return the fits of a study, by its record; `seed` is that of all randomness."""
    return Stages(partial(_first, seed), partial(_following, seed), _MOST)


def _first(seed: int) -> KPIFit:
    bank = Bank.of(np.zeros((0, 0)), np.zeros((0, 0)), {})
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
    kept = np.unique(bank.rows([sample.theta for sample in part.samples]))
    return KPIFit(bank, kept, scale, utilities)


def _experiments(history: History) -> Bank:
    """Return the KPIs of all experiments; see `filled_kpis`."""
    z, columns = cube_of(history), filled_kpis(history)
    thetas = np.array([s.theta for s in history.samples[: history.answered]], dtype=float)
    return Bank.of(z, thetas.reshape(z.shape), columns)


def _rng(seed: int, past: History) -> np.random.Generator:
    return np.random.default_rng([seed, past.answered, len(past.follow_ups), _STREAM])


def most_promising(
    space: KnobSpace, history: History, fit: KPIFit, penalty: Penalty | None, rng: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Return the point of the cube to run next, shape (n,): the best one for `expected_best`.

    Source: Z. J. Lin et al., "Preference exploration for efficient Bayesian optimization with
    multiple outcomes" (2022): a process for each KPI, draws of what the person wants.
    Deviation: draws follow `Utilities`, and the choice is that of `Screening`. The θ to choose from
    are random ones and steps from the best one, as in an evolution strategy.

    Args:
        space: Knobs to tune.
        history: Samples and answers.
        fit: What is known about the person.
        penalty: Penalty for places that are likely unsafe; those with one come last.
        rng: Generator of the θ to choose from, and of the draws.
    """
    samples = history.samples
    best = samples[history.incumbent or 0]
    points = np.vstack([random_points(space, _ANYWHERE, rng), _steps(space, best.z, rng)])
    points = space.snap_all(points)
    points = points[np.atleast_1d(space.allows(space.decode_all(points)))]
    value = expected_best(fit.costs(points, rng), fit.row(best.theta))[len(fit.kept) :]
    risk = np.zeros(len(points)) if penalty is None else penalty(points)
    ranked = points[np.lexsort((-value, risk))]
    tried = Tried(space, history)
    found = tried.first_new(ranked)
    return tried.fresh(ranked[0], rng) if found is None else found


def _steps(space: KnobSpace, best: tuple[float, ...], rng: np.random.Generator) -> Float[np.ndarray, "s n"]:
    """Return steps from the best θ of all lengths, which move some of the knobs, shape (s, n)."""
    shape = (_NEAR, len(space))
    moved = rng.random(shape) < rng.uniform(_MOVED, 1.0, (_NEAR, 1))
    moved[np.arange(_NEAR), rng.integers(0, len(space), _NEAR)] = True
    shortest, longest = np.log(_STEPS)
    length = np.exp(rng.uniform(shortest, longest, (_NEAR, 1)))
    low, high = space.corners
    return np.asarray(np.clip(best + length * moved * rng.standard_normal(shape), low, high))
