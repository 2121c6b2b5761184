"""Summarize a study: counts, comparisons of KPIs, consistency of answers, and what is to come."""

import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, isnan, nan
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, shortest_path

from prefcal_agents.agent import Agent
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.study import State
from prefcal_env.study.file import data_folder
from prefcal_scenarios.names import is_built_in
from prefcal_scenarios.runs import grouped
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.wording import (
    comparable,
    join_words,
    limits_text,
    meaning,
    measured_texts,
    range_ends,
    read_text,
    typed_name,
    typed_number,
    typed_theta,
    with_unit,
)

# --- Compare two experiments KPI by KPI, what tells them apart first, for page and terminal.

_FEW = 4  # minimum number of experiments whose spread tells what a large difference is
NOTICED = 0.02  # share of a KPI's value below which a difference never counts as large


class Spread:
    """How far apart the KPIs of a study usually are."""

    def __init__(self, known: Iterable[Mapping[str, float]] = ()) -> None:
        self._known = list(known)

    def __call__(self, kpi: str, *values: float) -> float:
        """Return how far apart this KPI's values usually are, in its unit.

        This is the range of the middle half of all experiments so far, or of all if that is 0;
        with fewer than four experiments, the largest of `values`.
        """
        known = np.array([kpis[kpi] for kpis in self._known if kpi in kpis])
        known = known[np.isfinite(known)]
        if len(known) < _FEW:
            return max((abs(v) for v in values), default=0.0)
        low, high = np.percentile(known, [25, 75])
        return float(high - low) or float(np.ptp(known)) or max(abs(v) for v in values)


def compare(
    left: Experiment, right: Experiment, known: Sequence[KPI], spread: Spread, named: Sequence[str] = ()
) -> list[dict[str, Any]]:
    """Return a row for each KPI that either side has, in the order in which every screen shows them.

    In each group the KPIs come first whose titles are `named` in the sentence above, then what tells the
    sides apart: an objective that only one side misses, then the largest difference. `size` is the
    difference as a share of what is usual in this study (`Spread`), at most 1;
    values that read the same do not differ. `change` is the same, but at most the difference
    as a share of the larger value. `better` is the better side by the KPI's goal, or None
    without a goal. `difference` is the right value minus the left one. `group` is "worst", "mean"
    or a maneuver, or "" if the experiments have no maneuvers.
    """
    kpis = grouped(known, left, right)
    order = list(dict.fromkeys(group for group, _ in kpis))
    pairs = _pairs([kpi for _, kpi in kpis], left, right)
    rows = [(group, _size(pair, spread), pair) for (group, _), pair in zip(kpis, pairs, strict=True)]
    # Stable: among equals, the first of the KPIs.
    places = {title: k for k, title in enumerate(named)}
    rows.sort(
        key=lambda row: (
            order.index(row[0]),
            places.get(row[2].kpi.title, len(places)),
            {*row[2].met} != {True, False},
            -row[1],
        )
    )
    return [{"group": group, **_row(pair, size)} for group, size, pair in rows]


def unmeasured(left: Experiment, right: Experiment, kpis: Sequence[KPI]) -> list[dict[str, Any]]:
    """Return the rows, without a group, of KPIs that neither side has."""
    return [_row(pair, 0.0) for pair in _pairs(kpis, left, right)]


def measured_rows(
    kpis: Sequence[KPI], experiment: Experiment, beside: Experiment | None = None
) -> list[dict[str, Any]]:
    """Return what each KPI is called and what it should be, its value, and whether that is met."""
    met, texts = [kpi.met_by(experiment) for kpi in kpis], measured_texts(kpis, experiment, beside)
    each = zip(map(_words, kpis, map(limits_text, kpis)), texts, met, strict=True)
    return [{**words, "text": text, "met": one} for words, text, one in each]


@dataclass(frozen=True, slots=True)
class _Pair:
    """What people read of one KPI of two experiments, left and right."""

    kpi: KPI
    objective: str  # its objective in words
    values: tuple[float, float]  # values as read, in its unit; NaN where one is missing
    texts: tuple[str, str]  # values in words
    met: tuple[bool | None, bool | None]  # whether each meets the objective; None without one or a value
    judged: tuple[float, float]  # how bad each value looks, see `KPI.judged`
    apart: float  # size of the difference as shown, in its unit


