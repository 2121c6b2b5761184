"""Define questions and answers, which an agent and a person or program exchange.

Source: the preference function is eq. pref_fun, its vector of answers eq. pref-vector.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any, Protocol, Self, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PreferenceError
from prefcal_env.knobs.knob import is_number
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plain import from_plain, to_plain

from .kpis import Outcome

ExperimentT = TypeVar("ExperimentT", contravariant=True)


Outcomes = tuple[Mapping[str, Any] | None, Mapping[str, Any] | None]
"""KPIs of the challenger and of the incumbent: names and numbers.

An `Answer` turns both into an `Outcome`. The values are not `float` here, since JSON has no
infinity: stored outcomes say "inf" or "-inf" instead.
"""


class Preference(IntEnum):
    """π(challenger, incumbent) of eq. pref_fun."""

    CHALLENGER = -1
    TIE = 0
    INCUMBENT = 1


class Mark(Enum):
    """Marks that a calibrator may give to one side besides the verdict.

    No calibrator gives the last one: it says that the KPIs of the challenger are lower bounds,
    because its run was cut short.
    """

    CHALLENGER_UNSAFE = "challenger unsafe"
    INCUMBENT_UNSAFE = "incumbent unsafe"
    CHALLENGER_GOOD_ENOUGH = "challenger good enough"
    INCUMBENT_GOOD_ENOUGH = "incumbent good enough"
    CHALLENGER_CUT_SHORT = "challenger cut short"

    @property
    def mirrored(self) -> "Mark":
        """The same mark on the other side."""
        side, _, what = self.value.partition(" ")
        return Mark(f"{'incumbent' if side == 'challenger' else 'challenger'} {what}")


@dataclass(frozen=True, slots=True)
class Answer:
    """An answer to a query.

    Args:
        preference: Which one is better; None is an abstention ("can't tell").
        strength: Weight c_h of eq. QP-pref, above 0, which counts where answers contradict each
            other: 1 for an ordinary verdict. That of a tie or an abstention is always 1.
        marks: Marks on either side.
        outcomes: Known KPIs of the challenger's and the incumbent's experiments by name, lower is
            better; infinite means never, NaN or no entry means unknown.
        value: Score of the challenger, lower is better, from which a value-based agent learns
            instead of a preference.
        automatic: The `marks` that no person gave, because they follow from how a run ended; see
            `completed`.

    Raises:
        PreferenceError: If the preference is none of -1, 0, 1 and None, the strength is not
            positive and finite, a mark is unknown, an automatic mark is not among the marks, or the
            value is not finite.
    """

    preference: Preference | None
    strength: float = 1
    marks: tuple[Mark, ...] = ()
    outcomes: Outcomes | None = None
    value: float | None = None
    automatic: tuple[Mark, ...] = ()

    def __post_init__(self) -> None:
        if self.preference is not None:
            object.__setattr__(self, "preference", _preference(self.preference))
        if not (is_number(self.strength) and 0 < self.strength < np.inf):
            raise PreferenceError(f"strength must be finite and above 0, got {self.strength!r}")
        if not self.preference and self.strength != 1:  # a tie or an abstention
            object.__setattr__(self, "strength", 1)
        object.__setattr__(self, "marks", tuple(self.marks))
        for mark in self.marks:
            if not isinstance(mark, Mark):
                raise PreferenceError(f"a mark must be one of {list(Mark)}, got {mark!r}")
        object.__setattr__(self, "automatic", tuple(self.automatic))
        if not set(self.automatic) <= set(self.marks):
            raise PreferenceError(f"automatic must be some of the marks {self.marks}, got {self.automatic}")
        if self.outcomes is not None:
            object.__setattr__(self, "outcomes", _outcomes(self.outcomes))
        if self.value is not None:
            object.__setattr__(self, "value", _score(self.value))

    @classmethod
    def of(cls, answer: "Answer | Preference | int | None") -> "Answer":
        """Return `answer` as an Answer; a bare -1, 0, 1 or None (abstain) is accepted.

        Raises:
            PreferenceError: If it is anything else.
        """
        return answer if isinstance(answer, cls) else cls(answer)  # type: ignore[arg-type]

    @classmethod
    def scored(cls, value: "Answer | float | None") -> "Answer":
        """Return the score `value` as an Answer; None if the experiment has no score.

        Raises:
            PreferenceError: If it is not a finite number, or an Answer that holds a preference.
        """
        answer = value if isinstance(value, cls) else cls(None, value=value)  # type: ignore[arg-type]
        if answer.preference is not None:
            raise PreferenceError(f"a value-based agent needs a score, not a preference: got {answer}")
        return answer

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON; `from_dict` reads it back."""
        plain: dict[str, Any] = to_plain(self)
        return plain

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> "Answer":
        """Read the data that `to_dict` returned; other keys are ignored.

        Raises:
            PreferenceError: If something is missing or malformed.
        """
        return from_plain(data, cls, PreferenceError, "an answer")


