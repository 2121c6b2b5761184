"""The record of a study: samples and answers, the rules that follow from them, and the best one."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate
from operator import or_
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import ProtocolError
from prefcal_env.knobs import KnobSpace, carry
from prefcal_env.plain import digest

from .answer import Answer, Mark, Outcome, Preference


@dataclass(frozen=True, slots=True)
class Verdict:
    """One valid answer: experiment `challenger` against experiment `incumbent`.

    A follow-up is about two experiments that had been compared before.
    """

    challenger: int
    incumbent: int
    preference: Preference
    follow_up: bool = False

    @property
    def winner(self) -> int | None:
        """Index of the better experiment; None for a tie."""
        if self.preference is Preference.TIE:
            return None
        return self.challenger if self.preference is Preference.CHALLENGER else self.incumbent

    @property
    def loser(self) -> int | None:
        """Index of the worse experiment; None for a tie."""
        winner = self.winner
        if winner is None:
            return None
        return self.incumbent if winner == self.challenger else self.challenger


def best_of(verdicts: Sequence[Verdict], unsafe: Set[int] = frozenset()) -> int:
    """Return the index of the best experiment, an undominated one (see `find_undominated`).

    The crown starts with experiment 0 and passes to a new experiment that wins, since that was
    compared with the best so far. A follow-up passes the crown on only if its owner lost; a
    follow-up about two others changes nothing. If the crown ends up on an experiment that is
    dominated (because an answer was retracted, or it was marked unsafe), the undominated
    experiment that won most recently is the best.

    Args:
        verdicts: Valid answers, in the order given.
        unsafe: Indices marked unsafe; they are the best only if nothing else was compared.
    """
    return next(bests([(verdicts, unsafe)]))


def bests(parts: Iterable[tuple[Sequence[Verdict], Set[int]]]) -> Iterator[int]:
    """Yield `best_of` the record after each of its parts: new verdicts, and all unsafe so far.

    The crown is passed on, not found anew, so a long record takes time in proportion to its length.
    """
    crown, known, touched = 0, list[Verdict](), set[int]()
    for verdicts, unsafe in parts:
        crown = reigns(verdicts, crown)[-1]
        touched |= {i for v in verdicts for i in (v.challenger, v.incumbent) if v.winner != i}
        known.extend(verdicts)
        # An experiment that has never lost or tied is undominated: there is no group to find.
        clear = crown not in touched and crown not in unsafe
        yield crown if clear else _undominated_one(crown, known, unsafe)


def _undominated_one(crown: int, verdicts: Sequence[Verdict], unsafe: Set[int]) -> int:
    known = {index for group in find_undominated(verdicts, unsafe) for index in group}
    return crown if not known or crown in known else representative(verdicts, known)


def reigns(verdicts: Sequence[Verdict], first: int = 0) -> tuple[int, ...]:
    """Return all experiments that were the best at some time, in order, from the `first` on."""
    crowned = [first]
    for verdict in verdicts:
        winner = verdict.winner
        if winner is None or winner == crowned[-1]:
            continue
        if verdict.loser == crowned[-1] or (winner == verdict.challenger and not verdict.follow_up):
            crowned.append(winner)
    return tuple(crowned)


def find_undominated(
    verdicts: Sequence[Verdict], unsafe: Set[int] = frozenset()
) -> tuple[frozenset[int], ...]:
    """Return the groups of experiments that did not lose to any outside their group.

    A group is one experiment, or several that are tied or beat each other in a circle. Losing
    through a chain counts: if 3 beats 2 and 2 is as good as 1, then 3 beats 1. If there are two or
    more groups, no answer says which one is better. (They are the parts of the Schwartz set.)

    Args:
        verdicts: Valid answers.
        unsafe: Indices marked unsafe; left out if anything else was compared.
    """
    groups = _sources(verdicts)
    safe = tuple(g - unsafe for g in groups if g - unsafe)
    if safe:
        return safe
    among_safe = [v for v in verdicts if not {v.challenger, v.incumbent} & unsafe]
    return _sources(among_safe) or groups


def representative(verdicts: Sequence[Verdict], group: Collection[int]) -> int:
    """Return the member of `group` that won most recently; the first one if none ever won."""
    for verdict in reversed(verdicts):
        if verdict.winner in group:
            return int(verdict.winner)  # type: ignore[arg-type]
    return min(group)


def contradictory(verdicts: Sequence[Verdict]) -> bool:
    """Return whether some answers cannot all be right: a circle with a strict verdict in it."""
    edges = _edges(verdicts)
    if not len(edges):
        return False
    labels = _components(edges)
    strict = [(v.winner, v.loser) for v in verdicts if v.winner is not None]
    return any(labels[a] == labels[b] for a, b in strict)


def _sources(verdicts: Sequence[Verdict]) -> tuple[frozenset[int], ...]:
    """Return the strongly connected groups of "at least as good as" that nothing leads into."""
    edges = _edges(verdicts)
    if not len(edges):
        return ()
    labels = _components(edges)
    across = labels[edges[:, 0]] != labels[edges[:, 1]]
    beaten = set(labels[edges[across, 1]].tolist())
    groups: dict[int, list[int]] = {}
    for index in np.unique(edges).tolist():
        if labels[index] not in beaten:
            groups.setdefault(int(labels[index]), []).append(index)
    return tuple(sorted((frozenset(g) for g in groups.values()), key=min))


def _edges(verdicts: Sequence[Verdict]) -> Int[np.ndarray, "m 2"]:
    """Return pairs (at least as good, the other); a tie gives one in each direction."""
    edges: list[tuple[int, int]] = []
    for v in verdicts:
        if v.winner is None:
            edges += [(v.challenger, v.incumbent), (v.incumbent, v.challenger)]
        else:
            edges.append((v.winner, v.challenger + v.incumbent - v.winner))
    return np.array(edges, dtype=np.int64).reshape(-1, 2)


def _components(edges: Int[np.ndarray, "m 2"]) -> Int[np.ndarray, " N"]:
    """Return the label of each node's strongly connected component."""
    from scipy.sparse import csr_array  # takes a tenth of a second to import
    from scipy.sparse.csgraph import connected_components

    size = int(edges.max()) + 1
    graph = csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))
    _, labels = connected_components(graph, directed=True, connection="strong")
    return np.asarray(labels, dtype=np.int64)


