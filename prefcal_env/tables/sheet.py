"""Read a table: CSV, Parquet, text or a DataFrame, with the place of each row."""

import io
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import RecordError
from prefcal_env.parquet import pyarrow
from prefcal_env.wording import and_more, did_you_mean

from .cells import advice, almost_a_number
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


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """A table with its headings and the places of its rows.

    Args:
        headings: Heading of each column.
        frame: pandas DataFrame whose columns are numbered from 0.
        lines: Line of each row as an editor shows it, shape (K,); None if it comes from no text.
    """

    headings: tuple[str, ...]
    frame: Any
    lines: Int[np.ndarray, " K"] | None = None

    def place(self, row: int) -> str:
        """Return where a row is, for messages: "line 7" of a file, or "row 5" counted from 0."""
        return f"row {row}" if self.lines is None else f"line {self.lines[row]}"

    def find(self, heading: str) -> int | None:
        """Return the number of the column with this heading, with or without its unit.

        Raises:
            RecordError: If several columns have it.
        """
        wanted = heading.strip()
        exact = [i for i, h in enumerate(self.headings) if h.strip() == wanted]
        found = exact or [i for i, h in enumerate(self.headings) if parts_of(h)[0] == wanted]
        if len(found) > 1:
            raise RecordError(
                f"column {heading!r} appears {len(found)} times: rename or remove all but one"
            )
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

    def numbers(self, column: int) -> Float[np.ndarray, " K"]:
        """Return a column as numbers, shape (K,); NaN for empty cells.

        Raises:
            RecordError: If a cell is neither a number nor empty.
        """
        import pandas as pd

        values = self.frame[column]
        if not pd.api.types.is_numeric_dtype(values.dtype):
            converted = pd.to_numeric(values, errors="coerce")
            wrong = np.flatnonzero(np.asarray(converted.isna() & values.notna()))
            if len(wrong) or pd.api.types.is_datetime64_any_dtype(values.dtype):
                raise RecordError(self._no_number(column, wrong))
            values = converted
        return np.asarray(values.to_numpy(dtype=float, na_value=np.nan))

    def _no_number(self, column: int, wrong: Sequence[int] | Int[np.ndarray, " M"]) -> str:
        name = parts_of(self.headings[column])[0]
        if not len(wrong):
            return f"column {name!r} holds time stamps, expected numbers: name it as time={name!r}"
        row = int(wrong[0])
        cell = str(self.frame[column].iloc[row]).strip()
        return (
            f"{self.place(row)}, column {name!r}: expected a number, got {cell[:40]!r}"
            f"{and_more(len(wrong))}; {advice(cell) or 'correct it, or leave the cell empty'}"
        )

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


def sheet_of(table: Table, wanted: Collection[str] = ()) -> Sheet:
    """Read a table.

    Args:
        table: A pandas DataFrame, the path of a CSV or Parquet file (text without a line end, or
            a `Path`), the content of such a file as bytes, the text of a CSV, or a `Sheet`.
        wanted: Headings that are expected, which tell which separator a CSV has.

    Raises:
        RecordError: If there is no such file, or it is not a table with a row of headings.
    """
    if isinstance(table, Sheet):
        return table
    if hasattr(table, "columns") and hasattr(table, "iloc"):
        return _of_frame(table)
    if isinstance(table, str) and not table.strip():
        raise RecordError("a table needs a line of headings and rows of values, got no line")
    if isinstance(table, str) and not _LINE_END.search(table):
        table = Path(table)
    if isinstance(table, Path):
        table = _content(table)
    if isinstance(table, bytes):
        table = _parquet(table) if table[:4] == _PARQUET else decoded(table)
    if isinstance(table, str):
        return _of_text(table, wanted)
    if hasattr(table, "columns"):
        return _of_frame(table)
    raise RecordError(
        "a table must be a pandas DataFrame, the path of a CSV or Parquet file, or the text of a "
        f"CSV, got {type(table).__name__}"
    )


def text_of(source: Table) -> str:
    """Return a table as the text of a CSV: a DataFrame, a path, the content of a file, or text.

    Text is a path if it has no line end and ends like the name of a file.

    Raises:
        RecordError: If there is no such file, or it is neither CSV nor Parquet.
    """
    named = isinstance(source, str) and not _LINE_END.search(source)
    if named and Path(source).suffix.lower() in (".csv", ".txt", ".parquet"):
        source = Path(source)
    if isinstance(source, Path):
        source = _content(source)
    if isinstance(source, bytes):
        source = _parquet(source) if source[:4] == _PARQUET else decoded(source)
    if isinstance(source, str):
        return source
    if not hasattr(source, "to_csv"):
        raise RecordError(
            "a record must be the text or path of a CSV, a Parquet file or a pandas DataFrame, "
            f"got {type(source).__name__}"
        )
    sheet = _of_frame(source)
    return str(sheet.frame.set_axis(list(sheet.headings), axis=1).to_csv(index=False))


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


def _of_text(text: str, wanted: Collection[str]) -> Sheet:
    """Return the sheet of a CSV. Empty lines and lines that begin with # are skipped."""
    lines = lines_of(text, wanted)
    if not lines.rows:
        raise RecordError(
            "a table needs a line of headings and rows of values, got "
            f"{'headings only' if lines.headings else 'no line'}"
        )
    _check_size(len(lines.rows), len(lines.headings))
    if problem := lines.uneven():
        raise RecordError(problem)
    frame = _parsed(lines)
    if len(frame) != len(lines.rows):
        raise RecordError("a quoted cell spans several lines: remove the line ends in it")
    return Sheet(lines.headings, frame, np.array(lines.places))


def _parsed(lines: Lines) -> Any:
    """Return the values of a CSV as a DataFrame whose columns are numbered."""
    import pandas as pd

    body, width = "\n".join(lines.rows), len(lines.headings)

    def parse(decimal: str) -> Any:
        try:
            return pd.read_csv(
                io.StringIO(body), sep=lines.separator, decimal=decimal, header=None,
                index_col=False,
                names=range(width), usecols=range(width), skip_blank_lines=False,
                skipinitialspace=True, low_memory=False,
            )  # fmt: skip
        except (ValueError, pd.errors.ParserError) as error:
            if "EOF inside string" in str(error):
                raise RecordError("a quoted cell does not end: close its quote") from error
            raise RecordError(f"the table is not a valid CSV: {error}") from error

    frame = parse(".")
    if not lines.decimal_comma or not any(_has_decimal_comma(frame[k]) for k in frame):
        return frame
    with_comma = parse(",")
    # Time stamps may be text in both: what counts is how many columns turn into numbers.
    return with_comma if _numeric(with_comma) > _numeric(frame) else frame


def _has_decimal_comma(values: Any) -> bool:
    import pandas as pd

    if pd.api.types.is_numeric_dtype(values.dtype):
        return False
    found = values.dropna().astype(str).str.fullmatch(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
    return bool(found.any())


def _numeric(frame: Any) -> int:
    import pandas as pd

    return sum(pd.api.types.is_numeric_dtype(frame[k].dtype) for k in frame)