def _outcomes(given: Any) -> tuple[Outcome | None, Outcome | None]:
    """Return a pair of outcomes, None if unknown; a single one is the challenger's."""
    if isinstance(given, Mapping):
        given = (given, None)
    if not isinstance(given, (tuple, list)) or len(given) != 2:
        raise PreferenceError(f"outcomes must be the challenger's and the incumbent's, got {given!r}")
    challenger, incumbent = (
        o if o is None or isinstance(o, Outcome) else Outcome.from_dict(o) for o in given
    )
    return challenger, incumbent


def _score(value: Any) -> float:
    if is_number(value) and np.isfinite(value):
        return float(value)
    raise PreferenceError(f"a score must be a finite number, or None if there is none, got {value!r}")


def _preference(value: Any) -> Preference:
    if is_number(value) and value in (-1, 0, 1):  # np.sign gives a float
        return Preference(int(value))
    raise PreferenceError(
        "an answer must be -1 (challenger better), 0 (equally good), 1 (incumbent better), "
        f"None (can't tell) or an Answer, got {value!r}"
    )


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Experiment number `index` (from 0), with parameters `theta`, physical, shape (n,)."""

    index: int
    theta: Float[np.ndarray, " n"]

    def __post_init__(self) -> None:
        theta = np.array(self.theta, dtype=float)
        theta.setflags(write=False)
        object.__setattr__(self, "theta", theta)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Suggestion):
            return NotImplemented
        return self.index == other.index and np.array_equal(self.theta, other.theta)

    def __hash__(self) -> int:
        return hash((self.index, (self.theta + 0.0).tobytes()))  # -0.0 is equal to 0.0


@dataclass(frozen=True, slots=True)
class Query:
    """A question: is the challenger better than the incumbent?

    The incumbent is None in the very first query (there is nothing to compare with; any answer
    closes it and teaches nothing) and in every query of a value-based agent. A `further` query
    compares two experiments that have run, and needs no new one.
    """

    challenger: Suggestion
    incumbent: Suggestion | None = None
    further: bool = False


class Agent(Protocol):
    """An agent that proposes θ and learns from preferences; the one mutable object of a study.

    `ask` is pure: asking twice changes nothing. `tell` refuses an answer to a query that is
    not the open one. The contract suite `tests/contracts/agents.py` is what an agent must pass.
    """

    @property
    def space(self) -> KnobSpace:
        """The knobs that θ is made of."""

    @property
    def n_max(self) -> int:
        """Number of experiments after which the agent is done."""

    @property
    def done(self) -> bool:
        """Whether all experiments are answered."""

    @property
    def best(self) -> Float[np.ndarray, " n"]:
        """θ of the incumbent, physical, shape (n,). Raises ProtocolError before any answer."""

    def ask(self) -> Query:
        """Return the open query. Raises ProtocolError when done."""

    def tell(self, query: Query, answer: Answer | Preference | int | None) -> None:
        """Close `query`. Raises ProtocolError if it is not open, PreferenceError if no answer."""

    def undo(self) -> None:
        """Take the last answer back and open its query again. Raises ProtocolError if none."""

    def retract(self, index: int) -> None:
        """Forget answer number `index` (from 0), keep its sample. Raises ProtocolError if none."""

    def copy(self) -> Self:
        """Return an independent copy, used to prepare the next query for each likely answer."""


@runtime_checkable
class Calibrator(Protocol[ExperimentT]):
    """A judge of two experiments: the front end of a person, or a synthetic one."""

    def prefer(self, challenger: ExperimentT, incumbent: ExperimentT) -> Answer | Preference | int | None:
        """Return which one is better: -1, 0 or 1 as in eq. pref_fun, or None to abstain."""
