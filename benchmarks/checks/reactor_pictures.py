"""Draw the hole in the reactor's performance index."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from prefcal_env.envs.cstr import BAND, TARGET
from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.style import BEST, FAINT, GOOD, OTHERS, canvas
from prefcal_scenarios.wording import number

HOLE = OTHERS[0]
Row = Mapping[str, float]


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
