"""Compare random tunings and calibrations of the overtaking with the paper's optimum.

    OMP_NUM_THREADS=1 python benchmarks/campaigns/overtake.py [--samples 500] [--seeds 20]
    ... --samples 0 --agents GLISp RandomSearch LatinHypercube
    ... --samples 0 --told --fresh 1000    # GLISp told the KPIs, against 1,000 other θ
    ... --steering "per step"            # 0.0873 rad per step instead of 0.0873 rad/s
    ... --optimum --steering "per second" "per step"

Part one runs a seeded sample of θ in the box and reports how they ended: interrupted runs,
unsolved QPs, criterion (i), seconds of an experiment. Part two calibrates with each agent, 50
experiments for each seed, and reports whether the synthetic calibrator prefers the returned θ to
the paper's, by which criterion, and whether it violates criterion (i) or safety. With `--fresh`
it also reports than how many other random θ the returned one is no worse. Prints Markdown.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

import time
from collections import Counter
from functools import cache, partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from course import spread
from rich.console import Console

import prefcal_agents
from prefcal_env.envs.overtake.road.rules import HORIZON
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.loop import calibrate
from prefcal_scenarios import Scenario, load, outcome
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.computation_time import measured_t_comp
from prefcal_scenarios.cases.overtake.controller import STEERING_LIMITS
from prefcal_scenarios.cases.overtake.kpis import SHORTEST_DISTANCE
from prefcal_scenarios.own.source import joined_source

AGENTS = ("GLISp", "RandomSearch", "LatinHypercube")
PAPER = "paper, preferences"
SHOWN = (
    "t_comp_ratio", "lateral_distance", "path_peak", "lane_deviation", "lateral_acceleration",
)  # fmt: skip
VERDICTS = {Preference.CHALLENGER: "better", Preference.TIE: "a tie", Preference.INCUMBENT: "worse"}


class Run(NamedTuple):
    """Result of one random θ."""

    end: str
    kpis: dict[str, float]
    exact: bool
    seconds: float


class Result(NamedTuple):
    """Result of one calibration."""

    seed: int
    theta: list[float]
    verdict: str
    reason: str
    violations: list[str]
    kpis: dict[str, float]
    ties: int
    seconds: float


@cache
def limited(steering: str) -> Scenario:
    """Return the scenario with this limit of the steering."""
    return load(joined_source("overtake", {"steering_limit": steering}))


def sample(i: int, steering: str) -> Run:
    """Run θ number i of the sample once."""
    theta = overtake.space.decode(np.random.default_rng([0, i]).random(len(overtake.space)))
    start = time.perf_counter()
    e = limited(steering).run(theta)
    seconds = time.perf_counter() - start
    finite = (
        all(np.isfinite(a).all() for a in (e.x, e.u)) and not np.isnan(list(e.kpis.values())).any()
    )
    if not finite:
        raise SystemExit(f"θ = {theta} left a number that is not finite")
    return Run(e.end.name, dict(e.kpis), exact_in_time(e), seconds)


def exact_in_time(e: Experiment) -> bool:
    """Return whether every sampling instant is k T_s to 1e-9 s and the run ended on time."""
    T_s, n = e.theta[0], len(e.t_control)
    instants = np.abs(e.t_control - T_s * np.arange(n)).max() < 1e-9
    last = e.end.interrupted or abs(e.t[-1] - T_s * np.ceil(HORIZON / T_s - 1e-9)) < 1e-9
    return bool(instants and last)


def fresh(i: int, steering: str) -> Experiment:
    """Run random θ number i of those that no calibration has seen."""
    theta = overtake.space.decode(np.random.default_rng([1, i]).random(len(overtake.space)))
    return limited(steering).run(theta)


def study(job: tuple[int, str, str, int], steering: str, told: bool) -> Result:
    """Run one calibration: seed, agent, calibrator, experiments; KPIs are `told` or not."""
    seed, name, judge, n_max = job
    scenario = limited(steering)
    start = time.perf_counter()
    calibrator: Any = overtake.calibrators[judge](seed)
    agent = getattr(prefcal_agents, name)(overtake.space, n_max=n_max, seed=seed)
    known = partial(outcome, scenario) if told else None
    comparisons = list(calibrate(agent, scenario.run, calibrator, known))
    best = scenario.run(agent.best)  # the last comparison may be about two others
    ties = sum(c.answer.preference is Preference.TIE for c in comparisons)
    verdict, criterion = calibrator.decide(best, scenario.run(overtake.references[PAPER]))
    return Result(
        seed, best.theta.tolist(), VERDICTS[verdict], cell(criterion.name) if criterion else "",
        violated(best, calibrator), dict(best.kpis), ties, time.perf_counter() - start,
    )  # fmt: skip


def cell(text: str) -> str:
    """Return the text for a cell of a Markdown table."""
    return text.replace("|", r"\|")


def violated(e: Experiment, calibrator: Any) -> list[str]:
    """Return which of criterion (i) and safety is violated."""
    objections = {
        "real time": calibrator.first[0].key(e) > 0,
        "interrupted": e.end.interrupted,
        "too near": e.kpis["lateral_distance"] < SHORTEST_DISTANCE,
        "off the road": e.kpis["off_road"] > 0,
        "unsolved QP": e.kpis["unsolved"] > 0,
    }
    return [name for name, holds in objections.items() if holds]


def tell_paper(steering: str, console: Console) -> None:
    scenario = limited(steering)
    scenario.run(overtake.references[PAPER])  # compiles
    e = scenario.run(overtake.references[PAPER])
    text = [f"The paper's optimum, 0.0873 rad {steering}:", "", "| what | value |", "| --- | --- |"]
    text += [f"| {cell(k.title)} [{k.unit}] | {e.kpis[k.name]:.4g} |" for k in overtake.kpis]
    worst, most = (f"{seconds * 1e3:.2f}" for seconds in measured_t_comp(e))
    text += [f"| t_comp measured here, worst and 99th percentile [ms] | {worst}, {most} |"]
    console.print("\n".join(text), soft_wrap=True, markup=False)


def tell_samples(runs: list[Run], console: Console) -> None:
    n = len(runs)
    shares = {
        "collisions": sum(r.kpis["collision"] > 0 for r in runs),
        "other interruptions": sum(r.end == "UNSAFE" and not r.kpis["collision"] for r in runs),
        "runs with an unsolved QP": sum(r.kpis["unsolved"] > 0 for r in runs),
        "criterion (i) violated on the paper's processor": sum(
            r.kpis["t_comp_ratio"] >= 1 for r in runs
        ),
        f"below {SHORTEST_DISTANCE:g} m beside the obstacle": sum(
            r.kpis["lateral_distance"] < SHORTEST_DISTANCE for r in runs
        ),
        "time not exact to 1e-9 s": sum(not r.exact for r in runs),
    }
    seconds = np.quantile([r.seconds for r in runs], [0.5, 0.95, 1.0])
    text = [f"\n{n} random θ:", "", "| what | runs | share |", "| --- | --- | --- |"]
    text += [f"| {what} | {k} | {k / n:.1%} |" for what, k in shares.items()]
    text += ["", "Ended: " + ", ".join(f"{k} {v}" for k, v in Counter(r.end for r in runs).items())]
    text += [
        "Seconds of an experiment, median, 95 %, worst: " + " ".join(f"{s:.3f}" for s in seconds)
    ]
    console.print("\n".join(text), soft_wrap=True, markup=False)


def tell_studies(results: list[Result], name: str, judge: str, console: Console) -> None:
    text = [f"\n{len(results)} calibrations by {name}, calibrator {judge!r}; best against paper:\n"]
    text += [row("seed", *overtake.space.names, "is", "by", "violates", *SHOWN)]
    text += [row(*["---"] * (len(overtake.space) + 4 + len(SHOWN)))]
    for r in results:
        theta, kpis = (f"{v:.3g}" for v in r.theta), (f"{r.kpis[k]:.3f}" for k in SHOWN)
        objections = ", ".join(r.violations) or "nothing"
        text.append(row(str(r.seed), *theta, r.verdict, r.reason, objections, *kpis))
    counts = Counter(r.verdict for r in results)
    text += ["", ", ".join(f"{counts[v]} {v}" for v in VERDICTS.values())]
    text += [f"{sum(bool(r.violations) for r in results)} violate criterion (i) or safety"]
    text += [f"Ties among the answers, median: {np.median([r.ties for r in results]):g}"]
    text += [f"Seconds of a calibration, median: {np.median([r.seconds for r in results]):.1f}"]
    console.print("\n".join(text), soft_wrap=True, markup=False)


def tell_shares(
    results: list[Result], judge: str, steering: str, others: list[Experiment], console: Console
) -> None:
    """Print than which share of other θ the returned ones are no worse, by their calibrators."""
    shares = []
    for r in results:
        calibrator: Any = overtake.calibrators[judge](r.seed)
        best = limited(steering).run(np.array(r.theta))
        verdicts = [calibrator.decide(best, other)[0] for other in others]
        shares.append(100 * np.mean([v is not Preference.INCUMBENT for v in verdicts]))
    low, middle, high = np.quantile(shares, [0.25, 0.5, 0.75])
    text = f"No worse than {middle:.1f} % [{low:.1f}, {high:.1f}] of {len(others)} other θ"
    console.print(f"{text} (median, quartiles over seeds)", soft_wrap=True, markup=False)


def row(*cells: str) -> str:
    """Return a row of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=500, help="random θ")
    parser.add_argument("--seeds", type=int, default=20, help="calibrations")
    parser.add_argument("--n-max", type=int, default=50, help="experiments of a calibration")
    parser.add_argument("--jobs", type=int, default=1, help="processes at a time")
    parser.add_argument(
        "--calibrator", nargs="+", default=["synthetic"], choices=sorted(overtake.calibrators)
    )
    parser.add_argument("--agents", nargs="+", default=["GLISp"], choices=AGENTS)
    parser.add_argument(
        "--steering", nargs="+", default=["per second"], choices=STEERING_LIMITS,
        help="what 0.0873 rad limits",
    )  # fmt: skip
    parser.add_argument("--optimum", action="store_true", help="only the paper's optimum")
    parser.add_argument("--told", action="store_true", help="agents are told the KPIs")
    parser.add_argument("--fresh", type=int, default=0, help="other random θ to compare with")
    args = parser.parse_args()
    for steering in args.steering:
        tell(steering, args, Console())


def tell(steering: str, args: argparse.Namespace, console: Console) -> None:
    """Run everything requested, with one limit of the steering."""
    if args.samples or args.optimum:
        tell_paper(steering, console)
    if args.samples and not args.optimum:
        one = partial(sample, steering=steering)
        tell_samples(list(spread(one, range(args.samples), args.jobs, "random θ")), console)
    runs = spread(partial(fresh, steering=steering), range(args.fresh), args.jobs, "fresh θ")
    others = [] if args.optimum else list(runs)
    for name, judge in product(args.agents, args.calibrator) if not args.optimum else ():
        jobs = [(seed, name, judge, args.n_max) for seed in range(args.seeds)]
        if jobs:
            one = partial(study, steering=steering, told=args.told)
            found = list(spread(one, jobs, args.jobs))
            tell_studies(found, name, judge, console)
            if others:
                tell_shares(found, judge, steering, others, console)


if __name__ == "__main__":
    main()