# --- The record of a study: samples and answers, and the rules that follow from them.
#
# The agent, the study file, the report and the benchmark hold the same `History`. It is frozen: every
# change returns a new one.

Point = tuple[float, ...]

_MARKS = {
    True: (Mark.CHALLENGER_UNSAFE, Mark.CHALLENGER_GOOD_ENOUGH),
    False: (Mark.INCUMBENT_UNSAFE, Mark.INCUMBENT_GOOD_ENOUGH),
}
"""Marks of the challenger (True) and of the incumbent; unsafe first."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One θ that is tried."""

    z: Point  # point of the unit cube, which models are trained on
    theta: Point  # θ that runs, physical
    after: int | None = None  # number of closed queries when it was proposed; None for the present number

    @classmethod
    def of(cls, space: KnobSpace, z: Float[np.ndarray, " n"]) -> "Sample":
        """Return the sample at point `z` of the cube, shape (n,)."""
        return cls(tuple(map(float, z)), tuple(map(float, space.decode(z))))

    def moved(self, old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None) -> "Sample":
        """Return the same θ as a sample of the space `new`.

        Raises:
            KnobError: If `new` does not hold it, or has a knob without a value.
        """
        if old.knobs == new.knobs:
            return self
        theta = carry(np.array(self.theta), old, new, added)
        return Sample(tuple(map(float, new.encode(theta))), tuple(map(float, theta)), self.after)


