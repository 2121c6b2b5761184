"""Define what a front end sees of a study at one moment: the phase, the question, the plant."""

from dataclasses import dataclass
from enum import Enum

from prefcal_app.simulating import Simulated
from prefcal_env.compiling import Compiling
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Mark, Outcomes, Preference
from prefcal_env.preferences.loop import completed, counts_as_unsafe
from prefcal_env.sources.run import Change, Progress, RunCurve
from prefcal_env.study import State, Suggested

UNSAFE, GOOD_ENOUGH = "unsafe", "good enough"
MARKS = (UNSAFE, GOOD_ENOUGH)
"""Marks that a person can give an experiment, apart from any verdict."""

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
    """Question about two experiments.

    Args:
        id: Id of the event that showed the question; an answer must name it.
        number: Number of the comparison, from 1.
        left: Experiment on the left.
        right: Experiment on the right.
        repeats: Id of the earlier question that is asked again; None for a new question.
        outcomes: KPIs of challenger and incumbent, for the agent; None for a repeated question.
        further: Whether this is a follow-up comparison, of two experiments that were seen before.
    """

    id: int
    number: int
    left: Side
    right: Side
    repeats: int | None = None
    outcomes: Outcomes | None = None
    further: bool = False

    @property
    def challenger(self) -> Side:
        """Return the side that the agent proposed."""
        return self.left if self.left.challenger else self.right

    @property
    def incumbent(self) -> Side:
        """Return the other side: the best so far, or the rival in a follow-up comparison."""
        return self.right if self.left.challenger else self.left

    def preference(self, choice: Choice) -> Preference | None:
        """Return the preference of eq. pref_fun that `choice` means; None for an abstention."""
        if choice is Choice.CANNOT_TELL:
            return None
        if choice is Choice.SAME:
            return Preference.TIE
        left_won = choice is Choice.LEFT
        won = left_won == self.left.challenger
        return Preference.CHALLENGER if won else Preference.INCUMBENT

    def answer(self, choice: Choice) -> Answer:
        """Return the answer that `choice` means, with the current marks of both sides."""
        return Answer(self.preference(choice), marks=self.marks)

    def completed(self, given: Answer) -> Answer:
        """Return `given` with the KPIs and automatic marks of both sides, for record and agent."""
        new, old = self.challenger.experiment, self.incumbent.experiment
        return completed(given, new, old, self.outcomes)

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

    RUNNING = "running"
    """A proposal is being computed or an experiment is being run."""
    RECORD = "record"
    """The person must run the experiment and provide its record."""
    CONFIRM = "confirm"
    """The person must confirm what is written to a live plant."""
    FAILED = "failed"
    """The run raised an error, or the study file could not be written."""
    QUESTION = "question"
    """The person must answer the open question."""
    OVER = "over"
    """The study has ended: all is compared, one is good enough, or the person finished it."""


class Recovery(Enum):
    """Whether the plant has its old values again, which an interrupted run may have changed."""

    DUE = "due"
    RUNNING = "running"
    FAILED = "failed"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class PlantNow:
    """What a front end shows of a plant on which each run must be confirmed.

    Args:
        changes: What a run would write, for the person to confirm; None while it is not known.
        problem: Why it is not known, or what remains to be done on the plant; empty if all is well.
        progress: How far the run is; None if none is in progress.
        times: Instants recorded so far, in seconds.
        curves: Outputs recorded so far.
        stopping: Whether the run was told to stop.
        recovery: Whether the plant has its old values again. If that failed, `problem` says why,
            and nothing is written until it succeeds.
    """

    changes: tuple[Change, ...] | None
    problem: str
    progress: Progress | None
    times: tuple[float, ...]
    curves: tuple[RunCurve, ...]
    stopping: bool
    recovery: Recovery = Recovery.DONE


@dataclass(frozen=True, slots=True)
class Now:
    """Consistent view of an interview.

    Args:
        version: Number that grows with every change.
        phase: What the interview waits for.
        question: Open question, in phase QUESTION.
        problem: Description of the problem, in phase FAILED.
        pending: Sample that is running, awaited or failed; None while it is being proposed.
        incumbent: Index of the best experiment so far; None before the first.
        can: Names of the steps that the person can take.
        state: State of the study file.
        draft: Comment of the answer that was just undone.
        preparing: Part that is being compiled before the first experiment; None when done.
        run_limit: Time limit of a run in seconds; None if it has none.
        simulated: Numbers of what was simulated unseen; None if the agent simulates nothing.
        plant: What is known of a plant whose runs a person confirms; None if the scenario has none.
        running: Number of experiments that are running, if several can; 0 if one runs at a time.
    """

    version: int
    phase: Phase
    question: Question | None
    problem: str | None
    pending: Suggested | None
    incumbent: int | None
    can: frozenset[str]
    state: State
    draft: str = ""
    preparing: Compiling | None = None
    run_limit: float | None = None
    simulated: Simulated | None = None
    plant: PlantNow | None = None
    running: int = 0
