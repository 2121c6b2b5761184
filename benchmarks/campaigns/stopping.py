"""Compare stopping advice with reality: improvements predicted and observed in ten experiments.

    python benchmarks/campaigns/stopping.py [--functions camel branin] [--seeds 10]

GLISp gives its advice after 15, 20 ... 40 of 50 experiments. Two synthetic people compare: one sees
every difference, the other treats two experiments as equal if their costs differ by less than 2 %
of the range of the first ten. The parameters of the advice were chosen on the functions of
CHOSEN_ON.
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from prefcal_agents import Advice, GLISp
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_scenarios.cases.functions import FUNCTIONS, TestFunction

CHOSEN_ON = ("camel", "hartman3", "ackley2", "rosenbrock4", "styblinski3", "levy4")
HELD_OUT = ("branin", "hartman6", "ackley5", "adjiman", "terraces3", "levy8")
N_INIT, N_MAX, AHEAD = 10, 50, 10
ASKED = (15, 20, 25, 30, 35, 40)
BANDS = {"sees every difference": 0.0, "2 % counts as equal": 0.02}


@dataclass(frozen=True)
class Case:
    """Advice at one point, the improvements that followed, and the gain relative to the range."""

    advice: Advice
    happened: int
    gain: float


def study(f: TestFunction, seed: int, band: float) -> list[Case]:
    """Return the advice given in one study, with the improvements that followed."""
    agent = GLISp(f.space, n_init=N_INIT, n_max=N_MAX, seed=seed)
    costs, best, won, advice = [], [], [], {}

    def answer(new: float, old: float | None) -> int | None:
        costs.append(new)
        if old is None:
            return None
        same = abs(new - old) < band * np.ptp(costs[:N_INIT])
        return 0 if same else int(np.sign(new - old))

    for step in ask_and_tell(agent, f, answer):
        won.append(step.answer == -1)
        best.append(step.challenger if step.answer in (None, -1) else best[-1])
        if len(costs) in ASKED:
            advice[len(costs)] = agent.advice
    fall = -np.array(best) / np.ptp(costs[:N_INIT])
    return [
        Case(a, sum(won[n : n + AHEAD]), fall[n + AHEAD - 1] - fall[n - 1])
        for n, a in advice.items()
    ]


def rows(cases: list[Case], of, edges: tuple[float, ...]) -> None:
    """Print the cases by `of` their advice, in bins between `edges`."""
    for low, high in pairwise(edges):
        some = [c for c in cases if low <= of(c.advice) < high]
        if some:
            predicted, observed, none, inside, gain = (
                np.mean([g(c) for c in some])
                for g in (
                    lambda c: c.advice.expected,
                    lambda c: c.happened,
                    lambda c: c.happened == 0,
                    lambda c: c.advice.low <= c.happened <= c.advice.high,
                    lambda c: c.gain > 0.01,
                )
            )
            said = np.mean([c.advice.none for c in some])
            print(f"| {low:g} to {high:g} | {len(some)} | {predicted:.2f} | {observed:.2f} | "
                  f"{said:.2f} | {none:.2f} | {inside:.2f} | {gain:.2f} |", flush=True)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--functions", nargs="+", choices=sorted(FUNCTIONS))
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    groups = {"chosen on": CHOSEN_ON, "held out": HELD_OUT}
    for group, names in ({"named": options.functions} if options.functions else groups).items():
        for person, band in BANDS.items():
            every = [(FUNCTIONS[name], seed) for name in names for seed in range(options.seeds)]
            cases = [case for f, seed in every for case in study(f, seed, band)]
            head = "cases | predicted | observed | none, predicted | none | in 80 % | gain > 1 %"
            print(f"\n{group}, {person}\n\n| expected | {head} |\n|" + " --- |" * 8)
            rows(cases, lambda a: a.expected, (0, 0.25, 0.5, 1, 2, 3, 4, 10))
            rows(cases, lambda a: 0.0, (0, 1))


if __name__ == "__main__":
    main()
