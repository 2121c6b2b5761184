"""Draw what the tracking KPIs of a run are, for docs/tracking.md: as the code finds them, not by hand."""

from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.experiments.events import Response
from prefcal_scenarios.style import BEST, FAINT, FIRST, GOOD, INK, LIMIT, OTHERS, canvas, legend, png, style

T = np.arange(0.0, 40.0, 0.05)
Curve = Float[np.ndarray, " K"]


def swinging(s: Curve, damping: float) -> Curve:
    """Return the unit step response of a loop of second order at the times `s` since the step."""
    s, root = np.maximum(s, 0.0), np.sqrt(1 - damping**2)
    return np.asarray(1 - np.exp(-damping * s) * (np.cos(root * s) + damping / root * np.sin(root * s)))


def drawn(axes: Axes, y: Curve, r: Curve, title: str) -> Response:
    """Draw an output with its reference and the bands of its events; return how it follows."""
    found = Response.of(T, y, r)
    for event in found.events:
        rows = slice(event.first, event.end)
        axes.fill_between(T[rows], r[rows] - event.band, r[rows] + event.band, color=GOOD, alpha=0.2, lw=0)
        axes.axvline(T[event.first], color=FAINT, lw=0.8, ls=":")
    axes.plot(T, r, color=FIRST, ls=(0, (4, 2)), drawstyle="steps-post", label="reference")
    axes.plot(T, y, color=BEST, label="output")
    axes.set(title=title, xlabel="time [s]")
    return found


def time_of(axes: Axes, found: Response, k: int, height: float, word: str) -> None:
    """Draw the time that event k takes until the output stays in its band."""
    event = found.events[k]
    start, takes = T[event.first], found.settling_time(event)
    axes.annotate(
        "", (start, height), (start + takes, height), arrowprops={"arrowstyle": "<->", "color": INK}
    )
    axes.annotate(
        f"{word}\n{takes:.1f} s", (start + takes, height), (4, 0), textcoords="offset points", va="center"
    )


def beyond(axes: Axes, found: Response, k: int) -> None:
    """Draw the overshoot of event k where it is largest."""
    event = found.events[k]
    rows = np.arange(event.first, event.end)
    row = rows[np.argmax(np.sign(event.size) * (found.y - found.r[event.last])[rows])]
    axes.plot([T[row]] * 2, [found.r[event.last], found.y[row]], color=LIMIT, lw=2.2)
    words = f"overshoot {found.overshoot(event):.1f}"
    axes.annotate(words, (T[row], found.y[row]), (5, 0), textcoords="offset points", color=LIMIT)


def rest(axes: Axes) -> None:
    """Draw a step after a rest."""
    y, r = 20 + 10 * swinging(T - 10, 0.4), np.where(T >= 10, 30.0, 20.0)
    found = drawn(axes, y, r, "A step after a rest")
    time_of(axes, found, 0, 22.0, "settling")
    beyond(axes, found, 0)


def several(axes: Axes) -> None:
    """Draw a start away from the reference and a step back: the worst of both counts."""
    y, r = 20 + 10 * swinging(T, 0.4) - 5 * swinging(T - 20, 0.4), np.where(T < 20, 30.0, 25.0)
    found = drawn(axes, y, r, "Several changes: the worst")
    for k in (0, 1):
        time_of(axes, found, k, 21.5, "")
        beyond(axes, found, k)


def ramp(axes: Axes) -> None:
    """Draw a ramp, with the lag behind it."""
    s = np.maximum(T - 5, 0.0)
    r, y = 20 + np.minimum(0.5 * s, 10.0), 20 + 0.5 * (s - 3 * (1 - np.exp(-s / 3)))
    late = np.maximum(T - 25, 0.0)
    y = np.where(T < 25, y, 30 - (30 - y[np.searchsorted(T, 25.0)]) * np.exp(-late / 3))
    found = drawn(axes, y, r, "A ramp has a lag")
    lag, level = found.lag(found.events[0]), 25.0
    reached = float(np.interp(level, r[T < 25], T[T < 25]))
    axes.plot([reached, reached + lag], [level, level], color=OTHERS[0], lw=2.2)
    axes.annotate(
        f"lag {lag:.1f} s", (reached + lag, level), (5, -4), textcoords="offset points", color=OTHERS[0]
    )


def load(axes: Axes) -> None:
    """Draw a load after a step: it is recovered from, and no overshoot."""
    s = np.maximum(T - 25, 0.0)
    y, r = 20 + 10 * swinging(T - 2, 0.6) + 3 * s * np.exp(1 - s), np.where(T >= 2, 30.0, 20.0)
    found = drawn(axes, y, r, "A load is no overshoot")
    beyond(axes, found, 0)
    time_of(axes, found, 0, 22.0, "settling")
    time_of(axes, found, 1, 26.0, "recovery")


PANELS: tuple[Callable[[Axes], None], ...] = (rest, several, ramp, load)


def measured() -> tuple[dict[str, bytes], Mapping[str, float]]:
    """Draw all of them; return the figure and the numbers to keep."""
    with style():
        figure: Figure = canvas(5.2)
        panels = figure.subplots(2, 2)
        for draw, axes in zip(PANELS, panels.flat, strict=True):
            draw(axes)
        legend(figure, panels.flat[0])
        return {"tracking.png": png(figure)}, {}