@dataclass(frozen=True)
class Comparison:
    """One answer about two samples.

    A retracted answer stays on record, but no agent learns from it. Agents need the first five
    fields; the others are circumstances that only a study file knows.

    Args:
        challenger: Index of the sample that was proposed, or of the later one of two.
        incumbent: Index of the other sample; None for sample 0, which is compared with nothing,
            and for scores given to an agent.
        answer: The answer.
        after: Number of closed queries when a follow-up question was asked; None for others.
        retracted: Whether the answer was taken back.
        seq: Number of its event in the study file.
        at: Time of the answer, by the clock of the study.
        question: Id of the question; None if nobody was asked.
        challenger_left: Whether the challenger was shown on the left; None if not shown.
        comment: Remark of the person.
        blind: Whether θ and the roles were hidden.
        repeats: Id of the earlier question that was asked again; None for others.
    """

    challenger: int
    incumbent: int | None
    answer: Answer
    after: int | None = None
    retracted: bool = False
    seq: int = 0
    at: str = ""
    question: int | None = None
    challenger_left: bool | None = None
    comment: str = ""
    blind: bool = False
    repeats: int | None = None

    @cached_property  # records share their answers, so a longer record costs little more
    def key(self) -> bytes:
        """Return a digest of what agents go by: the first five fields."""
        a = self.answer
        # A strength of 1 is one of 1.0, which a digest tells apart.
        told = (a.preference, float(a.strength), a.marks, a.outcomes, a.value, a.automatic)
        return digest((self.challenger, self.incumbent, told, self.after, self.retracted))

    @cached_property
    def verdict(self) -> Verdict | None:
        """Return which sample is better; None if the answer does not say or is retracted."""
        preference = self.answer.preference
        if self.incumbent is None or self.retracted or preference is None:
            return None
        return Verdict(self.challenger, self.incumbent, preference, self.after is not None)

    @cached_property
    def teaches(self) -> bool:
        """Return whether agents learn a preference from it: a verdict not derived from scores."""
        return self.answer.value is None and self.verdict is not None

    @property
    def value(self) -> float | None:
        """Return the score of the challenger; None if there is none or it is retracted."""
        return None if self.retracted else self.answer.value

    def about(self, index: int) -> bool:
        """Return whether sample `index` was compared."""
        return index in (self.challenger, self.incumbent)

    def corrected(self, index: int, outcome: Outcome | None, *, unsafe: bool) -> "Comparison":
        """Return the answer after the record of experiment `index` was replaced.

        Its verdict and its marks were about other curves, so they no longer count.

        Args:
            index: Index of the sample; an answer about others stays as it is.
            outcome: KPIs of the right record.
            unsafe: Whether the right record counts as unsafe.
        """
        if not self.about(index):
            return self
        answer, is_challenger = self.answer, index == self.challenger
        marks = tuple(m for m in answer.marks if m not in _MARKS[is_challenger])
        automatic = tuple(m for m in answer.automatic if m not in _MARKS[is_challenger])
        if unsafe:
            mark = _MARKS[is_challenger][0]
            marks, automatic = (*marks, mark), (*automatic, mark)
        known = answer.outcomes
        if known is not None:
            known = (outcome, known[1]) if is_challenger else (known[0], outcome)
        answer = replace(answer, marks=marks, automatic=automatic, outcomes=known)
        return replace(self, answer=answer, retracted=self.incumbent is not None)


@dataclass(frozen=True, slots=True)
class Lead:
    """The sample that an agent holds for the best, where the answers one by one name another."""

    index: int  # index of the sample
    after: int  # number of answers that it follows from


_UNKNOWN = Outcome({})


class KPIValues(NamedTuple):
    """KPIs of N samples, lower is better."""

    names: tuple[str, ...]  # names of the k KPIs
    values: Float[np.ndarray, "N k"]  # their values, NaN where one is not known, shape (N, k)

    @classmethod
    def of(cls, outcomes: Sequence[Outcome]) -> "KPIValues":
        """Return the KPIs of N experiments as one table."""
        names, rows = Outcome.table(outcomes)
        return cls(names, np.array(rows, dtype=float).reshape(len(rows), len(names)))

    def outcome(self, row: int) -> Outcome | None:
        """Return the KPIs of one sample; None if none are known."""
        return Outcome(dict(zip(self.names, self.values[row].tolist(), strict=True))) or None


