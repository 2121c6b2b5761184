"""Draw curves: gap and worth against experiments or answers, worth along studies, data profiles."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from prefcal_bench.results.campaign import HUGE, Campaign
from prefcal_bench.results.curves import Setting, after_answers
from prefcal_bench.results.standing import Profiles
from prefcal_bench.results.statistics import FLOOR, random_search
from prefcal_bench.results.tables import Worths
from prefcal_bench.results.words import problem_name
from prefcal_scenarios.presentation.style import FAINT, GRID

from .drawing import Look, drawn, gap_axis, line_options, markers, name_agents, panels, worth_axis

_FEW = 3
"""Largest number of agents whose overlapping bands are still distinguishable."""
_SOME = 8
"""Largest number of agents that are drawn with lines of the usual width."""
_MOST_ANSWERS = 2
"""The axis of answers ends at this many answers per experiment of the budget."""
_SHADED = "#eef1f4"
_THEORY = Line2D([], [], color="#aab2bb", linewidth=3.2, label="random search, in theory")
_SEES_VALUES = {
    where: Line2D([], [], color=color, linewidth=1.2, linestyle=(0, (6, 2, 1, 2)),
                  label=f"sees values: {where}")
    for where, color in (("median at the end", "#5d6874"), ("at the end", FAINT))
}  # fmt: skip
"""What the legends say about agents that are never asked."""
_Band = Float[np.ndarray, "3 _"]
"""Lower quartile, median (of gaps) or geometric mean (of worth), and upper quartile."""


def against_experiments(campaign: Campaign, setting: Setting, looks: Mapping[str, Look]) -> Figure:
    """Draw a panel for each problem, with the median over the seeds and a band of quartiles.

    To the right of each panel are the final quartiles of all agents, side by side.
    """
    shown = campaign.problems(setting, cost=True)
    figure, grid = panels(len(shown))
    present = _present(campaign.costly(setting), looks)
    name_agents(figure, present, (_start(),))
    for axes, problem in zip(grid, shown, strict=True):
        groups = _by_agent(campaign.costly(setting), "problem", problem)
        bands = {agent: _quartiles(list(group["curve"])) for agent, group in groups}
        axes.axvspan(0, setting.n_init + 0.5, color=_SHADED, linewidth=0, zorder=0)
        _draw_gaps(axes, bands, 1, present)
        axes.set_title(drawn(problem_name(campaign, problem)))
    _label_gaps(figure, grid, "experiments")
    return figure


def against_questions(campaign: Campaign, setting: Setting, looks: Mapping[str, Look]) -> Figure:
    """Draw the gap against the number of questions asked so far.

    An agent that never asks, because it sees values, is a line at its final median gap.
    """
    shown = campaign.problems(setting, cost=True)
    figure, grid = panels(len(shown))
    present = _present(campaign.costly(setting), looks)
    silent = False
    for axes, problem in zip(grid, shown, strict=True):
        bands, ends = {}, {}
        for agent, group in _by_agent(campaign.costly(setting), "problem", problem):
            if group["questions"].any():
                bands[agent] = _quartiles(_by_questions(group))
            else:
                ends[agent] = np.array([np.median(group["gap"])])
        bottom = _draw_gaps(axes, bands, 0, present, others=tuple(ends.values()))
        for agent, end in ends.items():
            _draw_level(axes, agent, max(float(end[0]), bottom), present)
        silent = silent or bool(ends)
        axes.set_title(drawn(problem_name(campaign, problem)))
    name_agents(figure, present, (_SEES_VALUES["median at the end"],) * silent)
    _label_gaps(figure, grid, "questions")
    return figure


def worth_by_experiments(worths: Worths, setting: Setting, looks: Mapping[str, Look]) -> Figure:
    """Draw a panel for each loop: geometric mean of worth over the seeds, and the middle half.

    Among many agents, the line of the baseline is thicker than the others.
    To the right of each panel are the final means and quartiles of all agents, side by side.
    """
    studies, loops = worths.curves.of(setting), worths.curves.loops(setting)
    present, limits = _present(studies, looks), _limits(studies)
    figure, grid = panels(len(loops))
    name_agents(figure, present, (_THEORY, _start()))
    for axes, loop in zip(grid, loops, strict=True):
        axes.axvspan(0, setting.n_init + 0.5, color=_SHADED, linewidth=0, zorder=0)
        _draw_theory(axes, setting.n_max)
        groups = _by_agent(studies, "loop", loop)
        bands = {agent: _middle_half(list(group["worth"])) for agent, group in groups}
        _draw_worth(axes, bands, (1, setting.n_max), present, worths.baseline, ends=bands)
        _finish(axes, drawn(loop), limits)
    _label_worth(figure, grid, "experiments")
    return figure


def worth_by_answers(worths: Worths, setting: Setting, looks: Mapping[str, Look]) -> Figure:
    """Draw the same against the number of answers given so far.

    An agent that is never answered, because it sees values, is a line at its final mean. Agents
    that ask more than the axis has room for end at its edge; their ends to the right of it show
    the whole study.
    """
    studies, loops = worths.curves.of(setting), worths.curves.loops(setting)
    present, limits, silent = _present(studies, looks), _limits(studies), False
    figure, grid = panels(len(loops))
    most = max(asked[-1] for asked in studies["asked"])
    last = int(min(most, _MOST_ANSWERS * setting.n_max))
    for axes, loop in zip(grid, loops, strict=True):
        bands, ends = {}, {}
        for agent, group in _by_agent(studies, "loop", loop):
            ends[agent] = _middle_half(list(group["worth"]))
            asks = max(asked[-1] for asked in group["asked"])
            if asks:
                pairs = zip(group["worth"], group["asked"], strict=True)
                cut = [after_answers(w, q, min(asks, last)) for w, q in pairs]
                bands[agent] = _middle_half(cut)
                continue
            silent = True
            _draw_level(axes, agent, ends[agent][1, -1], present)
        _draw_worth(axes, bands, (0, last), present, worths.baseline, ends=ends)
        _finish(axes, drawn(loop), limits)
    name_agents(figure, present, (_SEES_VALUES["at the end"],) * silent)
    _label_worth(figure, grid, "answers")
    return figure


def along(worths: Worths, settings: Sequence[Setting], looks: Mapping[str, Look]) -> Figure:
    """Draw a panel for each setting: mean over the loops of the worth held after each experiment.

    To the right of each panel, a line leads from each agent's worth at the end up to that of the
    best θ that it ever held: its length is the drift.
    """
    curves, (figure, grid) = worths.curves, panels(len(settings), 2.3)
    present = _present(pd.concat([curves.of(setting) for setting in settings]), looks)
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
        _draw_theory(axes, setting.n_max)
        bands = {a: np.array([held] * 3) for a, (held, _) in means[setting].items()}
        ends = {a: np.array([held[-1:], held[-1:], top[-1:]])
                for a, (held, top) in means[setting].items()}  # fmt: skip
        span = (1, setting.n_max)
        _draw_worth(axes, bands, span, present, worths.baseline, ends=ends, drift=True)
        _finish(axes, drawn(setting.name(curves.settings)), limits)
    _label_worth(figure, grid, "experiments")
    return figure


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
        axes.set_xlim(0.5, found.setting.n_max + 0.5)
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


def _start() -> Line2D:
    return Line2D([], [], color="#e1e6eb", linewidth=7, label="initial samples")


def _by_agent(studies: pd.DataFrame, column: str, place: str) -> list[tuple[str, pd.DataFrame]]:
    """Return the studies of each agent on one problem or loop."""
    return list(studies[studies[column] == place].groupby("agent", observed=True))


def _present(studies: pd.DataFrame, looks: Mapping[str, Look]) -> dict[str, Look]:
    there = set(studies["agent"])
    return {agent: look for agent, look in looks.items() if agent in there}


def _quartiles(curves: Sequence[Float[np.ndarray, " K"]]) -> _Band:
    return np.asarray(np.quantile(np.array(curves), [0.25, 0.5, 0.75], axis=0))


def _middle_half(curves: Sequence[Float[np.ndarray, " K"]]) -> _Band:
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


def _by_questions(studies: pd.DataFrame) -> list[Float[np.ndarray, " K"]]:
    """Return the gap of each study after 0, 1, ... questions, from the last experiment by then."""
    questions, curves = np.arange(int(studies["questions"].max()) + 1), []
    for asked, curve in zip(studies["asked"], studies["curve"], strict=True):
        place = np.searchsorted(asked, questions, side="right") - 1
        curves.append(np.where(place < 0, HUGE, curve[place]))
    return curves


def _limits(studies: pd.DataFrame) -> tuple[float, float]:
    """Return limits of the worth that show where means start, and the middle half of studies."""
    groups = studies.groupby(["loop", "agent"], observed=True)["worth"]
    tops = [np.quantile([w.max() for w in group], 0.75) for _, group in groups]
    starts = [np.mean([np.log(w.min()) for w in group]) for _, group in groups]
    return (max(0.9, 0.8 * float(np.exp(min(starts)))), max(10.0, 1.3 * max(tops)))


def _draw_gaps(
    axes: Axes,
    bands: Mapping[str, _Band],
    start: int,
    looks: Mapping[str, Look],
    *,
    others: tuple[Float[np.ndarray, " 1"], ...] = (),
) -> float:
    """Draw the bands over start, start + 1, ...; return the value at which the floor is drawn."""
    bottom = gap_axis(axes, [*bands.values(), *others])
    last = start + max((band.shape[1] for band in bands.values()), default=1) - 1
    seen = {a: np.where(band <= FLOOR, bottom, band) for a, band in bands.items()}
    seen = {a: np.where(band < HUGE, band, np.nan) for a, band in seen.items()}
    alpha = 0.14 if len(looks) <= _FEW else 0.07  # keeps many overlapping bands legible
    _draw(axes, seen, (start, last), looks, ends=seen, alpha=alpha)
    return bottom


def _draw_worth(
    axes: Axes,
    bands: Mapping[str, _Band],
    span: tuple[int, int],
    looks: Mapping[str, Look],
    baseline: str,
    *,
    ends: Mapping[str, _Band],
    drift: bool = False,
) -> None:
    """Draw the bands from the start of `span`; the baseline's line is thick among many."""
    alpha = 0.14 if len(looks) <= _FEW and not drift else 0.0
    thick = baseline if len(looks) > _SOME else None
    _draw(axes, bands, span, looks, ends=ends, alpha=alpha, thick=thick, caps=drift)


