"""What a record teaches: training data as arrays, and what is worked out answer by answer."""

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Any, Generic, TypeVar, final

import numpy as np
from jaxtyping import Bool, Float, Int

from prefcal_env.preferences.answer import Answer, Mark, Outcome
from prefcal_env.preferences.history import Comparison, History, KPIValues

_GOOD = (Mark.CHALLENGER_GOOD_ENOUGH, Mark.INCUMBENT_GOOD_ENOUGH)


@dataclass(frozen=True, slots=True)
class Preferences:
    """M comparisons of N samples as training data: the vector B of eq. pref-vector."""

    samples: Float[np.ndarray, "N n"]  # points of the unit cube, shape (N, n)
    first: Int[np.ndarray, " M"]  # i(h), the challenger of comparison h, shape (M,)
    second: Int[np.ndarray, " M"]  # j(h), the incumbent that it was compared with, shape (M,)
    b: Int[np.ndarray, " M"]  # preference b_h in {-1, 0, 1}, shape (M,); -1: the first is better
    weights: Float[np.ndarray, " M"]  # c_h of eq. QP-pref, above 0, shape (M,).

    @classmethod
    def of(cls, history: History) -> "Preferences":
        """Return the comparisons of all answers that are not retracted."""
        lessons = history.lessons
        return cls(
            samples=cube_of(history),
            first=np.array([c.challenger for c in lessons], dtype=np.int64),
            second=np.array([c.incumbent for c in lessons], dtype=np.int64),
            b=np.array([c.answer.preference for c in lessons], dtype=np.int64),
            weights=np.array([c.answer.strength for c in lessons], dtype=float),
        )

    def __len__(self) -> int:
        return len(self.b)

    def subset(self, rows: Int[np.ndarray, " K"]) -> "Preferences":
        """Return only the comparisons `rows`, on all samples."""
        return Preferences(
            self.samples, self.first[rows], self.second[rows], self.b[rows], self.weights[rows]
        )


@dataclass(frozen=True, slots=True)
class Marks:
    """Marks of the K samples that a calibrator looked at."""

    samples: Float[np.ndarray, "K n"]  # points of the unit cube, shape (K, n)
    unsafe: Bool[np.ndarray, " K"]  # whether unsafe, shape (K,); a sample without that mark counts as safe

    @classmethod
    def of(cls, history: History) -> "Marks":
        """Return the marks of all answers that are not retracted; one answer is enough.

        The answer to the first query often comes from a program: it can mark sample 0, but
        without a mark it does not say that sample 0 is safe. Nor is a run known to be safe that
        was cut short: what it became is unknown.
        """
        unsafe, seen, good = history.unsafe, set[int](), set[int | None]()
        for c in history.counting:
            if c.retracted:
                continue
            sides = dict(zip(_GOOD, (c.challenger, c.incumbent), strict=True))
            good.update(sides[mark] for mark in c.answer.marks if mark in sides)
            if c.incumbent is not None:
                seen.update((c.challenger, c.incumbent))
        safe = (seen - history.cut_short) | {i for i in good if i is not None}
        known = np.array(sorted(safe | unsafe), dtype=np.int64)
        labels = np.array([index in unsafe for index in known], dtype=np.bool_)
        return cls(cube_of(history)[known], labels)


def cube_of(history: History) -> Float[np.ndarray, "N n"]:
    """Return the points of the samples that are answered, shape (N, n); (0, 0) if none is."""
    if not history.answered:
        return np.zeros((0, 0))
    return np.array([s.z for s in history.samples[: history.answered]], dtype=float)


def scores_of(history: History) -> tuple[Int[np.ndarray, " K"], Float[np.ndarray, " K"]]:
    """Return the indices of the samples with a score, and the scores, both of shape (K,)."""
    scores = {c.challenger: c.value for c in history.comparisons if c.value is not None}
    return np.array([*scores], dtype=np.int64), np.array([*scores.values()], dtype=float)


