"""Draw worth against experiments or answers, and how it drifts along the study."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from prefcal_scenarios.app.presentation.style import FAINT, GRID
from prefcal_scenarios.bench.results.figures.drawing import (
    Look,
    drawn,
    line_options,
    markers,
    name_agents,
    panels,
)

from .curves import Curves, Setting, after_answers
from .statistics import random_search

_FEW = 3
"""Largest number of agents whose overlapping bands are still distinguishable."""
_SOME = 8
"""Largest number of agents that are drawn with lines of the usual width."""
_MOST_ANSWERS = 2
"""The axis of answers ends at this many answers per experiment of the budget."""
_SEES_VALUES = Line2D([], [], color=FAINT, linewidth=1.2, linestyle=(0, (6, 2, 1, 2)),
                      label="sees values: at the end")  # fmt: skip
_THEORY = Line2D([], [], color="#aab2bb", linewidth=3.2, label="random search, in theory")
_Band = Float[np.ndarray, "3 _"]
"""Lower quartile, geometric mean and upper quartile of worth."""


def against_experiments(
    curves: Curves, setting: Setting, looks: Mapping[str, Look], baseline: str
) -> Figure:
    """Draw a panel for each loop: geometric mean of worth over the seeds, and the middle half.

    Among many agents, the line of `baseline` is thicker than the others.
    To the right of each panel are the final means and quartiles of all agents, side by side.
    """
    studies = curves.of(setting)
    loops, present = curves.loops(setting), _present(studies, looks)
    figure, grid = panels(len(loops))
    start = Line2D([], [], color="#e1e6eb", linewidth=7, label="initial samples")
    name_agents(figure, present, (_THEORY, start))
    limits = _limits(studies)
    for axes, loop in zip(grid, loops, strict=True):
        axes.axvspan(0, setting.n_init + 0.5, color="#eef1f4", linewidth=0, zorder=0)
        _theory(axes, 1, setting.n_max)
        bands = {a: _band(list(g["worth"])) for a, g in _by_agent(studies, loop)}
        _draw(axes, bands, (1, setting.n_max), present, baseline, ends=bands)
        _finish(axes, drawn(loop), limits)
    _label(figure, grid, "experiments")
    return figure


def against_answers(
    curves: Curves, setting: Setting, looks: Mapping[str, Look], baseline: str
) -> Figure:
    """Draw the same against the number of answers given so far.

    An agent that is never answered, because it sees values, is a line at its final mean. Agents
    that ask more than the axis has room for end at its edge; their ends to the right of it show
    the whole study.
    """
    studies = curves.of(setting)
    loops, present = curves.loops(setting), _present(studies, looks)
    figure, grid = panels(len(loops))
    most = max(asked[-1] for asked in studies["asked"])
    last = int(min(most, _MOST_ANSWERS * setting.n_max))
    limits, silent = _limits(studies), False
    for axes, loop in zip(grid, loops, strict=True):
        bands, ends = {}, {}
        for agent, group in _by_agent(studies, loop):
            ends[agent] = _band(list(group["worth"]))
            asks = max(asked[-1] for asked in group["asked"])
            if asks:
                pairs = zip(group["worth"], group["asked"], strict=True)
                bands[agent] = _band([after_answers(w, q, min(asks, last)) for w, q in pairs])
                continue
            silent = True
            axes.axhline(ends[agent][1, -1], color=present[agent].color, linewidth=1.2,
                         linestyle=_SEES_VALUES.get_linestyle(), label=agent)  # fmt: skip
        _draw(axes, bands, (0, last), present, baseline, ends=ends)
        _finish(axes, drawn(loop), limits)
    name_agents(figure, present, (_SEES_VALUES,) if silent else ())
    _label(figure, grid, "answers")
    return figure


def along(
    curves: Curves, settings: Sequence[Setting], looks: Mapping[str, Look], baseline: str
) -> Figure:
    """Draw a panel for each setting: mean over the loops of the worth held after each experiment.

    To the right of each panel, a line leads from each agent's worth at the end up to that of the
    best θ that it ever held: its length is the drift.
    """
    figure, grid = panels(len(settings), 2.3)
    all_studies = pd.concat([curves.of(setting) for setting in settings])
    present = _present(all_studies, looks)
    best = Line2D([], [], color=FAINT, linewidth=0, marker="_", markersize=7, markeredgewidth=1.6,
                  label="best held before")  # fmt: skip
    name_agents(figure, present, (_THEORY, best))
    means = {}
    for setting in settings:
        groups = curves.of(setting).groupby("agent", observed=True)
        means[setting] = {agent: _held_and_best(group) for agent, group in groups}
    highest = max(float(both.max()) for found in means.values() for both in found.values())
    lowest = min(float(both.min()) for found in means.values() for both in found.values())
    limits = (max(0.9, 0.8 * lowest), 1.2 * max(highest, random_search(settings[0].n_max)))
    for axes, setting in zip(grid, settings, strict=True):
        _theory(axes, 1, setting.n_max)
        bands, ends = {}, {}
        for agent, (held, top) in means[setting].items():
            bands[agent] = np.array([held, held, held])
            ends[agent] = np.array([held[-1:], held[-1:], top[-1:]])
        _draw(axes, bands, (1, setting.n_max), present, baseline, ends=ends, caps=True)
        _finish(axes, drawn(setting.name(curves.settings)), limits)
    _label(figure, grid, "experiments")
    return figure


def _by_agent(studies: pd.DataFrame, loop: str) -> list[tuple[str, pd.DataFrame]]:
    return list(studies[studies["loop"] == loop].groupby("agent", observed=True))


def _present(studies: pd.DataFrame, looks: Mapping[str, Look]) -> dict[str, Look]:
    there = set(studies["agent"])
    return {agent: look for agent, look in looks.items() if agent in there}


def _band(curves: Sequence[Float[np.ndarray, " K"]]) -> _Band:
    logs = np.log(np.array(curves))
    low, high = np.quantile(logs, [0.25, 0.75], axis=0)
    return np.asarray(np.exp([low, logs.mean(axis=0), high]))


def _held_and_best(studies: pd.DataFrame) -> Float[np.ndarray, "2 n_max"]:
    """Return the mean over the loops of the worth held, and of the highest held so far."""
    logs = []
    for _, group in studies.groupby("loop", observed=True):
        held = np.log(np.array(list(group["worth"])))
        best = np.maximum.accumulate(held, axis=1)
        logs.append([held.mean(axis=0), best.mean(axis=0)])
    return np.asarray(np.exp(np.mean(logs, axis=0)))


def _limits(studies: pd.DataFrame) -> tuple[float, float]:
    """Return limits of the worth that show the middle half of each panel's studies."""
    tops = [
        np.quantile([w.max() for w in group["worth"]], 0.75)
        for _, group in studies.groupby(["loop", "agent"], observed=True)
    ]
    return (_lowest(studies), max(10.0, 1.3 * max(tops)))


