"""The study as a function of its record: what is known, what is shown, and what is to do."""

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, cast
from weakref import WeakValueDictionary

import numpy as np

from prefcal_agents import restore
from prefcal_agents.agent import Agent, AgentState, Strategy
from prefcal_agents.learned_cost import LearnedCost
from prefcal_agents.lessons import Subset, judged
from prefcal_agents.registry import CLASSES
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import Findings
from prefcal_app.simulating import SimulationCounts, Simulator, simulates
from prefcal_app.summary import ENOUGH as ENOUGH
from prefcal_env.compiling import Compiling
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Channels, End, Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_env.plain import digest
from prefcal_env.preferences.answer import (
    Answer,
    Mark,
    Outcome,
    Outcomes,
    Preference,
    Query,
    Suggestion,
    completed,
    counts_as_unsafe,
    first_ready,
)
from prefcal_env.preferences.answer import Comparison as Compared
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.sources.source import Asks, Change, Progress, RunCurve
from prefcal_env.study import (
    Answered,
    Ended,
    Event,
    Failed,
    Finished,
    Led,
    Reopened,
    Requested,
    Shown,
    State,
    StudyFile,
    Suggested,
    Taken,
    Undone,
    space_of,
)
from prefcal_env.study import knobs_as_dicts as knobs_as_dicts
from prefcal_scenarios.runs import outcome
from prefcal_scenarios.scenario import Scenario, with_ranges

# --- Define what a front end sees of a study at one moment: the phase, the question, the plant.

UNSAFE: Final = "unsafe"
GOOD_ENOUGH: Final = "good enough"
MARKS = (UNSAFE, GOOD_ENOUGH)  # marks that a person can give an experiment, apart from any verdict

_CHALLENGER = {UNSAFE: Mark.CHALLENGER_UNSAFE, GOOD_ENOUGH: Mark.CHALLENGER_GOOD_ENOUGH}
_INCUMBENT = {UNSAFE: Mark.INCUMBENT_UNSAFE, GOOD_ENOUGH: Mark.INCUMBENT_GOOD_ENOUGH}