def _draw(
    axes: Axes,
    bands: Mapping[str, _Band],
    span: tuple[int, int],
    looks: Mapping[str, Look],
    *,
    ends: Mapping[str, _Band],
    alpha: float,
    thick: str | None = None,
    caps: bool = False,
) -> None:
    """Draw the bands from the start of `span`, and the last values of `ends` right of its end.

    If an agent is `thick`, all others are thin. `caps` mark the upper ends that are apart.
    """
    start, last = span
    step = 0.028 * (last - start + 1)
    for i, agent in reversed(list(enumerate(looks))):  # draws the first agent on top
        look = looks[agent]
        if agent in bands:
            low, middle, high = bands[agent]
            x = np.arange(start, start + len(middle))
            if alpha:
                axes.fill_between(x, low, high, color=look.color, alpha=alpha, linewidth=0)
            axes.plot(
                x, middle, label=agent, markevery=markers(len(x), i, len(looks)),
                **line_options(look) | _width(agent, thick),
            )  # fmt: skip
        if agent in ends:
            low, middle, high = ends[agent][:, -1]
            place = last + (i + 1.5) * step
            axes.vlines(place, low, high, color=look.color, linewidth=1.8, clip_on=False)
            axes.plot(place, middle, marker=look.marker, linestyle="none", color=look.color,
                      markersize=4.5, markeredgewidth=0, clip_on=False)  # fmt: skip
            if caps and high > 1.02 * middle:
                axes.plot(place, high, "_", color=look.color, markersize=5, markeredgewidth=1.6)
    axes.axvline(last + 0.5 * step, color=GRID, linewidth=0.8, zorder=0)
    axes.set_xlim(start - 0.5, last + (len(looks) + 1) * step)
    axes.set_xticks([t for t in MaxNLocator(5, integer=True).tick_values(start, last)
                     if start <= t <= last])  # fmt: skip


