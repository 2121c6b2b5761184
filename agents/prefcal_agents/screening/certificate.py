"""What can be said of a result: how many θ are noticeably better, for people unlike the draws, too.

The draws' own shares are too sure about people who judge by something that no draw looks at. So
what they say, and how the answers went, enters a formula that was fitted to simulated people of
eleven kinds, and checked on other loops and people (docs/research/certificate.md).
"""

from dataclasses import dataclass
from math import ceil
from typing import Self

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import expit, logit, logsumexp

from prefcal_agents.utility.posterior import Lessons, explains
from prefcal_agents.utility.utilities import Utilities, noticed
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import History

from .growth import Stage

FROM = 2
"""Number of answers from which on something can be said."""
PROBABILITY = 0.95
"""How probably fewer θ are better than is said."""
LEAST = 0.01
"""Smallest share that is said."""
MOST = 1000
"""Largest number of random experiments that is said: 8,192 tell little of more."""
ENOUGH_AFTER, ENOUGH_SHARE, ENOUGH_CHANCE = (6, 8), 0.1, 0.5
"""Numbers of answers after which a study can end, and the largest share and chance with which it does.

Source: none. Of the rules that ask ten questions at most, one that keeps nine tenths of what ten
answers are worth. There are two looks, since each one can end a study by mistake.
"""
_BY_CHANCE = -1.1
"""Mean log probability of an answer, in nats, if each of the three is as likely: log(1/3)."""
_SHARE = (1.583, 0.382, -0.177, -0.169, 0.615, -0.364)
"""Coefficients of log10 of the share: a constant, then of what `Evidence.terms` returns.

Source: none. An ordinal logistic regression of how many random θ are noticeably better, at 99 %:
above what is promised, so that it holds for each kind of people by itself and for new ones.
"""
_AT, _STEP = 0.01, 0.544
"""Chance of being exceeded for which the constant of the share is, and by how many decades the share
falls where the logit of that chance is larger by 1, by the same regression."""
_INTERVAL = (0.05, 0.5, 0.95)
"""Chances of being exceeded, by that regression, of the shares that numbers of experiments follow from."""
_CHANCE = 0.72
"""How much the logit of the draws' chance counts, by a logistic regression."""
_ADDED = 0.001
"""What is added to shares before their logarithm."""
_QUANTILE = 0.9
"""Quantile over the draws of the share of the θ that fill the space."""
_AT_ONCE = 200
"""Number of θ that are compared with the result at a time, which bounds the memory."""
_SURE = 0.98
"""Largest chance that is believed; 1 minus it is the smallest."""


@dataclass(frozen=True, slots=True)
class Evidence:
    """What draws and answers say of a result.

    Args:
        answers: Number of answers, 1 or more.
        better: Share of the simulated θ that are noticeably better than the result, the mean over
            the draws.
        wide: Share of those θ that fill the space which are, exceeded by a tenth of the draws.
        held: How far the result has held against challengers since it won: the sum of -log(1 - p),
            where p is the chance that each would win, by the draws and all other answers.
        predicted: Mean logarithm of the probability of each answer by all others, in nats.
        explained: Whether KPIs predict the answers about as well as θ does, see `explains`.
        chance: Share of the draws to which the most promising θ is noticeably better.
        promising: The most promising θ of those that were not shown, physical.
    """

    answers: int
    better: float
    wide: float
    held: float
    predicted: float
    explained: bool
    chance: float
    promising: tuple[float, ...]

    @property
    def terms(self) -> tuple[float, ...]:
        """Return the numbers in which the logarithm of the share is linear."""
        better, wide = np.log10(np.array([self.better, self.wide]) + _ADDED).tolist()
        return better, float(np.log(self.answers)), self.held, wide, self.predicted


