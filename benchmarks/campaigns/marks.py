"""Measure how much marks help: test functions with an unsafe third of the box, with and without.

    python benchmarks/campaigns/marks.py  # 15 problems, 20 seeds, about 40 minutes
    python benchmarks/campaigns/marks.py --seeds 5 --functions camel hartman3
    python benchmarks/campaigns/marks.py --scenarios  # automatic marks: 4 scenes, half an hour

Prints a Markdown table. The synthetic calibrator prefers a safe experiment to an unsafe one and
compares two of the same kind by the function; with marks it also says which side was unsafe. With
--scenarios the calibrator marks nothing: the only difference is whether the agent learns from the
marks of interrupted runs.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np

from prefcal_agents import GLISp, GLISpSettings
from prefcal_env import Answer, End, Experiment, Mark, Preference, calibrate
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_scenarios import Scenario, load, outcome
from prefcal_scenarios.cases.functions import FUNCTIONS, TestFunction

Level = Callable[[np.ndarray, np.ndarray], np.ndarray]

DEFAULT = ("camel", "branin", "hartman3", "styblinski3", "hartman6")
SHARE = 1 / 3  # of the box that is unsafe
REGIONS: Mapping[str, Level] = {
    "half space": lambda z, best: (z - best) @ (best - 0.5 + 1e-3),
    "ball": lambda z, best: -np.linalg.norm(z - (0.6 * best + 0.2), axis=1),
    "stripes": lambda z, best: np.cos(4 * np.pi * (z[:, 0] - best[0] + 0.02)),
}
"""Level functions of points (m, n) and the minimizer. Points with the highest levels are unsafe,
and the unconstrained minimizer is among them."""


@dataclass(frozen=True)
class Problem:
    """Test function with an unsafe part of the box, where `level` exceeds `ceiling`."""

    function: TestFunction
    level: Level
    ceiling: float
    optimum: float

    @classmethod
    def of(cls, function: TestFunction, level: Level) -> "Problem":
        """Find the ceiling by Monte Carlo, and the optimum among safe θ by a dense search."""
        rng, n = np.random.default_rng(0), len(function.space)
        z = rng.random((40_000, n))
        best = function.space.encode(np.array(function.minimizers[0]))
        ceiling = float(np.quantile(level(z, best), 1 - SHARE))
        problem = cls(function, level, ceiling, np.inf)
        value = problem.safe_values(z)
        leaders = z[np.argsort(value)[:5]]
        for step in np.geomspace(0.1, 1e-7, 60):
            around = leaders[:, None] + step * rng.standard_normal((5, 40, n))
            tries = np.concatenate([leaders[:, None], np.clip(around, 0, 1)], axis=1)
            values = problem.safe_values(tries.reshape(-1, n)).reshape(5, -1)
            leaders = tries[np.arange(5), np.argmin(values, axis=1)]
        return cls(function, level, ceiling, float(problem.safe_values(leaders).min()))

    def unsafe(self, z: np.ndarray) -> np.ndarray:
        """Return whether the rows of `z`, unit cube, shape (m, n), are unsafe, (m,)."""
        best = self.function.space.encode(np.array(self.function.minimizers[0]))
        return np.asarray(self.level(z, best) > self.ceiling)

    def safe_values(self, z: np.ndarray) -> np.ndarray:
        """Return the values at the rows of `z`, infinite where unsafe, (m,)."""
        pairs = zip(z, self.unsafe(z), strict=True)
        return np.array([np.inf if u else self.function(self.function.space.decode(p))
                         for p, u in pairs])  # fmt: skip

    def answer(self, new: np.ndarray, old: np.ndarray | None, marks: bool) -> Answer:
        """Return the synthetic calibrator's answer."""
        space = self.function.space
        bad = [t is not None and bool(self.unsafe(space.encode(t)[None])) for t in (new, old)]
        words = np.array([Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE])
        verdict = None if old is None else int(bad[0]) - int(bad[1])
        verdict = self.function.prefer(new, old) if verdict == 0 else verdict
        return Answer(verdict, marks=tuple(words[bad]) if marks else ())


def study(problem: Problem, seed: int, marks: bool) -> tuple[int, float]:
    """Return the number of unsafe experiments and the gap of the result, infinite if unsafe."""
    agent = GLISp(problem.function.space, n_max=50, seed=seed)
    deque(ask_and_tell(agent, lambda theta: theta, partial(problem.answer, marks=marks)), maxlen=0)
    z = np.array([problem.function.space.encode(theta) for theta in agent.samples])
    best = problem.function.space.encode(agent.best)
    return int(problem.unsafe(z).sum()), problem.safe_values(best[None])[0] - problem.optimum