def _width(agent: str, thick: str | None) -> dict[str, float]:
    if thick is None:
        return {}
    return {"linewidth": 2.2, "zorder": 2.5} if agent == thick else {"linewidth": 1, "alpha": 0.8}


def _draw_level(axes: Axes, agent: str, value: float, looks: Mapping[str, Look]) -> None:
    color = looks[agent].color
    axes.axhline(value, color=color, linewidth=1.2, linestyle="--", label=agent)


def _draw_theory(axes: Axes, last: int) -> None:
    x = range(1, last + 1)
    axes.plot(x, [random_search(n) for n in x], color=_THEORY.get_color(), zorder=1.5,
              linewidth=_THEORY.get_linewidth(), solid_capstyle="butt")  # fmt: skip


def _finish(axes: Axes, title: str, limits: tuple[float, float]) -> None:
    axes.set_title(title)
    worth_axis(axes, limits, vertical=True)
    axes.grid(False, axis="x")


def _label_gaps(figure: Figure, grid: Sequence[Axes], what: str) -> None:
    for axes in grid:
        axes.grid(False, axis="x")
    figure.supxlabel(what, fontsize=9.5)
    figure.supylabel("gap of the returned θ", fontsize=9.5)


def _label_worth(figure: Figure, grid: Sequence[Axes], what: str) -> None:
    columns = 2 if len(grid) == 4 else min(len(grid), 3)
    for i, axes in enumerate(grid):
        axes.tick_params(labelleft=i % columns == 0, labelbottom=i + columns >= len(grid))
    figure.supxlabel(what, fontsize=9.5)
    figure.supylabel("worth of the returned θ", fontsize=9.5)
