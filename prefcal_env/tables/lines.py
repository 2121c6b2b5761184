"""Find the headings, the separator and the rows of a CSV, whatever its encoding."""

import csv
import io
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from prefcal_env.errors import RecordError
from prefcal_env.wording import and_more

from .units import SECONDS, parts_of

_SPACES = r"\s+"
"""The separator of a table that is aligned with spaces."""
_SEPARATORS = ",;\t|"
_LINE_END = re.compile(r"\r\n|\r|\n")
_DIGITS = re.compile(r"[+-]?[.,]?\d")
"""How numbers and time stamps begin."""
_SPACED = re.compile(r'"([^"]*)"|(\S+)')
"""A cell of a table that is aligned with spaces."""
_NUMBER = re.compile(r"\s*[+-]?[\d.,]+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class Lines:
    """The cells of a CSV without comments and empty lines.

    Args:
        headings: Headings of the columns, with the units of a row of units.
        separator: What separates cells.
        rows: Cells of each line below the headings.
        places: Number of the line of each of `rows`, as shown by an editor.
    """

    headings: tuple[str, ...]
    separator: str
    rows: Sequence[Sequence[str]]
    places: tuple[int, ...]

    @property
    def decimal_comma(self) -> bool:
        """Whether numbers may have a decimal comma, which requires another separator."""
        return self.separator != ","

    def uneven(self) -> str:
        """Return what is wrong with rows of more cells than headings; "" if there are none.

        Between spaces, no cell can be empty: rows of fewer cells are wrong, too.
        """
        width, spaced = len(self.headings), self.separator == _SPACES
        wrong = [
            (place, len(row))
            for row, place in zip(self.rows, self.places, strict=True)
            if len(row) != width and (spaced or any(cell.strip() for cell in row[width:]))
        ]
        if not wrong:
            return ""
        place, count = wrong[0]
        if width == 1:
            return (
                f"line {place} has {count} cells, but the first line only one: remove the lines "
                "above the headings, or let them begin with #"
            )
        hint = "" if self.decimal_comma else ": a decimal comma needs semicolons between the cells"
        if spaced:
            hint = (
                ": of a table that is separated by spaces, every row needs as many cells as there "
                "are headings; write it with commas or tabs if cells are empty"
            )
        return f"line {place} has {count} cells under {width} headings{and_more(len(wrong))}{hint}"


def lines_of(text: str, wanted: Collection[str] = ()) -> Lines:
    """Return the cells of a CSV that is separated by commas, semicolons, tabs, bars or spaces.

    Empty lines and lines that begin with # are left out. A second line may hold units.

    Args:
        text: Text of the file.
        wanted: Expected names and headings: the separator that finds most of them is used.

    Raises:
        RecordError: If there is no line, the first one holds numbers, or quotes are broken.
    """
    every = _LINE_END.split(text.removeprefix("\ufeff"))
    if re.fullmatch("sep=.", every[0].strip()):
        every[0] = ""  # a hint for spreadsheets
    places = [
        number
        for number, line in enumerate(every, start=1)
        if line.strip(" \t") and not line.lstrip().startswith("#")
    ]
    if not places:
        raise RecordError("a table needs a line of headings and rows of values, got no line")
    first, *below = (every[number - 1] for number in places)
    if first.count('"') % 2:
        raise RecordError(f"line {places[0]}: a quoted heading does not end: close its quote")
    separator = _separator(first, below[0] if below else "", wanted)
    (headings,) = _split([first], separator)
    while len(headings) > 1 and not headings[-1].strip():
        headings.pop()  # a separator at the end of each line
    if all(_NUMBER.fullmatch(heading) for heading in headings):
        raise RecordError(
            f"the first line must hold headings, got the numbers {', '.join(headings[:5])}: add a "
            "line such as 'time [s],level [m]'"
        )
    rows = _split(below, separator)
    units = _units(headings, rows[0]) if rows else None
    skipped = 0 if units is None else 1
    return Lines(tuple(units or headings), separator, rows[skipped:], tuple(places[1 + skipped :]))


def decoded(content: bytes) -> str:
    """Return the text of a file: UTF-8 or UTF-16 with its mark, or else Windows' Western one.

    Raises:
        RecordError: If it is no text.
    """
    if content.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise RecordError("the file is a workbook or an archive, no table: save it as CSV in UTF-8")
    encodings = ["utf-16"] if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise RecordError("the file is neither text nor Parquet: save it as CSV in UTF-8")


def _separator(first: str, second: str, wanted: Collection[str]) -> str:
    """Return what separates most wanted headings of the first line, or else most headings."""

    def found(separator: str) -> tuple[int, int]:
        try:
            (headings,) = _split([first], separator)
        except RecordError:
            return (-1, 0)
        known = sum(h.strip() in wanted or parts_of(h)[0] in wanted for h in headings)
        return known, len(headings)

    best = max(_SEPARATORS, key=found)
    names, values = _split([first, second], _SPACES)
    return _SPACES if best not in first and 1 < len(names) == len(values) else best


def _units(headings: Sequence[str], cells: Sequence[str]) -> list[str] | None:
    """Return headings with the units in `cells`; None if `cells` are no units.

    They are if one of them is a unit of time, or all are in brackets, and none begins as a number.
    """
    plain = [cell.strip() for cell in cells]
    bare = [cell.strip("[]()").strip() for cell in plain]
    bracketed = all(cell[:1] + cell[-1:] in ("[]", "()") for cell in plain if cell)
    if any(_DIGITS.match(cell) for cell in plain) or len(cells) > len(headings):
        return None
    if not any(bare) or not (bracketed or set(bare) & set(SECONDS)):
        return None
    units = [*bare, *[""] * (len(headings) - len(bare))]
    return [
        f"{heading.strip()} [{unit}]" if unit and parts_of(heading)[1] is None else heading
        for heading, unit in zip(headings, units, strict=True)
    ]


def _split(lines: Sequence[str], separator: str) -> list[list[str]]:
    """Return the cells of each line. Raises RecordError if quotes are broken."""
    if separator == _SPACES:
        return [[quoted or plain for quoted, plain in _SPACED.findall(line)] for line in lines]
    try:
        text = io.StringIO("\n".join(lines))
        found = list(csv.reader(text, delimiter=separator, strict=True))
    except csv.Error as error:
        why = "a quote does not end" if "unexpected end" in str(error) else error
        raise RecordError(f"the record is not valid CSV: {why}") from error
    if len(found) != len(lines):
        raise RecordError("a quoted cell spans several lines: remove the line ends in it")
    return found