def row(name: str, kept: np.ndarray, told: np.ndarray) -> str:
    """Return a line of the table; both arrays hold counts and gaps of each seed, (seeds, 2)."""
    counts, gaps = (kept[:, 0], told[:, 0]), (kept[:, 1], told[:, 1])
    ratio = np.log10(np.maximum(gaps[1], 1e-9) / np.maximum(gaps[0], 1e-9))
    duel = f"{np.sum(ratio < 0)} to {np.sum(ratio > 0)}"
    return (f"| {name} | {counts[0].mean():.1f} | {counts[1].mean():.1f} "
            f"| {np.median(gaps[0]):.2g} | {np.median(gaps[1]):.2g} | {duel} |")  # fmt: skip


Found = tuple[int, np.ndarray, Experiment]
"""Result of one calibration: number of unsafe experiments, every θ, and the best experiment."""
HEATING = 8.5
"""Heating rate of the reactor [K/h] above which an alarm stops the run, as in 30 % of the box; the
best known θ stays below, at 8.26."""


def alarmed(theta: np.ndarray, seed: int = 0) -> Experiment:
    """Run the reactor with an alarm that ends the run if it heats up faster than `HEATING`."""
    e = load("cstr").run(theta, seed=seed)
    fast = np.flatnonzero(np.diff(e.x[:, 0]) > HEATING * np.diff(e.t))
    if not len(fast):
        return e
    kept, steps = fast[0] + 2, np.count_nonzero(e.t_control <= e.t[fast[0]])
    rows = {k: getattr(e, k)[:kept] for k in ("t", "x", "u")}
    rows |= {k: getattr(e, k)[:steps] for k in
             ("t_control", "u_control", "y_ref", "iterations", "solve_time", "solved")}  # fmt: skip
    signals = {name: values[:kept] for name, values in e.signals.items()}
    return replace(e, **rows, signals=signals, end=End.UNSAFE)


@cache
def scenes() -> Mapping[str, Scenario]:
    """Return the scenarios by name, and the reactor with an unsafe third of the box."""
    return {
        "cstr": load("cstr"),
        "overtake": load("overtake"),
        "cstr, alarm": replace(load("cstr"), run=alarmed),
    }


def unasked(scene: Scenario, seed: int, marks: bool) -> Found:
    """Run one calibration; without `marks`, the agent ignores them."""
    off = {} if marks else {"unsafe_weight": 0.0}
    agent = GLISp(scene.space, n_max=50, seed=seed, settings=GLISpSettings(**off))
    judge: Any = scene.calibrators["synthetic"](seed)
    steps = list(calibrate(agent, scene.run, judge, partial(outcome, scene)))
    unsafe = sum(step.challenger.end is End.UNSAFE for step in steps)
    return unsafe, agent.samples, steps[-1].winner


def compared(scene: Scenario, found: list[tuple[Found, Found]]) -> str:
    """Return the rest of a line: unsafe counts, indices, and which results are preferred."""
    judge: Any = scene.calibrators["synthetic"](0)
    verdicts = [judge.prefer(told[2], kept[2]) for kept, told in found]
    wins, ties = (verdicts.count(v) for v in (Preference.CHALLENGER, Preference.TIE))
    same = sum(np.array_equal(kept[1], told[1]) for kept, told in found)
    cells = [f"{np.mean([pair[k][0] for pair in found]):.1f}" for k in (0, 1)]
    for k in (0, 1):
        costs = [] if scene.cost is None else [scene.cost(pair[k][2]) for pair in found]
        low, middle, high = np.quantile(costs, [0.25, 0.5, 0.75]) if costs else 3 * [np.nan]
        cells.append(f"{middle:.4f} [{low:.4f}, {high:.4f}]" if costs else "")
    return " | ".join([*cells, f"{wins} to {len(found) - wins - ties}, {ties}", str(same)])


def automatic(names: list[str], seeds: range) -> None:
    """Measure the marks of interrupted runs, and print."""
    print("| scenario | unsafe, off | on | median index [quartiles], off | on | on wins, ties "
          "| studies alike |\n|" + 7 * " --- |")  # fmt: skip
    for name in names or scenes():
        scene = scenes()[name]
        found = [(unasked(scene, seed, False), unasked(scene, seed, True)) for seed in seeds]
        print(f"| {name} | {compared(scene, found)} |", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--functions", nargs="+", choices=sorted(FUNCTIONS), default=DEFAULT)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed, with --scenarios")
    parser.add_argument("--scenarios", nargs="*", help=f"any of {', '.join(scenes())}")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    if options.scenarios is not None:
        automatic(options.scenarios, seeds)
        return
    print("| problem | unsafe, off | on | median gap, off | on | on wins |\n|" + 6 * " --- |")
    every = []
    for name, region in product(options.functions, REGIONS):
        problem = Problem.of(FUNCTIONS[name], REGIONS[region])
        runs = np.array([[study(problem, seed, marks) for marks in (False, True)]
                         for seed in range(options.seeds)])  # fmt: skip
        every.append(runs)
        print(row(f"{name}, {region}", runs[:, 0], runs[:, 1]), flush=True)
    print(row("all", *np.concatenate(every).transpose(1, 0, 2)))


if __name__ == "__main__":
    main()
