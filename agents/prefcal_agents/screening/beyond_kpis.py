"""What Screening shows if KPIs do not explain the answers: GLISp on θ alone proposes."""

import numpy as np
from jaxtyping import Float

from prefcal_agents.glisp.selection import ModelSelection
from prefcal_agents.glisp.settings import GLISpSettings, Setup
from prefcal_agents.glisp.strategy import propose
from prefcal_agents.utility.posterior import AFTER, explains
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import Comparison, History

from .growth import Stage
from .simulations import Simulations

_STALLED = 5
"""Number of challengers lost in a row after which every second one is proposed without KPIs."""
_UNTIL, _EVERY = 30, 4
"""Until so many answers, every fourth such proposal fills the space, as the start of GLISp does."""


def without_kpis(history: History, stage: Stage) -> bool:
    """Return whether the next θ is proposed without KPIs."""
    known = not stage.bank.hopeless[stage.spread].all()
    return known and (
        is_stalled(history) or not explains(history, stage.bank, stage.scale, stage.utilities)
    )


def is_stalled(history: History) -> bool:
    """Return whether it is the turn of a proposal without KPIs, since those with them all lost."""
    lessons = history.lessons()
    lost = not any(_won(c) for c in lessons[-_STALLED:])
    strict = any(c.answer.preference for c in lessons)
    return len(lessons) >= AFTER and len(lessons) % 2 == 1 and lost and strict


def _won(comparison: Comparison) -> bool:
    """Return whether the challenger won."""
    verdict = comparison.verdict
    return verdict is not None and verdict.winner == comparison.challenger


class BeyondKPIs:
    """Proposals from answers and θ alone; what it remembers only saves time."""

    def __init__(self, simulations: Simulations, space: KnobSpace, seed: int) -> None:
        self._models = ModelSelection(Setup(space, AFTER, seed, GLISpSettings(kpis=False)))

    def propose(self, history: History, stage: Stage) -> Float[np.ndarray, " n"]:
        """Return the next point of the cube, shape (n,)."""
        count = len(history.lessons())
        if count < _UNTIL and count % _EVERY == _EVERY - 1:
            rows = stage.spread[~stage.bank.hopeless[stage.spread]]
            return np.asarray(stage.bank.z[rows[count % len(rows)]])
        return propose(self._models.setup, self._models.fit(history))
