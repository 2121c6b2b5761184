"""Define the actions of the page: methods of the interview, with the fields of their requests."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, defstruct

from prefcal_app.session import Choice

from .bodies import Real, Signed, Text, Whole

MOST_MORE = 10_000
"""Maximum number of additional experiments per request."""
MOST_QUESTIONS = 99
"""Maximum number of comparisons for each experiment; no ranking needs more."""

_FIELDS: dict[str, dict[str, Any]] = {
    "answer": {"question": Whole, "choice": Choice, "comment": Text, "blind": bool},
    "mark": {
        "question": Whole,
        "side": Literal["left", "right"],
        "mark": Literal["unsafe", "good enough"],
        "on": bool,
    },
    "undo": {"version": Whole},
    "retract": {"answer": Signed},
    "repeat": {},
    "pace": {"questions": Annotated[int, Meta(ge=1, le=MOST_QUESTIONS)]},
    "ask_for": {"theta": tuple[Real, ...]},
    "stop_run": {"index": Whole},
    "write_and_start": {"index": Whole},
    "retry": {},
    "fail": {"index": Whole, "reason": Text},
    "finish": {},
    "go_on": {"more": Annotated[int, Meta(ge=0, le=MOST_MORE)]},
}
ACTIONS: Mapping[str, type[Struct]] = MappingProxyType(
    {
        name: defstruct(name, list(fields.items()), forbid_unknown_fields=True)
        for name, fields in _FIELDS.items()
    }
)
"""Bodies of the requests, by the name of the interview's method; every field is required."""


class Nothing(Struct, forbid_unknown_fields=True):
    """Body without fields."""
