"""Stopping advice: what another ten experiments would be expected to gain."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from prefcal_agents.history.history import Comparison, History
from prefcal_env.preferences.answer import Preference

AHEAD = 10
"""Experiments that the advice looks ahead."""
_LEAST = 5
"""Verdicts below which nothing is said."""
_HALF_LIFE = 7.0
"""Experiments after which a verdict counts half."""
_TIE = 5.0
"""Verdicts against a new experiment that one tie is worth."""
_PRIOR = (0.2, 0.8)
"""Imagined improvement, and verdict against one."""
_PROBABLY, _HARDLY = 0.75, 0.25
"""Chance of no improvement from which on stopping is advised, and below which going on is."""


@dataclass(frozen=True, slots=True)
class Advice:
    """What the record of improvements and the surrogate say of the next `AHEAD` experiments.

    Source: none. A Krichevsky-Trofimov-like estimate (counts with a prior, so a beta distribution
    of the rate and a beta-binomial one of the number); how well it foretells:
    docs/research/stopping.md.

    Args:
        recent: How many of the latest experiments were compared, `AHEAD` at most.
        improved: How many of these became the best.
        expected: Improvements expected among the next `AHEAD` experiments.
        low: Number of improvements that is not reached with a chance of 10 % at most.
        high: Number of improvements that is exceeded with a chance of 10 % at most.
        none: Chance that none of them improves, 0 to 1.
    """

    recent: int
    improved: int
    expected: float
    low: int
    high: int
    none: float

    @property
    def stop(self) -> bool:
        """Whether another `AHEAD` experiments would probably bring nothing better."""
        return self.none >= _PROBABLY

    @property
    def text(self) -> str:
        """Whether to go on, in one sentence, with the numbers that it rests on."""
        ahead = f"another {AHEAD} experiments"
        record = f"{self.improved} of the last {self.recent} beat the best before"
        nothing = f"{100 * self.none:.0f} %" if self.none >= 0.005 else "less than 1 %"
        if self.stop:
            return (
                f"It is a good time to stop: with a chance of {nothing}, {ahead} would bring "
                f"nothing better ({record})."
            )
        odds = "are likely to" if self.none < _HARDLY else "may"
        about = f"about {max(round(self.expected), 1)} would beat the best"
        return (
            f"{ahead.capitalize()} {odds} bring a better one: {about}, none with a chance of "
            f"{nothing} ({record})."
        )


def advise(history: History) -> Advice | None:
    """The advice after `history`; None while too little is known.

    An improvement is a new experiment that became the best. Abstentions and retracted answers
    count as nothing; a tie counts for more than a defeat, since it says that the differences
    have become too small to see. Recent experiments count more than old ones.

    Args:
        history: Samples and answers.
    """
    verdicts = _verdicts(history)
    if len(verdicts) < _LEAST:
        return None
    age = np.arange(len(verdicts))[::-1]
    weights = 0.5 ** (age / _HALF_LIFE)
    won = np.array([v is Preference.CHALLENGER for v in verdicts])
    against = np.where([v is Preference.TIE for v in verdicts], _TIE, 1.0) * ~won
    a, b = _PRIOR[0] + float(weights @ won), _PRIOR[1] + float(weights @ against)
    from scipy.stats import betabinom  # takes most of a second to import

    number = betabinom(AHEAD, a, b)
    return Advice(
        recent=min(AHEAD, len(verdicts)),
        improved=int(won[-AHEAD:].sum()),
        expected=float(number.mean()),
        low=int(number.ppf(0.1)),
        high=int(number.ppf(0.9)),
        none=float(number.pmf(0)),
    )


def _verdicts(history: History) -> list[Preference]:
    """On each new experiment against the best before it."""
    scored = [c.value for c in history.comparisons if c.value is not None]
    if scored:
        lowest = np.minimum.accumulate(scored).tolist()
        return [
            Preference.CHALLENGER if after < before else Preference.INCUMBENT
            for before, after in pairwise(lowest)
        ]
    return [_verdict(c) for c in history.comparisons if c.teaches]


def _verdict(comparison: Comparison) -> Preference:
    assert comparison.answer.preference is not None
    return comparison.answer.preference
