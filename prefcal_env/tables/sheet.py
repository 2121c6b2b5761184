"""Read a table: its units, headings, separator and rows, with the place of each row."""

import csv
import io
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import timedelta
from itertools import takewhile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env import units
from prefcal_env.errors import MissingExtraError, RecordError
from prefcal_env.wording import and_more, did_you_mean

_SUBSCRIPT = re.compile(r"\s*-?\d+\s*([,:]\s*-?\d+\s*)*")


def parts_of(heading: str) -> tuple[str, str | None]:
    """Return name and unit of a heading "name [unit]"; the unit is None if there is none.

    Parentheses may hold a unit, too, as in "time (s)"; otherwise they belong to the name. So do
    the subscripts of x[2] and A[1,3]; "x [1]" has no dimension.
    """
    plain = heading.strip()
    if plain.endswith("]") and "[" in plain:
        name, _, unit = plain[:-1].rpartition("[")
        if _SUBSCRIPT.fullmatch(unit) and not (name.endswith(" ") and unit.strip() == "1"):
            return plain, None
        return name.strip(), unit.strip()
    if plain.endswith(")") and "(" in plain:
        name, _, unit = plain[:-1].rpartition("(")
        if units.known(unit):
            return name.strip(), unit.strip()
    return plain, None


# --- Find the headings, the separator and the rows of a CSV, whatever its encoding.

_SPACES = r"\s+"  # the separator of a table that is aligned with spaces
_SEPARATORS = ",;\t|"
_ANY_LINE_END = re.compile(r"\r\n|\r|\n")
_DIGITS = re.compile(r"[+-]?[.,]?\d")  # how numbers and time stamps begin
_SPACED = re.compile(r'"([^"]*)"|(\S+)')  # A cell of a table that is aligned with spaces
_MAYBE_NUMBER = re.compile(r"\s*[+-]?[\d.,]+([eE][+-]?\d+)?\s*")


