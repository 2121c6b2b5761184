"""Check strictly what a page sends: exact names, exact types, bounded sizes."""

import json
import re
import sys
import unicodedata
from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any
from urllib.parse import parse_qsl

LARGEST_NUMBER = 2**53 - 1
"""Largest whole number that JavaScript, JSON and SQLite all hold exactly."""
LONGEST_TEXT = 10_000
"""Maximum number of characters of a comment or note."""

Check = Callable[[str, Any], Any]
"""Function of a field's name and value that returns the value or raises MalformedError."""


class MalformedError(ValueError):
    """A request that prefcal's page never sends; the text is a sentence for the person."""


def read_json(body: bytes, fields: Mapping[str, Check]) -> dict[str, Any]:
    """Return the JSON object in `body`, which must have exactly these fields.

    Raises:
        MalformedError: If it is not JSON in UTF-8, has other fields, or fails a check.
    """
    try:
        found = json.loads(
            body.decode("utf-8"), object_pairs_hook=_object, parse_constant=_no_number
        )
    except MalformedError:
        raise
    except (ValueError, RecursionError) as error:
        raise MalformedError("The request is not JSON in UTF-8.") from error
    if not isinstance(found, dict):
        raise MalformedError("The request must be a JSON object.")
    return _checked(found, fields, optional=False)


def read_query(query: bytes, fields: Mapping[str, Check]) -> dict[str, Any]:
    """Return the checked parameters after the "?" of an address; each is optional.

    Raises:
        MalformedError: If there are other or repeated parameters, or a value fails a check.
    """
    try:
        # Strict parsing refuses an empty query, which is allowed here.
        pairs = _pairs(query.decode("ascii")) if query else []
    except ValueError as error:
        raise MalformedError("The address has parameters that cannot be read.") from error
    return _checked(_object(pairs), fields, optional=True)


def whole(name: str, value: Any) -> int:
    """Return `value`, which must be a whole number from 0 on."""
    # Not isinstance: in Python, True is an int.
    if type(value) is not int or not 0 <= value <= LARGEST_NUMBER:
        raise MalformedError(f"{name} must be a whole number, 0 or more.")
    return value


def numbered(name: str, value: Any) -> int:
    """Return `value`, the number of an answer: not 0, and below 0 for a follow-up comparison."""
    if type(value) is not int or not 0 < abs(value) <= LARGEST_NUMBER:
        raise MalformedError(f"{name} must be a whole number other than 0.")
    return value


def between(low: int, high: int) -> Check:
    """Return a check for a whole number from `low` to `high`."""

    def check(name: str, value: Any) -> int:
        if not low <= whole(name, value) <= high:
            raise MalformedError(f"{name} must be from {low} to {high}.")
        return int(value)

    return check


def at_most(limit: int) -> Check:
    """Return a check for a whole number from 0 to `limit`."""

    def check(name: str, value: Any) -> int:
        if whole(name, value) > limit:
            raise MalformedError(f"{name} must be at most {limit}.")
        return int(value)

    return check


def text(name: str, value: Any) -> str:
    """Return `value`, which must be text of limited length that any file can hold."""
    if type(value) is not str:
        raise MalformedError(f"{name} must be text.")
    if len(value) > LONGEST_TEXT:
        raise MalformedError(f"{name} is too long: at most {LONGEST_TEXT} characters.")
    # Cc: control characters, including NUL. Cs: half a surrogate pair, not allowed in UTF-8.
    if any(unicodedata.category(c) in ("Cc", "Cs") and c not in "\t\n\r" for c in value):
        raise MalformedError(f"{name} has characters that are not text.")
    return value


def flag(name: str, value: Any) -> bool:
    """Return `value`, which must be true or false."""
    if type(value) is not bool:
        raise MalformedError(f"{name} must be true or false.")
    return value


def one_of(*choices: str) -> Check:
    """Return a check for one of these words."""

    def check(name: str, value: Any) -> str:
        if type(value) is not str or value not in choices:
            raise MalformedError(f"{name} must be one of: {', '.join(choices)}.")
        return value

    return check


def reals(name: str, value: Any) -> tuple[float, ...]:
    """Return `value`, which must be a list of finite numbers."""
    # Not isinstance: in Python, True is an int. An int may be too large for a float.
    if type(value) is not list or any(type(v) not in (int, float) for v in value):
        raise MalformedError(f"{name} must be a list of numbers.")
    if not all(abs(v) <= sys.float_info.max for v in value):
        raise MalformedError(f"{name} must be finite.")
    return tuple(map(float, value))


def digits(name: str, value: Any) -> int:
    """Return the whole number, 0 or more, that is written in an address."""
    if not re.fullmatch("[0-9]{1,15}", value):
        raise MalformedError(f"{name} must be a whole number, 0 or more.")
    return int(value)


def number_of_answer(name: str, value: Any) -> int:
    """Return the whole number other than 0 that is written in an address."""
    if not re.fullmatch("-?[1-9][0-9]{0,14}", value):
        raise MalformedError(f"{name} must be a whole number other than 0.")
    return int(value)


def numbers(name: str, value: Any) -> tuple[float, ...]:
    """Return the finite numbers that are written in an address, separated by commas."""
    try:
        found = tuple(float(part) for part in value.split(","))
    except ValueError as error:
        raise MalformedError(f"{name} must be numbers separated by commas.") from error
    if not all(map(isfinite, found)):
        raise MalformedError(f"{name} must be finite.")
    return found


def bit(name: str, value: Any) -> bool:
    """Return whether the address says 1 rather than 0."""
    if value not in ("0", "1"):
        raise MalformedError(f"{name} must be 0 or 1.")
    return bool(value == "1")


def _checked(
    found: Mapping[str, Any], fields: Mapping[str, Check], *, optional: bool
) -> dict[str, Any]:
    missing = [] if optional else [name for name in fields if name not in found]
    if missing:
        raise MalformedError(f"The request is missing {', '.join(missing)}.")
    if any(name not in fields for name in found):
        raise MalformedError("The request has unknown fields.")
    return {name: fields[name](name, value) for name, value in found.items()}


def _pairs(query: str) -> list[tuple[str, str]]:
    return parse_qsl(
        query, keep_blank_values=True, strict_parsing=True, max_num_fields=8, errors="strict"
    )


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise MalformedError("The request has the same field twice.")
    return found


def _no_number(name: str) -> None:
    raise MalformedError(f"{name} is not a number.")