def _pairs(kpis: Sequence[KPI], left: Experiment, right: Experiment) -> list[_Pair]:
    """Return what people read of all KPIs: each number is read once, and each text made once."""
    values = [[float(e.kpis.get(kpi.name, nan)) for e in (left, right)] for kpi in kpis]
    read = [(kpi.read(a), kpi.read(b)) for kpi, (a, b) in zip(kpis, values, strict=True)]
    judged = [(kpi.judged(a), kpi.judged(b)) for kpi, (a, b) in zip(kpis, read, strict=True)]
    shown = [comparable(kpi, pair) for kpi, pair in zip(kpis, values, strict=True)]
    # Of what is shown, so that people who subtract get the same.
    apart = [abs(b - a) for a, b in shown]
    met = [(kpi.met_by(left), kpi.met_by(right)) for kpi in kpis]
    units = left.channels.time_unit, right.channels.time_unit
    texts = [tuple(map(read_text, (kpi, kpi), pair, units)) for kpi, pair in zip(kpis, shown, strict=True)]
    return list(map(_Pair, kpis, map(limits_text, kpis), read, texts, met, judged, apart))


def _row(pair: _Pair, size: float) -> dict[str, Any]:
    """Return the row of one KPI, without its group."""
    left, right = ({"text": text, "met": met} for text, met in zip(pair.texts, pair.met, strict=True))
    return {
        **_words(pair.kpi, pair.objective),
        "left": left,
        "right": right,
        "difference": _difference(pair) if size else "",
        "better": _better(pair) if size else None,
        "size": round(min(size, 1.0), 3),
        "change": round(min(size, _share(*pair.values)), 3),
    }


def _words(kpi: KPI, objective: str) -> dict[str, str]:
    """Return what a KPI is called, and what it should be."""
    return {"title": kpi.title, "about": meaning(kpi), "unit": kpi.unit, "objective": objective}


def _size(pair: _Pair, spread: Spread) -> float:
    """Return how large the difference is; 0 if both read the same, or meet a target alike."""
    a, b = pair.values
    alike = pair.kpi.goal is not None and pair.judged[0] == pair.judged[1]
    if alike or pair.texts[0] == pair.texts[1]:
        return 0.0
    if not (isfinite(a) and isfinite(b)):
        return inf
    usual = max(spread(pair.kpi.name, a, b), NOTICED * max(abs(a), abs(b)))
    return abs(b - a) / usual


def _share(a: float, b: float) -> float:
    """Return the difference as a share of the larger value; 1 if one is infinite or missing."""
    if not (isfinite(a) and isfinite(b)):
        return 1.0
    return abs(b - a) / (max(abs(a), abs(b)) or 1.0)


def _difference(pair: _Pair) -> str:
    """Return the right value minus the left one, with sign and unit; "" if it is not a number."""
    a, b = pair.values
    if not (isfinite(a) and isfinite(b)):
        return ""
    size = pair.apart
    text = f"{size:.3g}" if 1e-4 <= size < 1e3 else f"{size:.12f}".rstrip("0").rstrip(".")
    unit = "% points" if pair.kpi.unit == "%" else pair.kpi.unit  # "%" alone would read as a share
    return with_unit(("+" if b > a else "−") + text, unit)


def _better(pair: _Pair) -> str | None:
    """Return the side whose value is better; None if that is not known."""
    left, right = pair.judged
    if pair.kpi.goal is None or isnan(left) or isnan(right) or left == right:
        return None
    return "left" if left < right else "right"


# --- Measure how consistent a person's answers are: repeated questions, and cycles.


@dataclass(frozen=True, slots=True)
class Consistency:
    """Consistency of the answers of a study."""

    repeated: int  # number of questions that were asked again
    agreed: int  # number of those with the same answer both times
    # cycles of experiments, by index: each is better than the next, and the last is
    # better than or as good as the first. There is one for each group of experiments
    # whose answers contradict each other
    cycles: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, state: State) -> "Consistency":
        """Return the consistency of a study, without abstentions and retracted answers."""
        history = state.history
        by_question = {c.question: c for c in history.counting}
        pairs = [(c, o) for c in history.repeats if (o := by_question.get(c.repeats)) is not None]
        agreed = sum(c.answer.preference == o.answer.preference for c, o in pairs)
        return cls(len(pairs), agreed, _cycles([*history.counting, *history.repeats]))