@dataclass(frozen=True, slots=True)
class Lines:
    """The cells of a CSV without comments and empty lines."""

    headings: tuple[str, ...]  # headings of the columns, with the units of a row of units
    separator: str  # what separates cells
    rows: Sequence[Sequence[str]]  # cells of each line below the headings
    places: tuple[int, ...]  # number of the line of each of `rows`, as shown by an editor

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
        wanted: Expected names and headings: the separator that finds most of them is used.

    Raises:
        RecordError: If there is no line, the first one holds numbers, or quotes are broken.
    """
    every = _ANY_LINE_END.split(text.removeprefix("\ufeff"))
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
    return _lines(separator, [_join(headings, separator), *_split(below, separator)], places)


def _join(headings: Sequence[str], separator: str) -> list[str]:
    """Return headings without separators in brackets, as A[1,3] has one without quotes."""
    found: list[str] = []
    for heading in headings:
        if found and found[-1].count("[") > found[-1].count("]"):
            found[-1] += separator + heading
        else:
            found.append(heading)
    return found if all(h.count("[") == h.count("]") for h in found) else list(headings)


def _lines(separator: str, cells: Sequence[list[str]], places: Sequence[int]) -> Lines:
    """Return the cells of a table, whose headings come first, and perhaps a row of units."""
    headings, *rows = cells
    while len(headings) > 1 and not headings[-1].strip():
        headings.pop()  # a separator at the end of each line
    if all(_MAYBE_NUMBER.fullmatch(heading) for heading in headings):
        raise RecordError(
            f"the first line must hold headings, got the numbers {', '.join(headings[:5])}: add a "
            "line such as 'time [s],level [m]'"
        )
    with_units = _units(headings, rows[0]) if rows else None
    skipped = 0 if with_units is None else 1
    return Lines(tuple(with_units or headings), separator, rows[skipped:], tuple(places[1 + skipped :]))


def lines_of_workbook(content: bytes) -> Lines:
    """Return the cells of the first sheet of an Excel workbook: .xlsx, .xls, .xlsb, or .ods.

    Raises:
        MissingExtraError: If python-calamine is not installed.
        RecordError: If it is no workbook, or its sheet no table.
    """
    try:
        from python_calamine import CalamineError, CalamineWorkbook
    except ImportError as error:
        raise MissingExtraError(
            "Excel needs python-calamine: pip install 'prefcal[excel]', or save the table as CSV in UTF-8"
        ) from error
    try:
        sheet = CalamineWorkbook.from_filelike(io.BytesIO(content)).get_sheet_by_index(0)
        _check_size(sheet.total_height, sheet.total_width)
        cells = sheet.to_python(skip_empty_area=False)
    except CalamineError as error:
        raise RecordError(
            f"the file is a workbook or an archive that cannot be read ({error}): save it as CSV in UTF-8"
        ) from error
    rows = [[_text_of(cell) for cell in row] for row in cells]
    places = [k for k, row in enumerate(rows) if any(row)]
    if not places:
        raise RecordError("a table needs a line of headings and rows of values, got an empty sheet")
    width = max(k + 1 for place in places for k, cell in enumerate(rows[place]) if cell)
    return _lines(",", [rows[k][:width] for k in places], [k + 1 for k in places])


def _text_of(cell: Any) -> str:
    """Return a cell of a workbook as it would stand in a CSV."""
    if isinstance(cell, timedelta):
        minutes, seconds = divmod(cell.total_seconds(), 60)
        return f"{int(minutes // 60)}:{int(minutes % 60):02d}:{seconds:09.6f}"
    return str(cell).strip()


def decode(content: bytes) -> str:
    """Return the text of a file: UTF-8 or UTF-16 with its mark, or else Windows' Western one.

    Raises:
        RecordError: If it is no text.
    """
    encodings = ["utf-16"] if content[:2] in (b"\xff\xfe", b"\xfe\xff") else ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = content.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise RecordError("the file is neither text nor Parquet nor a workbook: save it as CSV in UTF-8")


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
    if not any(bare) or not (bracketed or any(map(units.seconds, bare))):
        return None
    found = [*bare, *[""] * (len(headings) - len(bare))]
    return [
        f"{heading.strip()} [{unit}]" if unit and parts_of(heading)[1] is None else heading
        for heading, unit in zip(headings, found, strict=True)
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


def pyarrow() -> ModuleType:
    """Return pyarrow, with its module `parquet`. Raises MissingExtraError if pyarrow is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingExtraError("Parquet needs pyarrow: pip install pyarrow, or use CSV") from error
    return pyarrow  # type: ignore[no-any-return]


# --- Read a table: CSV, Parquet, text or a DataFrame, with the place of each row.