@dataclass(frozen=True, slots=True)
class Certificate:
    """What can be said of a result, so that it holds for people who are not the learner's own.

    Args:
        share: Share of random θ of which fewer are noticeably better than the result, 0.01 to 1;
            None if the answers do not follow from the KPIs.
        probability: Probability that this is true.
        chance: Chance that the most promising θ is noticeably better than the result; None if the
            answers do not follow from the KPIs.
        promising: The most promising θ of those that were not shown, physical.
        experiments: Number of random experiments whose best one is as good as the result: the lower
            end of a 90 % interval for people of all kinds together, the median, and the upper end,
            1 to 1000, which stands for more, too. None if the answers do not follow from the KPIs.
        enough: Whether so little is left that a study can end, after 6 and 8 answers.
    """

    share: float | None
    probability: float
    chance: float | None
    promising: tuple[float, ...]
    experiments: tuple[float, float, float] | None = None
    enough: bool = False

    @property
    def explained(self) -> bool:
        """Return whether the answers follow from the KPIs: otherwise no number is stated."""
        return self.share is not None

    @classmethod
    def of(cls, found: Evidence) -> Self:
        """Return what can be said by the evidence.

        Nothing can if the draws predict each answer from the others no better than by chance, or
        if θ predicts them better.
        """
        if found.predicted < _BY_CHANCE or not found.explained:
            return cls(None, PROBABILITY, None, found.promising)
        constant, *slopes = _SHARE
        size = constant + float(np.dot(slopes, found.terms))
        share = ceil(100 * np.clip(10.0 ** min(size, 0.0), LEAST, 1.0)) / 100
        believed = np.clip(found.chance, 1.0 - _SURE, _SURE)
        chance = float(expit(_CHANCE * logit(believed)))
        enough = found.answers in ENOUGH_AFTER and share <= ENOUGH_SHARE and chance <= ENOUGH_CHANCE
        return cls(share, PROBABILITY, chance, found.promising, _experiments(size), enough)


def _experiments(size: float) -> tuple[float, float, float]:
    """Return the `experiments` of a certificate, given log10 of the share that is said.

    The best of N random experiments is as good as the result if N find something noticeably better
    with probability 1/2: (1 - s)^N = 1/2, with s the share of all θ that are better.
    """
    logs = size + _STEP * (logit(_AT) - logit(_INTERVAL))
    low, middle, high = np.clip(np.log(2) / -np.log1p(-np.minimum(10.0**logs, 0.5)), 1, MOST).tolist()
    return low, middle, high


def evidence(stage: Stage, best: int, history: History) -> Evidence:
    """Return what draws and answers say of row `best` of the bank.

    Args:
        stage: What is known after `history`.
        best: Row of the result.
        history: Samples and answers, one answer or more.
    """
    count = len(stage.utilities)
    draws = stage.utilities.take(np.arange(0, count, count // len(stage.costs)))
    better = _better(draws, stage.logs, best) & ~stage.bank.hopeless
    chances = better.mean(axis=0)
    chances[[stage.bank.find(sample.theta) for sample in history.samples[: history.answered]]] = 0.0
    row = int(np.argmax(chances))
    held, predicted = _foretold(draws, Lessons.of(stage.bank, stage.scale, history), history)
    return Evidence(
        answers=len(history.lessons()),
        better=float(better.mean()),
        wide=float(np.quantile(better[:, stage.spread].mean(axis=1), _QUANTILE)),
        held=held,
        predicted=predicted,
        explained=explains(history, stage.bank, stage.scale, stage.utilities),
        chance=float(chances[row]),
        promising=tuple(stage.bank.thetas[row].tolist()),
    )


def _better(draws: Utilities, logs: Float[np.ndarray, "m k"], best: int) -> Bool[np.ndarray, "s m"]:
    """Return to which draws each θ is noticeably better than row `best`, shape (s, m).

    The two are compared as people compare them. Costs, which order all θ at once, count the steps
    of an order from the best value, which splits differences that nobody notices.
    """
    found = np.zeros((len(draws), len(logs)), dtype=np.bool_)
    for rows in np.array_split(np.arange(len(logs)), -(-len(logs) // _AT_ONCE)):
        levels = draws.levels(logs[np.append(rows, best)])
        each = np.arange(len(rows))
        found[:, rows] = draws.gains(levels, each, np.full(len(rows), len(rows))).sum(axis=0) > 1.0
    return found


def _foretold(draws: Utilities, lessons: Lessons, history: History) -> tuple[float, float]:
    """Return `held` and `predicted` of `Evidence`.

    Source: A. E. Gelfand, D. K. Dey, H. Chang, "Model determination using predictive
    distributions" (1992): draws given all answers tell one of them by the others, if each draw
    counts by the inverse of the probability that it gives to that answer.
    """
    asked = history.lessons()
    count = len(asked)  # those that marks make are no answers
    logs = lessons.log_probabilities(draws)[:, :count]
    shares = np.exp(-logs - logsumexp(-logs, axis=0))
    gain = draws.gains(draws.levels(lessons.logs), lessons.better, lessons.worse).sum(axis=0)
    of_challenger = np.where(lessons.tie, gain, -gain)[:, :count]  # where it did not win
    chance = np.sum(shares * noticed(of_challenger), axis=0)
    won = [k for k, c in enumerate(asked) if c.answer.preference is Preference.CHALLENGER]
    since = won[-1] + 1 if won else 0
    held = -np.log1p(-np.minimum(chance[since:], _SURE)).sum()
    predicted = np.mean(np.log(len(logs)) - logsumexp(-logs, axis=0))
    return float(held), float(predicted)
