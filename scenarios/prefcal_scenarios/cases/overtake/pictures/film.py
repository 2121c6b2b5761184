"""Animate an overtaking: the best run above the first, seen from above, as a GIF."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from prefcal_scenarios.app.presentation.style import FAINT, INK
from prefcal_scenarios.app.report.record import Record

from .drawing import Drawing, Frame
from .roads import PAINT, paint
from .shown import Shown, runs

RATE = 8
"""Frames per second."""
BEHIND, SEEN = 42.0, 84.0
"""Visible length of road behind the front end, and in total [m]."""
_SCALE, _DPI = 10, 100
"""Pixels per meter, and per inch."""
_WORDS, _MARGIN = 34, 26
"""Heights of the line of text above a road, and of the distance marks below it [pixels]."""


def gif(record: Record) -> bytes:
    """Return the animation: `RATE` frames a second in real time, in an endless loop."""
    shown = runs(record)
    last = max(s.experiment.t[-1] for s in shown)
    reel = _Reel(shown)
    frames = [reel.frame(k / RATE) for k in range(int(np.ceil(last * RATE)) + 1)]
    palette = frames[len(frames) // 2].quantize(64, dither=Image.Dither.NONE)
    flat = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    # GIF times are whole hundredths of a second: 12 and 13 in turn average an eighth.
    ends = [round(100 * (k + 1) / RATE) for k in range(len(flat))]
    durations = [10 * (b - a) for a, b in zip([0, *ends], ends, strict=False)]
    durations[-1] = 2000
    buffer = BytesIO()
    flat[0].save(
        buffer, format="GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0,
        optimize=False, disposal=1,
    )  # fmt: skip
    return buffer.getvalue()


def still(shown: Shown, time: float) -> bytes:
    """Return the road of one run at `time` [s] as a PNG, without text."""
    buffer = BytesIO()
    _Reel((shown,), words=0).frame(time).save(buffer, format="PNG")
    return buffer.getvalue()


@dataclass(frozen=True, slots=True)
class _Strip:
    """Place of one run in the picture, with the height of its line of text [pixels]."""

    shown: Shown
    drawing: Drawing
    axes: Axes
    words: int

    def begin(self) -> None:
        """Set the limits of the road, and write the label above it."""
        low, high = self.drawing.road
        self.axes.set_axis_off()
        self.axes.set_xlim(0, SEEN)
        self.axes.set_ylim(low - _MARGIN / _SCALE, high + self.words / _SCALE)
        if self.words:
            self._text(1, self.shown.label, color=self.shown.color, weight="bold")

    def draw(self, time: float) -> None:
        """Draw the run at `time` [s]."""
        axes, now = self.axes, self.drawing.at(time)
        start = float(now.own[0]) - BEHIND
        axes.set_xlim(start, start + SEEN)
        frame = self.drawing.frame(time, start, start + SEEN)
        made: list[Artist] = [*paint(axes, frame, self.shown.color), *self._marks(frame)]
        if self.words:
            made += self._write(min(time, float(self.drawing.t[-1])), now.speed)
        for artist in sorted(made, key=Artist.get_zorder):
            axes.draw_artist(artist)
            artist.remove()

    def _marks(self, frame: Frame) -> Iterator[Artist]:
        """Draw the distance marks below the road."""
        low, _ = self.drawing.road
        ticks = [[(label.x, low), (label.x, low - 0.4)] for label in frame.labels]
        made = LineCollection(ticks, colors=PAINT, linewidths=0.8)
        yield self.axes.add_collection(made, autolim=False)
        for label in frame.labels:
            yield self.axes.text(
                label.x, low - 0.6, label.text, color=FAINT, fontsize=8, ha="center", va="top",
                clip_on=True,
            )  # fmt: skip

    def _write(self, time: float, speed: float) -> Iterator[Artist]:
        """Write time and speed above the road; a cross shows that the run was stopped."""
        ended = self.drawing.stopped and time >= self.drawing.t[-1]
        when = f"× stopped at {time:.1f} s" if ended else f"{time:.1f} s"
        end = self.axes.get_xlim()[1]
        yield self._text(end - 1, f"{speed:.0f} km/h", color=INK, ha="right")
        yield self._text(end - 10, when, color=INK, ha="right")

    def _text(self, x: float, words: str, **look: Any) -> Artist:
        y = self.drawing.road[1] + (self.words - 22) / _SCALE
        return self.axes.text(x, y, words, fontsize=11, va="baseline", **look)


class _Reel:
    """A figure with one road above the other; only what moves is redrawn for each frame."""

    def __init__(self, shown: Sequence[Shown], words: int = _WORDS) -> None:
        drawings = [Drawing.of(run.experiment) for run in shown]
        heights = [round((d.road[1] - d.road[0]) * _SCALE) + words + _MARGIN for d in drawings]
        width, height = SEEN * _SCALE, sum(heights)
        figure = Figure((width / _DPI, height / _DPI), dpi=_DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(figure)
        self._strips = []
        for k, (run, drawing) in enumerate(zip(shown, drawings, strict=True)):
            bottom = (height - sum(heights[: k + 1])) / height
            axes = figure.add_axes((0, bottom, 1, heights[k] / height))
            self._strips.append(_Strip(run, drawing, axes, words))
            self._strips[-1].begin()
        self._canvas.draw()  # type: ignore[no-untyped-call]
        self._still = self._canvas.copy_from_bbox(figure.bbox)  # type: ignore[no-untyped-call]

    def frame(self, time: float) -> Image.Image:
        """Return the picture of all runs at `time` [s]."""
        self._canvas.restore_region(self._still)  # type: ignore[no-untyped-call]
        for strip in self._strips:
            strip.draw(time)
        pixels = np.asarray(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        return Image.fromarray(pixels).convert("RGB")
