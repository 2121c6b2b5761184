"""Break text into lines by the widths of its letters."""

from collections.abc import Iterator

from matplotlib.font_manager import FontProperties
from matplotlib.textpath import text_to_path

FAMILY = "DejaVu Sans"
_INCH = 72.0
"""Points per inch."""


def width(text: str, size: float, *, bold: bool = False) -> float:
    """Return the width of one line of text in inches.

    Args:
        text: Text without line breaks.
        size: Font size in points.
        bold: Whether the font is bold.
    """
    font = FontProperties(family=FAMILY, weight="bold" if bold else "normal", size=size)
    points, _, _ = text_to_path.get_text_width_height_descent(text, font, ismath=False)
    return float(points) / _INCH


def broken(text: str, size: float, most: float, *, bold: bool = False) -> list[str]:
    """Return the lines of a text that is at most `most` inches wide, at least one.

    Lines break at spaces and line breaks, and inside a word only if it does not fit in a line.
    """
    lines = [""]
    for paragraph in text.split("\n"):
        for word in _words(paragraph, size, most, bold):
            joined = f"{lines[-1]} {word}".strip()
            if lines[-1] and width(joined, size, bold=bold) > most:
                lines.append(word)
            else:
                lines[-1] = joined
        lines.append("")
    return lines[:-1]


def _words(paragraph: str, size: float, most: float, bold: bool) -> Iterator[str]:
    for word in paragraph.split():
        rest = word
        while len(rest) > 1 and width(rest, size, bold=bold) > most:
            fits = next(
                k for k in range(len(rest) - 1, 0, -1)
                if k == 1 or width(rest[:k], size, bold=bold) <= most
            )  # fmt: skip
            yield rest[:fits]
            rest = rest[fits:]
        yield rest
