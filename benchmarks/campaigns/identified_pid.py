"""Judge PIDs tuned on identified models: do they hold on the true plant, and are they better than SIMC?

    python benchmarks/campaigns/identified_pid.py --records 300 --out results

Each record is one of `identification.py`. A simulated person answers ten questions about runs of the best
model. That tuning and SIMC's on the same model (Skogestad's half rule, settings with τ_c = θ) then
run on the true plant, from the same start and with the same step and load. A tuning settles if its run is not
stopped, and is within 5 % of the step in time both after the step and after the load. People are those who do
not notice every difference. Records that are in the folder do not run again: the same line resumes.
"""

import argparse
import json
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from identification import Truth, truth
from jaxtyping import Float
from scipy.stats import beta

from prefcal_agents import Screening
from prefcal_agents.agent import one_thread
from prefcal_bench.people.named import RuleCalibrator, taste
from prefcal_bench.people.runs import Runs, runs_of
from prefcal_bench.people.sample import thetas
from prefcal_env.controllers.pid import simc
from prefcal_env.errors import RecordError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.plants.explained import Model
from prefcal_env.plants.identify import Identified, identify
from prefcal_env.plants.systems import system_of
from prefcal_env.preferences.answer import Answer, Preference, ask_and_tell
from prefcal_scenarios.described.design import process_of
from prefcal_scenarios.described.identified import Found
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.runs import screened, simulator
from prefcal_scenarios.scenario import Scenario

TASTES = ("priorities", "ideal", "majority", "ranks", "curves")
ANSWERS, SIMULATED, USUAL = 10, 200, 60
Theta = Float[np.ndarray, " n"]
Row = dict[str, Any]


def main(words: Sequence[str] | None = None) -> None:
    """Run what is missing, and print the shares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--records", type=int, default=300, help="number of records (300)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first one (0)")
    parser.add_argument("--out", type=Path, default=Path("prefcal-identified"), metavar="FOLDER")
    parser.add_argument("--simulated", type=int, default=SIMULATED, help=f"θ simulated unseen ({SIMULATED})")
    given = parser.parse_args(words)
    given.out.mkdir(parents=True, exist_ok=True)
    file, wanted = given.out / "identified.jsonl", range(given.first, given.first + given.records)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for seed in wanted:
        if all(row["seed"] != seed for row in rows):
            with one_thread():
                rows.append(row_of(seed, given.simulated))
            with file.open("a") as stored:
                stored.write(json.dumps(rows[-1]) + "\n")
            print(rows[-1], flush=True)
    print("\n".join(summary([row for row in rows if row["seed"] in wanted])))


def row_of(seed: int, simulated: int) -> Row:
    """Return how the tunings on the model of one record fare on its plant."""
    plant = truth(seed)
    row: Row = {"seed": seed, "kind": plant.kind, "delay": plant.delay / plant.T}
    try:
        found = identify(plant.t, plant.u, plant.y, resolution=plant.resolution, seed=seed)
    except RecordError as error:
        return row | {"refused": str(error)}
    model, true = scenarios_of(plant, found)
    person = person_of(model, seed)
    tuned, rule = study(model, person, seed, simulated), simc_of(model, found)
    mine = true.run(tuned)
    row |= {"theta": tuned.tolist(), "settles": settles(mine)}
    row |= {"settles on the model": settles(model.run(tuned))}
    if rule is None:
        return row
    theirs = true.run(rule)
    verdict = person.prefer(mine, theirs).name
    return row | {"SIMC": rule.tolist(), "SIMC settles": settles(theirs), "verdict": verdict}


def scenarios_of(plant: Truth, found: Identified) -> tuple[Scenario, Scenario]:
    """Return the PID of the best model, and the same task on the true plant."""
    true = Model("the true plant", tuple(plant.num.tolist()), tuple(plant.den.tolist()), plant.delay)
    first = int(np.argmax(plant.u != plant.u[0]))
    kept = Found(
        record="step.csv",
        digest="",
        time_unit="s",
        input="valve",
        output="y",
        units=("%", ""),
        start=(float(plant.u[0]), float(plant.y[:first].mean())),
        limits=(0.0, 100.0),
        best=found.best,
        models=(*found.models, true),
    )
    model = pid_scenario(kept.plant())
    varied = model.source.varied()
    name = next(factor.name for factor in varied.factors if factor.name.endswith("step.csv"))
    return model, replace(model, run=varied.at({name: float(len(kept.models))}))


def person_of(model: Scenario, seed: int) -> RuleCalibrator:
    """Return a person who knows what is usual with the model."""
    tried = thetas(model, "usual", USUAL)
    usual = runs_of(model.kpis, [model.run(theta) for theta in tried])
    z = np.array([model.space.encode(theta) for theta in tried])
    known = Runs(usual.names, usual.values, usual.survived, z, usual.seen)
    return RuleCalibrator(model.kpis, taste(TASTES[seed % len(TASTES)], model.kpis, known, seed).rule)


def study(model: Scenario, person: RuleCalibrator, seed: int, simulated: int) -> Theta:
    """Return the best θ after the person's answers."""
    agent = Screening(
        model.space, simulate=simulator(model), n_simulated=simulated, n_max=ANSWERS + 1, seed=seed
    )

    def answer(new: Experiment, old: Experiment | None) -> Answer:
        verdict = None if old is None else person.prefer(new, old)
        told = [None if each is None else screened(model, each) for each in (new, old)]
        return Answer(verdict, outcomes=(told[0], told[1]))

    for _ in ask_and_tell(agent, model.run, answer):
        pass
    return np.asarray(agent.best)


