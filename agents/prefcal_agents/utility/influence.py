"""Which answers carry the result, and what the open question can still change.

The result of another record is what its answers say, unless the draws, weighted again, hold another
experiment for noticeably better. Nothing is fitted again.
"""

from dataclasses import dataclass, replace

import numpy as np

from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.preferences.history import History

from .choice import overtaking, worth
from .pool import Pool

_SURE = 0.5
"""Probability of being noticeably better than the best by the answers, up to which an experiment
does not take its place, whoever draws."""
_JUDGES = 256
"""Number of draws that choose among several that take its place."""
_DOUBTFUL = 0.1
"""Chance of the other answer from which on it tells something that the result rests on one."""


@dataclass(frozen=True, slots=True)
class Influence:
    """What the result would be if an answer were the other way round.

    Args:
        answer: Number of the answer, that of its challenger.
        reversed: Sample that would be the best then.
        chance: Probability of that other answer, by all answers but this one.
        sure: Whether draws leave no doubt about `reversed`.
    """

    answer: int
    reversed: int
    chance: float
    sure: bool

    @property
    def doubtful(self) -> bool:
        """Return whether the other answers leave this one in doubt."""
        return self.chance >= _DOUBTFUL


def influences(pool: Pool, history: History) -> tuple[Influence, ...]:
    """Return the influence of each answer that teaches and prefers a side, in the order given.

    Args:
        pool: Draws of the study.
        history: Samples and answers.
    """
    found = []
    for index, comparison in enumerate(history.comparisons):
        if not comparison.teaches or not comparison.answer.preference:
            continue
        rest, other_way = history.retracted(index), turned(history, index)
        likely = np.exp(pool.log_likelihood(other_way) - pool.log_likelihood(rest))
        other, sure = _result(pool, other_way)
        found.append(Influence(index, other, float(pool.weights(rest) @ likely), sure))
    return tuple(found)


def decisive(found: tuple[Influence, ...], best: int) -> Influence | None:
    """Return the influence of the answer that carries the result; None if none alone does.

    Of those that surely change it, if any, it is the one that the other answers support least.
    """
    changing = [each for each in found if each.reversed != best]
    return max(changing, key=lambda each: (each.sure, each.chance), default=None)


def stakes(pool: Pool, history: History, incumbent: int) -> float:
    """Return how probably another sample is the best after the answer to the open question.

    Args:
        pool: Draws of the study, with the challenger among the samples.
        history: Samples and answers so far; the next sample is the challenger.
        incumbent: Sample that is the best so far.
    """
    given, before = pool.weights(history), pool.log_likelihood(history)
    other = total = 0.0
    for preference in (Preference.CHALLENGER, Preference.TIE, Preference.INCUMBENT):
        after = history.with_answer(Answer(preference), incumbent)
        likely = float(given @ np.exp(pool.log_likelihood(after) - before))
        total += likely
        other += likely * (_result(pool, after)[0] != incumbent)
    return other / total  # below 1 where something was unsafe, which each new experiment is better than


def turned(history: History, index: int) -> History:
    """Return the record as if the other side had been preferred in comparison `index`."""
    given = history.comparisons[index]
    preference = Preference(-int(given.answer.preference or 0))
    other = replace(given, answer=replace(given.answer, preference=preference))
    comparisons = (*history.comparisons[:index], other, *history.comparisons[index + 1 :])
    return replace(history, comparisons=comparisons, leads=())


def _result(pool: Pool, history: History) -> tuple[int, bool]:
    """Return the sample that is the best after a record, and whether draws leave no doubt."""
    best = history.by_answers
    assert best is not None  # something was answered
    count = history.answered
    better = pool.weights(history) @ (pool.costs[:, :count] < pool.costs[:, [best]] - 1.0)
    rivals = overtaking(better, history)
    if not rivals.any():
        return best, bool(better.max() < _SURE)
    value = worth(pool.drawn(history, _JUDGES).costs(pool.logs))[:, pool.shown[:count]].mean(axis=0)
    return int(np.argmax(np.where(rivals > 0, value, -np.inf))), False