@dataclass(frozen=True)
class History:
    """Samples in the order proposed, and the answers about them."""

    samples: tuple[Sample, ...] = ()  # all samples; the last one may not be answered yet
    comparisons: tuple[Comparison, ...] = ()  # comparison h closed the query of sample h
    # Answers about two samples whose queries were closed, in the order given
    follow_ups: tuple[Comparison, ...] = ()
    # Answers to questions that were asked again; agents do not learn from them
    repeats: tuple[Comparison, ...] = ()
    leads: tuple[Lead, ...] = ()  # what an agent held for the best against single answers, in order

    # Conclusions from the record. It is frozen, so what an answer asks for many times is worked out once.

    @cached_property
    def key(self) -> bytes:
        """Return a digest of all that agents go by: no circumstances, and no repeated questions."""
        return digest((self.samples, [c.key for c in self.counting], self.leads))

    @cached_property
    def kpis(self) -> KPIValues:
        """Return the KPIs of each sample that is answered.

        KPIs that came with a retracted answer count too, since the experiment is still valid.
        """
        told = dict[int, Any]()  # typed as mappings there, but an answer holds `Outcome`s
        for c in self.comparisons:
            for index, kpis in zip((c.challenger, c.incumbent), c.answer.outcomes or (), strict=False):
                if index is not None and kpis:
                    told.setdefault(index, kpis)
        found = KPIValues.of([told.get(index, _UNKNOWN) for index in range(self.answered)])
        found.values.setflags(write=False)  # all agents of the record share it
        return found

    @cached_property
    def answered(self) -> int:
        """Return the number of samples whose query is closed: the index of the next one."""
        return len(self.comparisons)

    @cached_property
    def pending(self) -> Sample | None:
        """Return the sample that takes the next number; None if none is proposed yet."""
        return self.samples[self.answered] if len(self.samples) > self.answered else None

    @property
    def waits(self) -> bool:
        """Return whether a sample was proposed since the last query was closed."""
        waiting = self.samples[self.answered :]
        return any(s.after is None or s.after >= self.answered for s in waiting)

    @cached_property
    def counting(self) -> tuple[Comparison, ...]:
        """Return all answers except those to repeated questions; follow-ups come last."""
        return (*self.comparisons, *self.follow_ups)

    def in_order(self) -> tuple[Comparison, ...]:
        """Return all answers except those to repeated questions, in the order given."""
        if not self.follow_ups:
            return self.comparisons
        keyed = [(c.challenger + 1, 0, c) for c in self.comparisons]
        keyed += [(c.after or 0, 1, c) for c in self.follow_ups]
        return tuple(c for _, _, c in sorted(keyed, key=lambda k: k[:2]))

    @property
    def latest(self) -> tuple[Comparison, ...]:
        """Return the answer to the last closed query and to the follow-ups after it."""
        since = tuple(c for c in self.follow_ups if c.after == self.answered)
        return (*self.comparisons[-1:], *since)

    @cached_property
    def lessons(self) -> tuple[Comparison, ...]:
        """Return the answers from which agents learn a preference, in the order given."""
        return tuple(c for c in self.in_order() if c.teaches)

    def verdicts(self) -> tuple[Verdict, ...]:
        """Return the verdicts that are not retracted, in the order given."""
        return tuple(v for c in self.in_order() if (v := c.verdict) is not None)

    @cached_property
    def unsafe(self) -> frozenset[int]:
        """Return the indices of the samples marked unsafe by answers that are not retracted."""
        return _unsafe(self.counting)

    @property
    def interrupted(self) -> frozenset[int]:
        """Return those of `unsafe` that no person marked: their runs were interrupted."""
        return _unsafe(self.counting, automatic=True)

    @cached_property
    def cut_short(self) -> frozenset[int]:
        """Return the indices of the samples whose runs were cut short: their KPIs are bounds."""
        return frozenset(
            c.challenger for c in self.comparisons if Mark.CHALLENGER_CUT_SHORT in c.answer.marks
        )

    @cached_property
    def given(self) -> int:
        """Return the number of answers, follow-ups included."""
        return len(self.comparisons) + len(self.follow_ups)

    @cached_property
    def incumbent(self) -> int | None:
        """Return the index of the best sample so far; None before the first answer.

        It is the one that the agent holds for the best, if it says so, else `by_answers`.
        """
        latest = self.leads[-1] if self.leads else None
        return latest.index if latest and latest.after == self.given else self.by_answers

    @cached_property
    def by_answers(self) -> int | None:
        """Return the index of the best sample by all answers; None before the first one.

        It is `best_of` the verdicts; if only scores are known, the first with the lowest score.
        """
        if not self.comparisons:
            return None
        verdicts = self.verdicts()
        scores = [(c.value, c.challenger) for c in self.comparisons if c.value is not None]
        if scores and not verdicts:
            return min(scores)[1]
        return best_of(verdicts, self.unsafe)

    def incumbents(self) -> tuple[int, ...]:
        """Return the best sample after each closed query and the follow-ups until the next one."""
        given: list[list[Comparison]] = [[closed] for closed in self.comparisons]
        for c in self.follow_ups:
            if c.after is not None:
                given[max(c.after, 1) - 1].append(c)
        verdicts = [[v for c in part if (v := c.verdict) is not None] for part in given]
        unsafe = accumulate((_unsafe(part) for part in given), or_)
        scores = ((c.value is None, c.value or 0.0, c.challenger) for c in self.comparisons)
        judged = accumulate(map(bool, verdicts), or_)
        found = zip(judged, bests(zip(verdicts, unsafe, strict=True)), accumulate(scores, min), strict=True)
        best = [best if by_verdict else lowest[2] for by_verdict, best, lowest in found]
        leads = {each.after: each.index for each in self.leads}
        return tuple(map(leads.get, accumulate(map(len, given)), best))

    def unbeaten(self) -> tuple[int, ...]:
        """Return the best sample, then the others that no answer calls worse, by index."""
        best = self.by_answers
        if best is None:
            return ()
        verdicts = self.verdicts()
        others = [g for g in find_undominated(verdicts, self.unsafe) if best not in g]
        return (best, *sorted(representative(verdicts, group) for group in others))

    def asked(self, first: int, second: int, *, standing: bool = False) -> bool:
        """Return whether the two samples were compared, whatever the answer.

        With `standing`, retracted answers do not count.
        """
        asked = (c for c in self.counting if not (standing and c.retracted))
        return any({c.challenger, c.incumbent} == {first, second} for c in asked)

    @cached_property
    def past(self) -> "History":
        """Return the answered samples with their answers and follow-ups: what anything is learned from."""
        alone = len(self.samples) == self.answered and not (self.repeats or self.leads)
        # The same object, so that what was worked out from it is there.
        return self if alone else self.until(self.answered)

    def until(self, count: int) -> "History":
        """Return the first `count` samples with their answers and follow-ups."""
        follow_ups = tuple(c for c in self.follow_ups if c.after is not None and c.after <= count)
        return History(self.samples[:count], self.comparisons[:count], follow_ups)

    # Changed copies.

    def with_best(self, index: int) -> "History":
        """Hold sample `index`, unless it is unsafe, for the best until the next answer."""
        if index == self.incumbent or index in self.unsafe:
            return self
        return replace(self, leads=(*self.leads, Lead(index, self.given)))

    def with_pending(self, sample: Sample) -> "History":
        """Store `sample` as the next one, in place of the one that has this number, if any."""
        stored, due = replace(sample, after=self.answered), self.answered
        return replace(self, samples=(*self.samples[:due], stored, *self.samples[due + 1 :]))

    def with_another(self, sample: Sample) -> "History":
        """Store `sample` behind all others that are pending."""
        return replace(self, samples=(*self.samples, replace(sample, after=self.answered)))

    def taken(self, index: int) -> tuple[int, ...]:
        """Return the present indices of all samples after pending sample `index` came next.

        Samples are numbered in the order of their answers, however many are pending, so that the
        first `answered` ones are those that are compared. Pending ones keep their order.

        Raises:
            ProtocolError: If it is not pending.
        """
        due, count = self.answered, len(self.samples)
        if not due <= index < count:
            raise ProtocolError(f"sample {index} is not pending: {count - due} are, from {due}")
        return (*range(due), index, *(i for i in range(due, count) if i != index))

    def undoing(self) -> tuple[int, ...]:
        """Return the present indices of the samples that stay if the last answer is taken back.

        Samples proposed after it go. Others that are pending stay, since they may be running.
        """
        due, waiting = self.answered, self.samples[self.answered :]
        asked = ((i, s.after) for i, s in enumerate(waiting, due))
        return (*range(due), *(i for i, after in asked if after is not None and after < due))

    def arranged(self, order: Sequence[int]) -> "History":
        """Return the record with the samples of these present indices, the answered ones first."""
        return replace(self, samples=tuple(self.samples[i] for i in order))

    def recorded(self, answer: Comparison) -> "History":
        """Add an answer to the repeated questions, the follow-ups, or as that of the open query."""
        if answer.repeats is not None:
            return replace(self, repeats=(*self.repeats, answer))
        if answer.challenger < self.answered:
            follow_up = replace(answer, after=self.answered)
            return replace(self, follow_ups=(*self.follow_ups, follow_up))
        return replace(self, comparisons=(*self.comparisons, answer))

    def with_answer(self, answer: Answer, incumbent: int | None) -> "History":
        """Close the open query against `incumbent`; its sample must be stored."""
        return self.recorded(Comparison(self.answered, incumbent, answer))

    def with_follow_up(self, answer: Answer, challenger: int, incumbent: int) -> "History":
        """Add the answer to a follow-up question about two known samples."""
        return self.recorded(Comparison(challenger, incumbent, answer))

    def undone(self) -> "History":
        """Take the last answer back: its query is open again. See `undoing` for later samples.

        Raises:
            ProtocolError: If nothing is answered.
        """
        if not self.comparisons:
            raise ProtocolError("there is no answer to undo")
        kept = self.arranged(self.undoing())
        kept = replace(kept, leads=tuple(each for each in self.leads if each.after < self.given))
        if len(self.latest) > 1:
            return replace(kept, follow_ups=self.follow_ups[:-1])
        return replace(kept, comparisons=self.comparisons[:-1])

    def retracted(self, index: int, *, follow_up: bool = False) -> "History":
        """Stop learning from answer number `index` (from 0); every sample stays.

        What was held for the best after it may have followed from it, so no longer is. Follow-ups
        are numbered separately.

        Raises:
            ProtocolError: If there is no such answer, or it is already retracted.
        """
        answers = self.follow_ups if follow_up else self.comparisons
        what = "follow-up answer" if follow_up else "answer"
        if isinstance(index, bool) or not isinstance(index, (int, np.integer)):
            raise ProtocolError(f"the index of an answer must be an integer, got {index!r}")
        if not 0 <= index < len(answers):
            raise ProtocolError(f"there is no {what} {index}: {len(answers)} are given, counted from 0")
        if answers[index].retracted:
            raise ProtocolError(f"{what} {index} is retracted already")
        before = next(k for k, c in enumerate(self.in_order()) if c is answers[index])
        leads = tuple(lead for lead in self.leads if lead.after <= before)
        changed = replace(answers[index], retracted=True)
        answers = (*answers[:index], changed, *answers[index + 1 :])
        if follow_up:
            return replace(self, follow_ups=answers, leads=leads)
        return replace(self, comparisons=answers, leads=leads)

    def corrected(self, index: int, outcome: Outcome | None, *, unsafe: bool) -> "History":
        """Return the record after that of experiment `index` was replaced by the right one.

        See `Comparison.corrected`.
        """

        def each(answers: Iterable[Comparison]) -> tuple[Comparison, ...]:
            return tuple(c.corrected(index, outcome, unsafe=unsafe) for c in answers)

        return History(self.samples, each(self.comparisons), each(self.follow_ups), each(self.repeats))

    def moved(self, old: KnobSpace, new: KnobSpace, added: Mapping[str, float] | None = None) -> "History":
        """Return the record for the space `new`, given that its samples are of the space `old`.

        Raises:
            KnobError: If `new` does not hold every sample, or has a knob without a value.
        """
        return replace(self, samples=tuple(s.moved(old, new, added) for s in self.samples))

    def scores_alone(self) -> "History":
        """Return the record for an agent that learns from scores: nothing is compared.

        A study file also keeps which experiment each score was compared with, for its readers.
        """
        alone = tuple(
            replace(c, incumbent=None, answer=replace(c.answer, preference=None)) for c in self.comparisons
        )
        return replace(self, comparisons=alone)


def _unsafe(answers: Iterable[Comparison], *, automatic: bool = False) -> frozenset[int]:
    """Return the indices of the samples that `answers` mark unsafe."""
    found = set()
    for c in answers:
        marks = c.answer.automatic if automatic else c.answer.marks
        if c.retracted or not marks:
            continue
        if Mark.CHALLENGER_UNSAFE in marks:
            found.add(c.challenger)
        if Mark.INCUMBENT_UNSAFE in marks and c.incumbent is not None:
            found.add(c.incumbent)
    return frozenset(found)


def lost_since(history: History) -> int:
    """Return the number of answers since a challenger won; all of them if none did."""
    won = [c.answer.preference is Preference.CHALLENGER for c in reversed(history.lessons)]
    return won.index(True) if True in won else len(won)
