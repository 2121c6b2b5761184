"""Style all figures alike: colors that color-blind people can tell apart, and a light grid.

Blue marks the best experiment, orange what it is compared with, gray the first experiment.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

BEST, OTHERS, FIRST = "#0a66c2", ("#d9610a", "#8a4fb0", "#7a6a10"), "#7f8893"
INK, FAINT, GRID = "#1f2933", "#5d6874", "#e4e8ec"
_DASHES: tuple[Any, ...] = ((0, (5, 1.6)), (0, (1.5, 1.2)), "-")
GOOD, LIMIT = "#12805c", "#b9463c"
WIDTH, DPI = 8.4, 140  # width in inches and resolution in dots per inch: about 1180 pixels, sharp in a README

_RC: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "text.color": INK,
    "axes.edgecolor": "#c5ccd3",
    "axes.labelcolor": INK,
    "axes.labelsize": 9.5,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.titlecolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.8,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "lines.linewidth": 1.7,
    "lines.solid_capstyle": "round",
    "mathtext.fontset": "dejavusans",
    "savefig.dpi": DPI,
    "figure.dpi": DPI,
}


@contextmanager
def style() -> Iterator[None]:
    """Apply this style inside the block, and restore the caller's settings afterwards."""
    with rc_context(_RC):
        yield


def canvas(height: float, width: float = WIDTH) -> Figure:
    """Return an empty figure, `width` by `height` inches, that needs no window system."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.05)  # type: ignore[union-attr, call-arg]
    return figure


def png(figure: Figure) -> bytes:
    """Return a PNG whose bytes depend on the picture alone."""
    engine = figure.get_layout_engine()
    if engine is not None:  # otherwise `savefig` draws the figure twice, the first time for this
        engine.execute(figure)
        figure.set_layout_engine("none")
    buffer = BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None}, pil_kwargs={"compress_level": 4})
    return buffer.getvalue()


def look(i: int) -> tuple[str, Any]:
    """Return color and dashes of reference number `i`, from 0: nine of them differ."""
    return OTHERS[i % len(OTHERS)], _DASHES[(i + i // len(OTHERS)) % len(_DASHES)]


def above(axes: Axes, text: str, points: float, **look: Any) -> None:
    """Write text `points` above the upper left corner of `axes`."""
    axes.annotate(text, (0, 1), (0, points), xycoords="axes fraction", textcoords="offset points", **look)


def legend(figure: Figure, axes: Axes, columns: int = 6) -> None:
    """Draw a legend with the labels of `axes` above the whole figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=columns,
        columnspacing=1.6,
        handlelength=1.6,
        handletextpad=0.6,
        borderaxespad=0.2,
    )
