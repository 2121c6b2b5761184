"""Measure how many varied plants the results of studies with tight limits hold on, with and without --robust.

    python benchmarks/campaigns/tight_limits.py --out rows.jsonl  # 20 studies of ten plants: half an hour
    python benchmarks/campaigns/tight_limits.py --quick           # one plant, few runs: a minute

The plants are those of `benchmarks/checks/verified.py`. Of 150 random PIDs of each that overshoot by at most
10 % with a maximum sensitivity of at most 1.9, the fastest settles in T_s: the limits are an overshoot of
10 % and a settling time of 1.05 T_s, or 1.3 T_s. A program answers, which likes what settles faster. Four
tunings run on 200 plants as `prefcal verify` draws them, with a seed of their own: the result without
--robust, the tuning that `verify` names then (that result if it names none), that of a robust study that
begins with the named one, and that of one that begins as the first study does.
"""

import argparse
import json
import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "checks"))
from verified import PROCESSES, scenario_of

from prefcal_agents.screening.agent import Screening
from prefcal_app.simulating import Simulator
from prefcal_bench.results.words import markdown
from prefcal_env.arrays import holds_more
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.verification import verify
from prefcal_scenarios.verification.result import count_kept

SLACKS = (1.05, 1.3)
NAMES = ("not robust", "named by verify", "robust, from that", "robust")
RUNS = 200
_RANDOM, _OVERSHOOT, _PEAK = 150, 10.0, 1.9
_SIMULATED, _SHOWN = 150, 7
_SAME = 0.01  # share of the settling time below which the program sees no difference
Theta = Float[np.ndarray, " n"]
Row = dict[str, Any]


def limited(scenario: Scenario, slack: float) -> Scenario:
    """Return a scenario with limits that the fastest of some random tunings just keeps."""
    space = scenario.space
    thetas = space.proposals(space.scaled(np.random.default_rng(0).random((_RANDOM, len(space)))))[1]
    kpis = [scenario.run(theta).kpis for theta in thetas]
    sound = [k["settling_time"] for k in kpis if k["M_s"] <= _PEAK and k["overshoot"] <= _OVERSHOOT]
    most = {"settling_time": slack * min(sound), "overshoot": _OVERSHOOT}
    stated = tuple(replace(k, at_most=most[k.name]) if k.name in most else k for k in scenario.kpis)
    return replace(scenario, kpis=stated)


def study(scenario: Scenario, start: Theta | None, *, robust: bool) -> Theta:
    """Return the result of a study in which a program answers that likes what settles faster."""
    simulate = Simulator(scenario, jobs=0, robust=robust)
    given = None if start is None else [start]
    agent = Screening(
        scenario.space, simulate=simulate, n_simulated=_SIMULATED, n_max=_SHOWN, seed=0, start=given
    )
    while not agent.done:
        query, answer = agent.ask(), None
        if query.incumbent is not None:
            both = (query.challenger, query.incumbent)
            new, best = (scenario.run(np.array(each.theta)).kpis["settling_time"] for each in both)
            answer = (
                0 if new == best or abs(new - best) < _SAME * min(new, best) else int(np.sign(new - best))
            )
        agent.tell(query, answer)
    return agent.best


def row_of(name: str, slack: float, runs: int) -> Row:
    """Return on how many plants each tuning holds, and in which time it settles nominally."""
    scenario = limited(scenario_of(PROCESSES[name]), slack)
    first = study(scenario, None, robust=False)
    found = verify(scenario, first, runs // 2, jobs=1)
    best = found.others.best if found.others else None
    own, new = (
        np.array([not run.problems for run in each.runs]) for each in (found.tuning, best or found.tuning)
    )
    named = best.theta if best and holds_more(new, own) else first
    tunings = (first, named, study(scenario, named, robust=True), study(scenario, None, robust=True))
    plain = replace(scenario, simulated=False)  # other tunings are tried no more
    made = [verify(plain, theta, runs, seed=100, jobs=1).tuning for theta in tunings]
    return {
        "plant": name,
        "slack": slack,
        "runs": [len(each.runs) for each in made],
        "held": [count_kept(each.runs) for each in made],
        "settles": [each.nominal.kpis["settling_time"] for each in made],
    }


def table(rows: Sequence[Row]) -> list[str]:
    """Return the table of all rows, and their means."""
    lines = [
        [
            row["plant"],
            f"{row['slack']:g}",
            *(f"{h} of {n}" for h, n in zip(row["held"], row["runs"], strict=True)),
        ]
        for row in rows
    ]
    shares = np.array([row["held"] for row in rows]) / np.array([row["runs"] for row in rows])
    times = np.array([row["settles"] for row in rows])
    slower = np.exp(np.log(times / times[:, :1]).mean(axis=0))
    lines.append(["all", "", *(f"{100 * share:.0f} %" for share in shares.mean(axis=0))])
    lines.append(["settling time, beside the first", "", *(f"{each:.2f}" for each in slower)])
    return markdown(["plant", "limit", *NAMES], lines, "Plants on which the limits are kept")


def main(words: Sequence[str] | None = None) -> None:
    """Run what is missing, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, help="file to append to, and to resume from")
    parser.add_argument("--quick", action="store_true", help="one plant and few runs")
    options = parser.parse_args(words)
    names, slacks, runs = (["lag"], SLACKS[1:], 20) if options.quick else (list(PROCESSES), SLACKS, RUNS)
    lines = options.out.read_text("utf-8").splitlines() if options.out and options.out.exists() else []
    rows = [json.loads(line) for line in lines]
    known = {(row["plant"], row["slack"]) for row in rows}
    for name, slack in ((name, slack) for name in names for slack in slacks):
        if (name, slack) in known:
            continue
        rows.append(row_of(name, slack, runs))
        print(rows[-1], file=sys.stderr, flush=True)
        if options.out:
            with options.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(rows[-1]) + "\n")
    print("\n".join(table(rows)))


if __name__ == "__main__":
    main()