class Choice(Enum):
    """Verdict by side, as the person sees it."""

    LEFT = "left"
    RIGHT = "right"
    SAME = "same"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two experiments of a question; `index` counts from 0, people count from 1.

    The `role` is shown next to the number: "new", "best so far" or nothing. A repeated or answered
    question shows no roles.
    """

    index: int
    experiment: Experiment
    challenger: bool
    marks: frozenset[str] = frozenset()
    role: str = ""

    @property
    def counts_as_unsafe(self) -> bool:
        """Return whether it counts as unsafe because of how its run ended."""
        return counts_as_unsafe(self.experiment)


@dataclass(frozen=True, slots=True)
class Question:
    """Question about two experiments."""

    id: int  # id of the event that showed the question; an answer must name it
    number: int  # number of the comparison, from 1
    left: Side  # experiment on the left
    right: Side  # experiment on the right
    repeats: int | None = None  # id of the earlier question that is asked again; None for a new question
    # KPIs of challenger and incumbent, for the agent; None for a repeated question
    outcomes: Outcomes | None = None
    further: bool = False  # whether this is a follow-up comparison, of two experiments that were seen before

    @property
    def challenger(self) -> Side:
        """Return the side that the agent proposed."""
        return self.left if self.left.challenger else self.right

    @property
    def incumbent(self) -> Side:
        """Return the other side: the best so far, or the rival in a follow-up comparison."""
        return self.right if self.left.challenger else self.left

    def side(self, name: str) -> Side:
        """Return the side "left" or "right"."""
        return self.left if name == "left" else self.right

    def preference(self, choice: Choice) -> Preference | None:
        """Return the preference of eq. pref_fun that `choice` means; None for an abstention."""
        if choice is Choice.CANNOT_TELL:
            return None
        if choice is Choice.SAME:
            return Preference.TIE
        won = (choice is Choice.LEFT) == self.left.challenger
        return Preference.CHALLENGER if won else Preference.INCUMBENT

    def answer(self, choice: Choice) -> Answer:
        """Return the answer that `choice` means, with the current marks of both sides."""
        return Answer(self.preference(choice), marks=self.marks)

    def completed(self, given: Answer) -> Answer:
        """Return `given` with the KPIs and automatic marks of both sides, for record and agent."""
        return completed(given, self.challenger.experiment, self.incumbent.experiment, self.outcomes)

    def choice(self, preference: Preference | None) -> Choice:
        """Return the choice that means `preference`."""
        return next(c for c in Choice if self.preference(c) is preference)

    @property
    def marks(self) -> tuple[Mark, ...]:
        """Return the current marks of both sides, as an `Answer` names them."""
        sides = ((self.challenger, _CHALLENGER), (self.incumbent, _INCUMBENT))
        return tuple(words[m] for side, words in sides for m in MARKS if m in side.marks)


class Phase(Enum):
    """What a study waits for."""

    RUNNING = "running"  # a proposal is being computed or an experiment is being run
    RECORD = "record"  # the person must run the experiment and provide its record
    CONFIRM = "confirm"  # the person must confirm what is written to a live plant
    FAILED = "failed"  # the run raised an error, or the study file could not be written
    QUESTION = "question"  # the person must answer the open question
    OVER = "over"  # the study has ended: all is compared, one is good enough, or the person finished it


class Recovery(Enum):
    """Whether the plant has its old values again, which an interrupted run may have changed."""

    DUE = "due"
    RUNNING = "running"
    FAILED = "failed"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class TrialNow:
    """What a front end shows of a trial on a live plant."""

    blind: bool  # whether it is hidden which θ is which
    wanted: int  # index of the experiment whose θ the person wants on the plant
    shown: int | None  # index of the one whose θ it has; None while it is written
    # What the plant has, for the person to confirm; None while it is not known
    changes: tuple[Change, ...] | None
    problem: str  # why it is not known, or why the trial ended
    moves: bool  # whether the plant is being changed


@dataclass(frozen=True, slots=True)
class PlantNow:
    """What a front end shows of a plant on which each run must be confirmed."""

    # What a run would write, for the person to confirm; None while it is not known
    changes: tuple[Change, ...] | None
    problem: str  # why it is not known, or what remains to be done on the plant; empty if all is well
    progress: Progress | None  # how far the run is; None if none is in progress
    times: tuple[float, ...]  # instants recorded so far, in seconds
    curves: tuple[RunCurve, ...]  # outputs recorded so far
    stopping: bool  # whether the run was told to stop
    # Whether the plant has its old values again. If that failed, `problem` says why, and nothing is written
    # until it succeeds.
    recovery: Recovery = Recovery.DONE
    trial: TrialNow | None = None  # what is tried; None if nothing is


@dataclass(frozen=True, slots=True)
class Now:
    """Consistent view of an interview."""

    version: int  # number that grows with every change
    phase: Phase  # what the interview waits for
    question: Question | None  # open question, in phase QUESTION
    problem: str | None  # description of the problem, in phase FAILED
    pending: Suggested | None  # sample that is running, awaited or failed; None while it is being proposed
    incumbent: int | None  # index of the best experiment so far; None before the first
    can: frozenset[str]  # names of the actions that the person can take
    state: State  # state of the study file
    draft: str = ""  # comment of the answer that was just undone
    # Part that is being compiled before the first experiment; None when done
    preparing: Compiling | None = None
    run_limit: float | None = None  # time limit of a run in seconds; None if it has none
    # Numbers of what was simulated unseen; None if the agent simulates nothing
    simulated: SimulationCounts | None = None
    # What is known of a plant whose runs a person confirms; None if the scenario has none
    plant: PlantNow | None = None
    running: int = 0  # number of experiments that are running, if several can; 0 if one runs at a time


# --- Say what a study needs next: a function of its agent and its record, without input or output.

PERSON = "human"  # who answers, in the configuration of a study
ALL_COMPARED = "all compared"  # why a study ends after its last question
FINISHED = "stopped"  # why it ends if the person who answers finishes it
_SIDES, _REPEATS, _TRIALS = 11, 12, 13  # streams of the study's seed; agents use other ones


def why_over(ended: str, found: Findings | None = None) -> str:
    """Return why a study is over, in words, with what is said of its result if few answers were enough.

    Little is left to find among θ drawn at random; one that was simulated may still be better.
    """
    if ended != ENOUGH:
        return "at your request" if ended == FINISHED else ended
    said = None if found is None else found.certificate
    if said is None or said.share is None:
        return "few random θ are noticeably better"
    return f"fewer than {100 * said.share:.0f} % of random θ are noticeably better"


class Moment(Enum):
    """What happens to a study and is no event of its file."""

    THINK = "the agent chooses the next query"
    RUN = "experiments run"
    RECORD = "a record is waited for"
    CONFIRM = "a confirmation is waited for"
    CONFIRMED = "a run was confirmed"
    ASKED = "the open question is shown"
    BROKEN = "a step failed"
    RETRIED = "the failed step is tried again"
    OVER = "nothing is left to do"


_ANY = frozenset(Phase)
TRANSITIONS: Mapping[type[Event] | Moment, tuple[frozenset[Phase], Phase]] = MappingProxyType(
    {
        Answered: (_ANY, Phase.RUNNING),
        Undone: (_ANY, Phase.RUNNING),
        Requested: (_ANY, Phase.RUNNING),
        # One that ran beside an open question, or beside a failed run, does not change what is waited for.
        Finished: (frozenset({Phase.RUNNING, Phase.RECORD, Phase.CONFIRM}), Phase.RUNNING),
        Failed: (_ANY, Phase.FAILED),
        Ended: (_ANY, Phase.OVER),
        Reopened: (frozenset({Phase.OVER}), Phase.RUNNING),
        Moment.THINK: (_ANY, Phase.RUNNING),
        Moment.RUN: (_ANY, Phase.RUNNING),
        Moment.RECORD: (_ANY, Phase.RECORD),
        Moment.CONFIRM: (_ANY, Phase.CONFIRM),
        Moment.CONFIRMED: (frozenset({Phase.CONFIRM}), Phase.RUNNING),
        Moment.ASKED: (_ANY, Phase.QUESTION),
        Moment.BROKEN: (_ANY, Phase.FAILED),
        Moment.RETRIED: (frozenset({Phase.FAILED}), Phase.RUNNING),
        Moment.OVER: (_ANY, Phase.OVER),
    }
)
"""For each event or moment: the phases that it changes, and the phase it leads to. Others change no phase."""


@dataclass(frozen=True, slots=True)
class Write:
    """Save an event that follows from the record."""

    event: Event


@dataclass(frozen=True, slots=True)
class Settle:
    """Close the query of experiment `index`, about which nobody is asked."""

    index: int


@dataclass(frozen=True, slots=True)
class Ask:
    """Ask about two experiments."""

    shown: Shown


Todo = Write | Settle | Ask | Moment
_WAITS: Mapping[Asks, Moment] = {"": Moment.RUN, "record": Moment.RECORD, "confirm": Moment.CONFIRM}


@dataclass(frozen=True, slots=True)
class PlantFacts:
    """What decides of a plant, or of whatever runs θ, what a person can do now."""

    asks: Asks = ""  # what a person does for each run, as `Source.asks` says
    stops: bool = False  # whether a run can be stopped
    moves: bool = False  # whether a run changes the plant now
    ready: bool = False  # whether it is known what the pending run would write
    recovery: Recovery = Recovery.DONE  # whether the plant has its old values again
    tries: bool = False  # whether old and new can be tried in turn
    holds: bool = False  # whether it has one of them now


@dataclass(frozen=True)
class Study:
    """A study at one moment. Whoever drives it saves each event, feeds it, and asks what is next."""

    strategy: Strategy  # what the agent asks after a record
    state: State  # state after all events, see `prefcal_env.study.fold`
    at_once: int = 1  # number of experiments that may be pending at the same time
    simulates: bool = False  # whether choosing a query may take simulations
    phase: Phase = Phase.RUNNING  # what it waits for
    plant: PlantFacts = PlantFacts()  # what runs θ
    # Whether the agent has thought about this record, to which only events were added that follow from it
    thought: bool = False
    proposed: bool = False  # whether `next` has been followed until experiments run; any event makes it False

    def feed(self, happened: Event | Moment, state: State | None = None) -> "Study":
        """Return the study after an event, with the record's `state` after it, or after a moment."""
        kind = happened if isinstance(happened, Moment) else type(happened)
        sources, target = TRANSITIONS.get(kind, (_ANY, self.phase))
        return replace(
            self,
            state=state or self.state,
            phase=target if self.phase in sources else self.phase,
            thought=kind in (Led, Suggested, Taken),
            proposed=happened is Moment.RUN,
        )

    @cached_property
    def repeats(self) -> bool:
        """Return whether the question that is open was asked before."""
        shown = self.state.open
        return self.phase is Phase.QUESTION and shown is not None and shown[1].repeats is not None

    @property
    def _may_stop(self) -> bool:
        """Return whether the study may end by itself.

        It may if a person answers, has not reopened it, and neither sees nor asked for a question.
        """
        state, history = self.state, self.state.history
        person = state.configuration.get("options", {}).get("calibrator") == PERSON
        repeated = bool(history.repeats) and state.answers[-1] is history.repeats[-1]
        wants = repeated or any(index >= history.answered for index in state.requested)
        return person and not (wants or state.open or state.reopened)

    @property
    def seed(self) -> int:
        """Return the seed of the study."""
        return int(self.state.configuration["seed"])

    @property
    def best(self) -> int | None:
        """Return the index of the agent's best experiment so far; None before the first."""
        return self.state.history.incumbent

    @cached_property
    def pending(self) -> Suggested | None:
        """Return the sample that has no answer yet; None until it is proposed."""
        sample, index = self.state.history.pending, self.state.history.answered
        return None if sample is None else Suggested(index, sample.z, sample.theta)

    @cached_property
    def unfinished(self) -> tuple[Suggested, ...]:
        """Return all samples that have no experiment yet, in the order proposed."""
        samples = enumerate(self.state.history.samples)
        return tuple(Suggested(i, s.z, s.theta) for i, s in samples if i not in self.state.finished)

    @property
    def must_think(self) -> bool:
        """Return whether choosing the next query may take simulations, so no lock may be held."""
        history = self.state.history
        return self.simulates and history.pending is None and not self.strategy.knows(history)

    def next(self) -> Todo:
        """Return what is to be written, settled or asked now, or what is waited for."""
        strategy, history = self.strategy, self.state.history
        if self.state.ended:
            return Moment.OVER
        if self.must_think and not self.thought:
            return Moment.THINK
        turn = strategy.turn(history)
        # An agent that learns from scores may lead with a run that is unsafe, which the record never takes.
        if turn.best is not None and turn.best != history.incumbent and turn.best not in history.unsafe:
            return Write(Led(turn.best))
        if turn.over:
            return Write(Ended(ALL_COMPARED))
        opened, queries = strategy.open(turn, self.at_once)
        index = len(history.samples)
        if len(opened.samples) > index:
            return Write(Suggested(index, opened.samples[index].z, opened.samples[index].theta))
        if self._may_stop and strategy.has_enough(history):
            return Write(Ended(ENOUGH))
        # A query about two known experiments comes first, then the experiment that ended first.
        ready = first_ready(queries, self.state.finished)
        return _WAITS[self.plant.asks] if ready is None else self._about(ready)

    def _about(self, ready: Query) -> Todo:
        """Return what is to do about a query whose experiments are known."""
        new, old = ready.challenger.index, ready.incumbent
        if not ready.further and new != self.state.history.answered:
            return Write(Taken(new))  # it gets the number of the next one to be answered
        if old is None:
            return Settle(new)
        left = challenger_left(self.seed, new, old.index if ready.further else None)
        return Ask(Shown(new, old.index, left))

    @property
    def is_overtaken(self) -> bool:
        """Return whether the agent would now ask another question than the one shown, if any.

        A retraction, a changed setting or a newer algorithm can change the agent's question, and
        after a crash the old one is still shown: an answer to it would be about the wrong pair.
        """
        if self.state.open is None:
            return True
        _, shown = self.state.open
        if shown.repeats is not None:
            return False
        if shown.challenger < self.state.history.answered:
            if self.must_think:
                return True  # until the agent has thought, the shown question may be any
            turn = self.strategy.turn(self.state.history)
            asked = None if turn.over else self.strategy.open(turn)[1][0]
            if asked is None or asked.incumbent is None:
                return True
            return (asked.challenger.index, asked.incumbent.index) != (shown.challenger, shown.incumbent)
        return shown.incumbent != self.best


