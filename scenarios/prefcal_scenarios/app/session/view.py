"""What a front end sees at one moment of an interview. Frozen."""

from dataclasses import dataclass
from enum import Enum

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.mpc.compiling import Compiling
from prefcal_env.preferences.answer import Answer, Mark, Outcomes, Preference, Strength
from prefcal_env.preferences.run_facts import completed, counts_as_unsafe
from prefcal_env.study import State, Suggested

UNSAFE, GOOD_ENOUGH = "unsafe", "good enough"
MARKS = (UNSAFE, GOOD_ENOUGH)
"""What a person may say of one experiment, apart from any verdict."""

_CHALLENGER = {UNSAFE: Mark.CHALLENGER_UNSAFE, GOOD_ENOUGH: Mark.CHALLENGER_GOOD_ENOUGH}
_INCUMBENT = {UNSAFE: Mark.INCUMBENT_UNSAFE, GOOD_ENOUGH: Mark.INCUMBENT_GOOD_ENOUGH}


class Phase(Enum):
    """What the interview is waiting for."""

    RUNNING = "running"
    """A proposal is being computed or an experiment is being run."""
    RECORD = "record"
    """The person has to run the experiment himself, and hand its record in."""
    FAILED = "failed"
    """The run raised, or the study file could not be written: try again, or count it as failed."""
    QUESTION = "question"
    """An answer."""
    OVER = "over"
    """Nothing: all is compared, an experiment is good enough, or the person has stopped."""


class Choice(Enum):
    """A verdict by side, as the person sees it."""

    LEFT = "left"
    RIGHT = "right"
    SAME = "same"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True, slots=True)
class Side:
    """One of the two experiments of a question; `index` counts from 0, people from 1.

    The `role` is said beside the number: "new", "best so far", or nothing. In a question that asks
    an earlier one again, or that was closed, nobody is said to be the best.
    """

    index: int
    experiment: Experiment
    challenger: bool
    marks: frozenset[str] = frozenset()
    role: str = ""

    @property
    def counts_as_unsafe(self) -> bool:
        """Whether its answer marks it as unsafe because of how its run ended, unsaid."""
        return counts_as_unsafe(self.experiment)


@dataclass(frozen=True, slots=True)
class Question:
    """Two experiments, and which of them stands where.

    Args:
        id: Of the event that put it on show; an answer has to name it.
        number: Of the comparison, from 1.
        left: The experiment on the left.
        right: The other one.
        repeats: Id of the earlier question that it asks again; None for a new one.
        outcomes: KPIs of challenger and incumbent, for the agent; None where it learns nothing.
        further: Whether both experiments had been compared with others before.
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
        """The side that the agent proposed."""
        return self.left if self.left.challenger else self.right

    @property
    def incumbent(self) -> Side:
        """The side that was there before: the best so far, or in a further question the earlier."""
        return self.right if self.left.challenger else self.left

    def preference(self, choice: Choice) -> Preference | None:
        """What `choice` means, as in eq. pref_fun; None for an abstention."""
        if choice is Choice.CANNOT_TELL:
            return None
        if choice is Choice.SAME:
            return Preference.TIE
        left_won = choice is Choice.LEFT
        won = left_won == self.left.challenger
        return Preference.CHALLENGER if won else Preference.INCUMBENT

    def answer(self, choice: Choice, strength: float = Strength.BETTER) -> Answer:
        """What `choice` means, with the marks that both sides bear now."""
        return Answer(self.preference(choice), strength, self.marks)

    def completed(self, given: Answer) -> Answer:
        """`given` with all that comes with it unasked: what is recorded and told."""
        new, old = self.challenger.experiment, self.incumbent.experiment
        return completed(given, new, old, self.outcomes)

    def choice(self, preference: Preference | None) -> Choice:
        """The reverse of `preference`."""
        return next(c for c in Choice if self.preference(c) is preference)

    @property
    def marks(self) -> tuple[Mark, ...]:
        """The marks that both sides bear now, in the words of an `Answer`."""
        sides = ((self.challenger, _CHALLENGER), (self.incumbent, _INCUMBENT))
        return tuple(words[m] for side, words in sides for m in MARKS if m in side.marks)


@dataclass(frozen=True, slots=True)
class Now:
    """One consistent view of an interview.

    Args:
        version: Grows with every change.
        phase: What is waited for.
        question: The open question, in phase QUESTION.
        problem: What went wrong, in phase FAILED.
        pending: The sample that is run, awaited or failed; None while it is being proposed.
        incumbent: Index of the best experiment so far; None before the first.
        can_undo: Whether there is an answer to take back.
        state: What the study file says.
        draft: The comment of the answer that was just taken back.
        preparing: What is compiled before the first experiment can run; None once all is there.
        run_limit: Most seconds of a run, which can be stopped; None where runs cannot be stopped.
    """

    version: int
    phase: Phase
    question: Question | None
    problem: str | None
    pending: Suggested | None
    incumbent: int | None
    can_undo: bool
    state: State
    draft: str = ""
    preparing: Compiling | None = None
    run_limit: float | None = None
