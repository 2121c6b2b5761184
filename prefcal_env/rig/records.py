"""Read a record, a CSV of time and channels, and report all of its problems at once."""

import csv
import io
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RecordError
from prefcal_env.tables.cells import advice, almost_a_number, number_of
from prefcal_env.tables.lines import lines_of
from prefcal_env.tables.sheet import Sheet
from prefcal_env.tables.steps import gap_words, gaps, step_back_words, steps_back
from prefcal_env.tables.timing import instants
from prefcal_env.tables.units import parts_of, same_unit
from prefcal_env.wording import and_more

_MOST_LISTED = 5
"""Largest number of problems in a message; people fix some of them and try again."""
_WIDEST = 1e30
"""Largest plausible value in any unit; beyond it plots and sums overflow."""


@dataclass(frozen=True, slots=True)
class _Cells:
    """The rows of a record: the line of each and its cells, and how numbers are written."""

    rows: tuple[tuple[int, list[str]], ...]
    decimal_comma: bool


@dataclass(frozen=True, slots=True)
class Columns:
    """The columns of a record: names and units, time first.

    Args:
        names: Names of the required columns.
        units: Unit of each column.
        ranges: Maps a name to the range of its sensor, in its unit.
        max_gap: Longest step in time, in median steps.
        max_rows: Largest number of rows.
        optional: Maps the names of optional columns to their units.
        time_format: Format of time stamps as for `datetime.strptime`; None for ISO 8601.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    max_gap: float
    max_rows: int
    optional: Mapping[str, str]
    time_format: str | None = None

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of the required columns, as they should appear in the first line."""
        return tuple(_heading(n, u) for n, u in zip(self.names, self.units, strict=True))

    @property
    def template(self) -> str:
        """Return the first line of a record, quoted where a name needs it."""
        line = io.StringIO()
        csv.writer(line, lineterminator="\n").writerow(self.headings)
        return line.getvalue()

    def read(self, text: str) -> Float[np.ndarray, "K n"]:
        """Return the values of `names` and then `optional`, shape (K, n); NaN for absent columns.

        Separators are commas, semicolons, tabs, bars or spaces; without commas, numbers may have a
        decimal comma. Lines that begin with # and unknown columns are ignored. Time stamps count
        from the earliest one.

        Raises:
            RecordError: If the record is not valid; the message lists all problems, with line
                numbers as shown by an editor.
        """
        known = self._known()
        lines = lines_of(text, {*known, *(_heading(n, u) for n, u in known.items())})
        if not lines.headings:
            raise RecordError(f"the record is empty: expected {', '.join(self.headings)}")
        places, count = self._places(lines.headings), len(lines.rows)
        if count < 2:
            raise RecordError(f"a record needs 2 rows of values or more, got {count}")
        if count > self.max_rows:
            raise RecordError(f"a record may have {self.max_rows} rows, got {count}")
        cells = _Cells(tuple(zip(lines.places, lines.cells(), strict=True)), lines.decimal_comma)
        values = np.full((count, len(known)), np.nan)
        problems = [*filter(None, [lines.uneven()]), *_mixed(cells, places.values())]
        for i, name in enumerate(known):
            if name == self.names[0] and self._is_stamped(cells, places[name]):
                problems += self._elapsed(cells, places[name], values[:, i])
            elif name in places:
                problems += self._column(cells, name, places[name], values[:, i])
        problems += self._time(values[:, 0], lines.places)
        problems += self._in_range(values, lines.places)
        _refuse(problems)
        return values

    def _known(self) -> dict[str, str]:
        return dict(zip(self.names, self.units, strict=True)) | dict(self.optional)

    def _places(self, headings: Sequence[str]) -> dict[str, int]:
        """Return the position of each column by name."""
        known, problems, places = self._known(), [], {}
        parts = [_parts(heading, known) for heading in headings]
        for name, unit in known.items():
            found = [(i, given) for i, (called, given) in enumerate(parts) if called == name]
            if len(found) != 1 and (found or name not in self.optional):
                what = f"appears {len(found)} times" if found else "is missing"
                there = ", ".join(called[:40] for called, _ in parts[:12])
                problems.append(f"column {name!r} {what}; the headings are {there}")
            for place, given in found:
                places[name] = place
                if given is not None and not same_unit(given, unit):
                    problems.append(
                        f"column {name!r} is in {given[:40] or 'no unit'}, "
                        f"expected {unit or 'no unit'}: convert it"
                    )
        _refuse(problems)
        return places

    def _column(
        self, cells: _Cells, name: str, place: int, values: Float[np.ndarray, " K"]
    ) -> list[str]:
        """Fill `values` with the column `name`; return its problem, if any, as one sentence."""
        first, what, count = "", "", 0
        for k, (line, row) in enumerate(cells.rows):
            cell = row[place] if place < len(row) else ""
            value = number_of(cell, decimal_comma=cells.decimal_comma)
            if value is not None and np.isfinite(value):
                values[k] = value
                continue
            got = f"{cell.strip()[:40]!r}" if cell.strip() else "nothing"
            first = first or f"line {line}, column {name!r}: expected a number, got {got}"
            what = what or (f": {found}" if (found := advice(cell)) else "")
            count += 1
        return [first + and_more(count) + what] if count else []

    def _is_stamped(self, cells: _Cells, place: int) -> bool:
        """Return whether the time is not written as numbers, judged by its first filled cell."""
        column = (row[place].strip() for _, row in cells.rows if place < len(row))
        first = next(filter(None, column), "")
        return bool(first) and (self.time_format is not None or not almost_a_number(first))

    def _elapsed(self, cells: _Cells, place: int, values: Float[np.ndarray, " K"]) -> list[str]:
        """Fill `values` with the time since the earliest time stamp, in the record's unit.

        Return what is wrong with the time stamps or the unit of time, if anything.
        """
        import pandas as pd

        stamps = [row[place].strip() if place < len(row) else "" for _, row in cells.rows]
        frame = pd.DataFrame({0: [stamp or None for stamp in stamps]})
        sheet = Sheet((self.names[0],), frame, np.array([line for line, _ in cells.rows]))
        try:
            found, _ = instants(sheet, 0, self.units[0], self.time_format)
            values[:] = found - found.min()  # times of day count from midnight
        except RecordError as error:
            return [str(error)]
        return []

    def _time(self, t: Float[np.ndarray, " K"], lines: Sequence[int]) -> Iterator[str]:
        if np.any(np.isnan(t)):
            return
        unit = self.units[0]
        back = steps_back(t)
        if len(back):
            k = int(back[0])
            yield f"line {lines[k + 1]}: {step_back_words(t, k, unit, len(back))}"
            return
        for k in map(int, gaps(t, self.max_gap)):
            yield (
                f"line {lines[k + 1]}: {gap_words(t, k, unit, 1)}: fill it, or enter the run as "
                "failed"
            )

    def _in_range(self, values: Float[np.ndarray, "K n"], lines: Sequence[int]) -> Iterator[str]:
        for i, (name, unit) in enumerate(self._known().items()):
            low, high = self.ranges.get(name, (-_WIDEST, _WIDEST))
            low, high = max(low, -_WIDEST), min(high, _WIDEST)
            outside = np.flatnonzero((values[:, i] < low) | (values[:, i] > high))
            if len(outside):
                k = int(outside[0])
                yield (
                    f"line {lines[k]}, column {name!r}: {values[k, i]:g} {unit} is outside "
                    f"[{low:g}, {high:g}] {unit}{and_more(len(outside))}: is the unit right?"
                )


def _heading(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _parts(heading: str, known: Mapping[str, str]) -> tuple[str, str | None]:
    """Return the intended name and unit; a known name may itself contain brackets."""
    plain = heading.strip()
    for name, unit in known.items():
        if plain in (name, _heading(name, unit)):
            return name, unit
    return parts_of(plain)


def _mixed(cells: _Cells, places: Collection[int]) -> list[str]:
    """Report a mix of commas and points in numbers: one of them must separate thousands."""
    if not cells.decimal_comma:
        return []
    seen: dict[str, int] = {}
    for line, row in cells.rows:
        for place in places:
            cell = row[place] if place < len(row) else ""
            for sign in ",.":
                if sign in cell and number_of(cell, decimal_comma=True) is not None:
                    seen.setdefault(sign, line)
    if len(seen) < 2:
        return []
    return [f"line {seen[',']} has a decimal comma, line {seen['.']} a decimal point: use one"]


def _refuse(problems: Sequence[str]) -> None:
    if not problems:
        return
    listed = list(problems[:_MOST_LISTED])
    if len(problems) > _MOST_LISTED:
        listed.append(f"and {len(problems) - _MOST_LISTED} more")
    raise RecordError("; ".join(listed))
