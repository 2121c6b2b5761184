"""Draw gap or worth against experiments or answers, worth along studies, and the final worth."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from prefcal_scenarios.style import FAINT, GRID, INK, canvas

from .campaign import HUGE, Campaign, Setting, after_answers, problems_of
from .drawing import (
    AgentStyle,
    agent_styles,
    drawn,
    gap_axis,
    line_options,
    markers,
    name_agents,
    panels,
    worth_axis,
)
from .rows import ended
from .statistics import FLOOR, random_search
from .words import plain_number, problem_name, with_interval

_INTERVAL = ("worth_low", "worth_high")
_FEW = 3  # largest number of agents whose overlapping bands are still distinguishable
_SOME = 8  # largest number of agents that are drawn with lines of the usual width
_MOST_ANSWERS = 2  # the axis of answers ends at this many answers per experiment of the budget
_BETTER = {"worth": "higher is better", "gap": "lower is better"}
_THEORY = Line2D([], [], color="#aab2bb", linewidth=3.2, label="random search, in theory")
_START = Line2D([], [], color="#e1e6eb", linewidth=7, label="initial samples")
_SEES_VALUES = Line2D([], [], color="#5d6874", linewidth=1.2, linestyle="--", label="sees values: at the end")
"""What the legends say about agents that are never asked."""
_Band = Float[np.ndarray, "3 _"]
"""Lower quartile, median (of gaps) or geometric mean (of worth), and upper quartile."""


def against(campaign: Campaign, setting: Setting, value: str, unit: str, baseline: str = "") -> Figure:
    """Draw a panel for each problem: gap or worth of the θ that each agent would return by then.

    A line is the median gap, or the geometric mean of the worth, over the seeds; a band is their
    middle half. To the right of each panel are the ends of the studies of all agents, side by side.
    Against answers, an agent that is never asked, because it sees values, is a line at its end,
    and agents that ask more than the axis has room for stop at its edge.

    Args:
        campaign: All results.
        setting: Setting to draw.
        value: "gap" or "worth".
        unit: "experiments" or "answers".
        baseline: Agent whose line is thicker than the others if these are many.
    """
    studies = campaign.of(setting, value)
    styles, shown = _styles(campaign, studies), problems_of(studies)
    most = min(max(asked[-1] for asked in studies["asked"]), _MOST_ANSWERS * setting.n_max)
    span = (1, setting.n_max) if unit == "experiments" else (0, int(most))
    figure, grid = panels(len(shown))
    for axes, problem in zip(grid, shown, strict=True):
        groups = studies[studies["problem"] == problem].groupby("agent", observed=True)
        ends = {agent: _band(list(group[value]), value) for agent, group in groups}
        bands = ends if unit == "experiments" else _by_answers(groups, value, span[1])
        if value == "gap":
            axes.set_title(drawn(problem_name(campaign, problem)))
            bottom = gap_axis(axes, ends, bands)
            bands, ends = _visible(bands, bottom), _visible(ends, bottom)
        else:
            axes.set_title(drawn(problem))
            worth_axis(axes, _limits(studies), "y")
        if unit == "experiments":
            axes.axvspan(0, setting.n_init + 0.5, color="#eef1f4", linewidth=0, zorder=0)
            if value == "worth":
                _draw_theory(axes, setting.n_max)
        for agent in ends.keys() - bands.keys():
            axes.axhline(
                ends[agent][1, -1], color=styles[agent].color, linewidth=1.2, linestyle="--", label=agent
            )
        _draw(axes, bands, ends, span, styles, baseline, shaded=len(styles) <= _FEW)
    name_agents(figure, styles, _legend(studies, value, unit))
    _label(figure, grid, unit, value)
    return figure


def along(campaign: Campaign, settings: Sequence[Setting], baseline: str = "") -> Figure:
    """Draw a panel for each setting: mean over the loops of the worth held after each experiment.

    To the right of each panel, a line leads from each agent's worth at the end up to that of the
    best θ that it ever held: its length is the drift.
    """
    figure, grid = panels(len(settings), 2.3)
    studies = {setting: campaign.of(setting, "worth") for setting in settings}
    styles = _styles(campaign, pd.concat(studies.values()))
    short: Any = {"linewidth": 0, "marker": "_", "markersize": 7, "markeredgewidth": 1.6}
    best = Line2D([], [], color=FAINT, label="best held before", **short)
    name_agents(figure, styles, (_THEORY, best))
    means = {
        setting: {a: _held_and_best(g) for a, g in one.groupby("agent", observed=True)}
        for setting, one in studies.items()
    }
    every = np.concatenate([both.ravel() for found in means.values() for both in found.values()])
    top = max(every.max(), random_search(settings[0].n_max))
    for axes, setting in zip(grid, settings, strict=True):
        _draw_theory(axes, setting.n_max)
        bands = {a: np.array([held] * 3) for a, (held, _) in means[setting].items()}
        ends = {a: np.array([held, held, top]) for a, (held, top) in means[setting].items()}
        span = (1, setting.n_max)
        _draw(axes, bands, ends, span, styles, baseline, shaded=False, caps=True)
        axes.set_title(drawn(setting.name(campaign.having("worth"))))
        worth_axis(axes, (max(0.9, 0.8 * float(every.min())), 1.2 * float(top)), "y")
    _label(figure, grid, "experiments", "worth")
    return figure


def summary(campaign: Campaign, rows: pd.DataFrame, settings: Sequence[Setting]) -> Figure:
    """Draw a panel for each setting with the final worth of each agent, the highest on top.

    Args:
        campaign: All results.
        rows: TextTable of worth, see `worth_rows`.
        settings: Settings to draw, one or more.
    """
    ends = {s: ended(rows, s) for s in settings}
    columns = min(len(settings), 2)
    lines = [settings[i : i + columns] for i in range(0, len(settings), columns)]
    heights = [max(len(ends[s]) for s in line) for line in lines]
    figure = canvas(sum(0.2 * h + 0.42 for h in heights) + 0.6)
    ratios = [h + 1 for h in heights]
    grid = figure.subplots(len(lines), columns, squeeze=False, height_ratios=ratios)
    theories = {s: random_search(s.n_max) for s in settings}
    every = pd.concat(ends.values())
    low, high = (every[name].fillna(every["worth"]).astype(float) for name in _INTERVAL)
    least, most = min(low.min(), *theories.values()), max(high.max(), *theories.values())
    for axes in grid.flat[len(settings) :]:
        axes.set_axis_off()
    for axes, setting in zip(grid.flat, settings, strict=False):
        _draw_ends(axes, ends[setting], agent_styles(campaign.agents))
        axes.axvline(theories[setting], color=FAINT, linewidth=1, linestyle="--", zorder=1)
        axes.set_title(drawn(setting.name(campaign.having("worth"))), fontweight="bold")
        worth_axis(axes, (max(0.9, least / 1.25), 1.25 * most), "x")
    budgets = " and ".join(map(str, sorted({s.n_max for s in settings})))
    theory = " and ".join(plain_number(value) for value in sorted(set(theories.values())))
    figure.supxlabel(
        f"worth of the θ after {budgets} experiments, in random experiments: {_BETTER['worth']}\n"
        f"dashed: random search in theory, {theory}; hollow: told values",
        fontsize=9,
    )
    return figure


def _draw_ends(axes: Axes, ends: pd.DataFrame, styles: Mapping[str, AgentStyle]) -> None:
    """Draw each agent's marker, its interval, and its value to the right of the row."""
    where = axes.get_yaxis_transform()
    for y, row in enumerate(ends.itertuples()):
        style, sees, interval = styles[row.agent], row.answers == 0, (row.worth_low, row.worth_high)
        if row.worth_low is not None:
            bar: Any = {"color": style.color, "linewidth": 2.4, "solid_capstyle": "butt", "zorder": 3}
            axes.plot(interval, [y, y], **bar)
        face, edge = ("white", style.color) if sees else (style.color, "white")
        dot: Any = {
            "marker": style.marker,
            "markersize": 7 * style.scale,
            "markeredgewidth": 1.2,
            "zorder": 4,
        }
        axes.plot(row.worth, y, linestyle="none", color=face, markeredgecolor=edge, **dot)
        text = with_interval(row.worth, *interval)
        axes.annotate(text, (1.02, y), xycoords=where, va="center", color=INK, fontsize=8)
    names = [drawn(agent) for agent in ends["agent"]]
    axes.set_yticks(range(len(names)), names, color=INK, fontsize=8.5)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(False, axis="y")
    axes.spines["left"].set_visible(False)


