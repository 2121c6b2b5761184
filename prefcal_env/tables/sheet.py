"""Read a table: CSV, Parquet, text or a DataFrame, with the place of each row."""

import io
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import RecordError
from prefcal_env.parquet import pyarrow
from prefcal_env.wording import and_more, did_you_mean

from .lines import Lines, decoded, lines_of
from .units import parts_of, same_unit

Table = Any
"""A DataFrame, the path of a CSV or Parquet file, its content, the text of a CSV, or a `Sheet`."""
_LINE_END = re.compile(r"[\r\n]")
_PARQUET = b"PAR1"
_SAMPLE = 1000
"""Number of cells that tell whether a column was meant as numbers."""
_MOST_NAMED = 12
"""Largest number of headings in a message."""
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
    """A table with its headings and the places of its rows.

    Args:
        headings: Heading of each column.
        frame: pandas DataFrame whose columns are numbered from 0.
        lines: Line of each row as an editor shows it, shape (K,); None if it comes from no text.
        uneven: What is wrong with rows of too many cells; "" if nothing is.
        signs: Line of the first number with a decimal comma, and with a point, by column.
    """

    headings: tuple[str, ...]
    frame: Any
    lines: Int[np.ndarray, " K"] | None = None
    uneven: str = ""
    signs: Mapping[int, Mapping[str, int]] = field(default_factory=dict)

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
            RecordError: If they contradict each other.
        """
        name, found = parts_of(self.headings[column])
        if given is not None and found is not None and not same_unit(given, found):
            raise RecordError(
                f"column {name!r} is in {found or 'no unit'} by its heading, but units= says "
                f"{given or 'no unit'}: convert the values, or correct the unit"
            )
        return found or "" if given is None else given

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
        table: A pandas DataFrame, the path of a CSV or Parquet file (text without a line end, or
            a `Path`), the content of such a file as bytes, the text of a CSV, or a `Sheet`.
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
        return _of_text(table, wanted, text)
    if hasattr(table, "columns") and hasattr(table, "iloc"):
        return _of_frame(table)
    raise RecordError(
        "a table must be a pandas DataFrame, the path of a CSV or Parquet file, or the text of a "
        f"CSV, got {type(table).__name__}"
    )


def _loaded(source: Table) -> Any:
    """Return the text or the DataFrame in a file, or in its content; others as they are."""
    if isinstance(source, Path):
        source = _content(source)
    if isinstance(source, bytes):
        return _parquet(source) if source[:4] == _PARQUET else decoded(source)
    return source


def _content(path: Path) -> bytes:
    try:
        return path.expanduser().read_bytes()
    except (OSError, ValueError, RuntimeError) as error:  # no such file, NUL, no such user
        why = getattr(error, "strerror", None) or error
        raise RecordError(f"cannot read the table {str(path)[:200]!r}: {why}") from error


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

    Integers without a name are row numbers, which a selection of rows does not count anew.
    """
    import pandas as pd

    if isinstance(frame.columns, pd.MultiIndex) or isinstance(frame.index, pd.MultiIndex):
        raise RecordError("the DataFrame has several levels: flatten it with reset_index()")
    index = frame.index
    if not pd.api.types.is_integer_dtype(index.dtype) or index.name is not None:
        name = "time" if index.name is None else index.name
        frame = pd.concat([index.to_series(index=index, name=name), frame], axis=1)
    headings = tuple(str(heading) for heading in frame.columns)
    return Sheet(headings, frame.set_axis(range(len(headings)), axis=1).reset_index(drop=True))


def _of_text(content: str, wanted: Collection[str], text: Collection[str]) -> Sheet:
    """Return the sheet of a CSV. Empty lines and lines that begin with # are skipped."""
    import pandas as pd

    lines = lines_of(content, wanted)
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
    found = []
    for cell in cells:
        value = _number(cell, comma=comma)
        if value is None:
            return None
        found.append(value)
    return np.array(found)
