"""Reading a record, a CSV of time and channels, and saying all that is wrong with it at once."""

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RecordError

_HEADING = re.compile(r"^\s*(?P<name>.*?)\s*(?:\[\s*(?P<unit>[^\]]*?)\s*\]\s*)?$")
_MOST_TOLD = 5
"""Problems that are listed; a person mends some and tries again."""


@dataclass(frozen=True, slots=True)
class Columns:
    """What a record has to hold: names and their units, the time first.

    Args:
        names: Of the columns.
        units: One for each.
        ranges: Name to what its sensor can show, in its unit.
        max_gap: Longest step in time, in median steps.
        max_rows: Most rows that are read.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    ranges: Mapping[str, tuple[float, float]]
    max_gap: float
    max_rows: int

    @property
    def headings(self) -> tuple[str, ...]:
        """As they should stand in the first line."""
        return tuple(
            f"{name} [{unit}]" if unit else name
            for name, unit in zip(self.names, self.units, strict=True)
        )

    def read(self, text: str) -> Float[np.ndarray, "K n"]:
        """The values in the order of the columns, shape (K, n).

        Separators may be commas, semicolons or tabs, with a decimal comma beside the latter two;
        lines that begin with # are left out; further columns too.

        Raises:
            RecordError: it lists what is wrong, with lines as an editor counts them.
        """
        lines = self._lines(text)
        order = self._order(lines[0][1])
        rows = [(number, [cells[i] if i < len(cells) else "" for i in order])
                for number, cells in lines[1:]]  # fmt: skip
        if len(rows) < 2:
            raise RecordError(f"a record needs 2 rows of values or more, got {len(rows)}")
        if len(rows) > self.max_rows:
            raise RecordError(f"a record may have {self.max_rows} rows, got {len(rows)}")
        values, problems = self._numbers(rows)
        numbers = [number for number, _ in rows]
        _refuse(problems)
        _refuse([*self._time(values[:, 0], numbers), *self._in_range(values, numbers)])
        return values

    def _lines(self, text: str) -> list[tuple[int, list[str]]]:
        """Number and cells of each line that holds something, the headings first."""
        content = text.removeprefix("\ufeff")
        kept = [
            (number, line)
            for number, line in enumerate(content.splitlines(), start=1)
            if line.strip() and not line.lstrip().startswith("#")
        ]
        if not kept:
            raise RecordError(f"the record is empty: expected {', '.join(self.headings)}")
        separator = max(";\t,", key=kept[0][1].count)
        try:
            cells = list(csv.reader(io.StringIO("\n".join(line for _, line in kept)),
                                    delimiter=separator, strict=True))  # fmt: skip
        except csv.Error as error:
            raise RecordError(f"the record is no CSV: {error}") from error
        if len(cells) != len(kept):
            raise RecordError("a quoted cell goes over several lines")
        decimal = separator != ","
        return [
            (number, [c.replace(",", ".") if decimal and i else c for c in row])
            for i, ((number, _), row) in enumerate(zip(kept, cells, strict=True))
        ]

    def _order(self, headings: Sequence[str]) -> list[int]:
        """Where each column stands."""
        found = [_HEADING.match(h) for h in headings]
        names = [m["name"] if m else "" for m in found]
        problems, order = [], []
        for name, unit in zip(self.names, self.units, strict=True):
            count = names.count(name)
            if count != 1:
                what = "is missing" if count == 0 else f"stands there {count} times"
                problems.append(f"column {name!r} {what}; the headings are {', '.join(names)}")
                continue
            place = names.index(name)
            match = found[place]
            given = match["unit"] if match else None
            if given is not None and _plain(given) != _plain(unit):
                problems.append(
                    f"column {name!r} is in {given or 'no unit'}, expected {unit or 'no unit'}: "
                    "convert it"
                )
            order.append(place)
        _refuse(problems)
        return order

    def _numbers(
        self, rows: Sequence[tuple[int, list[str]]]
    ) -> tuple[Float[np.ndarray, "K n"], list[str]]:
        values = np.full((len(rows), len(self.names)), np.nan)
        problems = []
        for k, (number, cells) in enumerate(rows):
            for i, cell in enumerate(cells):
                value = _number(cell)
                values[k, i] = np.nan if value is None else value
                if not np.isfinite(values[k, i]):
                    got = repr(cell.strip()[:40]) if cell.strip() else "nothing"
                    problems.append(
                        f"line {number}, column {self.names[i]!r}: expected a number, got {got}"
                    )
        return values, problems

    def _time(self, t: Float[np.ndarray, " K"], lines: Sequence[int]) -> Iterator[str]:
        steps = np.diff(t)
        unit = self.units[0]
        for k in map(int, np.flatnonzero(steps <= 0)):
            yield (
                f"line {lines[k + 1]}: time must increase, got {t[k + 1]:g} {unit} "
                f"after {t[k]:g} {unit}"
            )
        if np.any(steps <= 0):
            return
        usual = float(np.median(steps))
        for k in map(int, np.flatnonzero(steps > self.max_gap * usual)):
            yield (
                f"line {lines[k + 1]}: a gap of {steps[k]:g} {unit} after {t[k]:g} {unit}, where "
                f"{usual:g} {unit} is usual: fill it, or enter the run as failed"
            )

    def _in_range(self, values: Float[np.ndarray, "K n"], lines: Sequence[int]) -> Iterator[str]:
        for i, name in enumerate(self.names):
            low, high = self.ranges.get(name, (-np.inf, np.inf))
            outside = np.flatnonzero((values[:, i] < low) | (values[:, i] > high))
            if len(outside):
                unit = self.units[i]
                yield (
                    f"line {lines[outside[0]]}, column {name!r}: {values[outside[0], i]:g} {unit} "
                    f"is outside [{low:g}, {high:g}] {unit}, as are {len(outside) - 1} more: is "
                    "the unit right?"
                )


def _refuse(problems: Sequence[str]) -> None:
    if not problems:
        return
    told = list(problems[:_MOST_TOLD])
    if len(problems) > _MOST_TOLD:
        told.append(f"and {len(problems) - _MOST_TOLD} more")
    raise RecordError("; ".join(told))


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _plain(unit: str) -> str:
    """Spellings of one unit: spaces, the micro sign, superscripts."""
    spelled = unit.replace(" ", "").replace("\u00b5", "\u03bc").replace("^", "")
    return spelled.translate(str.maketrans("\u00b2\u00b3", "23"))