def _lowest(studies: pd.DataFrame) -> float:
    """Return a lower limit of worth that shows where the means of the agents start."""
    logs = np.log(studies["worth"].map(np.min).astype(float))
    starts = logs.groupby([studies["loop"], studies["agent"]], observed=True).mean()
    return max(0.9, 0.8 * float(np.exp(starts.min())))


def _theory(axes: Axes, first: int, last: int) -> None:
    x = range(first, last + 1)
    axes.plot(x, [random_search(n) for n in x], color=_THEORY.get_color(), zorder=1.5,
              linewidth=_THEORY.get_linewidth(), solid_capstyle="butt")  # fmt: skip


def _draw(
    axes: Axes,
    bands: Mapping[str, _Band],
    span: tuple[int, int],
    looks: Mapping[str, Look],
    baseline: str,
    *,
    ends: Mapping[str, _Band],
    caps: bool = False,
) -> None:
    """Draw the bands from the start of `span`, and the last values of `ends` right of its end."""
    start, last = span
    step = 0.028 * (last - start + 1)
    for i, agent in reversed(list(enumerate(looks))):  # draws the first agent on top
        look = looks[agent]
        if agent in bands:
            low, mean, high = bands[agent]
            x = np.arange(start, start + len(mean))
            if len(looks) <= _FEW and not caps:
                axes.fill_between(x, low, high, color=look.color, alpha=0.14, linewidth=0)
            axes.plot(
                x, mean, label=agent, markevery=markers(len(x), i, len(looks)),
                **line_options(look) | _width(agent, looks, baseline),
            )  # fmt: skip
        if agent in ends:
            low, mean, high = ends[agent][:, -1]
            place = last + (i + 1.5) * step
            axes.vlines(place, low, high, color=look.color, linewidth=1.8, clip_on=False)
            axes.plot(place, mean, marker=look.marker, linestyle="none", color=look.color,
                      markersize=4.5,
                      markeredgewidth=0, clip_on=False)  # fmt: skip
            if caps and high > 1.02 * mean:
                axes.plot(place, high, "_", color=look.color, markersize=5, markeredgewidth=1.6)
    axes.axvline(last + 0.5 * step, color=GRID, linewidth=0.8, zorder=0)
    axes.set_xlim(start - 0.5, last + (len(looks) + 1) * step)
    axes.set_xticks([t for t in MaxNLocator(5, integer=True).tick_values(start, last)
                     if start <= t <= last])  # fmt: skip


def _width(agent: str, looks: Mapping[str, Look], baseline: str) -> dict[str, float]:
    if len(looks) <= _SOME:
        return {}
    return (
        {"linewidth": 2.2, "zorder": 2.5} if agent == baseline else {"linewidth": 1, "alpha": 0.8}
    )


def _finish(axes: Axes, title: str, limits: tuple[float, float]) -> None:
    axes.set_title(title)
    worth_axis(axes, limits, vertical=True)
    axes.grid(False, axis="x")


def worth_axis(axes: Axes, limits: tuple[float, float], *, vertical: bool) -> None:
    """Make an axis of worth logarithmic, with plain numbers at 1, 10, 100, ..."""
    axis = axes.yaxis if vertical else axes.xaxis
    set_scale, set_limits = (
        (axes.set_yscale, axes.set_ylim) if vertical else (axes.set_xscale, axes.set_xlim)
    )
    set_scale("log")
    set_limits(*limits)
    span = limits[1] / limits[0]
    subs = (1.0,) if span > 100 else (1.0, 3.0) if span > 30 else (1.0, 2.0, 5.0)
    ticks = [s * 10.0**k for k in range(5) for s in subs]
    axis.set_major_locator(FixedLocator([t for t in ticks if limits[0] <= t <= limits[1]]))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))


def _label(figure: Figure, grid: Sequence[Axes], what: str) -> None:
    columns = 2 if len(grid) == 4 else min(len(grid), 3)
    for i, axes in enumerate(grid):
        axes.tick_params(labelleft=i % columns == 0, labelbottom=i + columns >= len(grid))
    figure.supxlabel(what, fontsize=9.5)
    figure.supylabel("worth of the returned θ", fontsize=9.5)
