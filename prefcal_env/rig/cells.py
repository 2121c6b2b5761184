"""From the text of a record to its cells: lines, comments, separators, and what a number is."""

import csv
import io
import re
from collections.abc import Collection
from dataclasses import dataclass

from prefcal_env.errors import RecordError

_LINE_END = re.compile(r"\r\n|\r|\n")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_SEPARATORS = ",;\t"


@dataclass(frozen=True, slots=True)
class Cells:
    """What stands in a record, as text.

    Args:
        headings: Of the columns.
        rows: Number of the line, as an editor counts it, and its cells.
        decimal_comma: Whether a number may have one: not where commas separate the cells.
    """

    headings: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]
    decimal_comma: bool


def cells_of(text: str, wanted: Collection[str]) -> Cells:
    """The cells of a CSV that is separated by commas, semicolons or tabs.

    Args:
        text: Of the file; empty lines and those that begin with # are left out.
        wanted: Names and headings to look for: the separator is the one that finds most of them.

    Raises:
        RecordError: nothing but comments, or broken quotes.
    """
    lines = [
        (number, line)
        for number, line in enumerate(_LINE_END.split(text.removeprefix("\ufeff")), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        return Cells((), (), False)
    first = lines[0][1]
    separator = max(_SEPARATORS, key=lambda s: _found(first, s, wanted))
    cells = _split("\n".join(line for _, line in lines), separator)
    if len(cells) != len(lines):
        raise RecordError("a quoted cell goes over several lines")
    numbers = [number for number, _ in lines]
    return Cells(tuple(cells[0]), tuple(zip(numbers[1:], cells[1:], strict=True)), separator != ",")


def parts_of(heading: str) -> tuple[str, str | None]:
    """Name and unit of a heading "name [unit]"; None where it has no unit."""
    plain = heading.strip()
    if plain.endswith("]") and "[" in plain:
        name, _, unit = plain[:-1].rpartition("[")
        return name.strip(), unit.strip()
    return plain, None


def number_of(cell: str, *, decimal_comma: bool) -> float | None:
    """The number in a cell; None where there is none, NaN, or one with thousands set apart."""
    plain = cell.strip()
    if not _NUMBER.fullmatch(plain) or ("," in plain and not decimal_comma):
        return None
    return float(plain.replace(",", "."))


def same_unit(one: str, other: str) -> bool:
    """Whether two units are spelled alike, but for spaces, micro signs and superscripts."""
    return _plain(one) == _plain(other)


def _plain(unit: str) -> str:
    spelled = unit.replace(" ", "").replace("\u00b5", "\u03bc").replace("^", "")
    return spelled.translate(str.maketrans("\u00b2\u00b3", "23"))


def _found(line: str, separator: str, wanted: Collection[str]) -> tuple[int, int]:
    """How many headings are known with this separator, and how many there are."""
    try:
        headings = _split(line, separator)[0]
    except RecordError:
        return (-1, 0)
    known = sum(h.strip() in wanted or parts_of(h)[0] in wanted for h in headings)
    return known, len(headings)


def _split(text: str, separator: str) -> list[list[str]]:
    try:
        return list(csv.reader(io.StringIO(text), delimiter=separator, strict=True))
    except csv.Error as error:
        raise RecordError(f"the record is no CSV: {error}") from error
