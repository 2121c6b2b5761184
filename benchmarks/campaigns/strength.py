"""Measure what "much better" is worth: GLISp with and without strengths, in paired runs.

    python benchmarks/campaigns/strength.py [--problems camel cstr] [--seeds 16] [--factor 3]

Two synthetic people, who make no mistakes, say "much better" if the latent costs differ by more
than a threshold: for "start", the median difference among the ten initial experiments; for
"recent", the median difference of their last fifteen comparisons. Each run has a twin with the same
seed in which they never say so.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from rich.console import Console
from rich.table import Table

from prefcal_agents import GLISp
from prefcal_agents.space.design import latin_hypercube
from prefcal_env.calibrators import LatentCost
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_scenarios.bench.problems import Outcome, Problem, problem
from prefcal_scenarios.cases.functions import FUNCTIONS

N_INIT, N_MAX = 10, 50
RECENT = 15
"""Number of comparisons that a person remembers."""
CLOSEST = 1e-9
"""Gaps below count as this, since smaller ones are rounding."""


@dataclass
class Person:
    """Person who says "much better" above `threshold`, a function of the past (None: never)."""

    threshold: Callable[[list[float]], float | None]
    differences: list[float] = field(default_factory=list)

    def prefer(self, a, b) -> Answer:
        """Compare two outcomes."""
        judge = LatentCost(lambda o: o.cost, much_better=self.threshold(self.differences))
        self.differences.append(abs(a.cost - b.cost))
        return Answer.of(judge.prefer(a, b))


def by_the_start(of: Problem, seed: int) -> Person:
    """Return a person whose threshold comes from the initial experiments."""
    start = [of.space.decode(z) for z in latin_hypercube(of.space, N_INIT, seed)]
    costs = [of.outcome(theta).cost for theta in start]
    threshold = float(np.median([abs(a - b) for a, b in combinations(costs, 2)]))
    return Person(lambda past: threshold)


def by_the_recent(of: Problem, seed: int) -> Person:
    """Return a person who adapts their threshold to recent comparisons."""
    return Person(lambda past: float(np.median(past[-RECENT:])) if len(past) > 2 else None)


PEOPLE = {"plain": lambda of, seed: Person(lambda past: None),
          "start": by_the_start, "recent": by_the_recent}  # fmt: skip


def run(of: Problem, person: Person, seed: int, factor: float) -> tuple[float, int]:
    """Return the gap of the winner, and the number of "much better" answers."""
    agent = GLISp(of.space, n_init=N_INIT, n_max=N_MAX, seed=seed)

    def answer(new: Outcome, old: Outcome | None) -> Answer:
        said = Answer(None) if old is None else person.prefer(new, old)
        return Answer(said.preference, strength=factor) if said.much_better else said

    much = sum(step.answer.much_better for step in ask_and_tell(agent, of.outcome, answer))
    return of.gap(of.outcome(agent.best)), much


def against(gaps: np.ndarray, plain: np.ndarray) -> str:
    """Return the mean log10 ratio with its standard error, and wins to losses."""
    ratio = np.log10(np.maximum(gaps, CLOSEST) / np.maximum(plain, CLOSEST))
    error = ratio.std(ddof=1) / np.sqrt(len(ratio))
    wins, losses = int(np.sum(ratio < -0.01)), int(np.sum(ratio > 0.01))
    return f"{ratio.mean():+.2f} ± {error:.2f}, {wins} to {losses}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    functions = [*FUNCTIONS, "cstr"]
    parser.add_argument("--problems", nargs="+", default=functions, choices=functions)
    parser.add_argument("--seeds", type=int, default=16)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--factor", type=float, default=3.0)
    options = parser.parse_args()
    table = Table("problem", "plain", "start", "log10 ratio", "recent", "log10 ratio", "much")
    gaps: dict[str, list[float]] = {name: [] for name in PEOPLE}
    for name in options.problems:
        seeds = range(options.first, options.first + options.seeds)
        found = {
            who: np.array([run(problem(name), make(problem(name), s), s, options.factor)
                           for s in seeds])
            for who, make in PEOPLE.items()
        }  # fmt: skip
        plain, start, recent = (found[who][:, 0] for who in PEOPLE)
        for who in PEOPLE:
            gaps[who] += found[who][:, 0].tolist()
        much = " ".join(f"{found[who][:, 1].mean():.0f}" for who in ("start", "recent"))
        medians = [f"{np.median(g):.2g}" for g in (plain, start, recent)]
        row = [name, *medians[:2], against(start, plain), medians[2], against(recent, plain), much]
        table.add_row(*row)
        print(*row, sep=" | ", flush=True)
    plain, start, recent = (np.array(gaps[who]) for who in PEOPLE)
    table.add_row("all", "", "", against(start, plain), "", against(recent, plain), "")
    Console(width=130).print(table)


if __name__ == "__main__":
    main()
