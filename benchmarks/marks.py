"""How much marks help: test functions with an unsafe third of the box, marks told or kept back.

    python benchmarks/marks.py                          # 15 problems, 20 seeds, some 40 minutes
    python benchmarks/marks.py --seeds 5 --functions camel hartman3

Prints a Markdown table. The synthetic calibrator prefers a safe experiment to an unsafe one and
compares two of a kind by the function; with marks it also says which side was unsafe.
"""

import argparse
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from prefcal_agents import GLISp
from prefcal_env import Answer, Mark, Query
from prefcal_scenarios.functions import FUNCTIONS, TestFunction

Level = Callable[[np.ndarray, np.ndarray], np.ndarray]

DEFAULT = ("camel", "branin", "hartman3", "styblinski3", "hartman6")
SHARE = 1 / 3  # of the box that is unsafe
REGIONS: Mapping[str, Level] = {
    "half space": lambda z, best: (z - best) @ (best - 0.5 + 1e-3),
    "ball": lambda z, best: -np.linalg.norm(z - (0.6 * best + 0.2), axis=1),
    "stripes": lambda z, best: np.cos(4 * np.pi * (z[:, 0] - best[0] + 0.02)),
}
"""Unsafe is where the level, of points (m, n) and the minimiser, is highest; it holds him."""


@dataclass(frozen=True)
class Problem:
    """A test function, part of whose box is unsafe: where `level` exceeds `ceiling`."""

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
        """Whether the rows of `z`, unit cube, shape (m, n), are unsafe, (m,)."""
        best = self.function.space.encode(np.array(self.function.minimizers[0]))
        return np.asarray(self.level(z, best) > self.ceiling)

    def safe_values(self, z: np.ndarray) -> np.ndarray:
        """Values at the rows of `z`, infinite where unsafe, (m,)."""
        pairs = zip(z, self.unsafe(z), strict=True)
        return np.array([np.inf if u else self.function(self.function.space.decode(p))
                         for p, u in pairs])  # fmt: skip

    def answer(self, query: Query, marks: bool) -> Answer:
        """The synthetic calibrator's."""
        new, old = query.challenger.theta, query.incumbent and query.incumbent.theta
        space = self.function.space
        bad = [t is not None and bool(self.unsafe(space.encode(t)[None])) for t in (new, old)]
        words = np.array([Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE])
        verdict = None if old is None else int(bad[0]) - int(bad[1])
        verdict = self.function.prefer(new, old) if verdict == 0 else verdict
        return Answer(verdict, marks=tuple(words[bad]) if marks else ())


def study(problem: Problem, seed: int, marks: bool) -> tuple[int, float]:
    """Unsafe experiments and the gap of the θ returned; infinite where that is unsafe."""
    agent = GLISp(problem.function.space, n_max=50, seed=seed)
    while not agent.done:
        query = agent.ask()
        agent.tell(query, problem.answer(query, marks))
    z = np.array([problem.function.space.encode(theta) for theta in agent.samples])
    best = problem.function.space.encode(agent.best)
    return int(problem.unsafe(z).sum()), problem.safe_values(best[None])[0] - problem.optimum


def row(name: str, kept: np.ndarray, told: np.ndarray) -> str:
    """A line of the table; both arrays hold counts and gaps of each seed, (seeds, 2)."""
    counts, gaps = (kept[:, 0], told[:, 0]), (kept[:, 1], told[:, 1])
    ratio = np.log10(np.maximum(gaps[1], 1e-9) / np.maximum(gaps[0], 1e-9))
    duel = f"{np.sum(ratio < 0)} to {np.sum(ratio > 0)}"
    return (f"| {name} | {counts[0].mean():.1f} | {counts[1].mean():.1f} "
            f"| {np.median(gaps[0]):.2g} | {np.median(gaps[1]):.2g} | {duel} |")  # fmt: skip


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--functions", nargs="+", choices=sorted(FUNCTIONS), default=DEFAULT)
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
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