def _styles(campaign: Campaign, studies: pd.DataFrame) -> dict[str, AgentStyle]:
    """Return the styles of the agents of some studies, the same in every figure of the campaign."""
    there = set(studies["agent"])
    return {agent: style for agent, style in agent_styles(campaign.agents).items() if agent in there}


def _legend(studies: pd.DataFrame, value: str, unit: str) -> tuple[Line2D, ...]:
    """Return what the legend explains beside the agents."""
    if unit == "experiments":
        return (_THEORY, _START) if value == "worth" else (_START,)
    asked = studies["asked"].map(lambda asked: asked[-1]).groupby(studies["agent"], observed=True)
    return () if asked.max().all() else (_SEES_VALUES,)


def _band(curves: Sequence[Float[np.ndarray, " K"]], value: str) -> _Band:
    if value == "gap":
        return np.asarray(np.quantile(np.array(curves), [0.25, 0.5, 0.75], axis=0))
    logs = np.log(np.array(curves))
    low, high = np.quantile(logs, [0.25, 0.75], axis=0)
    return np.asarray(np.exp([low, logs.mean(axis=0), high]))


def _by_answers(groups: Any, value: str, last: int) -> dict[str, _Band]:
    """Return the bands over 0, 1, ... answers, at most `last`, of the agents that ask."""
    bands = {}
    for agent, group in groups:
        if asks := max(asked[-1] for asked in group["asked"]):
            pairs = zip(group[value], group["asked"], strict=True)
            bands[agent] = _band([after_answers(v, q, min(asks, last)) for v, q in pairs], value)
    return bands


