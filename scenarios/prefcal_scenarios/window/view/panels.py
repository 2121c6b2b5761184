"""The panels of a question: axes that both sides share, and the curves on them."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.experiment import Experiment
from prefcal_scenarios.report.wording import number, quantity
from prefcal_scenarios.scenario import Panel

_MOST = 4000
"""Points of a curve; above, each stretch is given by its smallest and its largest value."""


def panel_view(panel: Panel) -> dict[str, Any]:
    """Title, unit, and what is drawn beside the curve."""
    channel = panel.channel
    symbol = channel.symbol
    return {
        "title": channel.name if symbol in ("", channel.name) else f"{channel.name} {symbol}",
        "symbol": symbol or channel.name,
        "unit": channel.unit,
        "shape": "step" if panel.kind == "u" else "line",
        "low": _finite(channel.low),
        "high": _finite(channel.high),
        "target": channel.target,
        "band": channel.band,
    }


def curves(panel: Panel, experiment: Experiment) -> list[dict[str, list[float]]]:
    """One curve for each run of an experiment; none without a record."""
    runs = experiment.runs or (experiment,)
    return [curve(run.t, panel.values(run), held=panel.kind == "u") for run in runs if len(run.t)]


def reference(panel: Panel, experiment: Experiment) -> dict[str, list[float]] | None:
    """The reference that changes in time, where the panel names one."""
    if not panel.reference or not len(experiment.t):
        return None
    values = panel.scale * experiment.signals[panel.reference]
    return curve(experiment.t, values, held=True)


def curve(
    t: Float[np.ndarray, " K"], y: Float[np.ndarray, " K"], *, held: bool
) -> dict[str, list[float]]:
    """Points to draw, to six digits: where a held value changes, or the dense grid."""
    kept = _changes(y) if held else _extremes(y)
    return {"t": _rounded(t[kept]), "y": _rounded(y[kept])}


def _changes(y: Float[np.ndarray, " K"]) -> np.ndarray:
    changed = np.flatnonzero(y[1:] != y[:-1]) + 1
    return np.unique(np.concatenate([[0], changed, [len(y) - 1]]))


def _extremes(y: Float[np.ndarray, " K"]) -> np.ndarray:
    if len(y) <= _MOST:
        return np.arange(len(y))
    parts = np.array_split(np.arange(len(y)), _MOST // 2)
    kept = [k for part in parts for k in (part[np.argmin(y[part])], part[np.argmax(y[part])])]
    return np.unique(np.concatenate([[0], kept, [len(y) - 1]]))


def _rounded(values: Iterable[float]) -> list[float]:
    return [float(f"{v:.6g}") + 0.0 for v in values]


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def story(panel: Panel, experiment: Experiment) -> str:
    """A curve in words, for whoever does not see it."""
    channel = panel.channel
    if not len(experiment.t):
        return f"{channel.name}: no record"
    t, y = experiment.t, panel.values(experiment)
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
