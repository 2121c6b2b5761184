"""Find the headings, the separator and the rows of a CSV, whatever its encoding."""

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from prefcal_env.errors import RecordError
from prefcal_env.wording import and_more

from .units import SECONDS, parts_of

SPACES = r"\s+"
"""The separator of a table that is aligned with spaces, as a regular expression."""
_SEPARATORS = ",;\t|"
_LINE_END = re.compile(r"\r\n|\r|\n")
_DIGITS = re.compile(r"[+-]?[.,]?\d")
"""How numbers and time stamps begin."""
_SPACED = re.compile(r'"([^"]*)"|(\S+)')
"""A cell of a table that is aligned with spaces."""
_NUMBER = re.compile(r"\s*[+-]?[\d.,]+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class Lines:
    """The lines of a CSV without comments and empty lines.

    Args:
        headings: Headings of the columns, with the units of a row of units; none if there is no
            line.
        separator: What separates cells; `SPACES` for one or more spaces.
        rows: Lines below the headings.
        places: Number of each of `rows`, as shown by an editor.
    """

    headings: tuple[str, ...]
    separator: str
    rows: tuple[str, ...]
    places: tuple[int, ...]

    @property
    def decimal_comma(self) -> bool:
        """Whether numbers may have a decimal comma, which requires another separator."""
        return self.separator != ","

    def cells(self) -> list[list[str]]:
        """Return the cells of each row. Raises RecordError if quotes are broken."""
        if self.separator == SPACES:
            return [_spaced(row) for row in self.rows]
        found = _split("\n".join(self.rows), self.separator)
        if len(found) != len(self.rows):
            raise RecordError("a quoted cell spans several lines: remove the line ends in it")
        return found

    def uneven(self) -> str:
        """Return what is wrong with rows of more cells than headings; "" if there are none.

        Between spaces, no cell can be empty: rows of fewer cells are wrong, too.
        """
        width = len(self.headings)
        wrong = list(self._uneven(width))
        if not wrong:
            return ""
        place, count = wrong[0]
        if width == 1:
            return (
                f"line {place} has {count} cells, but the first line only one: remove the lines "
                "above the headings, or let them begin with #"
            )
        hint = "" if self.decimal_comma else ": a decimal comma needs semicolons between the cells"
        if self.separator == SPACES:
            hint = (
                ": of a table that is separated by spaces, every row needs as many cells as there "
                "are headings; write it with commas or tabs if cells are empty"
            )
        return f"line {place} has {count} cells under {width} headings{and_more(len(wrong))}{hint}"

    def _uneven(self, width: int) -> Iterator[tuple[int, int]]:
        """Yield the place of each row with a wrong number of cells, and that number."""
        for row, place in zip(self.rows, self.places, strict=True):
            if self.separator == SPACES:
                if (count := len(_spaced(row))) != width:
                    yield place, count
            elif row.count(self.separator) >= width:
                cells = _split(row, self.separator)[0]
                if any(cell.strip() for cell in cells[width:]):
                    yield place, len(cells)


def lines_of(text: str, wanted: Collection[str] = ()) -> Lines:
    """Return the lines of a CSV that is separated by commas, semicolons, tabs, bars or spaces.

    Empty lines and lines that begin with # are left out. A second line may hold units.

    Args:
        text: Text of the file.
        wanted: Expected names and headings: the separator that finds most of them is used.

    Raises:
        RecordError: If the first line holds numbers or broken quotes.
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
        return Lines((), ",", (), ())
    first, *rows = (every[number - 1] for number in places)
    if first.count('"') % 2:
        raise RecordError(f"line {places[0]}: a quoted heading does not end: close its quote")
    separator = _separator(first, rows[0] if rows else "", wanted)
    headings = _cells_of_one(first, separator)
    while len(headings) > 1 and not headings[-1].strip():
        headings.pop()  # a separator at the end of each line
    _check_headings(headings)
    units = _units(headings, _cells_of_one(rows[0], separator)) if rows else None
    skipped = 1 if units is None else 2
    return Lines(
        tuple(headings if units is None else units), separator,
        tuple(rows[skipped - 1 :]), tuple(places[skipped:]),
    )  # fmt: skip


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
    found = max(_SEPARATORS, key=lambda s: _found(first, s, wanted))
    names, values = _spaced(first), _spaced(second)
    if found not in first and 1 < len(names) == len(values):
        return SPACES
    return found


def _found(line: str, separator: str, wanted: Collection[str]) -> tuple[int, int]:
    """Return how many headings are known with this separator, and how many there are."""
    try:
        headings = _split(line, separator)[0]
    except RecordError:
        return (-1, 0)
    known = sum(h.strip() in wanted or parts_of(h)[0] in wanted for h in headings)
    return known, len(headings)


def _check_headings(headings: Sequence[str]) -> None:
    if all(_NUMBER.fullmatch(heading) for heading in headings):
        raise RecordError(
            f"the first line must hold headings, got the numbers {', '.join(headings[:5])}: add a "
            "line such as 'time [s],level [m]'"
        )


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


def _cells_of_one(line: str, separator: str) -> list[str]:
    return _spaced(line) if separator == SPACES else _split(line, separator)[0]


def _spaced(line: str) -> list[str]:
    return [quoted or plain for quoted, plain in _SPACED.findall(line)]


def _split(text: str, separator: str) -> list[list[str]]:
    try:
        return list(csv.reader(io.StringIO(text), delimiter=separator, strict=True))
    except csv.Error as error:
        why = "a quote does not end" if "unexpected end" in str(error) else error
        raise RecordError(f"the record is not valid CSV: {why}") from error
