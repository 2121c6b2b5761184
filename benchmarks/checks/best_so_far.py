"""Replay studies without wrong answers: is "best so far" true, and is anything better lost?

    python benchmarks/checks/best_so_far.py                             # as in docs/best_so_far.md
    python benchmarks/checks/best_so_far.py --problems camel --seeds 2  # a look

The calibrator makes no mistakes, so three counts must be 0: questions in which the best so far had
already lost to another experiment; studies that return another experiment than the best of all
shown; and experiments that differ from an earlier one by less than 0.2 % of every range (counted
only if knobs have a resolution, as on the reactor). Exits with 1 if a count is not 0.
"""

import argparse
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_agents import GLISp
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_scenarios import load, outcome
from prefcal_scenarios.cases.functions import FUNCTIONS

FOUR = ("camel", "hartman3", "levy4", "hartman6")
APART = 0.002
Known = tuple[float, Mapping[str, float] | None]
Kpis = tuple[Mapping[str, float], Mapping[str, float] | None] | None


class Replay(NamedTuple):
    """Result of one study."""

    untrue: int
    left_behind: bool
    too_close: int
    questions: int
    best: float


def reactor() -> tuple[KnobSpace, Callable[[np.ndarray], Known], int]:
    """Return the reactor as `prefcal calibrate cstr --calibrator synthetic` runs it."""
    scenario = load("cstr")
    assert scenario.cost is not None
    cost = scenario.cost

    def run(theta: np.ndarray) -> Known:
        experiment = scenario.run(theta)
        return cost(experiment), outcome(scenario, experiment)

    return scenario.space, run, 2 * len(scenario.space)


def problem(name: str) -> tuple[KnobSpace, Callable[[np.ndarray], Known], int]:
    """Return the space, a function with the cost and KPIs of a θ, and the initial experiments."""
    if name == "cstr":
        return reactor()
    function = FUNCTIONS[name]
    return function.space, lambda theta: (function(theta), None), 10


def replay(name: str, seed: int, n_max: int) -> Replay:
    """Run one study with a calibrator that makes no mistakes."""
    space, run, n_init = problem(name)
    agent = GLISp(space, n_init=n_init, n_max=n_max, seed=seed)
    known: list[Known] = []
    lost: set[int] = set()
    untrue = questions = 0
    while not agent.done:
        query = agent.ask()
        new, rival = query.challenger, query.incumbent
        if new.index == len(known):
            known.append(run(new.theta))
        if rival is None:
            agent.tell(query, Answer(None, outcomes=_pair(known[0], None)))
            continue
        questions += 1
        untrue += agent.best_index in lost
        a, b = known[new.index], known[rival.index]
        verdict = Preference(int(np.sign(a[0] - b[0])))
        if verdict is not Preference.TIE:
            lost.add(rival.index if verdict is Preference.CHALLENGER else new.index)
        agent.tell(query, Answer(verdict, outcomes=_pair(a, b)))
    assert agent.best_index is not None
    costs = [cost for cost, _ in known]
    best = costs[agent.best_index]
    return Replay(untrue, best > min(costs), _close(space, agent.samples), questions, best)


def _pair(
    a: Known, b: Known | None
) -> tuple[Mapping[str, float], Mapping[str, float] | None] | None:
    return None if a[1] is None else (a[1], None if b is None else b[1])


def _close(space: KnobSpace, thetas: np.ndarray) -> int:
    """Count experiments next to an earlier one; none if knobs have no resolution."""
    if any(knob.resolution == 0 for knob in space):
        return 0
    z = np.array([space.encode(theta) for theta in thetas])
    away = (np.abs(z[:k] - z[k]).max(axis=1) for k in range(1, len(z)))
    return sum(bool((distances < APART).any()) for distances in away)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--problems", nargs="+", default=["cstr", *FOUR])
    parser.add_argument("--seeds", type=int, help="default: 14 for the reactor, 20 for a function")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--n-max", type=int, default=50, help="experiments of a study")
    args = parser.parse_args()
    table = Table(
        "problem", "studies", "questions", "untrue labels", "better left behind", "too close",
        "result: median, quartiles",
    )  # fmt: skip
    wrong = 0
    for name in args.problems:
        seeds = range(args.first, args.first + (args.seeds or (14 if name == "cstr" else 20)))
        found = [
            replay(name, seed, args.n_max)
            for seed in track(seeds, name, console=Console(stderr=True))
        ]
        counts = np.array([(r.untrue, r.left_behind, r.too_close) for r in found]).sum(axis=0)
        wrong += int(counts.sum())
        asked = sum(r.questions for r in found)
        low, middle, high = np.percentile([r.best for r in found], [25, 50, 75])
        result = f"{middle:.5g} [{low:.5g}, {high:.5g}]"
        table.add_row(name, str(len(found)), str(asked), *map(str, counts), result)
    Console(width=110).print(table)
    raise SystemExit(wrong > 0)


if __name__ == "__main__":
    main()
