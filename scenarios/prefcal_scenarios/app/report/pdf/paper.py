"""Lay text, tables and pictures out on A4 pages, from top to bottom."""

from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import UInt8
from matplotlib import rc_context
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from prefcal_scenarios.app.presentation.style import FAINT, GRID, INK

from .lines import FAMILY, broken, width

WIDE, HIGH, MARGIN = 210 / 25.4, 297 / 25.4, 15 / 25.4
"""An A4 page and its margins, in inches."""
SPACE = WIDE - 2 * MARGIN
"""Width of a line in inches."""
_FOOT = 0.3
"""Height of the last line of a page in inches."""
_LINE = 1.3 / 72
"""Height of a line in inches per point of its font."""
_GAP = 0.14
"""Distance between the columns of a table in inches."""
_BELOW = 0.045
"""Distance of a table's text from the lines below and above it in inches."""
_FIRST = 1.5
"""Width in inches that a table's first column has if it needs as much; else the font shrinks."""
_ROOMY = 1.1
"""Width of a heading, in inches, up to which it has a line of its own if there is room."""
_SMALLEST = 5.0
"""Smallest font of a table in points."""


@dataclass(frozen=True, slots=True)
class Look:
    """How text looks: size in points, weight and color."""

    size: float = 9.0
    bold: bool = False
    color: str = INK


TITLE, HEADING, PLAIN, SMALL = Look(15, True), Look(11, True), Look(), Look(8, color=FAINT)