def fill_kpis(history: History) -> KPIValues:
    """Return each KPI of all samples that are answered.

    A missing one is that of the nearest θ that has it. KPIs with fewer than three values are left
    out, since nothing can be learned from them.
    """
    z, (names, known) = cube_of(history), history.kpis
    often = np.count_nonzero(~np.isnan(known), axis=0) >= _FEWEST
    filled = np.compress(often, known, axis=1)
    for values in filled.T:
        missing = np.isnan(values)
        there = np.flatnonzero(~missing)
        apart = np.sum((z[missing][:, None] - z[there]) ** 2, axis=2)
        values[missing] = values[there[np.argmin(apart, axis=1)]]
    return KPIValues(tuple(name for name, is_kept in zip(names, often, strict=True) if is_kept), filled)


_FEWEST = 3  # smallest number of experiments with a KPI to learn from it
MOST = 250  # maximum number of answers to learn from, so that a proposal takes less than a second
_OLDEST = 0.25  # share of the oldest answers: their samples are spread over the whole space
_SAMPLES = 4 / 3  # maximum number of samples that these compare, in units of `MOST`


@dataclass(frozen=True, slots=True)
class Subset:
    """The part of a history to learn from, as a history of its own.

    If a study has more than `MOST` answers or samples, this part holds `MOST` answers: the oldest
    and the latest, and the last answer about a sample before its earlier ones. It also holds the
    samples that they compare, the best one, and the latest others until there are `MOST` samples.
    A shorter study is kept as it is.

    Source: none.
    Deviation: the paper learns from all answers, in at most 50 experiments; the time this takes
    grows with the cube of their number. What the limit costs: docs/research/archive.md.
    """

    history: History  # samples and answers, renumbered
    kept: Int[np.ndarray, " K"]  # indices of the samples in the whole history, increasing, shape (K,)

    @classmethod
    def of(cls, history: History, most: int = MOST) -> "Subset":
        """Return the part of `history` to learn from: at most `most` answers."""
        count = history.answered
        lessons = history.lessons
        if max(count, len(lessons)) <= most:
            return cls(history, np.arange(count))
        samples = {history.incumbent or 0}
        chosen: list[int] = []
        for h in _by_weight(lessons, most):
            both = samples | {lessons[h].challenger, lessons[h].incumbent or 0}
            if len(chosen) < most and len(both) <= _SAMPLES * most:
                chosen.append(h)
                samples = both
        # Samples without an answer that is kept still have KPIs, from which processes learn.
        others = [i for i in range(count) if i not in samples]
        samples.update(others[len(others) - max(min(most, count) - len(samples), 0) :])
        kept = np.array(sorted(samples), dtype=np.int64)
        return cls(_history_of(history, [lessons[h] for h in sorted(chosen)], kept), kept)


def _by_weight(lessons: Sequence[Comparison], most: int) -> list[int]:
    """Return the numbers of the comparisons, the most important ones first."""
    later = [0] * len(lessons)  # comparisons of the same challenger that followed
    seen: dict[int, int] = {}
    for h in reversed(range(len(lessons))):
        later[h] = seen.get(lessons[h].challenger, 0)
        seen[lessons[h].challenger] = later[h] + 1
    # Only the last answer about each sample, so that the oldest ones cover as many samples as they can.
    oldest = [h for h in range(len(lessons)) if not later[h]][: int(_OLDEST * most)]
    rest = set(range(len(lessons))) - set(oldest)
    return [*oldest, *sorted(rest, key=lambda h: (later[h], -h))]


def _history_of(history: History, lessons: Sequence[Comparison], kept: Int[np.ndarray, " K"]) -> History:
    """Return a history of the samples `kept` and of `lessons`; other samples only teach KPIs."""
    number = {int(index): k for k, index in enumerate(kept)}
    own = {c.challenger: c for c in lessons if c.after is None}
    kpis, comparisons, follow_ups = history.kpis, [], []
    for index, k in number.items():
        if index in own:
            comparisons.append(_renumber(own[index], number))
        else:
            known = kpis.outcome(index)
            given = Answer(None, outcomes=None if known is None else (known, None))
            comparisons.append(Comparison(k, None, given))
    for c in lessons:
        if c.after is not None:
            # Follow-ups are numbered by the answers before them, of which some are left out now.
            after = int(np.searchsorted(kept, c.after))
            follow_ups.append(replace(_renumber(c, number), after=after))
    return History(tuple(history.samples[index] for index in number), tuple(comparisons), tuple(follow_ups))


