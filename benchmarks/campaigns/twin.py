"""Measure what a rough model of the plant saves, and what a wrong one costs.

    python benchmarks/campaigns/twin.py --out results            # 20 plants: an hour on two cores
    python benchmarks/campaigns/twin.py --out results --tastes weights priorities --seeds 3
    python benchmarks/campaigns/twin.py --quick --out look       # less than a minute

Plants are random closed loops. `Screening` simulates 1,000 θ on a twin of the plant and is told the
KPIs of those that run on the plant; "believing" is the same agent without being told. GLISp (told
the KPIs) and random search have no twin. Twins:

1, 3, 6, 10   each parameter of the plant is so many percent too large or too small
signs         two of the KPIs have the wrong sign: settling time and integrated error
other         another plant of the same kind, whose parameters differ by up to a factor of 2

The twin's noise is another one than the plant's. Worth is described in docs/worth.md; figures are
geometric means in which every plant counts the same, with 95 % bootstrap intervals over the seeds,
if there are several. "near" is the share of studies whose cost is at most 10 % above the lowest one
known, that of the plant's pool and of all studies. Studies in the folder do not run again.
"""

import argparse
import json
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents import GLISp, RandomSearch, Screening
from prefcal_agents.agent import Agent, one_thread
from prefcal_bench import Processes
from prefcal_bench.cells.engine import each
from prefcal_bench.cells.run import CellStudy
from prefcal_bench.loops import rough_model
from prefcal_bench.problems import Person, Problem, problem
from prefcal_bench.results.statistics import mean_of, ratio_of
from prefcal_bench.results.words import interval, markdown
from prefcal_env.errors import BenchmarkError, RunError
from prefcal_env.preferences.answer import Outcome as Kpis
from prefcal_scenarios import load, simulator
from prefcal_scenarios.scenario import Scenario

PLANTS = (*range(900, 915), *range(7000, 7005))  # seeds of the plants, on which nothing was developed
TWINS = ("1", "3", "6", "10", "signs", "other")
AGENTS = ("corrected", "believing", "GLISp", "RandomSearch")
WITHOUT = "none"  # name of the twin of agents that have none
RUNS = (1, 3, 5, 10, 20)
_WRONG = ("settling_time", "error")
_NEAR = 1.1
_QUICK_PLANTS = (300,)
Simulate = Callable[[Float[np.ndarray, " n"]], Mapping[str, float]]
Row = dict[str, Any]


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("prefcal-twin"), metavar="FOLDER")
    parser.add_argument("--plants", type=int, nargs="+", default=list(PLANTS), metavar="SEED")
    parser.add_argument("--twins", nargs="+", choices=TWINS, default=list(TWINS))
    parser.add_argument("--agents", nargs="+", choices=AGENTS, default=list(AGENTS))
    parser.add_argument("--tastes", nargs="+", default=["weights"])
    parser.add_argument("--seeds", type=int, default=1, help="seeds of each plant and taste")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--simulated", type=int, default=1000, help="θ simulated unseen")
    parser.add_argument("--quick", action="store_true", help="one plant, few simulations")
    options = parser.parse_args(words)
    if options.quick:
        options.plants, options.simulated = list(_QUICK_PLANTS), 60
        options.twins = ["3", "signs"]
    return options


def main(words: Sequence[str] | None = None) -> None:
    """Run what is missing, and write the tables to twin.md."""
    options = options_of(words)
    options.out.mkdir(parents=True, exist_ok=True)
    file = options.out / "studies.jsonl"
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {_key(row) for row in rows}
    workers = None if options.jobs == 1 else Processes(options.jobs)
    for seed in range(options.seeds):  # so that an interruption leaves whole seeds
        jobs = {plant: partial(study_plant, plant, seed, options, known) for plant in options.plants}
        for _, found in each(jobs, workers):
            if isinstance(found, RunError):
                raise BenchmarkError(str(found))
            rows += found
            with file.open("a") as stored:
                stored.writelines(json.dumps(row) + "\n" for row in found)
    report = "\n".join(tables(rows))
    (options.out / "twin.md").write_text(report + "\n")
    print(report)


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in ("plant", "taste", "seed", "agent", "twin"))


def study_plant(plant: int, seed: int, options: argparse.Namespace, known: set[Any]) -> list[Row]:
    """Return the studies of one plant and seed that are not `known`."""
    where, found = problem(f"loop-{plant}"), list[Row]()
    for agent in options.agents:
        without = agent in ("GLISp", "RandomSearch")
        for twin in (WITHOUT,) if without else options.twins:
            for taste in options.tastes:
                row: Row = {"plant": plant, "taste": taste, "seed": seed, "agent": agent, "twin": twin}
                if _key(row) in known:
                    continue
                simulate = None if without else twin_of(plant, twin)
                with one_thread():
                    made = _made(agent, where.space, simulate, seed, options.simulated)
                    found.append(row | study(made, where, where.person(taste, seed), agent != "believing"))
    return found


def _made(agent: str, space: Any, simulate: Simulate | None, seed: int, simulated: int) -> Agent:
    n_max = max(RUNS)
    if agent == "GLISp":
        return GLISp(space, n_init=10, n_max=n_max, seed=seed)
    if agent == "RandomSearch":
        return RandomSearch(space, n_init=1, n_max=n_max, seed=seed)
    return Screening(space, simulate=simulate, n_simulated=simulated, n_max=n_max, seed=seed)