def challenger_left(seed: int, challenger: int, further: int | None = None) -> bool:
    """Return whether the challenger is on the left: half of the time, reproducibly.

    `further` is the other experiment of a follow-up comparison.
    """
    pair = [challenger] if further is None else [challenger, further]
    return bool(np.random.default_rng([seed, *pair, _SIDES]).random() < 0.5)


def tried_on_plant(state: State, best: int | None) -> tuple[int, int] | None:
    """Return the experiments A and B of a blind trial: the first one and the best, in random order.

    None if they are the same. After each confirmation the order is drawn anew, also if it was
    withdrawn: what was confirmed is told, and with it the order.
    """
    if not best:
        return None
    drawn = np.random.default_rng([int(state.configuration["seed"]), best, state.confirmed, _TRIALS])
    return (0, best) if drawn.random() < 0.5 else (best, 0)


def mark_of_trial(file: StudyFile, before: int) -> str:
    """Return what tells a trial apart, given the number of confirmations before it.

    The place is a part of it: a copy of the file may confirm another trial on the same plant.
    """
    return digest((str(Path(file.path).resolve()), file.state.history.key, before)).hex()


def to_repeat(state: State, seed: int) -> Comparison | None:
    """Return an earlier question with a verdict that has not been repeated yet, or None."""
    done = {c.repeats for c in state.history.repeats}
    left = [c for c in state.history.counting if c.question is not None and c.question not in done]
    left = [c for c in left if not c.retracted and c.answer.preference is not None]
    # Not the very last one, which people remember, unless there is no other.
    left = left[:-1] if len(left) > 1 and left[-1] is state.history.comparisons[-1] else left
    if not left:
        return None
    rng = np.random.default_rng([seed, len(state.history.repeats), _REPEATS])
    return left[int(rng.integers(len(left)))]


