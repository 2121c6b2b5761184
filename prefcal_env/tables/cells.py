"""Split the text of a record into cells: lines, comments, separators, and numbers."""

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
    """The cells of a record, as text.

    Args:
        headings: Headings of the columns.
        rows: Line number, as shown by an editor, and cells of each row.
        decimal_comma: Whether numbers may have a decimal comma, which requires another separator.
    """

    headings: tuple[str, ...]
    rows: tuple[tuple[int, list[str]], ...]
    decimal_comma: bool


def cells_of(text: str, wanted: Collection[str]) -> Cells:
    """Return the cells of a CSV that is separated by commas, semicolons or tabs.

    Args:
        text: Text of the file; empty lines and lines that begin with # are ignored.
        wanted: Expected names and headings: the separator that finds most of them is used.

    Raises:
        RecordError: If there are only comments, or quotes are broken.
    """
    lines = [
        (number, line)
        for number, line in enumerate(_LINE_END.split(text.removeprefix("\ufeff")), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        return Cells((), (), False)
    separator = separator_of(lines[0][1], wanted)
    cells = _split("\n".join(line for _, line in lines), separator)
    if len(cells) != len(lines):
        raise RecordError("a quoted cell spans several lines")
    numbers = [number for number, _ in lines]
    return Cells(tuple(cells[0]), tuple(zip(numbers[1:], cells[1:], strict=True)), separator != ",")


def separator_of(line: str, wanted: Collection[str], separators: str = _SEPARATORS) -> str:
    """Return the separator by which most of the headings in `line` are wanted ones.

    If several find as many, it is the one that finds most headings.
    """
    return max(separators, key=lambda s: _found(line, s, wanted))


def split_line(line: str, separator: str) -> list[str]:
    """Return the cells of one line. Raises RecordError if quotes are broken."""
    return _split(line, separator)[0]


def parts_of(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading "name [unit]"; the unit is None if there is none."""
    plain = heading.strip()
    if plain.endswith("]") and "[" in plain:
        name, _, unit = plain[:-1].rpartition("[")
        return name.strip(), unit.strip()
    return plain, None


def number_of(cell: str, *, decimal_comma: bool) -> float | None:
    """Return the number in a cell; None for NaN, thousands separators, or no number."""
    plain = cell.strip()
    if not _NUMBER.fullmatch(plain) or ("," in plain and not decimal_comma):
        return None
    return float(plain.replace(",", "."))


def same_unit(one: str, other: str) -> bool:
    """Return whether two units are equal up to spaces, micro signs and superscripts."""
    return _plain(one) == _plain(other)


def _plain(unit: str) -> str:
    spelled = unit.replace(" ", "").replace("\u00b5", "\u03bc").replace("^", "")
    return spelled.translate(str.maketrans("\u00b2\u00b3", "23"))


def _found(line: str, separator: str, wanted: Collection[str]) -> tuple[int, int]:
    """Return how many headings are known with this separator, and how many there are."""
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
        raise RecordError(f"the record is not valid CSV: {error}") from error
