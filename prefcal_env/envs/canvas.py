"""Pictures for `render`, on one figure that is created lazily and reused, and render modes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float, UInt8

from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Channel

Make = TypeVar("Make", bound=Callable[..., Any])
_CURVE, _LIMIT, _TARGET, _BAND = "#0b62c4", "#b3261e", "#2b2b2b", "#2e7d32"


@dataclass(frozen=True, slots=True)
class DrawnCurve:
    """A curve in its own panel."""

    channel: Channel  # name, unit, limits, target and band
    t: Float[np.ndarray, " K"]  # instants, shape (K,)
    values: Float[np.ndarray, " K"]  # values at `t`, in the channel's unit, shape (K,)
    held: bool = False  # whether to draw steps, with each value held until the next instant
    span: tuple[float, float] | None = None  # range of the time axis; None fits it to `t`


class Canvas:
    """Draws traces one below the other on a single figure, which is not pickled.

    All pictures have the same size, as videos require: that of `panels` traces. If there are more
    traces, they share its height.
    """

    def __init__(self, title: str = "", time_label: str = "", panels: int = 3) -> None:
        self.title, self.time_label, self.panels = title, time_label, panels
        self._figure: Any = None
        self._drawn: tuple[Any, ...] = ()
        self._lines: list[Any] = []

    def frame(self, traces: Sequence[DrawnCurve], note: str = "") -> UInt8[np.ndarray, "h w 3"]:
        """Return the picture, shape (height, width, 3); all pictures have the same size."""
        layout = tuple((trace.channel, trace.held, trace.span) for trace in traces)
        if self._figure is None or layout != self._drawn:
            self._lay_out(traces)
            self._drawn = layout
        for line, trace in zip(self._lines, traces, strict=True):
            line.set_data(trace.t, trace.values)
            line.axes.set_ylim(*_vertical(trace))
            if trace.span is None:
                end = float(trace.t[-1]) if len(trace.t) else 0.0
                line.axes.set_xlim(0.0, max(end, 1e-9))
        heading = f"{self.title}   {note}".strip()
        size = min(11.0, 770.0 / max(len(heading), 1))  # a long one is smaller, to fit the width
        self._figure.texts[0].set(text=heading, fontsize=size)
        self._figure.canvas.draw()
        return np.array(self._figure.canvas.buffer_rgba())[:, :, :3].copy()

    def close(self) -> None:
        """Release the figure."""
        self._figure, self._drawn, self._lines = None, (), []

    def __getstate__(self) -> dict[str, Any]:
        return {"title": self.title, "time_label": self.time_label, "panels": self.panels}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def _lay_out(self, traces: Sequence[DrawnCurve]) -> None:
        # Imported here so that programs that do not render never load matplotlib.
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        height = 2.4 * max(self.panels, 1) + 0.4  # inches
        self._figure = Figure((7.2, height), dpi=100)
        FigureCanvasAgg(self._figure)
        # Use fixed margins: an automatic layout moves the panels from frame to frame.
        self._figure.subplots_adjust(
            left=0.09, right=0.97, top=1 - 0.65 / height, bottom=0.5 / height, hspace=0.45
        )
        self._figure.suptitle(" ", fontsize=11, x=0.01, ha="left")
        self._lines = []
        if traces:
            axes = self._figure.subplots(len(traces), 1, sharex=True, squeeze=False)[:, 0]
            self._lines = [_panel(ax, trace) for ax, trace in zip(axes, traces, strict=True)]
            axes[-1].set_xlabel(self.time_label)


def _panel(ax: Any, trace: DrawnCurve) -> Any:
    """Draw title, limits, target and band, which do not change; return the empty curve."""
    c = trace.channel
    title = f"${c.symbol}$  {c.label}" if c.symbol else c.label
    ax.set_title(title, fontsize=10, loc="left")
    ax.grid(color="#e3e6ea", linewidth=0.8)
    ax.spines[["top", "right"]].set_visible(False)
    if c.target is not None:
        if c.band is not None:
            ax.axhspan(c.target - c.band, c.target + c.band, color=_BAND, alpha=0.25, lw=0)
        ax.axhline(c.target, color=_TARGET, linewidth=1, linestyle=":")
    for limit in (c.low, c.high):
        if np.isfinite(limit):
            ax.axhline(limit, color=_LIMIT, linewidth=1, linestyle="--")
    if trace.span is not None:
        ax.set_xlim(*trace.span)
    style = "steps-post" if trace.held else "default"
    return ax.plot([], [], color=_CURVE, linewidth=1.8, drawstyle=style)[0]


def _vertical(trace: DrawnCurve) -> tuple[float, float]:
    c = trace.channel
    finite = trace.values[np.isfinite(trace.values)]
    wanted = [float(finite.min()), float(finite.max())] if len(finite) else []
    if c.target is not None:
        wanted += [c.target - (c.band or 0.0), c.target + (c.band or 0.0)]
    wanted += [limit for limit in (c.low, c.high) if np.isfinite(limit)]
    low, high = min(wanted, default=0.0), max(wanted, default=1.0)
    margin = 0.06 * (high - low) or 0.5
    return low - margin, high + margin


def check_render_mode(mode: Any, metadata: Mapping[str, Any]) -> None:
    """Raise SettingsError for an unknown render mode.

    `gymnasium.make` derives "human" and "rgb_array_list" from "rgb_array".
    """
    known = (None, *metadata["render_modes"])
    if mode not in known:
        raise SettingsError(
            f"render_mode must be one of {known}, got {mode!r} (gymnasium.make knows more of them)"
        )


def makes(environment: type) -> Callable[[Make], Make]:
    """Return a decorator that marks an entry point as one that makes `environment`.

    `gymnasium.make` reads the render modes of an entry point; if they lack "human" and
    "rgb_array_list", it wraps the environment.
    """

    def mark(make: Make) -> Make:
        vars(make)["metadata"] = vars(environment)["metadata"]
        return make

    return mark