# --- Read the experiments of a study by index, as questions show them.

_KEPT = 32  # number of recent experiments to keep in memory; a trajectory can take a megabyte


@dataclass(slots=True)
class ExperimentStore:
    """Store that reads experiments from the study file when they are shown.

    It keeps the most recent ones, and any that other code still holds. Of all others it keeps only
    what takes little memory: their KPIs and how they ended.
    """

    scenario: Scenario
    file: StudyFile
    _held: WeakValueDictionary[int, Experiment] = field(default_factory=WeakValueDictionary)
    _last: OrderedDict[int, Experiment] = field(default_factory=OrderedDict)
    _outcomes: dict[int, Outcome] = field(default_factory=dict)
    _ends: dict[int, End] = field(default_factory=dict)
    _without_kpis: set[int] = field(default_factory=set)

    def experiment(self, index: int) -> Experiment:
        """Return experiment number `index`, from 0. Raises StudyError if there is none."""
        seq = self._event(index)
        experiment = self._held.get(seq)
        if experiment is None:
            experiment = self._held[seq] = self._read(seq, index)
        self._last[seq] = experiment
        self._last.move_to_end(seq)
        while len(self._last) > _KEPT:
            self._last.popitem(last=False)
        return experiment

    def first_measured(self) -> Experiment | None:
        """Return the first experiment that has KPIs; None if there is none yet."""
        for index in sorted(set(self.file.state.finished) - self._without_kpis):
            experiment = self.experiment(index)
            if experiment.kpis:
                return experiment
            self._without_kpis.add(index)
        return None

    def end(self, index: int) -> End:
        """Return how experiment `index`, from 0, ended. Raises StudyError if there is none."""
        seq = self._event(index)
        if seq not in self._ends:
            self._ends[seq] = self.file.end(seq)
        return self._ends[seq]

    def outcomes(self, challenger: int, incumbent: int | None) -> tuple[Outcome, Outcome | None]:
        """Return what the agent can learn from two experiments besides their θ."""
        rival = None if incumbent is None else self._outcome(incumbent)
        return self._outcome(challenger), rival

    def scored(self, index: int) -> tuple[int | None, Answer]:
        """Return the best so far, and experiment `index` compared with it by the scenario's cost.

        It stands in for a question if the agent is told scores. The agent learns the score alone;
        the preference is for readers of the record. An experiment without a record has no score,
        nor has one that was cut short, and an abstention instead of a preference.
        """
        best, value = self.file.state.history.incumbent, self._score(index)
        if best is None:
            return None, Answer(None, value=value)
        rival = self._score(best)
        if value is None:
            return best, Answer(None)
        if rival is None:  # anything is better than a best without a score
            return best, Answer(Preference.CHALLENGER, value=value)
        return best, Answer(Preference(int(np.sign(value - rival))), value=value)

    def _score(self, index: int) -> float | None:
        experiment, cost = self.experiment(index), self.scenario.cost
        assert cost is not None, "refused before the study was begun"
        whole = len(experiment.t) and experiment.end is not End.CUT_SHORT
        value = float(cost(experiment)) if whole else np.nan
        return value if np.isfinite(value) else None

    def _event(self, index: int) -> int:
        finished = self.file.state.finished
        if index not in finished:
            raise StudyError(f"the study has no experiment {index + 1}")
        return finished[index]

    def _read(self, seq: int, index: int) -> Experiment:
        experiment, theta = self.file.experiment(seq), self.file.state.history.samples[index].theta
        added = len(experiment.theta) != len(theta)  # knobs, since it ran
        return replace(experiment, theta=np.array(theta)) if added else experiment

    def _outcome(self, index: int) -> Outcome:
        seq = self._event(index)
        if seq not in self._outcomes:
            self._outcomes[seq] = outcome(self.scenario, self.experiment(index))
        return self._outcomes[seq]

    def failed(self, index: int) -> Experiment:
        """Return an experiment without a record, for sample `index`, whose run failed."""
        theta = np.array(self.file.state.history.samples[index].theta)
        known = self.file.state.finished
        declared = self.scenario.source.channels or Channels((), (), ())
        channels = self.experiment(min(known)).channels if known else declared
        return Experiment.blank(theta, channels, End.FAILED)

    def open_question(self) -> Question:
        """Return the open question, with the current marks; unless it is repeated, with roles and KPIs."""
        state, history = self.file.state, self.file.state.history
        assert state.open is not None
        id_, shown = state.open
        question = self.question(id_, history.answered, shown)
        if shown.repeats is not None:
            return replace(question, further=any(c.question == shown.repeats for c in history.follow_ups))
        further = shown.challenger < history.answered

        def with_role(side: Side) -> Side:
            role = "new" if side.challenger and not further else ""
            return replace(side, role="best so far" if side.index == history.incumbent else role)

        left, right = map(with_role, (question.left, question.right))
        known = self.outcomes(shown.challenger, shown.incumbent)
        return replace(question, left=left, right=right, outcomes=known, further=further)

    def question(self, id_: int, number: int, shown: Shown) -> Question:
        """Return the question of the event `shown`, with the current marks."""
        marks, pair = self.file.state.marks, (shown.challenger, shown.incumbent)
        new, old = (
            Side(index, self.experiment(index), index == pair[0], marks.get(index, frozenset()))
            for index in pair
        )
        sides = (new, old) if shown.challenger_left else (old, new)
        return Question(id_, number, *sides, shown.repeats)

    def asked(self, closed: Comparison) -> Question:
        """Return an answered question as it was shown."""
        if closed.incumbent is None:
            raise StudyError("the first experiment was not compared with anything")
        shown = Shown(closed.challenger, closed.incumbent, closed.challenger_left is not False, None)
        # Nobody was asked if the agent learns from scores: the question has the id of the answer.
        question = self.question(closed.question or closed.seq, closed.challenger, shown)
        return replace(question, further=closed.after is not None)

    def comparison(self, index: int) -> Compared:
        """Return comparison number `index`, from 0; a retracted answer becomes an abstention."""
        return self.compared(self.file.state.history.comparisons[index])

    def compared(self, closed: Comparison) -> Compared:
        """Return the experiments and the answer; a retracted answer becomes an abstention."""
        index, rival, answer = closed.challenger, closed.incumbent, closed.answer
        if closed.retracted:
            answer = Answer(None, marks=answer.marks, automatic=answer.automatic)
        return Compared(
            Query(self._suggestion(index), None if rival is None else self._suggestion(rival)),
            answer,
            self.experiment(index),
            None if rival is None else self.experiment(rival),
        )

    def _suggestion(self, index: int) -> Suggestion:
        return Suggestion(index, np.array(self.file.state.history.samples[index].theta))


