"""How the bank of a screening agent grows from answer to answer."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.space.design import latin_hypercube
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History

from .bank import Bank, runnable
from .posterior import Lessons, posterior
from .refine import near_leaders
from .simulations import Simulations
from .utility import Scale, Utilities

_SPREAD, _AHEAD, _EACH = 0.4, 0.2, 0.04
"""Shares of the simulations: over the whole space, near the leaders before the first question, and
after each answer, until all are used up."""
_ROUNDS = 4
"""Number of rounds in which those before the first question are placed."""
_LEARN = 0
"""First stream of random numbers; the others place θ."""


@dataclass(frozen=True, eq=False, slots=True)
class Stage:
    """What is known when a query is made.

    Args:
        bank: Simulated θ.
        spread: Number of rows of the bank, the first ones, that fill the space.
        scale: How KPIs are measured.
        utilities: Draws of what the person wants.
        costs: Cost of each θ in each draw, lower is better, shape (s, m).
    """

    bank: Bank
    spread: int
    scale: Scale
    utilities: Utilities
    costs: Float[np.ndarray, "s m"]


class Growth:
    """The stages of a study: a function of the record, and remembered.

    Copies of an agent share it. Nothing in it has to be saved: a restored agent simulates the same
    θ again.

    Args:
        space: Knobs to tune.
        simulations: Simulations of the study.
        n_simulated: Number of θ to simulate.
        n_max: Number of experiments to show.
        seed: Seed of all randomness.
    """

    def __init__(
        self, space: KnobSpace, simulations: Simulations, n_simulated: int, n_max: int, seed: int
    ) -> None:
        self.simulations = simulations
        self._space, self._seed, self._most = space, seed, n_simulated
        self._spread = max(round(_SPREAD * n_simulated), 1)
        self._ahead = round(_AHEAD * n_simulated / _ROUNDS)
        answers = min(max(n_max - 1, 1), round((1 - _SPREAD - _AHEAD) / _EACH))
        self._each = (n_simulated - self._spread - _ROUNDS * self._ahead) // answers
        self._stages: dict[History, Stage] = {}

    def stage(self, history: History) -> Stage:
        """Return what is known after `history`, simulating what was not simulated yet."""
        past = history.until(history.answered).bare()
        if past not in self._stages:
            stage = self._begun()
            for count in range(1, past.answered + 1):
                stage = self._after(past.until(count), stage)
            self._stages[past] = stage
        return self._stages[past]

    def _begun(self) -> Stage:
        """Return the stage before the first answer: leaders by what anybody may want."""
        start = History()
        if start not in self._stages:
            design = latin_hypercube(self._space, self._spread, self._seed)
            bank = self._simulated(*runnable(self._space, design))
            stage = self._learned(start, bank, len(bank))
            for round_ in range(_ROUNDS):
                stage = self._refined(start, stage, self._ahead, round_)
            self._stages[start] = stage
        return self._stages[start]

    def _after(self, past: History, before: Stage) -> Stage:
        """Return the stage after `past`; `before` is the one without its last answers."""
        if past not in self._stages:
            stage = replace(before)
            if past.lessons() or past.unsafe():
                bank = self._with_shown(before.bank, past)
                stage = self._learned(past, bank, before.spread)
                left = max(self._most - len(bank), 0)
                stage = self._refined(past, stage, min(self._each, left))
            self._stages[past] = stage
        return self._stages[past]

    def _learned(self, past: History, bank: Bank, spread: int) -> Stage:
        """Return the stage after the answers of `past`, without new θ."""
        scale = Scale.of(bank, spread)
        lessons = Lessons.of(bank, scale, past)
        utilities = posterior(scale, lessons, self._rng(past, _LEARN))
        return Stage(bank, spread, scale, utilities, utilities.costs(scale(bank.kpis)))

    def _refined(self, past: History, stage: Stage, count: int, round_: int = 0) -> Stage:
        """Return the stage with `count` more θ near the leaders."""
        if not count or not len(stage.scale.columns):
            return stage
        rng = self._rng(past, _LEARN + 1 + round_)
        points = near_leaders(self._space, stage.bank.z, stage.costs, count, rng)
        bank = self._extended(stage.bank, *runnable(self._space, points))
        costs = stage.utilities.costs(stage.scale(bank.kpis))
        return replace(stage, bank=bank, costs=costs)

    def _with_shown(self, bank: Bank, past: History) -> Bank:
        """Return the bank with all samples of `past`, some of which a person may have given."""
        z, thetas = ([getattr(s, name) for s in past.samples] for name in ("z", "theta"))
        return self._extended(bank, np.array(z), np.array(thetas))

    def _extended(
        self, bank: Bank, z: Float[np.ndarray, "j n"], thetas: Float[np.ndarray, "j n"]
    ) -> Bank:
        return self._simulated(np.vstack([bank.z, z]), np.vstack([bank.thetas, thetas]))

    def _simulated(self, z: Float[np.ndarray, "j n"], thetas: Float[np.ndarray, "j n"]) -> Bank:
        return Bank.of(z, thetas, self.simulations(thetas))

    def _rng(self, past: History, stream: int) -> np.random.Generator:
        return np.random.default_rng([self._seed, past.answered, len(past.follow_ups), stream])