def simc_of(model: Scenario, found: Identified) -> Theta | None:
    """Return SIMC's PID for the model, or its PI if it has no PID; None if the rule has neither."""
    for name in ("SIMC", "SIMC without T_d"):
        if name in model.references:
            return model.references[name]
    # The scenario leaves a rule out whose tuning is far from its own: here it counts, within the ranges.
    best = found.models[found.best]
    process = process_of(system_of((list(best.num), list(best.den))), best.delay)
    made = simc(process) or simc(process, derivative=False)
    if made is None:
        return None
    low, high = np.array([(knob.low, knob.high) for knob in model.space.knobs]).T
    return np.clip((made.K_p, made.T_i, made.T_d, 1.0), low, high)


def settles(made: Experiment) -> bool:
    """Return whether a run ended by itself, and settled after step and load."""
    return not made.end.interrupted and bool(
        np.isfinite([made.kpis["settling_time"], made.kpis["recovery"]]).all()
    )


def summary(rows: Sequence[Row]) -> list[str]:
    """Return the shares, with 95 % intervals, a line each."""
    told = [row for row in rows if "refused" not in row]
    # Some people want a tuning so gentle that it does not settle in time on the model either.
    wanted = [row for row in told if row["settles on the model"]]
    ruled = [row for row in told if "verdict" in row]
    verdicts = [row["verdict"] for row in ruled]
    better, worse = Preference.CHALLENGER.name, Preference.INCUMBENT.name
    return [
        f"{len(rows)} records, {len(rows) - len(told)} refused; SIMC has a rule for {len(ruled)}",
        f"tuned by answers, settles on the true plant: {_share([row['settles'] for row in told])}",
        f"the same of those that settle on the model: {_share([row['settles'] for row in wanted])}",
        f"SIMC, settles on the true plant: {_share([row['SIMC settles'] for row in ruled])}",
        f"noticeably better than SIMC for the person: {_share([one == better for one in verdicts])}",
        f"noticeably worse: {_share([one == worse for one in verdicts])}",
    ]


def _share(those: Sequence[bool]) -> str:
    """Return a share with its 95 % interval (Clopper and Pearson)."""
    k, n = sum(those), len(those)
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return f"{k} of {n} ({100 * low:.0f} to {100 * high:.0f} %)"


if __name__ == "__main__":
    main()