# --- Translate between a study file and an agent, and restore the agent from a state.


def constraint_names(space: KnobSpace) -> list[str]:
    """Return the names of the constraints, which the study stores; the code is the scenario's."""
    return [constraint.name for constraint in space.constraints]


def agent_as_dict(agent: Agent) -> dict[str, Any]:
    """Return an agent's settings as plain data, without what it has learned."""
    return agent.configuration


QUESTIONS = "questions_per_experiment"  # name of the agent's setting for comparisons per experiment


def questions_of(configuration: Mapping[str, Any]) -> int:
    """Return the maximum number of comparisons per experiment of a study's agent.

    Raises:
        StudyError: If it is not a whole number.
    """
    settings = configuration["agent"].get("settings")
    most = settings.get(QUESTIONS, 1) if isinstance(settings, Mapping) else 1
    if type(most) is not int:
        raise StudyError(f"{QUESTIONS} of a study must be a whole number, got {most!r}")
    return most


def check_space(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    """Check that a study has the scenario's present knobs and constraints.

    Raises:
        StudyError: If they differ.
    """
    # Studies from before there were constraints have none.
    then, now = configuration.get("constraints", []), constraint_names(space)
    if not isinstance(then, list) or {str(name) for name in then} != set(now):
        raise StudyError(
            f"the scenario's constraints have changed since the study was started: expected {then}, got {now}"
        )
    old, new = configuration["knobs"], knobs_as_dicts(space)
    if old == new:
        return
    old = old if isinstance(old, list) else []
    changed = [knob["name"] for knob in old if knob not in new]
    changed += [knob["name"] for knob in new if knob not in old]
    raise StudyError(
        f"the scenario's knobs have changed since the study was started: {sorted(set(changed))} "
        "differ in name, range, unit or scale (`prefcal studies respace` updates the study)"
    )


def as_studied(scenario: Scenario, state: State) -> Scenario:
    """Return `scenario` with the space of the study, if that was changed after the start.

    Raises:
        StudyError: If the scenario's knobs have changed since the study's were changed.
    """
    configuration = state.configuration
    if "respaced" not in configuration:
        return scenario
    check_space({**configuration, "knobs": configuration.get("scenario_knobs")}, scenario.space)
    space = with_constraints(space_of(configuration), scenario.space)
    about = {knob.name: knob.about for knob in scenario.space if knob.name in space.names}
    return with_ranges(scenario, space.described(about))


def with_constraints(space: KnobSpace, scenario: KnobSpace) -> KnobSpace:
    """Return `space` with the scenario's constraints, whose code is not in the study."""
    within = dict(zip(space.names, space.within, strict=True))
    return KnobSpace(space.knobs, scenario.constraints, within=within)


def agent_of(state: State, space: KnobSpace, simulator: Simulator | None = None) -> Agent:
    """Return the agent of a study, restored with the identical next query.

    Args:
        simulator: What an agent that simulates does so with; without it, it proposes nothing new.

    Raises:
        StudyError: If the study has other knobs.
        SettingsError: If this version does not know the agent.
    """
    check_space(state.configuration, space)
    agent = restore(space, agent_state(state))
    if simulator is None or not simulates(agent):
        return agent
    return cast(Screening, agent).with_simulations(simulator)


def is_simulating(state: State) -> bool:
    """Return whether the agent of a study needs a simulator."""
    row = CLASSES.get(str(state.configuration["agent"].get("agent")))
    return row is not None and row.simulates


def is_robust(state: State) -> bool:
    """Return whether a study judges its candidates by perturbed runs."""
    return bool(state.configuration.get("options", {}).get("robust"))


def agent_state(state: State) -> AgentState:
    """Return the state of a study's agent. Raises SettingsError if it is invalid."""
    return replace(AgentState.of(state.configuration["agent"], state.history), n_max=state.n_max)


def known_outcomes(state: State, store: ExperimentStore) -> History:
    """Return the answers with the KPIs of every experiment, even if the agent did not get them.

    So studies from before KPIs were recorded, and agents that do not learn from KPIs, can be
    analyzed like any other.
    """
    history = agent_state(state).history
    return judged(replace(history, comparisons=tuple(_known(c, store) for c in history.comparisons)))


def index_of(history: History, seed: int) -> LearnedCost | None:
    """Return the weighted sum of KPIs that explains the answers in `history` best.

    As for a proposal, at most 250 answers count: with 1,000, a person would wait for seconds.
    """
    return LearnedCost.of(Subset.of(history).history, seed)


def trust_text(index: LearnedCost) -> str:
    """Return how reliable a learned sum of KPIs is."""
    right = f"{index.predicted} of {index.answers} answers that it had not learned from"
    doubt = (
        ", which is not clearly better than chance: what is said of other θ counts as far as your answers "
        "follow from the KPIs"
    )
    return f"A weighted sum of the KPIs predicted {right}{'' if index.explains else doubt}."


def _known(comparison: Comparison, store: ExperimentStore) -> Comparison:
    if comparison.answer.outcomes is not None and comparison.answer.outcomes[0] is not None:
        return comparison
    outcomes = store.outcomes(comparison.challenger, None)  # each is a challenger once
    return replace(comparison, answer=replace(comparison.answer, outcomes=outcomes))