def _cycles(answers: Iterable[Comparison]) -> tuple[tuple[int, ...], ...]:
    """Return a shortest cycle through a strict verdict for each strongly connected group."""
    better = set()  # (a, b): a is better than b
    as_good = set()
    for c in answers:
        if c.incumbent is None or c.retracted or c.answer.preference is None:
            continue
        pair = (c.challenger, c.incumbent)
        if c.answer.preference is Preference.TIE:
            as_good |= {pair, pair[::-1]}
        else:
            better.add(pair if c.answer.preference is Preference.CHALLENGER else pair[::-1])
    if not better:
        return ()
    edges = np.array(sorted(better | as_good))
    _, groups = connected_components(_graph(edges), directed=True, connection="strong")
    found = {}
    for a, b in sorted(better):
        if groups[a] == groups[b] and groups[a] not in found:
            found[groups[a]] = (a, *_path(edges, b, a))
    return tuple(found.values())


def _graph(edges: Int[np.ndarray, "m 2"]) -> csr_array:
    size = int(edges.max()) + 1
    return csr_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(size, size))


def _path(edges: Int[np.ndarray, "m 2"], start: int, end: int) -> tuple[int, ...]:
    """Return the nodes of a shortest path from `start` to `end`, both included."""
    _, before = shortest_path(_graph(edges), unweighted=True, indices=start, return_predecessors=True)
    path = [end]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return tuple(reversed(path))


# --- Count the experiments and questions of a study; nothing else counts them.

VERDICTS: Mapping[Preference | None, str] = {
    Preference.CHALLENGER: "newer better",
    Preference.TIE: "about the same",
    Preference.INCUMBENT: "older better",
    None: "can't tell",
}
"""Text of each verdict, in the order of the counts. The challenger is the newer experiment; the
older one need not be the best so far, since follow-up comparisons can be about other runs."""


ENOUGH = "little is left to gain"  # why a study ends before its last question


@dataclass(frozen=True, slots=True)
class Counts:
    """Counts of a study that every front end, the report and the JSON show."""

    experiments: int  # number of experiments that ran, including that of the open question; see `tried`
    comparisons: int  # number of standing answers about two experiments, including follow-up comparisons
    # number of comparisons by preference; they add up to `comparisons`
    verdicts: Mapping[Preference | None, int]

    @classmethod
    def of(cls, state: State) -> "Counts":
        """Return the counts of a study. A repeated question is not a new comparison."""
        given = [c.answer.preference for c in answered(state)]
        verdicts = {verdict: given.count(verdict) for verdict in (*Preference, None)}
        return cls(len(list_shown(state)), len(given), verdicts)


def list_shown(state: State) -> list[int]:
    """Return the numbers of the experiments that ran; where few answers were enough, only of those shown."""
    asked = state.history.answered if state.ended == ENOUGH else len(state.history.samples)
    return [index for index in sorted(state.finished) if index < asked]


@dataclass(frozen=True, slots=True)
class Planned:
    """How many questions a study asks: one for each experiment but the first.

    Follow-up questions, which only some agents ask, are called so and do not count.
    """

    answered: int  # number of questions that are answered
    total: int  # number of questions of the whole study

    @classmethod
    def of(cls, agent: Agent) -> "Planned":
        """Return the plan of the study of an agent."""
        return cls(max(agent.history.answered - 1, 0), agent.n_max - 1)

    def place(self, *, over: bool, further: bool) -> str:
        """Return how far the study is, such as "question 3 of 10"."""
        if over:
            of = "" if self.answered >= self.total else f"of {self.total} "
            return f"{self.answered} {of}{'question' if self.total == 1 else 'questions'} answered"
        if further:
            return f"follow-up question, after {self.answered} of {self.total}"
        return f"question {min(self.answered + 1, self.total)} of {self.total}"


def answered(state: State) -> tuple[Comparison, ...]:
    """Return the standing answers about two experiments, in the order given."""
    return tuple(
        c for c in state.answers if c.incumbent is not None and c.repeats is None and not c.retracted
    )


# --- Advise whether to continue: unbeaten experiments, and knobs at the end of their range.

_AT_END = 0.02  # share of a knob's searched range, in its scale, that counts as its end
_INWARD = 0.1  # distance in the cube over which a learned cost tells whether it falls toward an end
_WIDER = 0.25  # share of a range by which the command widens it


