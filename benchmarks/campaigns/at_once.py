"""Measure what several experiments at once cost and save: gap, worth and wall time.

    python benchmarks/campaigns/at_once.py                        # all parts: some hours
    python benchmarks/campaigns/at_once.py --parts functions --seeds 4
    python benchmarks/campaigns/at_once.py --quick                # a minute

functions  gap to the optimum after 50 experiments, one after the other and `--at-once` at a time
loops      worth after 20 experiments on closed loops, KPIs told, tastes of two kinds
time       wall time of 24 experiments of `--seconds` each, in real time

In the first two parts runs take a random time (log-normal, spread 0.5) by a clock of their own,
so they end in another order than they began. Both studies of a pair have the same seed.
docs/research/at_once.md has the results.
"""

import argparse
import os
import time
from collections.abc import Callable, Sequence
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

import numpy as np

from prefcal_agents import GLIS, GLISp
from prefcal_env.knobs.key import theta_key
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_scenarios.bench.problems import Outcome, Person, Problem, prefer, problem
from prefcal_scenarios.cases.functions import FUNCTIONS

FLOOR = 1e-9  # the optima are not known better
AGENTS = {"GLISp": GLISp, "GLIS": GLIS}
TASTES = ("weights", "priorities")
LOOPS = tuple(f"loop-{seed}" for seed in range(300, 306))
PARTS = ("functions", "loops", "time")
_SPREAD = 0.5
"""Standard deviation of the logarithm of the time of a run."""
_COUNT = 24
"""Number of experiments in real time."""


def study(
    agent: Any, where: Problem, person: Person, *, at_once: int, seed: int, mean: float = 1.0
) -> tuple[Outcome, float]:
    """Drive `agent` with runs that end in random order.

    Returns:
        The outcome of the best θ, and the time of the last answer by the clock of the runs, in
        units of the median time of a run.
    """
    rng, now = np.random.default_rng([seed, at_once]), 0.0
    ends: dict[bytes, float] = {}
    outcomes: dict[bytes, Outcome] = {}
    while not agent.done:
        queries = agent.ask(at_once)
        for query in queries:
            key = theta_key(query.challenger.theta)
            if key not in ends:
                ends[key] = now + mean * float(np.exp(_SPREAD * rng.standard_normal()))
                outcomes[key] = where.outcome(query.challenger.theta)
        query = min(queries, key=lambda q: (not q.further, ends[theta_key(q.challenger.theta)]))
        now = max(now, ends[theta_key(query.challenger.theta)])
        new = outcomes[theta_key(query.challenger.theta)]
        old = None if query.incumbent is None else outcomes[theta_key(query.incumbent.theta)]
        agent.tell(query, told(agent, person, new, old))
    return where.outcome(agent.best), now


def told(agent: Any, person: Person, new: Outcome, old: Outcome | None) -> Any:
    """Return what the agent is told: a cost, or a verdict with the KPIs that are known."""
    if agent.by_value:
        return person.cost(new)
    verdict = None if old is None else prefer(person.judge, new, old)
    if new.kpis is None:
        return verdict
    return Answer(verdict, outcomes=(person.told(new), None if old is None else person.told(old)))


def pairs(
    cases: Sequence[tuple[str, str]],
    options: argparse.Namespace,
    n_max: int,
    score: Callable[[Problem, Person, Outcome], float],
) -> None:
    """Print, for each problem and calibrator, the scores and the ratio of their means."""
    make, logs = AGENTS[options.agent], []
    for name, calibrator in cases:
        where, found = problem(name), []
        for seed in range(options.first, options.first + options.seeds):
            row = []
            for at_once in (1, options.at_once):
                agent = make(where.space, n_init=min(10, n_max // 2), n_max=n_max, seed=seed)
                person = where.person(calibrator, seed)
                best, _ = study(agent, where, person, at_once=at_once, seed=seed)
                row.append(np.log10(score(where, person, best)))
            found.append(row)
        logs.append(found)
        one, many = 10 ** np.mean(found, axis=0)
        print(
            f"{name:14} {calibrator:12} {one:10.3g} {many:10.3g}   x {many / one:.2f}", flush=True
        )
    apart = np.diff(np.array(logs), axis=2)[..., 0]  # problems x seeds
    spread = apart.std(axis=1, ddof=1) if options.seeds > 1 else np.zeros(len(apart))
    half = 1.96 * np.sqrt(np.sum(spread**2 / options.seeds)) / len(apart)
    middle = apart.mean()
    low, high = 10 ** (middle - half), 10 ** (middle + half)
    print(f"all: x {10**middle:.2f} (95 % interval {low:.2f} to {high:.2f})")
    medians = np.median(logs, axis=1)
    print(f"ratio of the medians of each problem: x {10 ** np.diff(medians, axis=1).mean():.2f}")


def wall_time(options: argparse.Namespace) -> None:
    """Print the wall time of studies in real time."""
    count = 8 if options.quick else _COUNT
    each = options.seconds
    one, many = (real_time(count, at_once, options.first, each) for at_once in (1, options.at_once))
    print(f"{count} experiments of {each:g} s: {one:.1f} s one by one, {many:.1f} s at once")
    print(f"share of the sequential time: {many / one:.0%}")


def real_time(count: int, at_once: int, seed: int, seconds: float) -> float:
    """Return the seconds that a study of `count` experiments of `seconds` each takes."""
    where = problem("hartman3")
    agent = GLISp(where.space, n_init=min(10, count // 2), n_max=count, seed=seed)
    person = where.person("perfect", seed)

    def run(theta: Any) -> Outcome:
        time.sleep(seconds)
        return where.outcome(theta)

    def answer(new: Outcome, old: Outcome | None) -> Any:
        return told(agent, person, new, old)

    start = time.monotonic()
    for _ in ask_and_tell(agent, run, answer, at_once=at_once):
        pass
    return time.monotonic() - start


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--agent", choices=tuple(AGENTS), default="GLISp")
    parser.add_argument("--functions", nargs="+", default=list(FUNCTIONS), metavar="NAME")
    parser.add_argument("--loops", nargs="+", default=list(LOOPS), metavar="NAME")
    parser.add_argument("--at-once", type=int, default=4)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--n-max", type=int, default=0, help="experiments; 50, on loops 20")
    parser.add_argument("--seconds", type=float, default=5.0, help="time of a run, part time")
    parser.add_argument("--quick", action="store_true", help="one seed of one problem each")
    return parser.parse_args(words)


def main() -> None:
    """Print all parts."""
    options = options_of()
    if options.quick:
        options.seeds, options.functions, options.loops = 1, ["camel"], LOOPS[:1]
    if "functions" in options.parts:
        print(f"gap after {options.n_max or 50} experiments, 1 and {options.at_once} at once")
        cases = [(name, "perfect") for name in options.functions]
        pairs(cases, options, options.n_max or 50, lambda p, _, best: max(p.gap(best), FLOOR))
    if "loops" in options.parts:
        print(f"worth after {options.n_max or 20} experiments, 1 and {options.at_once} at once")
        cases = [(name, taste) for taste in TASTES for name in options.loops]
        pairs(cases, options, options.n_max or 20, lambda _, person, best: person.worth(best))
    if "time" in options.parts:
        wall_time(options)


if __name__ == "__main__":
    main()