def _renumber(comparison: Comparison, number: dict[int, int]) -> Comparison:
    assert comparison.incumbent is not None  # it teaches
    first, second = number[comparison.challenger], number[comparison.incumbent]
    return replace(comparison, challenger=first, incumbent=second)


def judged(history: History) -> History:
    """Return `history` for a model that learns from KPIs; the same object if no run was cut short.

    The KPIs of a run that was cut short are lower bounds. Whole runs of similar θ have larger ones,
    so each KPI becomes that of the nearest θ whose run was completed before, or its bound if that
    is larger. Answers about such a run teach nothing about KPIs: they follow from what was learned,
    or are about half a run.
    """
    cut = history.cut_short
    if not cut:
        return history
    z, (names, kpis), partial = cube_of(history), history.kpis, cut | history.unsafe
    # Interrupted runs have infinite KPIs. So have those that never settle, which look the same.
    finite = ~np.isnan(kpis).all(axis=1) & ~np.isinf(kpis).any(axis=1)
    whole = [i for i in np.flatnonzero(finite).tolist() if i not in partial]
    filled = dict[int, Outcome]()
    for i in sorted(cut):
        # Only runs before it: what is learned after an answer must not change with later runs.
        apart = np.sum((z[[w for w in whole if w < i]] - z[i]) ** 2, axis=1)
        near = kpis[whole[int(np.argmin(apart))]] if len(apart) else kpis[i]
        filled[i] = Outcome(dict(zip(names, np.fmax(kpis[i], near).tolist(), strict=True)))

    def taught(c: Comparison) -> Comparison:
        if c.challenger not in cut and c.incumbent not in cut:
            return c
        pair = c.answer.outcomes or (None, None)
        new = filled.get(c.challenger, pair[0])
        old = pair[1] if c.incumbent is None else filled.get(c.incumbent, pair[1])
        silent = Answer(None, marks=c.answer.marks, outcomes=(new, old))
        return replace(c, answer=silent)

    return replace(
        history,
        comparisons=tuple(taught(c) for c in history.comparisons),
        follow_ups=tuple(taught(c) for c in history.follow_ups),
    )


def normalize(values: Float[np.ndarray, " N"], ceiling: float) -> Float[np.ndarray, " N"]:
    """Return `values` as shares of their range: 0 for the best, 1 for the worst; all 0 if equal.

    Values more than `ceiling` (median - best) above the median are capped there first.
    """
    largest = float(np.abs(values).max())
    shares = values / (largest if largest > 0 else 1.0)  # differences of huge values overflow
    ordered, middle = np.sort(shares), len(shares) // 2
    best, median = ordered[0], 0.5 * (ordered[middle] + ordered[-1 - middle])
    if median > best:
        shares = np.minimum(shares, median + ceiling * (median - best))
    spread = float(np.ptp(shares))
    return np.asarray((shares - best) / (spread if spread > 0 else 1.0))


# --- Work out what is known after a record, answer by answer, and remember it.

_LATEST = 16  # number of results in memory: those of the likely answers to a question and of an undo
_STAGES = 40  # number of stages in memory, up to about a megabyte each
_SELDOM = 10  # number of answers of a long step
_UNDONE = 40  # number of the latest answers that an undo may go back over without learning all others anew