@dataclass(frozen=True, slots=True)
class Outlook:
    """Advice on what to do next."""

    promise: str = ""  # sentence on what simulated θ or the next experiment promise; empty if unknown
    ends: str = ""  # sentence on the knobs at the end of their range; empty if there are none
    command: str = ""  # command that widens those ranges; empty without a study file
    unbeaten: str = ""  # sentence on other experiments that never lost; empty if there are none
    missed: str = ""  # sentence on the objectives that the best experiment misses; empty if it meets all
    result: tuple[str, ...] = ()  # sentences on what was wanted, and on which answer the result rests
    more: str = ""  # sentence with the command that asks more questions; empty if that promises little

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return all sentences, without the command."""
        parts = (self.missed, self.unbeaten, *self.result, self.promise, self.more, self.ends)
        return tuple(part for part in parts if part)

    @property
    def lines(self) -> tuple[str, ...]:
        """Return all sentences, then the command."""
        return (*self.sentences, self.command) if self.command else self.sentences


def others_unbeaten(history: History, *, robust: bool = False) -> str:
    """Return what is said of the experiments besides the best that never lost; empty without any.

    The answers do not say which of them is better: they were called about the same, or compared without a
    verdict. Or the agent takes one of them for a slip.
    """
    if history.leads and history.incumbent != history.by_answers:
        return after_a_slip(history, robust=robust)
    indices, said = history.unbeaten(), list[str]()
    if tied := _list_tied(history, *indices[:1]):
        said.append(
            f"The answers call {_name_all(tied)} about the same as experiment {indices[0] + 1}: a tie does "
            "not change which one is the best."
        )
    if others := indices[1:]:
        were = f"{_name_all(others)} {'were' if len(others) > 1 else 'was'}"
        said.append(
            f"Besides experiment {indices[0] + 1}, {were} never beaten: no answer says which one is better."
        )
    return " ".join(said)


def _name_all(indices: Sequence[int]) -> str:
    return f"experiment{'s' * (len(indices) > 1)} {join_words([str(index + 1) for index in indices])}"


def _list_tied(history: History, index: int | None = None) -> list[int]:
    """Return which experiments the latest answer beside one calls about the same as that, by index."""
    both = ((v, {v.challenger, v.incumbent}) for v in history.verdicts())
    latest = {other: v.winner for v, pair in both if index in pair for other in pair - {index}}
    return sorted(other for other, winner in latest.items() if winner is None)


def after_a_slip(history: History, *, robust: bool = False) -> str:
    """Return a sentence on the best, which is not the winner of the answers."""
    best, winner = ((index or 0) + 1 for index in (history.incumbent, history.by_answers))
    if history.by_answers in _list_tied(history, history.incumbent):
        by = (
            "of those shown that hold on the most varied plants, they prefer"
            if robust
            else "all together they speak for"
        )
        return f"The answers call experiments {winner} and {best} about the same: {by} {best}."
    if robust:
        return (
            f"Experiment {winner} won, but {best} is the best so far: of those shown that hold on the most "
            "varied plants, the answers prefer it."
        )
    return (
        f"Experiment {best} is the best so far, though {winner} won: all answers together speak "
        f"for {best}, so one of them is probably a slip."
    )


def foreseen(chance: float | None, index: int | None) -> str:
    """Return a sentence on what the next experiment can bring, by the answers before it.

    Args:
        chance: Chance that it is noticeably better; None if the KPIs do not explain the answers.
        index: Index of the experiment; None if it is not proposed yet.
    """
    if chance is None:
        return "Your answers may follow from more than the KPIs: how good the next run may be is not said."
    which = "the next run" if index is None else f"experiment {index + 1}"
    better = f"{which} is noticeably better than the best is {100 * chance:.0f} %"
    return f"By the answers so far, the chance that {better}."


NONE_SAFE = (
    "No experiment ended safely, so none is a result: go on or, if that does not help, start from values "
    "that are known to be safe (--start), widen the ranges of the knobs, or check the limits that end a run."
)
"""What is said in place of what the best experiment promises if no experiment ended safely."""


def outlook(
    promise: str,
    best: Float[np.ndarray, " n"],
    space: KnobSpace,
    place: str,
    state: State,
    *,
    missed: Sequence[str] = (),
    never: Sequence[str] = (),
    reached: Sequence[int] = (),
    unstable: bool = False,
    limiting: str = "",
    keeping: str = "",
    helps: Callable[[int, bool], bool],
) -> Outlook:
    """Return the outlook of a study.

    Args:
        promise: Sentence on what simulated θ or the next experiment promise; empty if unknown.
        best: Best θ, physical, shape (n,).
        space: Knobs with their searched ranges.
        place: Path of the study file; ":memory:" if there is none.
        state: State of the study.
        missed: Titles of the KPIs whose objectives the best experiment misses.
        never: Titles of the KPIs that are infinite even in the best experiment.
        reached: Numbers of the experiments, from 1, in which they all are finite.
        unstable: Whether the loop of the best experiment is not stable.
        limiting: Input whose range limits the best experiment; "" if none does.
        keeping: Words on another θ that misses no objective, of `begin_with`; "" if none is known.
        helps: Function of the number of a knob at its end, and whether it is the upper end, that
            returns whether going further is expected to help.
    """
    swings = "The loop of the best experiment is not stable." if unstable else ""
    why = " ".join(filter(None, (swings, _missed(missed, limiting, keeping), _say_unreached(never, reached))))
    ends = [
        (knob, up)
        for knob, up in at_end(space, best)
        if not _is_last(knob, space, upper=up) and helps(space.knobs.index(knob), up)
    ]
    if not ends:
        return Outlook(promise, missed=why)
    several = len(ends) > 1
    verb, whose = ("are", "their ranges") if several else ("is", "its range")
    listed = join_words([knob.name for knob, _ in ends])
    sentence = f"{listed} of the best θ {verb} {_near(ends, space, best)} the end of {whose}"
    within = promise and f"Within the present ranges, {promise[0].lower()}{promise[1:]}"
    if place == ":memory:":
        end = f"{sentence}; if your plant allows it, widen {whose}."
        return Outlook(within, end, missed=why)
    return Outlook(
        within,
        f"{sentence}; if your plant allows it, widen {whose}, for example with:",
        _command(ends, space, place, str(state.configuration["scenario"])),
        missed=why,
    )


def _near(ends: Sequence[tuple[Knob, bool]], space: KnobSpace, best: Float[np.ndarray, " n"]) -> str:
    """Return "at" if all these knobs are at an end of their range, else "near"."""
    numbers = [space.knobs.index(knob) for knob, _ in ends]
    reached = [space.within[number][up] for number, (_, up) in zip(numbers, ends, strict=True)]
    return "at" if np.allclose(best[numbers], reached, atol=0) else "near"


FIRST_RUN = "experiment 1"
"""What the first experiment of a study is called."""


def keeps_all(named: Mapping[str, Experiment], space: KnobSpace, limited: Sequence[KPI]) -> str:
    """Return what the first of some experiments is called that keeps all limits; empty if none does.

    It ended safely and lies in the searched ranges.

    Args:
        named: Experiments by what they are called.
        space: Knobs with their searched ranges.
        limited: KPIs with an objective.
    """
    low, high = np.array(space.within).T
    for name, run in named.items():
        inside = not run.end.interrupted and ((low <= run.theta) & (run.theta <= high)).all()
        if inside and all(kpi.met_by(run) for kpi in limited):
            return name
    return ""


def begin_with(named: Mapping[str, Experiment], space: KnobSpace, limited: Sequence[KPI]) -> str:
    """Return that one of some experiments keeps all limits, as `keeps_all`, and how to begin with it."""
    if not (name := keeps_all(named, space, limited)):
        return ""
    if name == FIRST_RUN:  # the same command would begin there again
        return f"{name}, where the study began, misses none: go back to it, or continue"
    start = shlex.join(["--start", typed_theta(space, named[name].theta.tolist())])
    return f"{name} misses none: to begin with it, repeat the command of the study with {start}"


def _say_unreached(never: Sequence[str], reached: Sequence[int]) -> str:
    """Return which KPIs are infinite even in the best experiment, and which others reached them; or ""."""
    if not reached or not never:
        return f"Not even the best experiment has a finite {join_words(never)}." if never else ""
    others = f"experiment{'s' * (len(reached) > 1)} {join_words([str(k) for k in reached])}"
    return f"The best experiment has no finite {join_words(never)}, while {others} reached that."


def _missed(titles: Sequence[str], limiting: str, keeping: str) -> str:
    """Return a sentence on missed objectives and what to do about them; empty if there are none."""
    if not titles:
        return ""
    which = "objectives" if len(titles) > 1 else "objective"
    more = "continue or, if more experiments do not help, widen the ranges or change the controller"
    todo = keeping or (range_ends(limiting) if limiting else more)
    return f"The best experiment misses the {which} for {join_words(titles)}: {todo}."


def at_end(space: KnobSpace, theta: Float[np.ndarray, " n"]) -> list[tuple[Knob, bool]]:
    """Return the knobs of θ at an end of their searched range, and whether it is the upper end.

    Frozen knobs are left out, and ends at 0: what is off or has no size, such as a derivative time, goes no
    further.
    """
    found = []
    for knob, (low, high), value in zip(space, space.within, theta.tolist(), strict=True):
        start, end, here = knob.encode(low), knob.encode(high), knob.encode(value)
        share = (here - start) / (end - start) if end > start else 0.5
        upper = share >= 1 - _AT_END
        if not _AT_END < share < 1 - _AT_END and (high if upper else low):
            found.append((knob, upper))
    return found


def falls_outward(
    cost: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]],
    space: KnobSpace,
    best: Float[np.ndarray, " n"],
    knob: int,
    upper: bool,
) -> bool:
    """Return whether a learned cost of physical θ falls toward an end of the range of a knob."""
    inward = space.encode(best).copy()
    inward[knob] += -_INWARD if upper else _INWARD
    here, there = cost(np.array([best, space.decode(np.clip(inward, 0.0, 1.0))]))
    return bool(here < there)


def _command(ends: list[tuple[Knob, bool]], space: KnobSpace, place: str, scenario: str) -> str:
    words = ["prefcal", "studies", "respace", study_name(place)]
    if not is_built_in(scenario):
        words += ["--scenario", scenario]
    for knob, upper in ends:
        low, high = space.within[space.knobs.index(knob)]
        low, high = (low, _beyond(knob, low, high)) if upper else (_beyond(knob, high, low), high)
        words += ["--knob", f"{typed_name(knob, space)}={typed_number(low)}:{typed_number(high)}"]
    return shlex.join(words)


def _is_last(knob: Knob, space: KnobSpace, *, upper: bool) -> bool:
    """Return whether nothing is beyond an end: at 1 of a share, from 0 to 1, or of a whole number."""
    low, high = space.within[space.knobs.index(knob)]
    other, end = (low, high) if upper else (high, low)
    is_share = knob.unit in ("", "-") and (low, high) == (0, 1)
    return (upper and is_share) or _beyond(knob, other, end) == end


def _beyond(knob: Knob, other: float, end: float) -> float:
    """Return a value beyond `end`, seen from the `other` end; positive numbers stay positive."""
    if knob.scale == "log10":
        return float(f"{end * (end / other) ** _WIDER:.3g}")
    beyond = end + _WIDER * (end - other)
    if end > 0 >= beyond:
        beyond = end / 2
    if knob.integer:
        return float(np.ceil(beyond) if end > other else max(floor(beyond), min(end, 1)))
    return float(f"{beyond:.3g}")


def kept_on_plant(state: State) -> dict[str, Any]:
    """Return what the person confirmed to keep on the plant, as plain data; empty if nothing."""
    if state.kept is None:
        return {}
    _, at, kept = state.kept
    by = state.configuration.get("options", {}).get("by") or ""
    which = "new" if kept.index else "old"
    return {"which": which, "experiment": kept.index + 1, "blind": kept.blind, "by": by, "at": at}


def kept_text(kept: Mapping[str, Any]) -> str:
    """Return what `kept_on_plant` says as a sentence; empty if nothing is kept."""
    if not kept:
        return ""
    blind = ", tried blind" if kept["blind"] else ""
    by = f"by {kept['by']} " if kept["by"] else ""
    when = f"on {kept['at'][:10]} at {kept['at'][11:16]} UTC"
    return f"Confirmed on the plant: {kept['which']} (experiment {kept['experiment']}){blind}, {by}{when}."


def study_name(place: str) -> str:
    """Return the name of the study file at `place` for the command line."""
    path = Path(place)
    return path.stem if path.parent == data_folder() else place
