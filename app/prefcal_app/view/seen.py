"""Track the ranges of all experiments of a study, for axes and for KPI differences."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.session import Interview
from prefcal_app.summary.compare import Spread
from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.maneuvers import by_maneuver
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.scenario import panels_of

from .panels import curves_view

_PAD = 0.04
"""Share of an axis left free at each end."""
_GRAIN = 20
"""Steps of an axis, up to twice as many: axes end at a step, so small growth moves nothing."""
_KEPT = 24
"""Number of runs whose curves are kept for the page: those of the last questions."""

_AT_ONCE = 200
"""Number of experiments read per look, to avoid waiting while thousands load from disk."""

Range = tuple[float, float]
_Drawn = tuple[Experiment, Sequence[Plot], dict[str, Any]]
_NOTHING: Range = (np.inf, -np.inf)


@dataclass(frozen=True, slots=True)
class _Reach:
    """The range of one experiment in time and in each of its panels."""

    t: Range
    y: tuple[Range, ...]


@dataclass(slots=True)
class Seen:
    """Results computed for a study's experiments; each experiment is read once.

    Axes only grow, so that a height on the screen means the same in every question.
    """

    _reach: dict[int, dict[str, _Reach]] = field(default_factory=dict)
    _kpis: dict[int, dict[str, float]] = field(default_factory=dict)
    _drawn: dict[int, _Drawn] = field(default_factory=dict)

    def look(self, interview: Interview) -> "Seen":
        """Read experiments that finished since the last look, and return `self`.

        Each look reads a limited number, newest first, so a long study loads in several looks.
        """
        finished = interview.file.state.finished.items()
        new = sorted((index, seq) for index, seq in finished if seq not in self._reach)
        for index, seq in new[-_AT_ONCE:]:
            experiment = interview.past.experiment(index)
            self._reach[seq] = {
                name: _reach(run, panels_of(interview.scenario, run))
                for name, run in by_maneuver(experiment).items()
            }
            self._kpis[seq] = dict(experiment.kpis)
        return self

    def frame(self, panels: Sequence[Plot], *shown: Experiment, maneuver: str = "") -> dict[str, Any]:
        """Return the axes of all experiments so far and of `shown`: `x`, and `y` by panel.

        Each maneuver has axes of its own; `shown` are runs of it.
        """
        known = [parts[maneuver] for parts in self._reach.values() if maneuver in parts]
        reached = [reach for reach in known if len(reach.y) == len(panels)]
        reached += [_reach(experiment, panels) for experiment in shown]
        t = _union(r.t for r in reached)
        y = [_axis(panel.channel, _union(r.y[i] for r in reached)) for i, panel in enumerate(panels)]
        return {"x": list(snapped(*t)) if t[0] < t[1] else [0.0, 1.0], "y": [list(range_) for range_ in y]}

    @property
    def spread(self) -> Spread:
        """Return how far apart the KPIs of the experiments so far usually are."""
        return Spread(self._kpis.values())

    def drawn(self, experiment: Experiment, panels: Sequence[Plot]) -> dict[str, Any]:
        """Return `curves_view`, cached because the best so far appears in every question."""
        kept = self._drawn.get(id(experiment))
        if kept is None or kept[0] is not experiment or kept[1] != panels:
            while len(self._drawn) >= _KEPT:
                del self._drawn[next(iter(self._drawn))]
            kept = (experiment, panels, curves_view(experiment, panels))
            self._drawn[id(experiment)] = kept
        return kept[2]


def _reach(experiment: Experiment, panels: Sequence[Plot]) -> _Reach:
    runs = [run for run in experiment.runs or (experiment,) if len(run.t)]
    t = _union((float(run.t[0]), float(run.t[-1])) for run in runs)
    return _Reach(t, tuple(_union(_ranges(panel, runs)) for panel in panels))


def _ranges(panel: Plot, runs: Sequence[Experiment]) -> Iterator[Range]:
    for run in runs:
        for values in (panel.values(run), *panel.beside(run)):
            if values is not None:
                yield _range(values)


def _range(values: Float[np.ndarray, " K"]) -> Range:
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if len(finite) else _NOTHING


def _union(ranges: Iterator[Range]) -> Range:
    low, high = _NOTHING
    for a, b in ranges:
        low, high = min(low, a), max(high, b)
    return low, high


def _axis(channel: Channel, reached: Range) -> Range:
    """Return the axis of a panel from the range of its curves and its target with band."""
    low, high = reached
    if channel.target is not None:
        band = channel.band or 0.0
        low, high = min(low, channel.target - band), max(high, channel.target + band)
    low, high = _framed(channel, low, high)
    if not low < high:
        middle = low if low == high else 0.0
        return middle - 1.0, middle + 1.0
    low, high = snapped(low, high)
    pad = _PAD * (high - low)
    return low - pad, high + pad


def snapped(low: float, high: float, grain: int = _GRAIN) -> Range:
    """Round a range outwards to at least `grain` steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / grain
    power = 10.0 ** np.floor(np.log10(rough))
    step = float(next(m for m in (5, 2, 1) if m * power <= rough) * power)
    return step * float(np.floor(low / step + 1e-9)), step * float(np.ceil(high / step - 1e-9))


def _framed(channel: Channel, low: float, high: float) -> Range:
    """Extend a range to limits that the curves come near; distant ones would flatten the curves.

    A range covers at least a tenth of the allowed span, so that noise is not magnified.
    """
    limits = [limit for limit in (channel.low, channel.high) if np.isfinite(limit)]
    if not low <= high:
        return (limits[0], limits[-1]) if limits else (low, high)
    allowed = (channel.high - channel.low) / 10 if len(limits) > 1 else 0.0
    middle, span = (low + high) / 2, max(high - low, allowed)
    near = [limit for limit in limits if max(low - limit, limit - high) <= 2 * span]
    return min(low, middle - span / 2, *near), max(high, middle + span / 2, *near)
