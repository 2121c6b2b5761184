"""Convert typed objects to plain data and back, and check plain data that people write."""

import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from hashlib import blake2b
from inspect import signature
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
        kind: A dataclass or a `msgspec.Struct`.
        what: Name of the data for the error, such as "an answer".

    Raises:
        error: If the data does not fit; the message says where and what was expected.
    """
    try:
        return msgspec.convert(data, kind)
    except UNREADABLE as cause:
        raise error(f"{what} cannot be read: {cause}") from cause


def digest(value: Any) -> bytes:
    """Return a digest of `value`, to the last bit of each number; its parts are those of `to_plain`."""
    return blake2b(msgspec.msgpack.encode(value, enc_hook=_plain), digest_size=16).digest()


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


# --- Check plain data that people write, such as a TOML file, against the keys of a table.

Table = TypeVar("Table")
Hint = Callable[[str, Iterable[str]], str]
_NO_HINT: Hint = lambda word, names: ""  # noqa: E731


def checked(
    values: object,
    table: type[Table],
    where: str,
    error: type[PrefcalError],
    hint: Hint = _NO_HINT,
    **given: Any,
) -> Table:
    """Return `values` as a `table`.

    Args:
        table: Class with the known keys as its arguments, with their types, or `msgspec.Struct` with
            them as its fields.
        where: Place of the data, for messages; empty if the caller names it.
        hint: Function that suggests one of the known names for an unknown one, as a sentence with
            a space before it; empty for none.
        given: Fields that the caller knows; they are no keys.

    Raises:
        error: If `values` is no table, a key is unknown or missing, or a value has the wrong type.
            The message names place, key, value and what was expected.
    """
    return table(**given, **entries(values, (table,), where, error, hint, known=given))


Keys = Mapping[str, tuple[Any, bool]]  # type of each key, and whether it is required


def entries(
    values: object,
    tables: tuple[type | Keys, ...],
    where: str,
    error: type[PrefcalError],
    hint: Hint = _NO_HINT,
    *,
    known: Collection[str] = (),
    partial: bool = False,
) -> dict[str, Any]:
    """Return `values` by key, each in the type of its field in one of the `tables`, or of its key.

    Arguments and errors are those of `checked`; fields that are `known` are no keys, and a
    `partial` table may lack keys whose fields have no default.
    """
    place = f"{where}: " if where else ""
    every = {k: v for table in tables for k, v in _fields(table).items() if k not in known}
    if not isinstance(values, Mapping):
        raise error(f"{place}expected a table with {', '.join(every)}, got {values!r:.80}")
    for key in values:
        if key not in every:
            raise error(f"{place}there is no key {key!r}.{hint(str(key), every)} Expected {', '.join(every)}")
    found = {k: _value(v, every[k][0], f"{place}{k}", error) for k, v in values.items()}
    missing = [name for name, (_, needed) in every.items() if needed and name not in found]
    if missing and not partial:
        raise error(f"{place}{missing[0]!r} is missing, expected {_example(missing[0])}")
    return found


def _fields(table: Any) -> Keys:
    """Return type of each field, and whether it is required."""
    if isinstance(table, Mapping):
        return table
    if issubclass(table, msgspec.Struct):
        return {f.name: (f.type, f.required) for f in msgspec.structs.fields(table)}
    arguments = [p for p in signature(table).parameters.values() if p.kind is not p.VAR_KEYWORD]
    return {p.name: (p.annotation, p.default is p.empty) for p in arguments}


def _value(value: Any, type_: Any, where: str, error: type[PrefcalError]) -> Any:
    try:
        return msgspec.convert(value, type_)
    except msgspec.ValidationError as cause:
        problem, _, place = str(cause).partition(" - at `$")
        if place.startswith("[...]") and isinstance(value, dict) and len(value) > 1:
            for key, entry in value.items():  # msgspec does not tell which entry is wrong
                _value({key: entry}, type_, where, error)
        if place.startswith("[...]") and isinstance(value, dict) and value:
            key, value = next(iter(value.items()))
            where = f"{where}, {key}"
        wanted = re.sub(r"`([^`]*)`", lambda m: _in_words(m[1]), problem.split(", got")[0])
        wanted = wanted[:1].lower() + wanted[1:]
        if wanted.startswith("invalid enum value"):
            options = ", ".join(repr(option) for option in _options(type_))
            wanted = f"expected one of {options}"
        raise error(f"{where}: {wanted}, got {value!r:.80}") from cause


_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}


def _in_words(names: str) -> str:
    words = [_WORDS.get(name, name) for name in names.split(" | ") if name != "null"]
    return " or ".join(dict.fromkeys(words))


def _options(type_: Any) -> list[str]:
    """Return the texts that a type allows."""
    options = getattr(type_, "__args__", ())
    found = [o for o in options if isinstance(o, str)]
    return found + [word for option in options for word in _options(option)]


def _example(key: str) -> str:
    return {
        "low": "low = 0.1",
        "high": "high = 100.0",
        "rate": "rate = 1.0, the largest change per second",
        "node": 'node = "ns=2;s=Tank.Level"',
        "url": 'url = "opc.tcp://127.0.0.1:4840"',
        "outputs": 'a table [rig.outputs] with level = { unit = "m" }',
    }.get(key, f"{key} = ...")
