"""Measure what KPIs besides θ are worth: the CSTR with useful, useless and misleading ones.

    python benchmarks/campaigns/outcomes.py  # all, 20 seeds, 50 experiments
    python benchmarks/campaigns/outcomes.py --kinds none all --n-init 6 --n-max 25 --jobs 2

Prints a Markdown table: median and quartiles of the true index of the best so far after some
numbers of experiments. The answers come from the scenario's synthetic calibrator. With
OPENBLAS_NUM_THREADS=1 in the environment it takes half the time.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from course import best_after_each, spread

from prefcal_agents import GLISp
from prefcal_env import KnobSpace, tracking_kpis
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios import load, outcome

AFTER = (15, 20, 25, 50)
"""Numbers of experiments, one for each column of the table."""
_RANDOM, _LOST = 8, 0.4

Kpis = Callable[[Experiment, np.random.Generator], Mapping[str, float]]


def _all(experiment: Experiment, rng: np.random.Generator) -> Mapping[str, float]:
    return outcome(load("cstr"), experiment)


def _generic(experiment: Experiment, rng: np.random.Generator) -> Mapping[str, float]:
    return tracking_kpis(experiment)


def _random(experiment: Experiment, rng: np.random.Generator) -> Mapping[str, float]:
    return {f"number {i}": float(v) for i, v in enumerate(rng.random(_RANDOM))}


def _reversed(experiment: Experiment, rng: np.random.Generator) -> Mapping[str, float]:
    return {name: -value for name, value in _all(experiment, rng).items()}


def _lost(experiment: Experiment, rng: np.random.Generator) -> Mapping[str, float]:
    known = _all(experiment, rng).items()
    return {name: np.nan if rng.random() < _LOST else value for name, value in known}


KINDS: Mapping[str, Kpis | None] = {
    "none": None,
    "all": _all,
    "generic": _generic,
    "random": _random,
    "reversed": _reversed,
    "40 % NaN": _lost,
}


class Study(NamedTuple):
    """Calibration to run."""

    n_init: int
    kind: str
    seed: int
    n_max: int
    any_value: bool = False


def best_costs(study: Study) -> list[float]:
    """Return the true index of the best so far after each experiment, (n_max,)."""
    scenario, kpis = load("cstr"), KINDS[study.kind]
    assert scenario.cost is not None
    knobs = [replace(k, step=0) if not k.integer else k for k in scenario.space]
    space = KnobSpace(knobs) if study.any_value else scenario.space
    agent = GLISp(space, n_init=study.n_init, n_max=study.n_max, seed=study.seed)
    judge = scenario.calibrators["synthetic"](study.seed)

    def known(experiment: Experiment) -> Mapping[str, float]:
        # Drawn from θ: the same experiment always has the same KPIs.
        seeds = [study.seed, *experiment.theta.view(np.uint64).tolist()]
        return {} if kpis is None else kpis(experiment, np.random.default_rng(seeds))

    steps = calibrate(agent, scenario.run, judge, None if kpis is None else known)
    return best_after_each(agent, steps, scenario.cost)


def table(rows: Sequence[tuple[int, str]], costs: np.ndarray) -> str:
    """Return Markdown: median [quartiles] over the seeds; `costs` is (rows, seeds, n_max)."""
    after = [n for n in AFTER if n <= costs.shape[2]]
    lines = ["| n_init | KPIs | " + " | ".join(f"after {n}" for n in after) + " |"]
    lines += ["| --- " * (2 + len(after)) + "|"]
    for (n_init, kind), found in zip(rows, costs, strict=True):
        quartiles = [np.quantile(found[:, n - 1], [0.5, 0.25, 0.75]) for n in after]
        cells = [f"{middle:.4f} [{low:.4f}, {high:.4f}]" for middle, low, high in quartiles]
        lines.append(f"| {n_init} | {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--n-init", type=int, nargs="+", default=[6, 10])
    parser.add_argument("--n-max", type=int, default=50, help="experiments of a study")
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds")
    parser.add_argument("--any-value", action="store_true", help="knobs without a step")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    args = parser.parse_args()
    rows = list(product(args.n_init, args.kinds))
    studies = [
        Study(*row, seed, args.n_max, args.any_value) for row in rows for seed in range(args.seeds)
    ]
    costs = np.array(list(spread(best_costs, studies, args.jobs))).reshape(
        len(rows), args.seeds, -1
    )
    print(table(rows, costs))


if __name__ == "__main__":
    main()
