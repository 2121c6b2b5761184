"""Compare random tunings and calibrations of the overtaking with the paper's optimum.

    OMP_NUM_THREADS=1 python benchmarks/campaigns/overtake.py [--samples 500] [--seeds 20]
    ... --samples 0 --agents GLISp RandomSearch LatinHypercube
    ... --samples 0 --told --fresh 1000    # GLISp told the KPIs, against 1,000 other θ
    ... --steering "per step"            # 0.0873 rad per step instead of 0.0873 rad/s

Part one runs a seeded sample of θ in the box and counts interrupted runs, unsolved QPs and
violations of criterion (i). Part two calibrates with each agent, 50 experiments for each seed, and
reports whether the synthetic calibrator prefers the returned θ to the paper's, by which criterion,
and whether it violates criterion (i) or safety. With `--fresh` it also reports than how many other
random θ the returned one is no worse. Prints Markdown.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections import Counter
from functools import cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from course import spread

import prefcal_agents
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios import Scenario, load, outcome
from prefcal_scenarios.cases.overtake import calibrator, overtake
from prefcal_scenarios.cases.overtake.controller import STEERING_LIMITS
from prefcal_scenarios.cases.overtake.kpis import SHORTEST_DISTANCE
from prefcal_scenarios.own.source import joined_source

AGENTS = ("GLISp", "RandomSearch", "LatinHypercube")
PAPER = "paper, preferences"
SHOWN = (
    "t_comp_ratio", "lateral_distance", "path_peak", "lane_deviation", "lateral_acceleration",
)  # fmt: skip
VERDICTS = {Preference.CHALLENGER: "better", Preference.TIE: "a tie", Preference.INCUMBENT: "worse"}


class Result(NamedTuple):
    """Result of one calibration."""

    seed: int
    theta: list[float]
    verdict: str
    reason: str
    violations: list[str]
    kpis: dict[str, float]
    ties: int


@cache
def limited(steering: str) -> Scenario:
    """Return the scenario with this limit of the steering."""
    return load(joined_source("overtake", {"steering_limit": steering}))


def random_run(i: int, stream: int, steering: str) -> Experiment:
    """Run random θ number i: of the sample (stream 0), or one that no calibration has seen (1)."""
    theta = overtake.space.decode(np.random.default_rng([stream, i]).random(len(overtake.space)))
    return limited(steering).run(theta)


def study(job: tuple[int, str, int], steering: str, told: bool) -> Result:
    """Run one calibration: seed, agent, experiments; KPIs are `told` or not."""
    seed, name, n_max = job
    scenario, judge = limited(steering), calibrator()
    agent = getattr(prefcal_agents, name)(overtake.space, n_max=n_max, seed=seed)
    known = partial(outcome, scenario) if told else None
    comparisons = list(calibrate(agent, scenario.run, judge, known))
    best = scenario.run(agent.best)  # the last comparison may be about two others
    ties = sum(c.answer.preference is Preference.TIE for c in comparisons)
    verdict, criterion = judge.decide(best, scenario.run(overtake.references[PAPER]))
    return Result(
        seed, best.theta.tolist(), VERDICTS[verdict], criterion.name if criterion else "",
        violated(best), dict(best.kpis), ties,
    )  # fmt: skip


def violated(e: Experiment) -> list[str]:
    """Return which of criterion (i) and safety is violated."""
    objections = {
        "collision": e.kpis["collision"] > 0,
        "other interruption": e.end.interrupted and not e.kpis["collision"],
        "real time": e.kpis["t_comp_ratio"] > 1,
        "too near": e.kpis["lateral_distance"] < SHORTEST_DISTANCE,
        "off the road": e.kpis["off_road"] > 0,
        "unsolved QP": e.kpis["unsolved"] > 0,
    }
    return [name for name, holds in objections.items() if holds]


def tell_samples(runs: list[Experiment]) -> None:
    counts = Counter(name for e in runs for name in violated(e))
    print(f"\n{len(runs)} random θ:\n\n| what | runs | share |\n| --- | --- | --- |")
    for name, k in counts.items():
        print(row(name, str(k), f"{k / len(runs):.1%}"))


def tell_studies(results: list[Result], name: str) -> None:
    print(f"\n{len(results)} calibrations by {name}; best against paper:\n")
    print(row("seed", *overtake.space.names, "is", "by", "violates", *SHOWN))
    print(row(*["---"] * (len(overtake.space) + 4 + len(SHOWN))))
    for r in results:
        theta, kpis = (f"{v:.3g}" for v in r.theta), (f"{r.kpis[k]:.3f}" for k in SHOWN)
        objections = ", ".join(r.violations) or "nothing"
        print(row(str(r.seed), *theta, r.verdict, r.reason, objections, *kpis))
    counts = Counter(r.verdict for r in results)
    print("\n" + ", ".join(f"{counts[v]} {v}" for v in VERDICTS.values()))
    print(f"{sum(bool(r.violations) for r in results)} violate criterion (i) or safety")
    print(f"Ties among the answers, median: {np.median([r.ties for r in results]):g}")


def tell_shares(results: list[Result], steering: str, others: list[Experiment]) -> None:
    """Print than which share of other θ the returned ones are no worse."""
    shares = []
    for r in results:
        best = limited(steering).run(np.array(r.theta))
        verdicts = [calibrator().prefer(best, other) for other in others]
        shares.append(100 * np.mean([v is not Preference.INCUMBENT for v in verdicts]))
    low, middle, high = np.quantile(shares, [0.25, 0.5, 0.75])
    print(f"No worse than {middle:.1f} % [{low:.1f}, {high:.1f}] of {len(others)} other θ")


def row(*cells: str) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=500, help="random θ")
    parser.add_argument("--seeds", type=int, default=20, help="calibrations")
    parser.add_argument("--n-max", type=int, default=50, help="experiments of a calibration")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument("--agents", nargs="+", default=["GLISp"], choices=AGENTS)
    parser.add_argument(
        "--steering", nargs="+", default=["per second"], choices=STEERING_LIMITS,
        help="what 0.0873 rad limits",
    )  # fmt: skip
    parser.add_argument("--told", action="store_true", help="agents are told the KPIs")
    parser.add_argument("--fresh", type=int, default=0, help="other random θ to compare with")
    args = parser.parse_args()
    for steering, (stream, n) in product(args.steering, enumerate((args.samples, args.fresh))):
        one: Any = partial(random_run, stream=stream, steering=steering)
        runs = list(spread(one, range(n), args.jobs, "random θ"))
        if stream == 0:
            tell_samples(runs)
            continue
        for name in args.agents:
            jobs = [(seed, name, args.n_max) for seed in range(args.seeds)]
            one = partial(study, steering=steering, told=args.told)
            found = list(spread(one, jobs, args.jobs))
            tell_studies(found, name)
            if runs:
                tell_shares(found, steering, runs)


if __name__ == "__main__":
    main()
