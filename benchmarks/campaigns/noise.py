"""Measure what wrong answers cost, for a GLISp that expects mistakes and one that does not.

    python benchmarks/campaigns/noise.py [--problems camel hartman3] [--seeds 10] [--first 0]
    python benchmarks/campaigns/noise.py --rates 0.1 0 --questions 2 --slips

Each study has 50 experiments, 10 of them initial, and up to `--questions` comparisons each. A share
of the answers is wrong; the same pair always gets the same answer, unless mistakes are `--slips`.
Prints median gaps of the returned θ, their ratio to those of a calibrator without mistakes, and in
brackets the gap of the best θ visited.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.protocol.agent import one_thread
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_scenarios.bench.problems import NOISES, Judge, Outcome, problem
from prefcal_scenarios.cases.functions import FUNCTIONS

N_INIT, N_MAX = 10, 50
CALIBRATORS = ("perfect", *NOISES)


class Gaps(NamedTuple):
    """Gaps of the returned θ and of the best θ visited."""

    returned: float
    visited: float


@dataclass(frozen=True, slots=True)
class Slipping:
    """Calibrator that randomly reverses answers of `judge`, independently for each question."""

    judge: Judge
    share: float
    rng: np.random.Generator

    def prefer(self, challenger: Outcome, incumbent: Outcome) -> Preference:
        """Return which one is better, or the opposite."""
        verdict = self.judge.prefer(challenger, incumbent)
        return Preference(-verdict) if self.rng.random() < self.share else verdict


def judge_of(name: str, calibrator: str, seed: int, *, slips: bool) -> Judge:
    """Return the calibrator that answers."""
    where = problem(name)
    if not slips or calibrator == "perfect":
        return where.calibrators[calibrator](seed)
    rng = np.random.default_rng([seed, 7])
    return Slipping(where.calibrators["perfect"](seed), NOISES[calibrator], rng)


def run(name: str, judge: Judge, seed: int, settings: GLISpSettings) -> Gaps:
    """Run one study."""
    where = problem(name)
    agent = GLISp(where.space, n_init=N_INIT, n_max=N_MAX, seed=seed, settings=settings)

    def answer(new: Outcome, old: Outcome | None) -> Any:
        return None if old is None else judge.prefer(new, old)

    gaps = [where.gap(step.challenger) for step in ask_and_tell(agent, where.outcome, answer)]
    return Gaps(where.gap(where.outcome(agent.best)), min(gaps))


def cells(found: dict[str, list[Gaps]]) -> Iterator[str]:
    """Return the medians of one row, and their ratios to the first."""
    first = None
    for gaps in found.values():
        returned, visited = np.median(np.array(gaps), axis=0)
        first = returned if first is None else first
        yield f"{returned:.2g} ({visited:.1g})"
        if gaps is not next(iter(found.values())):
            yield f"{returned / first:.2g}" if first > 0 else "-"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=[*FUNCTIONS], choices=FUNCTIONS)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--rates", type=float, nargs="+", default=[0.1, 0.0])
    parser.add_argument("--questions", type=int, default=1)
    parser.add_argument("--slips", action="store_true")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    table = Table("problem", "error_rate", "perfect", "noisy10", "times", "noisy20", "times")
    rows = [(name, rate) for name in options.problems for rate in options.rates]
    found: dict[tuple[str, float], dict[str, list[Gaps]]] = {
        row: {calibrator: [] for calibrator in CALIBRATORS} for row in rows
    }
    tasks = [(row, calibrator, s) for row in rows for calibrator in CALIBRATORS for s in seeds]
    with one_thread():
        for (name, rate), calibrator, seed in track(tasks, console=Console(stderr=True)):
            judge = judge_of(name, calibrator, seed, slips=options.slips)
            settings = GLISpSettings(error_rate=rate, questions_per_experiment=options.questions)
            found[name, rate][calibrator].append(run(name, judge, seed, settings))
    for name, rate in rows:
        table.add_row(name, f"{rate:g}", *cells(found[name, rate]))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
