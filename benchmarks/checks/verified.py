"""Compare `prefcal verify` with a Monte Carlo of other code: 20 PID loops, sound and fragile.

    python benchmarks/checks/verified.py            # all, with 299 and 3,000 plants: a quarter of an hour
    python benchmarks/checks/verified.py --quick    # one plant: seconds
    python benchmarks/checks/verified.py --runs 100 --seeds 3 --out rows.jsonl  # as in docs/research

With `--out`, each comparison is a line of a file, and what is in it is not run again.

`monte_carlo.py`, which shares no code with prefcal, judges each plant that `verify` drew, one by one, and
3,000 others of its own within the same ranges. Time constants and gain vary by 10 %, dead time by 20 %, the
actuator has a lag of up to a tenth of the dominant time constant, and the sensor a bias of up to 1 % of the
step. A plant fails if its output runs away, or is not within 5 % of its reference at the end of the step or
of the load. Fragile tunings have a gain close to the largest one with which the nominal loop settles.

Prints Markdown, and fails if a share differs by more than chance allows (Fisher, 1 % for all loops together),
if more than one verdict and more than 1 % of them on the same plants differ, or if the stated bound is below
the share of the others for more than 2 of 20 verifications.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import fisher_exact

sys.path.insert(0, __file__.rpartition("/")[0])
from monte_carlo import NOMINAL, PID, StepAndLoad, TransferFunction, drawn, failures

from prefcal_bench.results.words import markdown
from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs import Knob
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.verification import verify

PROCESSES: Mapping[str, TransferFunction] = {
    "lag": TransferFunction((2.0,), (20.0, 1.0), 3.0),
    "mostly dead time": TransferFunction((1.5,), (5.0, 1.0), 10.0),
    "heater, two lags": TransferFunction((0.8,), (160.0, 28.0, 1.0), 6.0),
    "three lags": TransferFunction((1.0,), (60.0, 47.0, 12.0, 1.0), 1.0),
    "dead time at the output": TransferFunction((1.2,), (12.0, 1.0), 0.0, 5.0),
    "dead time at both ends": TransferFunction((0.7,), (30.0, 1.0), 2.0, 3.0),
    "inverse response": TransferFunction((-4.0, 1.0), (80.0, 18.0, 1.0), 1.0),
    "oscillatory": TransferFunction((1.0,), (25.0, 6.0, 1.0), 2.0),
    "integrating": TransferFunction((0.1,), (4.0, 1.0, 0.0), 2.0),
    "unstable": TransferFunction((1.0,), (20.0, -1.0), 2.0),
}
RANGES = {"parameter": 0.1, "dead time": 0.2, "sensor": 0.0, "actuator": 0.0, "task": 0.0}
LAG, BIAS = "lag of the actuators", "bias of sensors"
KINDS = ("sound", "fragile")
RUNS, OTHERS = 299, 3000
_EDGE = 0.92  # share of the largest gain with which the nominal loop settles
_CHANCE, _SAME, _ABOVE, _FEW = 0.01, 0.01, 0.1, 2


@dataclass(frozen=True)
class Compared:
    """One loop: of `runs` plants of `verify`, `failed`; and what the other code says of them.

    Several verifications of a loop, with seeds of their own, add up to one (`together`).
    """

    name: str
    runs: int
    failed: int
    differ: int  # verdicts on the same plants that differ
    others: int  # failures of the other code among its own plants
    drawn: int  # number of these
    bounds: tuple[float, ...]  # what each verification states the probability of a failure is below

    @property
    def chance(self) -> float:
        """Return the probability of such a difference of both shares, if they are the same."""
        table = [[self.failed, self.runs - self.failed], [self.others, self.drawn - self.others]]
        return float(fisher_exact(table)[1])

    @property
    def above(self) -> int:
        """Return how many of the stated bounds are below the share of the others."""
        return sum(self.others / self.drawn > bound for bound in self.bounds)


def scenario_of(process: TransferFunction) -> Scenario:
    """Return the study of a process whose input goes from -100 to 100, around 0."""
    plant = Plant.of(
        (process.num, process.den),
        delay=process.delay,
        output_delay=process.output_delay,
        inputs=[Channel("valve", "%", -100.0, 100.0)],
    )
    # Fragile gains lie beyond the range that is found.
    return pid_scenario(plant, knobs=[Knob("K_p", 1e-3, 1e3, scale="log10")])


def compared(
    name: str, process: TransferFunction, kind: str, runs: int, others: int, seed: int = 0
) -> Compared:
    """Verify a sound or a fragile tuning, and let the other code judge the same plants and its own."""
    scenario = scenario_of(process)
    seed = 1000 * seed + list(PROCESSES).index(name)  # loops with the same draws would err alike
    theta = np.array(scenario.references["MIGO"])
    if kind == "fragile":
        theta[0] *= _EDGE * largest(scenario, process, theta)
    usual = {f.name: f.high for f in scenario.source.varied().factors}
    ranges = {**RANGES, LAG: (0.0, usual[LAG]), BIAS: usual[BIAS]}
    found = verify(scenario, theta, runs, seed=seed, ranges=ranges, jobs=1)
    given = numbers_of(scenario, theta)
    late = process.delay + process.output_delay
    rows = [
        [
            *(run.values["all time constants"], run.values["gain of valve"], run.values["dead time"] / late),
            *(run.values[LAG], run.values[BIAS]),
        ]
        for run in found.runs
    ]
    same = failures(process, *given, np.array(rows))
    own = failures(process, *given, drawn(others, 100 + seed, (0.1, 0.1, 0.2), usual[LAG], usual[BIAS]))
    bad = np.array([bool(run.problems) for run in found.runs])
    differ = int((bad != same).sum())
    return Compared(f"{name}, {kind}", runs, int(bad.sum()), differ, int(own.sum()), others, (found.bound,))


def together(rows: Sequence[Compared]) -> list[Compared]:
    """Return the comparisons of each loop as one, in the order in which loops first appear."""
    by_name = {
        name: [row for row in rows if row.name == name] for name in dict.fromkeys(r.name for r in rows)
    }
    return [
        Compared(
            name,
            sum(row.runs for row in same),
            sum(row.failed for row in same),
            sum(row.differ for row in same),
            sum(row.others for row in same),
            sum(row.drawn for row in same),
            tuple(bound for row in same for bound in row.bounds),
        )
        for name, same in by_name.items()
    ]


def numbers_of(scenario: Scenario, theta: np.ndarray) -> tuple[StepAndLoad, PID]:
    """Return the experiment and the controller of a study as numbers, for the other code."""
    loop = scenario.source.varied().loop
    assert loop is not None
    task, pid = loop.task, loop.controller(theta).parameters
    y_ref, (when, load), (valve,) = task.reference(0.0), task.d.steps[0], loop.plant.inputs
    start = float(loop.plant.g(task.x0, task.u0, task.disturbance(0.0))[0])
    phase = task.horizon / 2
    assert abs(when - phase) < 1e-6 * phase
    experiment = StepAndLoad(
        start, float(y_ref[0]), float(load[-1]), phase, pid["T_s"], valve.low, valve.high
    )
    return experiment, PID(pid["K_p"], pid["T_i"], pid["T_d"], pid["b"], pid["N"])


def largest(scenario: Scenario, process: TransferFunction, theta: np.ndarray) -> float:
    """Return the largest factor of the gain with which the nominal loop settles, by the other code."""
    low, high = 1.0, 1.0
    nominal = np.array([NOMINAL])

    def fails(factor: float) -> bool:
        given = numbers_of(scenario, theta * [factor, 1, 1, 1])
        return bool(failures(process, *given, nominal)[0])

    while not fails(high):
        low, high = high, 1.5 * high
    for _ in range(12):
        middle = (low + high) / 2
        low, high = (low, middle) if fails(middle) else (middle, high)
    return low


def report(rows: Sequence[Compared]) -> tuple[str, list[str]]:
    """Return the table, and what does not agree, a sentence each."""
    cells: list[list[Any]] = [
        [
            row.name,
            f"{row.failed} of {row.runs}",
            row.differ,
            f"{100 * row.failed / row.runs:.1f} %",
            f"{100 * row.others / row.drawn:.1f} %",
            f"{row.chance:.2g}",
            f"{100 * max(row.bounds):.1f} %" if len(row.bounds) == 1 else f"{row.above} of {len(row.bounds)}",
        ]
        for row in rows
    ]
    heads = [
        "loop",
        "failed",
        "verdicts that differ",
        "share",
        "share, other code and plants",
        "chance",
        "bound" if all(len(row.bounds) == 1 for row in rows) else "bounds below that share",
    ]
    wrong = [f"{row.name}: the shares differ" for row in rows if row.chance < _CHANCE / len(rows)]
    wrong += [f"{row.name}: verdicts differ" for row in rows if row.differ > max(_SAME * row.runs, 1)]
    above, bounds = sum(row.above for row in rows), sum(len(row.bounds) for row in rows)
    if above > max(_ABOVE * bounds, _FEW):
        wrong.append(f"{above} of {bounds} bounds are below the share of the other code")
    return "\n".join(markdown(heads, cells, "Failures of `prefcal verify` and of other code")), wrong


def _rows(names: Sequence[str], runs: int, others: int, seeds: int, out: Path | None) -> Iterator[Compared]:
    """Yield the comparisons of all loops, seed by seed; those that `out` has are read from there."""
    lines = out.read_text(encoding="utf-8").splitlines() if out and out.exists() else []
    known: dict[tuple[Any, ...], dict[str, Any]] = {tuple(key): row for key, row in map(json.loads, lines)}
    for key in ((seed, name, kind, runs) for seed in range(seeds) for name in names for kind in KINDS):
        seed, name, kind, _ = key
        if key not in known:
            known[key] = asdict(compared(name, PROCESSES[name], kind, runs, others, seed))
            if out:
                with out.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([key, known[key]]) + "\n")
        yield Compared(**known[key] | {"bounds": tuple(known[key]["bounds"])})


def main(words: Sequence[str] | None = None) -> None:
    """Print the table; exit with what does not agree, if anything."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="one plant and few runs")
    parser.add_argument("--runs", type=int, default=RUNS, help="plants that verify draws")
    parser.add_argument("--plants", nargs="+", default=list(PROCESSES), choices=list(PROCESSES))
    parser.add_argument("--seeds", type=int, default=1, help="verifications of each tuning")
    parser.add_argument("--out", type=Path, help="file to append to, and to resume from")
    options = parser.parse_args(words)
    chosen, runs, others = (["lag"], 30, 300) if options.quick else (options.plants, options.runs, OTHERS)
    rows = []
    for row in _rows(chosen, runs, others, options.seeds, options.out):
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
    text, wrong = report(together(rows))
    print(text)
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
