"""Measure how much the exploration δ of GLISp matters, with several δ and seeds.

    python benchmarks/campaigns/sensitivity.py  # δ from 0 to 16 on the CSTR, 10 seeds
    python benchmarks/campaigns/sensitivity.py --seeds 3 --jobs 2

Prints a Markdown table of the true index of the θ that each study returns, and draws the figure of
docs/research/sensitivity.md. The answers come from the scenario's synthetic calibrator. With
OPENBLAS_NUM_THREADS=1 in the environment it takes half the time.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from course import best_after_each, spread
from matplotlib.axes import Axes
from rich.console import Console

from prefcal_agents import GLISp
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios import load
from prefcal_scenarios.app.presentation.style import (
    BEST,
    FAINT,
    OTHERS,
    canvas,
    legend,
    save,
    style,
)

DELTAS = (0.0, 0.1, 0.3, 1.0, 3.0, 4.8, 16.0)
FIGURE = Path(__file__).parents[2] / "docs" / "figures" / "sensitivity.png"
SHADES = ("#9fb3c8", "#5b9bd5", BEST, "#e8a06a", OTHERS[0], *OTHERS[1:])


class Study(NamedTuple):
    """Calibration to run."""

    scenario: str
    delta: float
    seed: int
    n_max: int


def best_costs(study: Study) -> list[float]:
    """Return the true index of the best so far after each experiment, (n_max,)."""
    scenario = load(study.scenario)
    if scenario.cost is None:
        raise SystemExit(f"scenario {study.scenario!r} has no index to compare by")
    agent = GLISp(scenario.space, n_max=study.n_max, seed=study.seed, delta=study.delta)
    judge = scenario.calibrators["synthetic"](study.seed)
    return best_after_each(agent, calibrate(agent, scenario.run, judge), scenario.cost)


def table(deltas: Sequence[float], final: np.ndarray) -> str:
    """Return Markdown: quartiles of the final index, one row per δ; `final` is (δ, seeds)."""
    lines = [
        "| δ | lower quartile | median | upper quartile | worst |",
        "| --- | --- | --- | --- | --- |",
    ]
    for delta, costs in zip(deltas, final, strict=True):
        numbers = np.quantile(costs, [0.25, 0.5, 0.75, 1.0])
        lines.append(f"| {delta:g} | " + " | ".join(f"{v:.3f}" for v in numbers) + " |")
    return "\n".join(lines)


def draw(deltas: Sequence[float], costs: np.ndarray, path: Path) -> None:
    """Draw the final index by δ on the left, the median best so far on the right."""
    with style():
        figure = canvas(3.4)
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=[1, 1.25])
        _final(left, deltas, costs[:, :, -1])
        for i, delta in enumerate(deltas):
            median = np.median(costs[i], axis=0)
            numbers = np.arange(1, len(median) + 1)
            color = SHADES[i % len(SHADES)]
            right.plot(numbers, median, color=color, drawstyle="steps-post", label=f"δ = {delta:g}")
        right.set(xlabel="experiment", title="Median of the best so far")
        final = costs[:, :, -1]
        low, high = final.min(), np.quantile(costs[:, :, costs.shape[2] // 3], 0.75)
        left.set_ylim(low - 0.05 * (high - low), max(high, np.quantile(final, 0.95)) * 1.02)
        legend(figure, right)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            save(figure, file)


def _final(axes: Axes, deltas: Sequence[float], final: np.ndarray) -> None:
    for i, costs in enumerate(final):
        low, median, high = np.quantile(costs, [0.25, 0.5, 0.75])
        color = SHADES[i % len(SHADES)]
        axes.plot([i, i], [low, high], color=color, linewidth=9, alpha=0.35, solid_capstyle="butt")
        axes.plot([i - 0.22, i + 0.22], [median, median], color=color, linewidth=2.6)
        spread = i + np.linspace(-0.16, 0.16, len(costs))
        axes.plot(spread, costs, "o", color=FAINT, alpha=0.6, markersize=3.5, mew=0)
    axes.set_xticks(range(len(deltas)), [f"{d:g}" for d in deltas])
    axes.set(xlabel="exploration δ", title="Index reached, a dot a seed")
    axes.grid(False, axis="x")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenario", default="cstr")
    parser.add_argument("--deltas", type=float, nargs="+", default=DELTAS)
    parser.add_argument("--seeds", type=int, default=10, help="number of seeds")
    parser.add_argument("--n-max", type=int, default=50, help="experiments of a study")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--out", type=Path, default=FIGURE, help="file of the figure")
    args = parser.parse_args()
    studies = [
        Study(args.scenario, d, s, args.n_max) for d in args.deltas for s in range(args.seeds)
    ]
    costs = np.array(list(spread(best_costs, studies, args.jobs))).reshape(
        len(args.deltas), args.seeds, -1
    )
    draw(args.deltas, costs, args.out)
    print(table(args.deltas, costs[:, :, -1]))
    Console(stderr=True).print(f"Figure: {args.out}")


if __name__ == "__main__":
    main()
