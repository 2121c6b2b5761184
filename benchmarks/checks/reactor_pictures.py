"""Draw the reactor: what its calibration gains, and the hole in its performance index."""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_app.report.pictures import panel_title
from prefcal_env.envs.cstr import BAND, TARGET
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.panels import Plot
from prefcal_scenarios.scenario import Scenario, panels_of
from prefcal_scenarios.style import BEST, FAINT, FIRST, GOOD, INK, LIMIT, OTHERS, canvas
from prefcal_scenarios.wording import mathtext, number

PALE = "#c3cad1"
TOLD = ("settling_time", "final_concentration", "mean_square_move", "index")
"""KPIs of the reactor to show as numbers."""
HOLE = OTHERS[0]
Row = Mapping[str, float]


@dataclass(frozen=True)
class CalibratedRuns:
    """Finished study of a scenario with a cost."""

    scenario: Scenario
    initial: Sequence[Experiment]  # experiments before anything was learned, in order
    best: Experiment  # returned experiment
    number: int  # number of the returned experiment, from 1
    costs: Sequence[float]  # cost of every experiment, in order, shape (N,)


def gain(study: CalibratedRuns) -> Figure:
    """Draw the initial experiments and the best one on the left, and every index on the right."""
    figure = canvas(3.9)
    left, right = figure.subfigures(1, 2, width_ratios=[1.5, 1])
    above, below = left.subplots(2, 1, sharex=True)
    costs, table = right.subplots(2, 1, height_ratios=[1.3, 1])
    output, applied = panels_of(study.scenario, study.best)[:2]
    _curves(above, output, study)
    _curves(below, applied, study)
    below.set_xlabel(f"time [{study.best.channels.time_unit}]")
    _costs(costs, study)
    _table(table, study)
    handles, labels = above.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper left",
        ncols=3,
        borderaxespad=0.2,
        columnspacing=1.6,
        handlelength=1.6,
    )
    return figure


def _curves(axes: Axes, panel: Plot, study: CalibratedRuns) -> None:
    first, *others = study.initial
    looks = [(e, PALE, 1.1, "") for e in others]
    if others:
        label = f"experiments 2 to {len(study.initial)}, before any learning"
        looks[0] = (others[0], PALE, 1.1, label)
    looks += [(first, FIRST, 1.7, "before: experiment 1")]
    looks += [(study.best, BEST, 2.3, f"after: experiment {study.number}")]
    for experiment, color, width, label in looks:
        style = "steps-post" if panel.held else "default"
        t, values = experiment.t, panel.values(experiment)
        axes.plot(t, values, color=color, linewidth=width, label=label, drawstyle=style)
        axes.plot(t[-1], values[-1], "X" if experiment.end.interrupted else "o", color=color, ms=4)
    channel = panel.channel
    if channel.target is not None:
        axes.axhline(channel.target, color=GOOD, linewidth=0.9, linestyle=(0, (1, 2)))
    for limit in (channel.low, channel.high):
        if np.isfinite(limit):
            axes.axhline(limit, color=LIMIT, linewidth=1.0, linestyle=(0, (6, 3)))
    axes.set_title(panel_title(channel))
    axes.margins(x=0.01)


def _costs(axes: Axes, study: CalibratedRuns) -> None:
    costs, start = np.array(study.costs), len(study.initial)
    numbers = np.arange(1, len(costs) + 1)
    axes.set_yscale("log")
    axes.axvspan(0.3, start + 0.5, color="#eef1f4", linewidth=0, zorder=0)
    axes.plot(numbers, costs, "o", color=FAINT, alpha=0.5, ms=4, mew=0)
    for place, color in ((1, FIRST), (study.number, BEST)):
        cost = costs[place - 1]
        axes.plot(place, cost, "o", color=color, ms=8, mec="white", mew=1.2, zorder=4)
        axes.annotate(
            f"{cost:.2f}",
            (place, cost),
            (0, -7),
            textcoords="offset points",
            ha="center",
            va="top",
            color=INK if place == 1 else color,
            fontweight="bold",
        )
    ticks = [t for t in (0.7, 2, 10, 100, 1000) if costs.min() < 1.1 * t]
    axes.set_yticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set_ylim(costs.min() * 0.4, costs.max() * 1.3)
    axes.set_title("Performance index, lower is better")
    axes.set_xlabel("experiment (shaded: before any learning)")


