"""Whether KPIs explain what a person answers.

A person may judge by something that no KPI measures. Then a model over θ explains the answers
better.
"""

import numpy as np
from scipy.special import logsumexp

from prefcal_agents.history.lessons import Preferences
from prefcal_agents.models.gaussian_process import predicted
from prefcal_env.preferences.history import Comparison, History

from .bank import Bank
from .posterior import Lessons
from .utilities import Scale, Utilities

AFTER = 10
"""Number of answers before KPIs can be left; fewer say too little."""
_MARGIN = 2.0
"""Nats by which θ must predict the answers better than KPIs."""
_ERROR = 0.03
"""Rate of wrong answers of the model over θ."""
_STALLED = 5
"""Number of challengers lost in a row after which every second one is proposed without KPIs."""


def explains(history: History, bank: Bank, scale: Scale, utilities: Utilities) -> bool:
    """Return whether KPIs predict the answers about as well as θ does, or too few are known.

    Args:
        history: Samples and answers.
        bank: KPIs of all samples, and of others.
        scale: How the KPIs are measured.
        utilities: Draws of what the person wants, given the answers.
    """
    lessons = history.lessons()
    if len(lessons) < AFTER or not any(c.answer.preference for c in lessons):
        return True
    by_kpis = _by_kpis(history, Lessons.of(bank, scale, history), utilities)
    return bool(predicted(Preferences.of(history), _ERROR) <= by_kpis + _MARGIN)


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


def _by_kpis(history: History, lessons: Lessons, utilities: Utilities) -> float:
    """Return the log probability of the strict answers, each predicted from the others.

    Source: A. E. Gelfand, D. K. Dey, H. Chang, "Model determination using predictive
    distributions" (1992): the harmonic mean over draws given all answers.
    """
    strict = ~lessons.tie
    strict[len(history.lessons()) :] = False  # those that marks make are no answers
    logs = lessons.log_probabilities(utilities)[:, strict]
    return float(np.sum(np.log(len(logs)) - logsumexp(-logs, axis=0)))
