"""Figure: gap to the best known value against experiments, or against questions."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from prefcal_scenarios.bench.result import Result
from prefcal_scenarios.bench.results.campaign import HUGE, Campaign, Regime, curve
from prefcal_scenarios.bench.results.figures.axes import (
    gap_axis,
    line_options,
    markers,
    name_agents,
    panels,
)
from prefcal_scenarios.bench.results.figures.looks import Look, drawn
from prefcal_scenarios.bench.results.statistics import FLOOR
from prefcal_scenarios.bench.results.words import problem_name
from prefcal_scenarios.report.style import GRID

_FEW = 3
"""Agents whose bands can lie on each other and be seen."""
_Bands = dict[str, Float[np.ndarray, "3 K"]]
_SEES_VALUES = Line2D([], [], color="#5d6874", linewidth=1.2, linestyle=(0, (6, 2, 1, 2)),
                      label="sees values: median at the end")  # fmt: skip


def against_experiments(
    campaign: Campaign, regime: Regime, looks: Mapping[str, Look], floor: float = FLOOR
) -> Figure:
    """One panel for each problem: median over the seeds as a line, quartiles as a band.

    To the right of each panel, the quartiles at the end beside each other.
    """
    shown = _problems(campaign, regime)
    figure, grid = panels(len(shown))
    start = Line2D([], [], color="#e1e6eb", linewidth=7, label="initial samples")
    present = _present(campaign, regime, shown, looks)
    name_agents(figure, present, (start,))
    for axes, problem in zip(grid, shown, strict=True):
        bands = {
            a: _quartiles([curve(r) for r in found.values()])
            for a in present
            if (found := campaign.runs(regime, problem, a))
        }
        axes.axvspan(0, regime.n_init + 0.5, color="#eef1f4", linewidth=0, zorder=0)
        _lines(axes, bands, 1, present, floor)
        axes.set_title(drawn(problem_name(campaign, problem)))
    _label(figure, grid, "experiments")
    return figure


def against_questions(
    campaign: Campaign, regime: Regime, looks: Mapping[str, Look], floor: float = FLOOR
) -> Figure:
    """The same against the number of questions that were asked by then.

    An agent that never asks, because it sees values, is a line at its median gap of the end.
    """
    shown = _problems(campaign, regime)
    figure, grid = panels(len(shown))
    present = _present(campaign, regime, shown, looks)
    silent = False
    for axes, problem in zip(grid, shown, strict=True):
        bands, ends = {}, {}
        for agent in present:
            runs = list(campaign.runs(regime, problem, agent).values())
            if max((r.questions[-1] for r in runs), default=0):
                bands[agent] = _quartiles(_by_questions(runs))
            elif runs:
                ends[agent] = np.array([np.median([curve(r)[-1] for r in runs])])
        bottom = _lines(axes, bands, 0, present, floor, tuple(ends.values()))
        for agent, end in ends.items():
            axes.axhline(
                max(float(end[0]), bottom), color=present[agent].color, linewidth=1.2,
                linestyle=_SEES_VALUES.get_linestyle(), label=agent,
            )  # fmt: skip
        silent = silent or bool(ends)
        axes.set_title(drawn(problem_name(campaign, problem)))
    name_agents(figure, present, (_SEES_VALUES,) if silent else ())
    _label(figure, grid, "questions")
    return figure


def _problems(campaign: Campaign, regime: Regime) -> tuple[str, ...]:
    return campaign.problems(regime, cost=True)


def _present(
    campaign: Campaign, regime: Regime, problems: Sequence[str], looks: Mapping[str, Look]
) -> dict[str, Look]:
    return {
        a: look for a, look in looks.items() if any(campaign.runs(regime, p, a) for p in problems)
    }


def _quartiles(curves: Sequence[Float[np.ndarray, " K"]]) -> Float[np.ndarray, "3 K"]:
    return np.asarray(np.quantile(np.array(curves), [0.25, 0.5, 0.75], axis=0))


def _by_questions(runs: Sequence[Result]) -> list[Float[np.ndarray, " K"]]:
    """Gap of each run after 0, 1, ... questions: that of the last experiment by then."""
    asked = np.arange(max(r.questions[-1] for r in runs) + 1)
    curves = []
    for run in runs:
        place = np.searchsorted(run.questions, asked, side="right") - 1
        curves.append(np.where(place < 0, HUGE, curve(run)[place]))
    return curves


def _lines(
    axes: Axes,
    bands: _Bands,
    start: int,
    looks: Mapping[str, Look],
    floor: float,
    others: tuple[Float[np.ndarray, " 1"], ...] = (),
) -> float:
    """Draw the bands over start, start + 1, ...; give what the floor was drawn as."""
    bottom = gap_axis(axes, [*bands.values(), *others], floor)
    last = start + max((band.shape[1] for band in bands.values()), default=1) - 1
    step = 0.028 * (last - start + 1)
    alpha = 0.14 if len(looks) <= _FEW else 0.07  # many bands on each other are mud
    for i, agent in reversed(list(enumerate(looks))):  # the first agent lies on top
        if agent not in bands:
            continue
        seen = np.where(bands[agent] <= floor, bottom, bands[agent])
        low, median, high = np.where(seen < HUGE, seen, np.nan)
        x, look = np.arange(start, start + len(median)), looks[agent]
        axes.fill_between(x, low, high, color=look.color, alpha=alpha, linewidth=0)
        axes.plot(
            x, median, label=agent, markevery=markers(len(x), i, len(looks)),
            **line_options(look),
        )  # fmt: skip
        end = last + (i + 1.5) * step
        axes.vlines(end, low[-1], high[-1], color=look.color, linewidth=1.8, clip_on=False)
        axes.plot(end, median[-1], look.marker, color=look.color, markersize=4.5,
                  markeredgewidth=0, clip_on=False)  # fmt: skip
    axes.axvline(last + 0.5 * step, color=GRID, linewidth=0.8, zorder=0)
    axes.set_xlim(start - 0.5, last + (len(looks) + 1) * step)
    axes.set_xticks([t for t in MaxNLocator(5, integer=True).tick_values(start, last)
                     if start <= t <= last])  # fmt: skip
    return bottom


def _label(figure: Figure, grid: Sequence[Axes], what: str) -> None:
    for axes in grid:
        axes.grid(False, axis="x")
    figure.supxlabel(what, fontsize=9.5)
    figure.supylabel("gap of the returned θ", fontsize=9.5)