def _table(axes: Axes, study: CalibratedRuns) -> None:
    """Write the KPIs that differ most visibly: before and after."""
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    names = [kpi for kpi in study.scenario.kpis if kpi.name in TOLD]
    for x, words, color in ((0.76, "before", FIRST), (1.0, "after", BEST)):
        axes.text(x, 0.86, words, color=color, fontweight="bold", ha="right")
    runs = (study.initial[0], study.best)
    for i, kpi in enumerate(names):
        y = 0.66 - 0.2 * i
        unit = f" [{kpi.unit}]" if kpi.unit else ""
        axes.text(0, y, mathtext(kpi.title) + unit, color=INK)
        for x, run in zip((0.76, 1.0), runs, strict=True):
            axes.text(x, y, f"{run.kpis[kpi.name]:.3g}", color=INK, ha="right")


def rows_of(path: Path) -> dict[str, list[Row]]:
    """Return the table of best known indices: rows by N_p, for "calm" and for "all" runs."""
    found: dict[str, list[Row]] = {"calm": [], "all": []}
    with path.open() as file:
        for row in csv.DictReader(file):
            kind = row.pop("runs")
            found[kind].append({name: float(value) for name, value in row.items()})
    return found


def lowest(rows: Sequence[Row]) -> Row:
    """Return the row with the smallest index."""
    return min(rows, key=lambda row: row["index"])


def theta(row: Row) -> np.ndarray:
    """Return the physical θ of a row, shape (3,)."""
    return np.array([row["T_s"], row["N_p"], row["log_Q"]])


def hole(scenario: Scenario, table: Path) -> Figure:
    """Draw both optima at the top, and the smallest index for each N_p below."""
    rows = rows_of(table)
    pair = [lowest(rows["calm"]), lowest(rows["all"])]
    runs = [scenario.run(theta(row)) for row in pair]
    figure = canvas(6.3)
    grid = figure.subplot_mosaic([["y0", "y1"], ["u0", "u1"], ["n", "n"]], height_ratios=[1.25, 0.9, 1.25])
    for i, (row, run) in enumerate(zip(pair, runs, strict=True)):
        color = (BEST, HOLE)[i]
        _concentration(grid[f"y{i}"], run, color)
        _coolant(grid[f"u{i}"], run, color)
        name = ("Broad basin", "Hole")[i]
        grid[f"y{i}"].set_title(
            f"{name}: index {row['index']:.3f}\n"
            f"$T_s$ = {row['T_s']:.3g} h, $N_p$ = {row['N_p']:.0f}, "
            f"log $Q_{{Δu}}$ = {number(row['log_Q'])}",
            color=color,
            fontweight="bold",
        )
    for name in ("y", "u"):
        grid[f"{name}1"].sharey(grid[f"{name}0"])
    _horizons(grid["n"], rows)
    return figure


def _concentration(axes: Axes, run: Experiment, color: str) -> None:
    y = run.x[:, 1]
    axes.axhspan(TARGET - BAND, TARGET + BAND, color=GOOD, alpha=0.2, linewidth=0)
    axes.plot(run.t, y, color=color)
    axes.plot(run.t[-1], y[-1], "o", color=color, ms=5)
    axes.set_ylim(1.2, 4)
    axes.set_xlim(8, 24)
    axes.set_ylabel("$C_A$ [kgmol/m³]")
    under, at = TARGET - y.min(), float(run.t[int(y.argmin())])
    if under > BAND:
        words = f"{under:.2f} below the target,\nwhich the index does not count"
        axes.text(at + 2, float(y.min()) - 0.05, words, color=color, fontsize=8.5)
    else:
        words = "no undershoot"
        axes.text(run.t[-1], 1.55, words, color=color, fontsize=8.5, ha="right")


def _coolant(axes: Axes, run: Experiment, color: str) -> None:
    axes.plot(run.t, run.u[:, 0], color=color, drawstyle="steps-post")
    axes.plot(run.t[-1], run.u[-1, 0], "o", color=color, ms=5)
    axes.set_xlim(8, 24)
    axes.set_ylabel("$T_c$ [K]")
    axes.set_xlabel("time [h]")


def _horizons(axes: Axes, rows: Mapping[str, Sequence[Row]]) -> None:
    for kind, color, label in (
        ("all", HOLE, "of all runs"),
        ("calm", BEST, f"of runs that stay above {TARGET - BAND:g} kgmol/m³"),
    ):
        n = [row["N_p"] for row in rows[kind]]
        index = [row["index"] for row in rows[kind]]
        axes.plot(n, index, "o-", color=color, ms=4, label=label, zorder=3 if kind == "calm" else 2)
    best = lowest(rows["calm"])["index"]
    axes.axhline(best, color=FAINT, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.set_title("Smallest index for each prediction horizon")
    axes.set_xlabel("$N_p$")
    axes.legend(loc="upper right")
