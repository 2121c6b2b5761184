"""Define a question about two experiments, and the choices of the person who answers it."""

from dataclasses import dataclass
from enum import Enum

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer, Mark, Outcomes, Preference
from prefcal_env.preferences.loop import completed, counts_as_unsafe

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
