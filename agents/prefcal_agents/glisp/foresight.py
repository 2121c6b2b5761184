"""What the next experiment can bring, for people and plants unlike the draws, too.

The draws' own chance is too sure. So it enters a formula with how the answers went, which was
fitted to simulated people of eleven kinds, and checked on other loops and people
(docs/research/certificate.md).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

FROM = 5
"""Number of answers from which on something can be said."""
_CHANCE = (-0.69, 0.48, -0.25)
"""Coefficients of the logit of the chance: a constant, then of what `Foresight.terms` returns.

Source: none. A logistic regression of whether the next experiment is noticeably better.
"""
_SURE = 0.996
"""Largest share of the draws that is believed; 1 minus it is the smallest."""


@dataclass(frozen=True, slots=True)
class Foresight:
    """What draws and answers say of the next experiment, before it runs.

    Args:
        better: Share of the draws to which it is noticeably better than the best so far; None if
            KPIs do not explain the answers.
        lost: Number of answers since a challenger won, see `lost_since`.
    """

    better: float | None
    lost: int

    @property
    def terms(self) -> tuple[float, ...]:
        """Return the numbers in which the logit of the chance is linear; none if nothing can be said."""
        if self.better is None:
            return ()
        return float(logit(np.clip(self.better, 1.0 - _SURE, _SURE))), float(np.log1p(self.lost))

    @property
    def chance(self) -> float | None:
        """Return the chance that it is noticeably better; None if nothing can be said."""
        constant, *slopes = _CHANCE
        return float(expit(constant + np.dot(slopes, self.terms))) if self.terms else None


def lost_since(history: History) -> int:
    """Return the number of answers since a challenger won; all of them if none did."""
    won = [c.answer.preference is Preference.CHALLENGER for c in reversed(history.lessons())]
    return won.index(True) if True in won else len(won)
