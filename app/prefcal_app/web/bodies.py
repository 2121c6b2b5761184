"""Say what a page can do, and check strictly what it sends: exact names and types, bounded sizes."""

import re
import sys
from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl

import msgspec
from msgspec import Meta, Struct, defstruct

from prefcal_app.session import Choice

LARGEST_NUMBER = 2**53 - 1
"""Largest whole number that JavaScript, JSON and SQLite all hold exactly."""
LONGEST_TEXT = 10_000
"""Maximum number of characters of a comment or note."""

Whole = Annotated[int, Meta(ge=0, le=LARGEST_NUMBER)]
Signed = Annotated[int, Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Real = Annotated[float, Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
# Without control characters, and without half a surrogate pair, which UTF-8 does not allow.
Text = Annotated[
    str, Meta(max_length=LONGEST_TEXT, pattern=r"^[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]*\Z")
]

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
    "choose": {"theta": tuple[Real, ...], "best": Whole},
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


class JudgedRun(Struct, forbid_unknown_fields=True):
    """A verdict on one of the worst runs of a verification of the tuning with the digest `best`."""

    run: Whole
    seed: Whole
    best: Text
    acceptable: bool


Check = Callable[[str, str], Any]
"""Function of a parameter's name and text that returns its value or raises MalformedError."""


class MalformedError(ValueError):
    """A request that prefcal's page never sends; the text is a sentence for the person."""


def read_json(body: bytes, kind: type[Struct]) -> dict[str, Any]:
    """Return the JSON object in `body`, which must have exactly the fields of `kind`.

    Raises:
        MalformedError: If it is not JSON in UTF-8, or has other fields or values. Of two fields of
            the same name, the second counts.
    """
    try:
        return msgspec.structs.asdict(msgspec.json.decode(body, type=kind))
    except msgspec.ValidationError as error:
        raise MalformedError(f"The request does not fit: {error}.") from error
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise MalformedError("The request is not JSON in UTF-8.") from error


def read_query(query: bytes, fields: Mapping[str, Check]) -> dict[str, Any]:
    """Return the checked parameters after the "?" of an address; each is optional.

    Raises:
        MalformedError: If there are other or repeated parameters, or a value fails a check.
    """
    try:
        # Strict parsing refuses an empty query, which is allowed here.
        strict: Any = {"keep_blank_values": True, "strict_parsing": True, "errors": "strict"}
        pairs = parse_qsl(query.decode("ascii"), **strict, max_num_fields=8) if query else []
    except ValueError as error:
        raise MalformedError("The address has parameters that cannot be read.") from error
    found = dict(pairs)
    if len(found) != len(pairs) or any(name not in fields for name in found):
        raise MalformedError("The request has unknown fields, or one twice.")
    return {name: fields[name](name, value) for name, value in found.items()}


def digits(name: str, value: str) -> int:
    """Return the whole number, 0 or more, that is written in an address."""
    if not re.fullmatch("[0-9]{1,15}", value):
        raise MalformedError(f"{name} must be a whole number, 0 or more.")
    return int(value)


def number_of_answer(name: str, value: str) -> int:
    """Return the whole number other than 0 that is written in an address."""
    if not re.fullmatch("-?[1-9][0-9]{0,14}", value):
        raise MalformedError(f"{name} must be a whole number other than 0.")
    return int(value)


def numbers(name: str, value: str) -> tuple[float, ...]:
    """Return the finite numbers that are written in an address, separated by commas."""
    try:
        found = tuple(float(part) for part in value.split(","))
    except ValueError as error:
        raise MalformedError(f"{name} must be numbers separated by commas.") from error
    if not all(map(isfinite, found)):
        raise MalformedError(f"{name} must be finite.")
    return found


def bit(name: str, value: str) -> bool:
    """Return whether the address says 1 rather than 0."""
    if value not in ("0", "1"):
        raise MalformedError(f"{name} must be 0 or 1.")
    return bool(value == "1")
