"""Choose the part of a long study to learn from: some answers, and the samples they compare."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History

from .lessons import kpis_of

MOST = 250
"""Maximum number of answers to learn from, so that a proposal takes less than a second."""
_OLDEST = 0.25  # share of the oldest answers: their samples are spread over the whole space
_SAMPLES = 4 / 3  # maximum number of samples that these compare, in units of `MOST`


@dataclass(frozen=True, slots=True)
class Memory:
    """The part of a history to learn from, as a history of its own.

    If a study has more than `MOST` answers or samples, this part holds `MOST` answers: the oldest
    and the latest, and the last answer about a sample before its earlier ones. It also holds the
    samples that they compare, the best one, and the latest others until there are `MOST` samples.
    A shorter study is kept as it is.

    Source: none.
    Deviation: the paper learns from all answers, in at most 50 experiments; the time this takes
    grows with the cube of their number. What the limit costs: docs/research/better-glisp.md.

    Args:
        history: Samples and answers, renumbered.
        kept: Indices of the samples in the whole history, increasing, shape (K,).
    """

    history: History
    kept: Int[np.ndarray, " K"]

    @classmethod
    def of(cls, history: History, most: int = MOST) -> "Memory":
        """Return the part of `history` to learn from: at most `most` answers."""
        count = history.answered
        lessons = [c for c in history.in_order() if c.teaches]
        if max(count, len(lessons)) <= most:
            return cls(history, np.arange(count))
        samples = {history.incumbent or 0}
        chosen: list[int] = []
        for h in _by_weight(lessons, most):
            both = samples | {lessons[h].challenger, lessons[h].incumbent or 0}
            if len(chosen) < most and len(both) <= _SAMPLES * most:
                chosen.append(h)
                samples = both
        others = [i for i in range(count) if i not in samples]
        samples.update(others[len(others) - max(min(most, count) - len(samples), 0) :])
        kept = np.array(sorted(samples), dtype=np.int64)
        return cls(_part(history, [lessons[h] for h in sorted(chosen)], kept), kept)


def _by_weight(lessons: list[Comparison], most: int) -> list[int]:
    """Return the numbers of the comparisons, the most important ones first."""
    later = [0] * len(lessons)  # comparisons of the same challenger that followed
    seen: dict[int, int] = {}
    for h in reversed(range(len(lessons))):
        later[h] = seen.get(lessons[h].challenger, 0)
        seen[lessons[h].challenger] = later[h] + 1
    oldest = [h for h in range(len(lessons)) if not later[h]][: int(_OLDEST * most)]
    rest = set(range(len(lessons))) - set(oldest)
    return [*oldest, *sorted(rest, key=lambda h: (later[h], -h))]


def _part(history: History, lessons: list[Comparison], kept: Int[np.ndarray, " K"]) -> History:
    """Return a history of the samples `kept` and of `lessons`; other samples only teach KPIs."""
    number = {int(index): k for k, index in enumerate(kept)}
    own = {c.challenger: c for c in lessons if c.after is None}
    kpis, comparisons, follow_ups = kpis_of(history), [], []
    for index, k in number.items():
        if index in own:
            comparisons.append(_renumbered(own[index], number))
        else:
            known = (kpis[index], None) if kpis[index] else None
            comparisons.append(Comparison(k, None, Answer(None, outcomes=known)))
    for c in lessons:
        if c.after is not None:
            after = int(np.searchsorted(kept, c.after))
            follow_ups.append(replace(_renumbered(c, number), after=after))
    return History(
        tuple(history.samples[index] for index in number), tuple(comparisons), tuple(follow_ups)
    )


def _renumbered(comparison: Comparison, number: dict[int, int]) -> Comparison:
    assert comparison.incumbent is not None  # it teaches
    first, second = number[comparison.challenger], number[comparison.incumbent]
    return replace(comparison, challenger=first, incumbent=second)
