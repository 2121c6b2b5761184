"""Draw curves: the gap against experiments or questions, and data profiles."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from prefcal_scenarios.app.presentation.style import GRID
from prefcal_scenarios.bench.results.campaign import HUGE, Campaign, Regime
from prefcal_scenarios.bench.results.profiles import Profiles
from prefcal_scenarios.bench.results.statistics import FLOOR
from prefcal_scenarios.bench.results.words import problem_name

from .drawing import Look, drawn, gap_axis, line_options, markers, name_agents, panels

_FEW = 3
"""Largest number of agents whose overlapping bands are still distinguishable."""
_Bands = dict[str, Float[np.ndarray, "3 K"]]
_SEES_VALUES = Line2D([], [], color="#5d6874", linewidth=1.2, linestyle=(0, (6, 2, 1, 2)),
                      label="sees values: median at the end")  # fmt: skip


def against_experiments(
    campaign: Campaign, regime: Regime, looks: Mapping[str, Look], floor: float = FLOOR
) -> Figure:
    """Draw a panel for each problem, with the median over the seeds and a band of quartiles.

    To the right of each panel are the final quartiles of all agents, side by side.
    """
    shown = campaign.problems(regime, cost=True)
    figure, grid = panels(len(shown))
    start = Line2D([], [], color="#e1e6eb", linewidth=7, label="initial samples")
    present = _present(campaign, regime, looks)
    name_agents(figure, present, (start,))
    for axes, problem in zip(grid, shown, strict=True):
        bands = {
            agent: _quartiles(list(group["curve"]))
            for agent, group in _by_agent(campaign, regime, problem)
        }
        axes.axvspan(0, regime.n_init + 0.5, color="#eef1f4", linewidth=0, zorder=0)
        _lines(axes, bands, 1, present, floor)
        axes.set_title(drawn(problem_name(campaign, problem)))
    _label(figure, grid, "experiments")
    return figure


def against_questions(
    campaign: Campaign, regime: Regime, looks: Mapping[str, Look], floor: float = FLOOR
) -> Figure:
    """Draw the gap against the number of questions asked so far.

    An agent that never asks, because it sees values, is a line at its final median gap.
    """
    shown = campaign.problems(regime, cost=True)
    figure, grid = panels(len(shown))
    present = _present(campaign, regime, looks)
    silent = False
    for axes, problem in zip(grid, shown, strict=True):
        bands, ends = {}, {}
        for agent, group in _by_agent(campaign, regime, problem):
            if group["questions"].any():
                bands[agent] = _quartiles(_by_questions(group))
            else:
                ends[agent] = np.array([np.median(group["gap"])])
        bottom = _lines(axes, bands, 0, present, floor, others=tuple(ends.values()))
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


def _by_agent(campaign: Campaign, regime: Regime, problem: str) -> list[tuple[str, pd.DataFrame]]:
    studies = campaign.costly(regime)
    return list(studies[studies["problem"] == problem].groupby("agent", observed=True))


def _present(campaign: Campaign, regime: Regime, looks: Mapping[str, Look]) -> dict[str, Look]:
    there = set(campaign.costly(regime)["agent"])
    return {agent: look for agent, look in looks.items() if agent in there}


def _quartiles(curves: Sequence[Float[np.ndarray, " K"]]) -> Float[np.ndarray, "3 K"]:
    return np.asarray(np.quantile(np.array(curves), [0.25, 0.5, 0.75], axis=0))


def _by_questions(studies: pd.DataFrame) -> list[Float[np.ndarray, " K"]]:
    """Return the gap of each study after 0, 1, ... questions, from the last experiment by then."""
    questions = np.arange(int(studies["questions"].max()) + 1)
    curves = []
    for asked, curve in zip(studies["asked"], studies["curve"], strict=True):
        place = np.searchsorted(asked, questions, side="right") - 1
        curves.append(np.where(place < 0, HUGE, curve[place]))
    return curves


def _lines(
    axes: Axes,
    bands: _Bands,
    start: int,
    looks: Mapping[str, Look],
    floor: float,
    *,
    others: tuple[Float[np.ndarray, " 1"], ...] = (),
) -> float:
    """Draw the bands over start, start + 1, ...; return the value at which the floor is drawn."""
    bottom = gap_axis(axes, [*bands.values(), *others], floor)
    last = start + max((band.shape[1] for band in bands.values()), default=1) - 1
    step = 0.028 * (last - start + 1)
    alpha = 0.14 if len(looks) <= _FEW else 0.07  # keeps many overlapping bands legible
    for i, agent in reversed(list(enumerate(looks))):  # draws the first agent on top
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
        axes.plot(end, median[-1], marker=look.marker, linestyle="none", color=look.color,
                  markersize=4.5,
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


def data_profiles(found: Profiles, looks: Mapping[str, Look]) -> Figure:
    """Draw a panel for each tolerance: share of solved (problem, seed) against experiments."""
    figure, grid = panels(len(found.shares))
    present = {a: looks[a] for a in looks if a in next(iter(found.shares.values()))}
    for axes, (tolerance, shares) in zip(grid, found.shares.items(), strict=True):
        for i, agent in reversed(list(enumerate(present))):
            x = np.arange(1, len(shares[agent]) + 1)
            axes.plot(
                x, 100 * shares[agent], label=agent, drawstyle="steps-post",
                markevery=markers(len(x), i, len(present)), clip_on=False,
                **line_options(present[agent]),
            )  # fmt: skip
        axes.set_ylim(0, 100)
        axes.set_xlim(0.5, found.regime.n_max + 0.5)
        axes.set_title(f"to {100 * tolerance:g} % of the initial gap")
        axes.yaxis.set_major_formatter(PercentFormatter(decimals=0))
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.grid(False, axis="x")
    for axes in grid[1:]:
        axes.tick_params(labelleft=False)
    figure.supxlabel("experiments", fontsize=9.5)
    grid[0].set_ylabel("solved (problem, seed)")
    name_agents(figure, present)
    return figure
