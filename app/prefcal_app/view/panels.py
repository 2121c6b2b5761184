"""Describe the panels of a question and compute the curves to draw."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.panels import Plot, drawn
from prefcal_scenarios.presentation.wording import number, quantity

_MOST = 4000
"""Maximum number of points of a curve; longer ones keep minimum and maximum of each stretch."""


def panel_view(panel: Plot) -> dict[str, Any]:
    """Return title, unit, target and limits of a panel."""
    channel = panel.channel
    symbol = channel.symbol
    return {
        "title": channel.name if symbol in ("", channel.name) else f"{channel.name} {symbol}",
        "symbol": symbol or channel.name,
        "unit": channel.unit,
        "shape": "step" if panel.held else "line",
        "low": _finite(channel.low),
        "high": _finite(channel.high),
        "changing": [bool(panel.low_signal), bool(panel.high_signal)],
        "target": channel.target,
        "band": channel.band,
    }


def curves_view(experiment: Experiment, panels: Sequence[Plot]) -> dict[str, Any]:
    """Return curves, changing references and limits, and each panel in words."""
    runs = experiment.runs or (experiment,)
    recorded = runs if len(experiment.t) else ()
    found, held = [drawn(panels, run) for run in runs], [panel.held for panel in panels]
    beside = [[_held(values, runs[0]) for values in each[1:]] for each in found[0]]
    return {
        "runs": len(runs),
        "curves": [
            _curves([(run.t, each[i].values) for run, each in zip(recorded, found, strict=False)], held=steps)
            for i, steps in enumerate(held)
        ],
        "references": [reference for reference, _, _ in beside],
        "limits": [limits for _, *limits in beside],
        "stories": [
            _story(panel.channel, runs[0], each.values) for panel, each in zip(panels, found[0], strict=True)
        ],
    }


def _curves(
    runs: Sequence[tuple[Float[np.ndarray, " K"], Float[np.ndarray, " K"]]], *, held: bool
) -> list[dict[str, Any]]:
    """Return one curve per run, of instants and values; none without a record."""
    return [curve(t, y, held=held) for t, y in runs if np.isfinite(y).any()]


def _held(values: Float[np.ndarray, " K"] | None, experiment: Experiment) -> dict[str, Any] | None:
    """Return the curve of a reference or limit that changes; None if the panel names none."""
    return None if values is None else curve(experiment.t, values, held=True)


def curve(t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"], *, held: bool) -> dict[str, Any]:
    """Return the points to draw, to six digits: changes of a held value, or the dense grid."""
    kept = _changes(y) if held else _extremes(y)
    return {"t": _rounded(t[kept]), "y": _rounded(y[kept])}


def _changes(y: Float[np.ndarray, " K"]) -> np.ndarray:
    changed = np.flatnonzero(y[1:] != y[:-1]) + 1
    return np.unique(np.concatenate([[0], changed, [len(y) - 1]]))


def _extremes(y: Float[np.ndarray, " K"]) -> np.ndarray:
    if len(y) <= _MOST:
        return np.arange(len(y))
    parts = np.array_split(np.arange(len(y)), _MOST // 2)
    low, high = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    kept = [k for p in parts for k in (p[np.argmin(low[p])], p[np.argmax(high[p])])]
    return np.unique(np.concatenate([[0], kept, [len(y) - 1]]))


def _rounded(values: Float[np.ndarray, " K"]) -> list[float | None]:
    """Return the values to six digits; NaN and infinity become None, a gap in the curve."""
    values = np.asarray(values, dtype=float)
    finite = np.isfinite(values)
    if not finite.all():
        drawn = zip(_rounded(np.where(finite, values, 0.0)), finite, strict=True)
        return [value if there else None for value, there in drawn]
    size = np.where(values == 0, 1.0, np.abs(values))
    places = 5 - np.floor(np.log10(size))
    # Multiply and divide by whole powers of ten only, so that the results have no stray digits.
    up, down = 10.0 ** np.maximum(places, 0), 10.0 ** np.maximum(-places, 0)
    rounded: list[float | None] = (np.round(values * up / down) * down / up + 0.0).tolist()
    return rounded


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _story(channel: Channel, experiment: Experiment, y: Float[np.ndarray, " K"]) -> str:
    """Return a curve in words, for people who cannot see it."""
    if not len(experiment.t):
        return f"{channel.name}: no record"
    t, y = experiment.t[np.isfinite(y)], y[np.isfinite(y)]
    if not len(y):
        return f"{channel.name}: no values"
    time_unit = experiment.channels.time_unit
    words = (
        f"{channel.name}: from {number(float(y[0]))} to {quantity(float(y[-1]), channel.unit)}, "
        f"lowest {number(float(y.min()))}, highest {number(float(y.max()))}"
    )
    if channel.target is None or channel.band is None:
        return words
    outside = np.flatnonzero(np.abs(y - channel.target) > channel.band)
    target = f"the band around {number(channel.target)}"
    if not len(outside):
        return f"{words}, inside {target} all the time"
    if outside[-1] == len(t) - 1:
        return f"{words}, outside {target} at the end"
    since = quantity(float(t[outside[-1] + 1]), time_unit)
    return f"{words}, inside {target} from {since} on"