def study(agent: Agent, where: Problem, person: Person, tells: bool) -> dict[str, list[float]]:
    """Return worth and cost of the best so far after each run on the plant, and the lowest cost.

    That is the lowest one of the pool of random θ. There is none, and no cost, if the person has
    no cost. Unless the plant `tells`, KPIs come from the twin alone.
    """
    worth: Any = person.worth  # the person's rule and the pool are its first arguments
    taste, pool = worth.args
    costs = taste.rule.cost(pool)
    if not tells:
        where = replace(where, run=lambda theta, run=where.run: replace(run(theta), kpis=None))
    cost: Any = None if costs is None else person.cost
    course = CellStudy(agent, where, replace(person, gap=cost), max(RUNS))
    course.run()
    lowest = [] if costs is None else [float(np.min(costs))]
    return {"worth": course.worth, "cost": course.gaps, "lowest": lowest}


@cache
def twin_of(plant: int, kind: str) -> Simulate:
    """Return what simulates a twin of the plant; it remembers, since studies share it."""
    error = 0.0 if kind in ("signs", "other") else float(kind) / 100
    model = _other(plant) if kind == "other" else rough_model(plant, error)
    simulate = simulator(model, seed=1)
    turned = _turned(model, simulate) if kind == "signs" else {}
    known: dict[bytes, Mapping[str, float]] = {}

    def twin(theta: Float[np.ndarray, " n"]) -> Mapping[str, float]:
        key = theta.tobytes()
        if key not in known:
            kpis = dict(simulate(theta))
            known[key] = kpis | {
                name: product / kpis[name]
                for name, product in turned.items()
                if np.isfinite(kpis.get(name, np.inf)) and kpis[name] > 0
            }
        return known[key]

    return twin


def _turned(model: Scenario, simulate: Callable[[Any], Kpis]) -> dict[str, float]:
    """Return the squared median of each KPI that gets the wrong sign in a logarithmic scale."""
    points = np.random.default_rng(0).random((100, len(model.space)))
    runs = [simulate(model.space.decode(model.space.snap(z))) for z in points]
    columns = {name: np.array([run.get(name, np.inf) for run in runs]) for name in _WRONG}
    return {name: float(np.median(c[np.isfinite(c)])) ** 2 for name, c in columns.items()}


def _other(plant: int) -> Scenario:
    """Return another random loop of the same kind, found by its knobs and KPIs."""
    ours = load(f"loop-{plant}")
    for seed in range(400, 600):
        theirs = load(f"loop-{seed}")
        if theirs.space.knobs == ours.space.knobs and theirs.brief == ours.brief:
            return theirs
    raise LookupError(f"no other loop is of the kind of loop-{plant}")


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of the tables in Markdown."""
    for taste in sorted({row["taste"] for row in rows}):
        mine = [row for row in rows if row["taste"] == taste]
        found: dict[tuple[str, str], list[Row]] = {}
        for row in mine:
            found.setdefault((row["twin"], row["agent"]), []).append(row)
        order = sorted(found, key=lambda k: ([*TWINS, WITHOUT].index(k[0]), AGENTS.index(k[1])))
        heads, base = [f"{n} runs" for n in RUNS], found.get((WITHOUT, "GLISp"), [])
        yield from markdown(
            ["twin", "agent", "studies", *heads],
            [[*key, len(found[key]), *(_worth(found[key], n) for n in RUNS)] for key in order],
            f"**{taste}**: worth after so many runs on the plant",
        )
        yield from markdown(
            ["twin", "agent", *heads, "worse after 20"],
            [[*key, *_ratios(found[key], base)] for key in order if base],
            f"**{taste}**: worth over that of GLISp without a twin, in pairs",
        )
        if any(row["cost"] for row in mine):
            yield from markdown(
                ["twin", "agent", *heads],
                [[*key, *(_near(found[key], mine, n) for n in RUNS)] for key in order],
                f"**{taste}**: share of studies near the lowest known cost",
            )


def _after(rows: Sequence[Row], runs: int) -> dict[tuple[str, int], float]:
    return {(str(row["plant"]), row["seed"]): row["worth"][min(runs, len(row["worth"])) - 1] for row in rows}


def _worth(rows: Sequence[Row], runs: int) -> str:
    return interval(mean_of(_after(rows, runs)))


def _ratios(rows: Sequence[Row], base: Sequence[Row]) -> list[str]:
    ratios = [interval(ratio_of(_after(rows, n), _after(base, n)), 2) for n in RUNS]
    ours, theirs = _after(rows, max(RUNS)), _after(base, max(RUNS))
    both = ours.keys() & theirs.keys()
    worse = sum(ours[key] < 0.95 * theirs[key] for key in both)
    return [*ratios, f"{worse} of {len(both)}"]


def _near(rows: Sequence[Row], all_rows: Sequence[Row], runs: int) -> str:
    """Return the share of studies whose cost is near the lowest one known for the same person."""
    lowest: dict[tuple[int, int], float] = {}
    for row in all_rows:
        key = row["plant"], row["seed"]
        lowest[key] = min([lowest.get(key, np.inf), *row["cost"], *row["lowest"]])
    near = [
        row["cost"][min(runs, len(row["cost"])) - 1] <= _NEAR * lowest[row["plant"], row["seed"]]
        for row in rows
    ]
    return f"{100 * np.mean(near):.0f} %"


if __name__ == "__main__":
    main()