class Paper:
    """A document that grows from top to bottom, with as many A4 pages as it needs.

    Args:
        title: Title of the document, in its properties and at the foot of each page.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._pages: list[Figure] = []
        self._y = 0.0
        self.page()

    @property
    def left(self) -> float:
        """Return the height that is left on this page, in inches."""
        return self._y - MARGIN - _FOOT

    def page(self) -> None:
        """Begin a new page."""
        self._pages.append(Figure(figsize=(WIDE, HIGH)))
        self._y = HIGH - MARGIN

    def text(self, text: str, look: Look = PLAIN) -> None:
        """Write a paragraph over the whole width."""
        for line in broken(text, look.size, SPACE, bold=look.bold):
            self._room(look.size * _LINE)
            self._put(line, MARGIN, look)
            self._y -= look.size * _LINE
        self._y -= 0.04

    def heading(self, text: str, needed: float = 0.0) -> None:
        """Write a heading, on a new page if less than `needed` inches would follow it."""
        self._room(0.4 + needed)
        self._y -= 0.12
        self.text(text, HEADING)

    def table(
        self, headings: Sequence[str], rows: Sequence[Sequence[str]], look: Look = PLAIN
    ) -> None:
        """Write a table; its first column is to the left, the others to the right.

        Headings break their lines. The font shrinks until all columns fit. If they do not fit in
        the smallest one, the columns are divided among several tables, which all begin with the
        first column. Headings are repeated on each page.

        Args:
            headings: Headings of the columns.
            rows: Cells of each row, as many as headings.
            look: Look of the cells.
        """
        for part in _parts(headings, rows):
            self._table([headings[k] for k in part], [[row[k] for k in part] for row in rows], look)

    def _table(self, headings: Sequence[str], rows: Sequence[Sequence[str]], look: Look) -> None:
        """Write a table with the largest font in which its columns fit."""
        size = look.size
        columns = _widths(headings, rows, size, _ROOMY)
        if columns[0] < _first(headings, rows, size):
            columns = _widths(headings, rows, size)
        while columns[0] < _first(headings, rows, size) and size > _SMALLEST:
            size -= 0.5
            columns = _widths(headings, rows, size)
        top = _Row(headings, columns, Look(size, True, look.color))
        written = [_Row(cells, columns, Look(size, look.bold, look.color)) for cells in rows]
        self._room(top.height + (written[0].height if written else 0.0))
        self._row(top, INK)
        for row in written:
            if row.height > self.left:
                self.page()
                self._row(top, INK)
            self._row(row, GRID)
        self._y -= 0.06

    def image(self, content: bytes, most: float = HIGH) -> None:
        """Show a picture, as wide as a line and at most `most` inches high."""
        wide, high = size_of(content, most)
        self._room(high)
        self._y -= high
        box = ((WIDE - wide) / 2 / WIDE, self._y / HIGH, wide / WIDE, high / HIGH)
        axes = self._pages[-1].add_axes(box)
        axes.imshow(_pixels(content), interpolation="none", aspect="auto")
        axes.set_axis_off()
        self._y -= 0.05

    def sign(self, names: Sequence[str]) -> None:
        """Draw lines to sign on at the end of this page, with what belongs there."""
        self._y = min(self._y, MARGIN + _FOOT + 0.35)
        each = SPACE / len(names)
        for k in range(len(names)):
            x = MARGIN + k * each
            self._rule(x, x + each - 0.2, INK)
        self._y -= 0.05
        for k, name in enumerate(names):
            self._put(name, MARGIN + k * each, SMALL)
        self._y -= 0.2

    def content(self) -> bytes:
        """Return the bytes of the PDF, which depend on the content alone."""
        target = BytesIO()
        about: Any = {"Title": self._title, "Creator": "prefcal", "CreationDate": None}
        with rc_context({"pdf.fonttype": 42}), PdfPages(target, metadata=about) as pages:
            for number, figure in enumerate(self._pages, start=1):
                foot = f"{self._title} · page {number} of {len(self._pages)}"
                line = broken(foot, SMALL.size, SPACE)[0]
                figure.text(0.5, MARGIN / HIGH, line, ha="center", **_font(SMALL))
                pages.savefig(figure)
        return target.getvalue()

    def _room(self, height: float) -> None:
        if self.left < height:
            self.page()

    def _put(self, text: str, x: float, look: Look, *, right: bool = False) -> None:
        """Write one line at `x` inches from the left, below the present height."""
        side = "right" if right else "left"
        self._pages[-1].text(x / WIDE, self._y / HIGH, text, ha=side, va="top", **_font(look))

    def _rule(self, start: float, end: float, color: str) -> None:
        height = self._y / HIGH
        line = Line2D((start / WIDE, end / WIDE), (height, height), color=color, linewidth=0.6)
        self._pages[-1].add_artist(line)

    def _row(self, row: "_Row", color: str) -> None:
        """Write a row of a table, and the line below it."""
        self._room(row.height)
        top, x = self._y, MARGIN
        for k, (lines, wide) in enumerate(zip(row.lines, row.columns, strict=True)):
            self._y = top
            for line in lines:
                self._put(line, x + wide if k else x, row.look, right=k > 0)
                self._y -= row.look.size * _LINE
            x += wide + _GAP
        self._y = top - row.height + _BELOW
        self._rule(MARGIN, MARGIN + SPACE, color)
        self._y = top - row.height


@dataclass(frozen=True, slots=True)
class _Row:
    """Row of a table.

    Args:
        cells: Text of each cell.
        columns: Widths of the columns in inches.
        look: Look of the text.
    """

    cells: Sequence[str]
    columns: Sequence[float]
    look: Look

    @property
    def lines(self) -> list[list[str]]:
        """Return the lines of each cell."""
        return [
            broken(cell, self.look.size, wide + 1e-6, bold=self.look.bold)
            for cell, wide in zip(self.cells, self.columns, strict=True)
        ]

    @property
    def height(self) -> float:
        """Return the height in inches, with the line below."""
        return max(map(len, self.lines)) * self.look.size * _LINE + 2 * _BELOW


def _parts(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> list[list[int]]:
    """Return the columns of each of the fewest tables that fit, the first column in all of them."""
    for count in range(1, len(headings)):
        others = np.array_split(np.arange(1, len(headings)), count)
        parts = [[0, *map(int, few)] for few in others]
        if all(_fit([headings[k] for k in p], [[row[k] for k in p] for row in rows])
               for p in parts):  # fmt: skip
            return parts
    return [[0, k] for k in range(1, len(headings))] or [[0]]


def _fit(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> bool:
    """Return whether the columns fit in the smallest font."""
    return _widths(headings, rows, _SMALLEST)[0] >= _first(headings, rows, _SMALLEST)


def _first(headings: Sequence[str], rows: Sequence[Sequence[str]], size: float) -> float:
    """Return the width that the first column needs, in inches, at most `_FIRST`."""
    longest = max(width(headings[0], size, bold=True), *(width(row[0], size) for row in rows), 0.0)
    return min(longest, _FIRST)


def _widths(
    headings: Sequence[str], rows: Sequence[Sequence[str]], size: float, roomy: float = 0.0
) -> tuple[float, ...]:
    """Return the widths of all columns in inches: the first one gets what the others leave.

    Headings of up to `roomy` inches stay on one line. No other column is so wide that the first
    one would have less than `_FIRST`: a cell that needs more breaks its lines.
    """
    others = [
        min(
            max(
                *(width(word, size, bold=True) for word in headings[k].split() or [""]),
                *(width(row[k], size) for row in rows),
                min(width(headings[k], size, bold=True), roomy),
            ),
            SPACE - _GAP - _FIRST,
        )
        for k in range(1, len(headings))
    ]
    return (max(SPACE - sum(others) - _GAP * len(others), 0.0), *others)


def size_of(content: bytes, most: float = HIGH) -> tuple[float, float]:
    """Return width and height of a picture on paper, in inches; see `Paper.image`."""
    with Image.open(BytesIO(content)) as file:
        wide, high = file.size
    scale = min(SPACE / wide, min(most, HIGH - 2 * MARGIN - _FOOT - 0.8) / high)
    return wide * scale, high * scale


def _pixels(content: bytes) -> UInt8[np.ndarray, "h w 3"]:
    """Return a picture without transparency."""
    with Image.open(BytesIO(content)) as file:
        drawn = file.convert("RGBA")
    white = Image.new("RGBA", drawn.size, "white")
    return np.asarray(Image.alpha_composite(white, drawn).convert("RGB"))


def _font(look: Look) -> dict[str, Any]:
    weight = "bold" if look.bold else "normal"
    return {"family": FAMILY, "size": look.size, "weight": weight, "color": look.color,
            "parse_math": False}  # fmt: skip
