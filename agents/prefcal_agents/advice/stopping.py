"""Advise whether to stop, from what another ten experiments are expected to gain."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison, History

AHEAD = 10
"""Number of experiments that the advice looks ahead."""
_LEAST = 5
"""Minimum number of verdicts for an advice."""
_HALF_LIFE = 7.0
"""Number of experiments after which a verdict counts half."""
_TIE = 5.0
"""Number of verdicts against a new experiment that a tie counts as."""
_PRIOR = (0.2, 0.8)
"""Prior counts of improvements and of verdicts against one."""
_PROBABLY, _HARDLY = 0.75, 0.25
"""Probability of no improvement above which to stop, and below which to continue."""


@dataclass(frozen=True, slots=True)
class Advice:
    """The expected gain of the next `AHEAD` experiments, estimated from the improvements so far.

    Source: none. An estimate like Krichevsky-Trofimov's: counts with a prior, so the rate has a
    beta distribution and the number a beta-binomial one. Its accuracy: docs/research/archive.md.

    Args:
        recent: Number of the latest compared experiments, at most `AHEAD`.
        improved: Number of these that became the best.
        expected: Expected number of improvements among the next `AHEAD` experiments.
        low: Number of improvements that is missed with a probability of at most 10 %.
        high: Number of improvements that is exceeded with a probability of at most 10 %.
        none: Probability that none of them improves, 0 to 1.
    """

    recent: int
    improved: int
    expected: float
    low: int
    high: int
    none: float

    @property
    def stop(self) -> bool:
        """Return whether another `AHEAD` experiments would probably find nothing better."""
        return self.none >= _PROBABLY

    @property
    def text(self) -> str:
        """Return in one sentence whether to continue, with the numbers behind it."""
        if not self.stop:
            return self.estimate
        return f"It is a good time to stop: {self.estimate[0].lower()}{self.estimate[1:]}"

    @property
    def estimate(self) -> str:
        """Return the numbers in one sentence, without the advice to stop."""
        ahead = f"another {AHEAD} experiments"
        record = f"{self.improved} of the last {self.recent} beat the best before"
        nothing = f"{100 * self.none:.0f} %" if self.none >= 0.005 else "less than 1 %"
        if self.stop:
            return f"With a chance of {nothing}, {ahead} would bring nothing better ({record})."
        odds = "are likely to" if self.none < _HARDLY else "may"
        about = f"about {max(round(self.expected), 1)} would beat the best"
        return (
            f"{ahead.capitalize()} {odds} bring a better one: {about}, none with a chance of "
            f"{nothing} ({record})."
        )


def advise(history: History) -> Advice | None:
    """Return the advice after `history`; None while too little is known.

    An improvement is a new experiment that became the best. Abstentions and retracted answers do
    not count; a tie counts more than a defeat, since it shows that differences have become too
    small to see. Recent experiments count more than old ones.

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
    chances = _beta_binomial(AHEAD, a, b)
    low, high = np.searchsorted(np.cumsum(chances), (0.1, 0.9))
    return Advice(
        recent=min(AHEAD, len(verdicts)),
        improved=int(won[-AHEAD:].sum()),
        expected=AHEAD * a / (a + b),
        low=int(low),
        high=int(high),
        none=float(chances[0]),
    )


def _beta_binomial(n: int, a: float, b: float) -> Float[np.ndarray, " N"]:
    """Return the beta-binomial probabilities of 0 to n, shape (n + 1,).

    scipy.stats.betabinom is the same and takes 0.4 s to import.
    """
    from scipy.special import betaln, binom  # takes a tenth of a second to import

    k = np.arange(n + 1)
    return np.asarray(binom(n, k) * np.exp(betaln(k + a, n - k + b) - betaln(a, b)))


def _verdicts(history: History) -> list[Preference]:
    """Return the verdict on each new experiment against the best before it."""
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
