"""What KPIs do not explain: when to leave them, and what to show then.

A person may judge by something that no KPI measures. Then a surrogate over θ explains the answers
better, and GLISp proposes.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from prefcal_agents.glisp.selection import ModelSelection
from prefcal_agents.glisp.settings import GLISpSettings
from prefcal_agents.glisp.strategy import Setup, propose
from prefcal_agents.history.lessons import Preferences
from prefcal_agents.models.gaussian_process import predicted
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.qp import make_backend

from .growth import Stage
from .posterior import Lessons

_AFTER = 10
"""Number of answers before KPIs can be left; fewer say too little."""
_MARGIN = 2.0
"""Nats by which θ must predict the answers better than KPIs."""
_ERROR = 0.03
"""Rate of wrong answers of the surrogate over θ."""
_STALLED = 5
"""Number of challengers lost in a row after which every second one is proposed without KPIs."""
_UNTIL, _EVERY = 30, 4
"""Until so many answers, every fourth such proposal fills the space, as the start of GLISp does."""


class BeyondKPIs:
    """Proposals from answers and θ alone; what it remembers only saves time.

    Args:
        space: Knobs to tune.
        seed: Seed of all randomness.
    """

    def __init__(self, space: KnobSpace, seed: int) -> None:
        settings, backend = GLISpSettings(outcome_scales=(0.0,)), make_backend("piqp")
        self._setup = Setup(space, _AFTER, seed, settings, backend)
        self._models = ModelSelection(len(space), _AFTER, settings, seed, backend)

    def is_next(self, history: History, stage: Stage) -> bool:
        """Return whether the next θ is proposed without KPIs."""
        lessons = history.lessons()
        known = not stage.bank.hopeless[stage.spread].all()
        if len(lessons) < _AFTER or not known or not any(c.answer.preference for c in lessons):
            return False
        if len(lessons) % 2 and not any(_won(c) for c in lessons[-_STALLED:]):
            return True
        by_theta = predicted(Preferences.of(history), _ERROR)
        return by_theta > _by_kpis(history, stage) + _MARGIN

    def propose(self, history: History, stage: Stage) -> Float[np.ndarray, " n"]:
        """Return the next point of the cube, shape (n,)."""
        count = len(history.lessons())
        if count < _UNTIL and count % _EVERY == _EVERY - 1:
            rows = stage.spread[~stage.bank.hopeless[stage.spread]]
            return np.asarray(stage.bank.z[rows[count % len(rows)]])
        return propose(self._setup, self._models.fit(history))


def _won(comparison: Comparison) -> bool:
    """Return whether the challenger won."""
    verdict = comparison.verdict
    return verdict is not None and verdict.winner == comparison.challenger


def _by_kpis(history: History, stage: Stage) -> float:
    """Return the log probability of the strict answers, each predicted from the others.

    Source: A. E. Gelfand, D. K. Dey, H. Chang, "Model determination using predictive
    distributions" (1992): the harmonic mean over draws given all answers.
    """
    lessons = Lessons.of(stage.bank, stage.scale, history)
    strict = ~lessons.tie
    strict[len(history.lessons()) :] = False  # those that marks make are no answers
    logs = lessons.log_probabilities(stage.utilities)[:, strict]
    return float(np.sum(np.log(len(logs)) - logsumexp(-logs, axis=0)))