def _visible(bands: Mapping[str, _Band], bottom: float) -> dict[str, _Band]:
    """Return gaps, those at the floor at the `bottom` of the axis, and infinite ones as NaN."""
    seen = {a: np.where(band <= FLOOR, bottom, band) for a, band in bands.items()}
    return {a: np.where(band < HUGE, band, np.nan) for a, band in seen.items()}


def _held_and_best(studies: pd.DataFrame) -> Float[np.ndarray, "2 n_max"]:
    """Return the mean over the loops of the worth held, and of the highest held so far."""
    logs = []
    for _, group in studies.groupby("problem", observed=True):
        held = np.log(np.array(list(group["worth"])))
        best = np.maximum.accumulate(held, axis=1)
        logs.append([held.mean(axis=0), best.mean(axis=0)])
    return np.asarray(np.exp(np.mean(logs, axis=0)))


def _limits(studies: pd.DataFrame) -> tuple[float, float]:
    """Return limits of the worth that show where means start, and the middle half of studies."""
    groups = studies.groupby(["problem", "agent"], observed=True)["worth"]
    tops = [np.quantile([w.max() for w in group], 0.75) for _, group in groups]
    starts = [np.mean([np.log(w.min()) for w in group]) for _, group in groups]
    return (max(0.9, 0.8 * float(np.exp(min(starts)))), max(10.0, 1.3 * max(tops)))


def _draw(
    axes: Axes,
    bands: Mapping[str, _Band],
    ends: Mapping[str, _Band],
    span: tuple[int, int],
    styles: Mapping[str, AgentStyle],
    baseline: str,
    *,
    shaded: bool,
    caps: bool = False,
) -> None:
    """Draw the bands from the start of `span`, and the last values of `ends` right of its end.

    Among many agents the line of the `baseline` is thick. `caps` mark the upper ends that are apart.
    """
    start, last = span
    step = 0.028 * (last - start + 1)
    for i, agent in reversed(list(enumerate(styles))):  # draws the first agent on top
        style = styles[agent]
        if agent in bands:
            low, middle, high = bands[agent]
            x = np.arange(start, start + len(middle))
            if shaded:
                axes.fill_between(x, low, high, color=style.color, alpha=0.14, linewidth=0)
            options = line_options(style) | _width(agent == baseline, len(styles))
            axes.plot(x, middle, label=agent, markevery=markers(len(x), i, len(styles)), **options)
        if agent in ends:
            _draw_end(axes, last + (i + 1.5) * step, ends[agent][:, -1], style, caps)
    axes.axvline(last + 0.5 * step, color=GRID, linewidth=0.8, zorder=0)
    axes.set_xlim(start - 0.5, last + (len(styles) + 1) * step)
    ticks = MaxNLocator(5, integer=True).tick_values(start, last)
    axes.set_xticks([t for t in ticks if start <= t <= last])


def _draw_end(axes: Axes, place: float, end: Float[np.ndarray, " 3"], style: AgentStyle, caps: bool) -> None:
    """Draw the last values of a band at `place`, with a cap on an upper end that is apart."""
    (low, middle, high), color = end, style.color
    axes.vlines(place, low, high, color=color, linewidth=1.8, clip_on=False)
    dot: Any = {
        "marker": style.marker,
        "linestyle": "none",
        "markersize": 4.5 * style.scale,
        "markeredgewidth": 0,
    }
    axes.plot(place, middle, color=color, clip_on=False, **dot)
    if caps and high > 1.02 * middle:
        axes.plot(place, high, "_", color=color, markersize=5, markeredgewidth=1.6)


def _width(is_baseline: bool, agents: int) -> dict[str, float]:
    if agents <= _SOME:
        return {}
    return {"linewidth": 2.2, "zorder": 2.5} if is_baseline else {"linewidth": 1, "alpha": 0.8}


def _draw_theory(axes: Axes, last: int) -> None:
    x, color, width = range(1, last + 1), _THEORY.get_color(), _THEORY.get_linewidth()
    worth = [random_search(n) for n in x]
    axes.plot(x, worth, color=color, linewidth=width, zorder=1.5, solid_capstyle="butt")


def _label(figure: Figure, grid: Sequence[Axes], what: str, value: str) -> None:
    """Name both axes once; panels that share a scale have its numbers at the edge alone."""
    columns = 2 if len(grid) == 4 else min(len(grid), 3)
    for i, axes in enumerate(grid):
        axes.grid(False, axis="x")
        if value == "worth":
            axes.tick_params(labelleft=i % columns == 0, labelbottom=i + columns >= len(grid))
    figure.supxlabel(what, fontsize=9.5)
    figure.supylabel(f"{value} of the returned θ ({_BETTER[value]})", fontsize=9.5)
