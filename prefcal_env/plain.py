"""Conversion between typed objects and plain data as in JSON, by msgspec."""

import json
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
import numpy as np

from .errors import PrefcalError

T = TypeVar("T")

UNREADABLE = (msgspec.MsgspecError, ValueError, OverflowError, RecursionError)
"""Errors that reading untrusted JSON may raise."""


def to_plain(value: Any) -> Any:
    """Return `value` as dicts, lists, text, numbers, booleans and None.

    Raises:
        TypeError: If a part of it has no plain form.
    """
    return msgspec.to_builtins(value, enc_hook=_plain)


def from_plain(data: Any, kind: type[T], error: type[PrefcalError], what: str) -> T:
    """Return `data` as an object of type `kind`, with every field checked.

    Args:
        data: Plain data.
        kind: A dataclass or a `msgspec.Struct`.
        error: Error to raise.
        what: Name of the data for the error, such as "an answer".

    Raises:
        error: If the data does not fit; the message says where and what was expected.
    """
    try:
        return msgspec.convert(data, kind)
    except UNREADABLE as cause:
        raise error(f"{what} cannot be read: {cause}") from cause


def canonical(content: Any) -> str:
    """Return the one JSON text of plain data: sorted keys, no spaces.

    Raises:
        TypeError: If it is not plain data.
        ValueError: If a number is not finite or a string contains half of a surrogate pair.
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    text.encode()  # half of a surrogate pair cannot be encoded
    return text


def _plain(value: Any) -> Any:
    """Return the plain form of a type that msgspec does not know."""
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (np.floating, np.integer)):
        return value.item()
    raise TypeError(f"{type(value).__name__} is not plain data")