Table = Any
"""A DataFrame, the path of a CSV, Parquet or Excel file, its content, the text of a CSV, or a `Sheet`."""
_LINE_END = re.compile(r"[\r\n]")
_PARQUET = b"PAR1"
_WORKBOOK = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
_SAMPLE = 1000  # number of cells that tell whether a column was meant as numbers
_MOST_NAMED = 12  # largest number of headings in a message
_MOST_COLUMNS, _MOST_CELLS = 2_000, 5_000_000
"""Largest number of columns and of cells of a file; a run of an hour at 100 Hz has 360,000 rows."""

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?", re.ASCII)
_PLAIN = frozenset("0123456789+-.eE")
"""Characters of cells that Python takes for a number in no other case than we do."""
_WORDS = {
    **dict.fromkeys(("", "nan", "na", "n/a", "#n/a", "<na>", "null", "none"), np.nan),
    **dict.fromkeys(("inf", "+inf", "infinity", "+infinity"), np.inf),
    **dict.fromkeys(("-inf", "-infinity"), -np.inf),
    "false": 0.0,
    "true": 1.0,
}
"""Values of cells that hold no digits; NaN for an empty one."""
_BAD = re.compile(
    r"(bad|err(or)?|fault|fail(ed)?|invalid|(i/?o )?time-?out|no (data|good|result|sample|value|comm\w*)|"
    r"not (available|connect(ed)?|good|read)|(calc|comm)\w* (failed|fail|off|error|fault)|scan (off|timeout)|"
    r"out of serv\w*|(over|under) ?range|pt created|intf shut|shutdown|disconnected|offline|unavailable|"
    r"unknown)\b.*|#[a-z0-9/]+[!?]?|[-?*]+|\[-\d+\].*",
    re.IGNORECASE,
)
"""What historians, controllers and spreadsheets write if there is no good value."""
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}([., ']\d{3})+([.,]\d+)?")
_WITH_UNIT = re.compile(r"[+-]?[\d.,]+([eE][+-]?\d+)? *[^\d\s.,:]{1,8}")
_SURELY_WITH_UNIT = re.compile(
    r"[+-]?(\d*[.,]\d+([eE][+-]?\d+)?|\d+([eE][+-]?\d+)?(?=[ %°])) *[^\d\s.,:]{1,8}"
)
"""Unlike `_WITH_UNIT`, no identifier such as 12A."""
_STAMP = re.compile(r"\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}\b.*|\d{1,2}:\d\d(:\d\d.*)?")
_ONE_SIGN = "use decimal points in all columns, or decimal commas in all of them"


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A table with its headings and the places of its rows."""

    headings: tuple[str, ...]
    frame: Any  # pandas DataFrame whose columns are numbered from 0
    # Line of each row as an editor shows it, shape (K,); None if it comes from no text
    lines: Int[np.ndarray, " K"] | None = None
    uneven: str = ""  # what is wrong with rows of too many cells; "" if nothing is
    # Line of the first number with a decimal comma, and with a point, by column
    signs: Mapping[int, Mapping[str, int]] = field(default_factory=dict)
    # What was written instead of a good value, by column and row; such cells are NaN
    bad: Mapping[int, Mapping[int, str]] = field(default_factory=dict)
    # Why a column is nothing that was measured, such as "row numbers", by column
    aside: Mapping[int, str] = field(default_factory=dict)
    said: tuple[str, ...] = ()  # what else was made of the table, in words
    own_times: bool = False  # whether each column has times of its own, so that empty cells are not missing

    def take(self, rows: Int[np.ndarray, " M"]) -> "Sheet":
        """Return the sheet of these rows, in this order."""
        bad = {
            i: {new: cells[old] for new, old in enumerate(rows.tolist()) if old in cells}
            for i, cells in self.bad.items()
        }
        frame = self.frame.iloc[rows].reset_index(drop=True)
        return replace(self, frame=frame, lines=None if self.lines is None else self.lines[rows], bad=bad)

    def place(self, row: int) -> str:
        """Return where a row is, for messages: "line 7" of a file, or "row 5" counted from 0."""
        return f"row {row}" if self.lines is None else f"line {self.lines[row]}"

    def name(self, column: int) -> str:
        """Return the heading of a column without its unit."""
        return parts_of(self.headings[column])[0]

    def find(self, heading: str) -> int | None:
        """Return the number of the column with this heading, with or without its unit.

        Raises:
            RecordError: If several columns have it.
        """
        wanted = heading.strip()
        exact = [i for i, h in enumerate(self.headings) if h.strip() == wanted]
        found = exact or [i for i in range(len(self.headings)) if self.name(i) == wanted]
        if len(found) > 1:
            raise RecordError(f"column {heading!r} appears {len(found)} times: rename or remove all but one")
        return found[0] if found else None

    def column(self, heading: str, name: str) -> int:
        """Return the number of the column `heading`, which holds `name`.

        Raises:
            RecordError: If there is none, or there are several.
        """
        found = self.find(heading)
        if found is not None:
            return found
        names = [parts_of(h)[0] for h in self.headings]
        more = ", ..." if len(names) > _MOST_NAMED else ""
        use = "" if heading != name else f"; name another one with columns={{{name!r}: HEADING}}"
        raise RecordError(
            f"no column is called {heading!r}; there are "
            f"{', '.join(map(repr, names[:_MOST_NAMED]))}{more}{use}.{did_you_mean(heading, names)}"
        )

    def unit(self, column: int, given: str | None) -> str:
        """Return the unit of a column: `given`, or what its heading says.

        Raises:
            RecordError: If the heading's cannot be converted to the given one.
        """
        name, found = parts_of(self.headings[column])
        if given is not None and found is not None and units.conversion(found, given) is None:
            raise RecordError(
                f"column {name!r} is in {found or 'no unit'} by its heading, but units= says "
                f"{given or 'no unit'}: convert the values, or correct the unit"
            )
        return found or "" if given is None else given

    def converted(self, column: int, unit: str) -> Float[np.ndarray, " K"]:
        """Return a column as numbers in `unit`, shape (K,); as they are if one of the units is missing.

        Raises:
            RecordError: If a cell holds no number, or the unit of the heading cannot be converted.
        """
        name, found = parts_of(self.headings[column])
        if not found or not unit:
            return self.numbers(column)
        values = units.convert(self.numbers(column), found, unit, f"column {name!r}", RecordError)
        return np.asarray(values)

    def mixed(self, columns: Collection[int]) -> str:
        """Return which numbers have a decimal comma and which a point; "" if none, or one sign."""
        seen = [(line, sign) for i in columns for sign, line in self.signs.get(i, {}).items()]
        first = {sign: line for line, sign in sorted(seen, reverse=True)}
        if len(first) < 2:
            return ""
        return f"line {first[',']} has a decimal comma, line {first['.']} a decimal point: {_ONE_SIGN}"

    def numbers(self, column: int) -> Float[np.ndarray, " K"]:
        """Return a column as numbers, shape (K,); NaN for empty cells.

        Raises:
            RecordError: If a cell is neither a number nor empty.
        """
        import pandas as pd

        values = self.frame[column]
        if pd.api.types.is_datetime64_any_dtype(values.dtype):
            name = self.name(column)
            raise RecordError(
                f"column {name!r} holds time stamps, expected numbers: name it as time={name!r}"
            )
        if pd.api.types.is_numeric_dtype(values.dtype):
            return np.asarray(values.to_numpy(dtype=float, na_value=np.nan))
        cells = ["" if empty else str(v) for v, empty in zip(values, values.isna(), strict=True)]
        found = [_number(cell, comma="," in self.signs.get(column, {})) for cell in cells]
        wrong = [row for row, value in enumerate(found) if value is None]
        if wrong:
            cell = cells[wrong[0]].strip()
            what = f": {advice}" if (advice := _advice(cell)) else ""
            raise RecordError(
                f"{self.lacking(column, self.place(wrong[0]), repr(cell[:40]), len(wrong))}{what}"
            )
        return np.array(found, dtype=float)

    def got(self, column: int, row: int, value: float = np.nan) -> str:
        """Return what a cell without a number holds instead, for messages."""
        return self.bad.get(column, {}).get(row, "nothing" if np.isnan(value) else f"{value:g}")

    def lacking(self, column: int, place: str, got: str, count: int) -> str:
        """Return that `count` cells hold no number, the first of them `got` at a `place`."""
        what = f"expected a number, got {got}{and_more(count)}"
        return f"{place}, column {self.name(column)!r}: {what}"

    def is_almost_numeric(self, column: int) -> bool:
        """Return whether a column of text holds numbers but for a few cells, or their notation.

        It was meant as numbers, so it is better refused by `numbers` than left out.
        """
        import pandas as pd

        values = self.frame[column].dropna()
        if not len(values) or not pd.api.types.is_string_dtype(values.dtype):
            return False
        sample = values.iloc[:: max(len(values) // _SAMPLE, 1)].astype(str)
        return 2 * sum(map(almost_a_number, sample)) > len(sample)


def almost_a_number(cell: str) -> bool:
    """Return whether a cell is a number but for its separators or its unit."""
    plain = cell.strip()
    patterns = (_NUMBER, _DECIMAL_COMMA, _THOUSANDS, _SURELY_WITH_UNIT)
    return any(pattern.fullmatch(plain) for pattern in patterns)


def is_bad(cell: str) -> bool:
    """Return whether a cell says that there is no good value, such as "Bad Input"."""
    return _BAD.fullmatch(cell.strip()) is not None


def _number(cell: str, *, comma: bool) -> float | None:
    """Return the number in a cell, NaN for an empty one; None if it holds something else."""
    plain = cell.strip()
    if not _NUMBER.fullmatch(plain) or ("," in plain and not comma):
        return _WORDS.get(plain.casefold())
    return float(plain.replace(",", "."))


def _advice(plain: str) -> str:
    """Return what to do about a cell that is no number; "" if it looks like none at all."""
    if _THOUSANDS.fullmatch(plain) and not _DECIMAL_COMMA.fullmatch(plain):
        return "remove the separators of thousands"
    if _DECIMAL_COMMA.fullmatch(plain):
        return f"{_ONE_SIGN} with semicolons between the cells"
    if _STAMP.fullmatch(plain):
        return "convert time stamps to numbers"
    if _WITH_UNIT.fullmatch(plain):
        return "put the unit into the heading, as in 'level [m]'"
    return ""


def sheet_of(table: Table, wanted: Collection[str] = (), text: Collection[str] = ()) -> Sheet:
    """Read a table.

    Args:
        table: A pandas DataFrame, the path of a CSV, Parquet or Excel file (text without a line end,
            or a `Path`), the content of such a file as bytes, the text of a CSV, or a `Sheet`.
        wanted: Headings that are expected, which tell which separator a CSV has.
        text: Headings of the columns of a CSV whose cells stay text even if they are numbers.

    Raises:
        RecordError: If there is no such file, or it is not a table with a row of headings.
    """
    if isinstance(table, Sheet):
        return table
    if isinstance(table, str) and table.strip() and not _LINE_END.search(table):
        table = Path(table)
    table = _loaded(table)
    if isinstance(table, str):
        table = lines_of(table, wanted)
    if isinstance(table, Lines):
        return with_gaps(_of_lines(table, text), text)
    if hasattr(table, "columns") and hasattr(table, "iloc"):
        return with_gaps(_of_frame(table), text)
    raise RecordError(
        "a table must be a pandas DataFrame, the path of a CSV, Parquet or Excel file, or the text of a "
        f"CSV, got {type(table).__name__}"
    )


def _loaded(source: Table) -> Any:
    """Return the text, cells or DataFrame in a file, or in its content; others as they are."""
    if isinstance(source, Path):
        try:
            source = source.expanduser().read_bytes()
        except (OSError, ValueError, RuntimeError) as error:  # no such file, NUL, no such user
            why = getattr(error, "strerror", None) or error
            raise RecordError(f"cannot read the table {str(source)[:200]!r}: {why}") from error
    if isinstance(source, bytes):
        if source.startswith(_WORKBOOK):
            return lines_of_workbook(source)
        return _parquet(source) if source[:4] == _PARQUET else decode(source)
    return source


def _parquet(content: bytes) -> Any:
    import pandas as pd

    parquet = pyarrow().parquet
    try:
        # A small file may hold very many rows.
        about = parquet.ParquetFile(io.BytesIO(content)).metadata
        _check_size(about.num_rows, about.num_columns)
        return pd.read_parquet(io.BytesIO(content))
    except RecordError:
        raise
    except Exception as error:  # pyarrow has many
        raise RecordError(f"the Parquet file cannot be read: {error}") from error


def _check_size(rows: int, columns: int) -> None:
    """Raise RecordError if a file holds more than a run does, and would fill the memory."""
    if columns > _MOST_COLUMNS:
        raise RecordError(
            f"a table may have {_MOST_COLUMNS:,} columns, got {columns:,}: leave out those that "
            "you do not need"
        )
    if rows * columns > _MOST_CELLS:
        raise RecordError(
            f"a table may have {_MOST_CELLS:,} cells, got {rows:,} rows of {columns:,} columns: "
            "leave out columns, or keep every tenth row"
        )


def _of_frame(frame: Any) -> Sheet:
    """Return the sheet of a DataFrame; an index that is no row number becomes its first column.

    Integers without a name are row numbers, which a selection of rows does not count anew, unless
    they are as large as seconds, or parts of them, since 1970.
    """
    import pandas as pd

    if isinstance(frame.columns, pd.MultiIndex) or isinstance(frame.index, pd.MultiIndex):
        raise RecordError("the DataFrame has several levels: flatten it with reset_index()")
    index = frame.index.to_timestamp() if isinstance(frame.index, pd.PeriodIndex) else frame.index
    if not pd.api.types.is_integer_dtype(index.dtype) or index.name is not None or _are_dates(frame):
        name = "time" if index.name is None else index.name
        frame = pd.concat([index.to_series(index=frame.index, name=name), frame], axis=1)
    headings = tuple(str(heading) for heading in frame.columns)
    return Sheet(headings, frame.set_axis(range(len(headings)), axis=1).reset_index(drop=True))


def _are_dates(frame: Any) -> bool:
    return len(frame) > 0 and "time" not in frame.columns and bool(frame.index.min() > 9e8)


def with_gaps(sheet: Sheet, text: Collection[str]) -> Sheet:
    """Return a sheet whose columns of numbers with cells such as "Bad" are numbers with gaps."""
    import pandas as pd

    frame, bad = sheet.frame.copy(deep=False), {}
    for i, heading in enumerate(sheet.headings):
        values = sheet.frame[i]
        plain = pd.api.types.is_numeric_dtype(values.dtype) or values.dtype.kind in "mM"
        if plain or {heading.strip(), parts_of(heading)[0]} & {*text}:
            continue
        found, written = np.full(len(values), np.nan), {}
        comma = "," in sheet.signs.get(i, {})
        for row, (cell, empty) in enumerate(zip(values, values.isna(), strict=True)):
            value = np.nan if empty else _number(str(cell), comma=comma)
            if value is not None:
                found[row] = value
            elif is_bad(str(cell)):
                written[row] = repr(str(cell).strip()[:40])
            else:
                break
        else:
            if written and np.isfinite(found).any():
                frame[i], bad[i] = found, written
    return replace(sheet, frame=frame, bad=bad) if bad else sheet


def _of_lines(lines: Lines, text: Collection[str]) -> Sheet:
    """Return the sheet of a CSV, or of a workbook."""
    import pandas as pd

    _check_size(len(lines.rows), len(lines.headings))
    columns: dict[int, Any] = {}
    signs: dict[int, Mapping[str, int]] = {}
    for i, heading in enumerate(lines.headings):
        cells = [row[i] if i < len(row) else "" for row in lines.rows]
        seen = _signs(cells, lines) if lines.decimal_comma else {}
        if seen:
            signs[i] = seen
        kept = {heading.strip(), parts_of(heading)[0]} & {*text}
        found = None if kept else _numbers(cells, comma="," in seen)
        columns[i] = [c if c.strip() else None for c in cells] if found is None else found
    frame = pd.DataFrame(columns, index=range(len(lines.rows)))
    places = np.array(lines.places, dtype=np.int64)
    return Sheet(lines.headings, frame, places, lines.uneven(), signs)


def _signs(cells: Sequence[str], lines: Lines) -> Mapping[str, int]:
    """Return the first line with a decimal comma, and the first with a point, of the numbers."""
    found: dict[str, int] = {}
    for sign in ",.":
        for cell, line in zip(cells, lines.places, strict=True):
            if sign in cell and _NUMBER.fullmatch(cell.strip()):
                found[sign] = line
                break
    return found


def _numbers(cells: Sequence[str], *, comma: bool) -> Float[np.ndarray, " K"] | None:
    """Return the numbers in the cells of a column; None if one of them holds something else."""
    if not set("".join(cells)) - _PLAIN:
        with suppress(ValueError):  # the usual case, ten times as fast
            return np.array([float(cell or "nan") for cell in cells])
    found = [*takewhile(lambda value: value is not None, (_number(cell, comma=comma) for cell in cells))]
    return np.array(found, dtype=float) if len(found) == len(cells) else None