def every_tenth(history: History) -> Iterator[History]:
    """Yield the record as of every tenth of its last answers, where what follows after an undo begins."""
    last = history.answered - 1
    return map(history.until, range(last // _SELDOM * _SELDOM, max(last - _UNDONE, 0), -_SELDOM))


Known = TypeVar("Known")


@final
class Remembered(Generic[Known]):
    """A function of a record that remembers what it returned for those asked for last.

    Nothing of it has to be saved, and copies of an agent share it: memory only saves time.

    Args:
        function: Function of a record; anything else that it is given follows from the record.
        most: Number of results in memory.
    """

    def __init__(self, function: Callable[..., Known], most: int = _LATEST) -> None:
        self._function, self._most = function, most
        self._known: OrderedDict[bytes, Known] = OrderedDict()

    def __call__(self, history: History, *given: Any) -> Known:
        """Return what the function returns for `history`."""
        with suppress(KeyError):  # another thread may drop it at any time
            self._known.move_to_end(history.key)
            return self._known[history.key]
        known = self._known[history.key] = self._function(history, *given)
        while len(self._known) > self._most:
            self._known.popitem(last=False)
        return known

    def keep(self, history: History, known: Known) -> Known:
        """Remember what the function would return, which was found on the way to something else."""
        while len(self._known) >= self._most:
            self._known.popitem(last=False)
        self._known[history.key] = known
        return known

    def __contains__(self, history: History) -> bool:
        """Return whether what is known of `history` is in memory, so that it takes no time."""
        return history.key in self._known

    def known(self, history: History) -> Known | None:
        """Return what is known of `history` if it is in memory, where it stays longer then."""
        with suppress(KeyError):
            self._known.move_to_end(history.key)
        return self._known.get(history.key)


@final
class Stages(Generic[Known]):
    """What is known after each answer, which follows from what was known one answer earlier.

    What is known is never None, and the latest of it is in memory.

    Args:
        first: Function that returns what is known before the first answer.
        following: Function of a record, the record one step earlier, and what was known then. A
            step is a new experiment with its answer, or all follow-up answers after it.
        most: Number of answers after which steps are long: ten answers at once, and the rest. This
            saves time when a long study is opened. With None, they never are.
        whole: Whether a new experiment and all follow-up answers after it are one step.

    Attributes:
        recalled: Function of a record that returns what an earlier session knew after it, None if
            that was not kept.
    """

    def __init__(
        self,
        first: Callable[[], Known],
        following: Callable[[History, History, Known], Known],
        most: int | None = None,
        *,
        whole: bool = False,
    ) -> None:
        self._first, self._following, self._most, self._whole = first, following, most, whole
        self._known: OrderedDict[bytes, Known] = OrderedDict()
        self.recalled: Callable[[History], Known | None] = lambda past: None

    def __call__(self, history: History) -> Known:
        """Return what is known after `history`."""
        here, steps = history.past, list[History]()
        # From the latest one in memory on: a step that asks for the one before would nest too deeply.
        while (known := self._at_hand(here)) is None and (before := self._before(here)) is not None:
            steps.append(here)
            here = before
        if known is None:
            known = self._known[here.key] = self._first()
        for step in reversed(steps):
            known = self._known[step.key] = self._following(step, here, known)
            here = step
            while len(self._known) > _STAGES:
                self._known.popitem(last=False)
        return known

    def __contains__(self, history: History) -> bool:
        """Return whether what is known after `history` is in memory."""
        return history.past.key in self._known

    def worth_keeping(self, history: History) -> Iterator[tuple[bytes, Known]]:
        """Yield what is at hand and what the next stages, and those after an undo, follow from soon.

        Each comes with the key of its record, see `recalled`.
        """
        count = history.answered
        recent = (history.until(k) for k in range(count, 0, -1))  # not all stages are asked for each time
        latest = islice((past for past in recent if self._at_hand(past) is not None), 1)
        for past in chain(latest, every_tenth(history)):
            if (known := self._at_hand(past)) is not None:
                yield past.key, known

    def _at_hand(self, past: History) -> Known | None:
        """Return what is known after `past` if it is in memory, or was kept by an earlier session."""
        known = self._known.get(past.key)
        if known is None and (known := self.recalled(past)) is not None:
            self._known[past.key] = known
        return known

    def _before(self, past: History) -> History | None:
        """Return the record one step before `past`; None if nothing is answered."""
        if not past.answered:
            return None
        count = past.answered - 1
        while self._most is not None and count > self._most and count % _SELDOM:
            count -= 1
        before = past.until(count)
        if self._whole or len(before.follow_ups) == len(past.follow_ups):
            return before
        return replace(past, follow_ups=before.follow_ups)
