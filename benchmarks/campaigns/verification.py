"""Measure how many tunings of studies hold on plants that are not exactly as modeled.

    python benchmarks/campaigns/verification.py --out results          # 75 studies: half an hour
    python benchmarks/campaigns/verification.py --robust --out robust  # as with prefcal calibrate --robust
    python benchmarks/campaigns/verification.py --quick --out look     # a minute

Each study is `Screening` with ten answers of a simulated person on a held-out rough loop. Its θ runs
on 299 plants: each parameter up to 10 % smaller or larger, and 20 % more dead time where there is
one. A run fails if it ends unsafe, or if a KPI is infinite that is finite nominally: the output
never settles. Noise is drawn anew for each run, so as a control the θ also runs 299 times on the
nominal plant. "Random θ" are the first three random ones of each loop that keep the limits
nominally. Studies and rows in the folder do not run again.
"""

import argparse
import json
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from rich.console import Console

from prefcal_agents.screening.agent import Screening
from prefcal_app.simulating import Simulator
from prefcal_bench.cells.engine import Processes
from prefcal_bench.cells.runner import run_suite
from prefcal_bench.cells.simulation import Simulation
from prefcal_bench.cells.store import Store
from prefcal_bench.cells.suite import Suite
from prefcal_bench.cli.display import BenchDisplay
from prefcal_bench.results.words import markdown
from prefcal_env.knobs import KnobSpace
from prefcal_scenarios import load
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.result import problems_of

LOOPS = tuple(f"rough-{number}" for number in range(900, 915))
"""Loops on which nothing was developed."""
TASTES = ("weights", "ideal", "majority", "ranks", "curves")
RUNS, ANSWERS, RANDOM = 299, 10, 3
RANGES = {"dead time": (0.2, 0.2), "sensor": 0.0, "actuator": 0.0, "task": 0.0}
_TRIES = 2000
_BANDS = (0.01, 0.1, 0.5)
Row = dict[str, Any]


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("prefcal-verification"), metavar="FOLDER")
    parser.add_argument("--loops", nargs="+", default=list(LOOPS), metavar="LOOP")
    parser.add_argument("--seeds", type=int, default=1, help="seeds of each loop and kind of people")
    parser.add_argument("--jobs", type=int, default=1, help="processes of the studies")
    parser.add_argument("--robust", action="store_true", help="show only candidates that hold")
    parser.add_argument("--quick", action="store_true", help="one loop and person, few runs")
    return parser.parse_args(words)


def main(words: Sequence[str] | None = None) -> None:
    """Run what is missing, and write the table to verification.md."""
    options = options_of(words)
    loops, tastes, runs = (["rough-0"], TASTES[:1], 20) if options.quick else (options.loops, TASTES, RUNS)
    agent = f"{Path(__file__).resolve()}:RobustScreening" if options.robust else "Screening"
    suite = Suite((agent,), tuple(loops), tastes, options.seeds, ANSWERS // 2, ANSWERS + 1)
    with BenchDisplay(Console(stderr=True)) as display:
        processes = None if options.quick else Processes(options.jobs)
        studies = run_suite(suite, Store(options.out), processes, display)
    file = options.out / "verification.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {(row["loop"], row["who"]) for row in rows}
    for name in loops:
        scenario = load(name)
        tuned = (
            (f"{result.cell.calibrator}, seed {result.cell.seed}", np.array(result.best))
            for result in studies.results
            if result.cell.problem == name and not result.failure
        )
        for who, theta in (*tuned, *(() if options.robust else random_tunings(scenario))):
            if (name, who) in known:
                continue
            rows.append({"loop": name, "who": who, "runs": runs, **row_of(scenario, theta, runs)})
            with file.open("a") as stored:
                stored.write(json.dumps(rows[-1]) + "\n")
    report = "\n".join(table([row for row in rows if row["loop"] in loops]))
    worths = [result.worth[-1] for result in studies.results if result.worth]
    report += f"\n\nWorth of {len(worths)} tunings: {np.exp(np.log(worths).mean()):.0f}"
    (options.out / "verification.md").write_text(report + "\n", encoding="utf-8")
    print(report)


class RobustScreening:
    """Screening that shows only candidates which keep the limits in perturbed runs."""

    tell = Screening.tell

    def __new__(cls, space: KnobSpace, *, simulate: Simulation, **given: Any) -> Any:
        """Return the agent, which simulates as `prefcal calibrate --robust` does."""
        return Screening(space, simulate=Simulator(simulate.scenario, jobs=0, robust=True), **given)


def random_tunings(scenario: Scenario) -> Iterable[tuple[str, Float[np.ndarray, " n"]]]:
    """Yield the first random θ that end safely and settle."""
    rng, found = np.random.default_rng(0), 0
    for z in rng.random((_TRIES, len(scenario.space))):
        theta = scenario.space.decode(scenario.space.snap(z))
        made = scenario.run(theta)
        if not made.end.interrupted and np.isfinite(list(made.kpis.values())).all():
            yield f"random {found}", theta
            found += 1
            if found == RANDOM:
                return


def row_of(scenario: Scenario, theta: Float[np.ndarray, " n"], runs: int) -> Row:
    """Return how θ fares on varied plants, and on the nominal one with other noise."""
    found = verify(scenario, theta, runs, ranges=RANGES, jobs=1)
    ends = [scenario.run(theta, seed=run.seed) for run in found.runs]
    control = [problems_of(found.kpis, made, found.tuning.nominal) for made in ends]
    return {
        "failed": len(found.failed),
        "unsafe": sum(run.end.interrupted for run in found.failed),
        "by noise": sum(map(bool, control)),
        "theta": np.asarray(theta).tolist(),
    }


def table(rows: Sequence[Row]) -> list[str]:
    """Return the table of the tuned and of the random θ."""
    frame, lines = pd.DataFrame(rows), []
    frame["θ"] = np.where(frame["who"].str.startswith("random"), "random", "tuned")
    for name, part in frame.groupby("θ", sort=False):
        shares, total = part["failed"] / part["runs"], part["runs"].sum()
        counts = [
            (shares == 0).sum(),
            *((shares > band).sum() for band in _BANDS),
            (part["unsafe"] > 0).sum(),
        ]
        sums = [f"{100 * part[each].sum() / total:.2g} %" for each in ("failed", "unsafe", "by noise")]
        lines.append([name, len(part), *counts, *sums])
    heads = ["θ", "tunings", "all runs kept", *(f"above {100 * band:g} %" for band in _BANDS)]
    heads += ["an unsafe run", "failed runs", "unsafe runs", "failed on the nominal plant"]
    return markdown(heads, lines, "Tunings by their share of failed runs, and shares of all runs")


if __name__ == "__main__":
    main()
