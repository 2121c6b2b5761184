"""Measure what cutting hopeless runs short saves, and how often it is wrong.

    python benchmarks/campaigns/cutting.py --out results            # half an hour on one core
    python benchmarks/campaigns/cutting.py --out results --thresholds 0.001 0.01 0.05
    python benchmarks/campaigns/cutting.py --quick --out look       # less than a minute

GLISp is told the KPIs of 40 experiments on closed loops and the reactor, and a simulated person
answers. The same study is done without cutting (threshold 0), and with runs cut short at the first
of 25 instants at which the chance to win is below a threshold. Such a run is also simulated to its
end, which nobody in the study sees, to ask the person whether they would have preferred it.

Hours are those of the plant. Worth is described in docs/worth.md; figures are geometric means in
which every loop counts the same, with 95 % bootstrap intervals over the seeds. Studies in the
folder do not run again.
"""

import argparse
import json
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from course import done, stored
from jaxtyping import Float
from judged.courses import Study, mean_of, ratio_of
from judged.tables import interval, markdown

from prefcal_agents import GLISp
from prefcal_agents.protocol.agent import one_thread
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_env.preferences.run_facts import completed
from prefcal_scenarios.bench.problems import Outcome, Person, Problem, prefer, problem
from prefcal_scenarios.cutting import Chances, cut
from prefcal_scenarios.kpis import outcome

PLACES = ("tank", "servo", "steering", "cstr")
TASTES = ("weights", "priorities")
Row = dict[str, Any]


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("prefcal-cutting"), metavar="FOLDER")
    parser.add_argument("--places", nargs="+", default=list(PLACES), metavar="PROBLEM")
    parser.add_argument("--tastes", nargs="+", default=list(TASTES))
    parser.add_argument("--thresholds", type=float, nargs="+", default=[0.01])
    parser.add_argument("--seeds", type=int, default=4, help="persons of each taste")
    parser.add_argument("--first", type=int, default=0, help="number of the first person")
    parser.add_argument("--experiments", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--quick", action="store_true", help="one loop, one person, 15 runs")
    options = parser.parse_args(words)
    if options.quick:
        options.places, options.tastes, options.seeds = ["tank"], ["weights"], 1
        options.experiments = 15
    return options


def main(words: Sequence[str] | None = None) -> None:
    """Run what is missing, and write the tables to cutting.md."""
    options = options_of(words)
    options.out.mkdir(parents=True, exist_ok=True)
    rows = stored(options.out)
    known = {_key(row) for row in rows}
    keys = [
        (place, taste, seed, threshold, options.experiments)
        for seed in range(options.first, options.first + options.seeds)
        for place in options.places
        for taste in options.tastes
        for threshold in (0.0, *options.thresholds)
    ]
    jobs = [partial(study, *key) for key in keys if key not in known]
    for row in done(jobs, options.jobs):
        rows.append(row)
        with (options.out / "studies.jsonl").open("a") as file:
            file.write(json.dumps(row) + "\n")
    report = "\n".join(tables(rows))
    (options.out / "cutting.md").write_text(report + "\n")
    print(report)


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[n] for n in ("place", "taste", "seed", "threshold", "experiments"))


@dataclass
class Bench:
    """What a study does, and what it notes: hours, worth, stops and wrong stops."""

    where: Problem
    person: Person
    agent: GLISp
    threshold: float
    hours: list[float] = field(default_factory=list)
    worth: list[float] = field(default_factory=list)
    stops: int = 0
    wrong: int = 0
    saved: float = 0.0
    _whole: dict[bytes, Outcome] = field(default_factory=dict)

    def run(self, theta: Float[np.ndarray, " n"]) -> Outcome:
        """Run θ, cut short if the chance to win falls below the threshold."""
        whole, scenario = self.where.outcome(theta), self.where.scenario
        assert whole.experiment is not None
        assert scenario is not None
        self._whole[theta.tobytes()] = whole
        made = whole.experiment
        if self.threshold:
            made = cut(made, self._is_hopeless)
        self.hours.append(made.duration)
        if made.end is not End.CUT_SHORT:
            return whole
        self.saved += whole.experiment.duration - made.duration
        return replace(whole, experiment=made, kpis=outcome(scenario, made))

    def _is_hopeless(self, part: Experiment) -> bool:
        assert self.where.scenario is not None
        return Chances(self.agent, self.where.scenario).to_win(part) < self.threshold

    def answer(self, new: Outcome, old: Outcome | None) -> Answer:
        """Return the person's answer; a run that was cut short loses, rightly or not."""
        assert new.experiment is not None
        verdict = None if old is None else prefer(self.person.judge, *self._as_whole(new, old))
        if old is not None and new.experiment.end is End.CUT_SHORT:
            self.stops += 1
            self.wrong += verdict is Preference.CHALLENGER
            verdict = Preference.INCUMBENT
        rival = None if old is None else old.experiment
        pair = (new.kpis, None if old is None else old.kpis)
        return completed(Answer(verdict), new.experiment, rival, pair)

    def note(self) -> None:
        """Note the worth of the best so far."""
        assert self.person.worth is not None
        best = self._whole[self.agent.best.tobytes()]
        self.worth[self.agent.history.answered - 1 :] = [self.person.worth(best)]

    def _as_whole(self, *outcomes: Outcome) -> tuple[Outcome, Outcome]:
        new, old = (self._whole[o.theta.tobytes()] for o in outcomes)
        return new, old


def study(place: str, taste: str, seed: int, threshold: float, experiments: int) -> Row:
    """Return plant time and worth along one study, and how many runs were cut short."""
    where = problem(place)
    agent = GLISp(where.space, n_init=10, n_max=experiments, seed=seed)
    bench = Bench(where, where.person(taste, seed), agent, threshold)
    with one_thread():
        for _ in ask_and_tell(agent, bench.run, bench.answer):
            bench.note()
    return {
        "place": place, "taste": taste, "seed": seed, "threshold": threshold,
        "experiments": experiments, "hours": bench.hours, "worth": bench.worth,
        "stops": bench.stops, "wrong": bench.wrong, "saved": bench.saved,
    }  # fmt: skip


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of the tables in Markdown."""
    for taste in sorted({row["taste"] for row in rows}):
        mine = [row for row in rows if row["taste"] == taste]
        yield from ("", f"**{taste}**: plant time and worth at the end", "")
        yield from markdown(
            ["cut below", "where", "studies", "runs cut short", "wrong", "time saved", "worth",
             "worth over that without cutting"],
            list(_lines(mine)),
        )  # fmt: skip


def _lines(rows: Sequence[Row]) -> Iterator[list[str]]:
    base = [row for row in rows if not row["threshold"]]
    places = list(dict.fromkeys(row["place"] for row in base))
    for threshold in sorted({row["threshold"] for row in rows}):
        for place in [*places, "all"]:
            there = [r for r in rows if r["place"] == place or place == "all"]
            ours = [r for r in there if r["threshold"] == threshold]
            if ours:
                yield _line(threshold, place, ours, [r for r in there if not r["threshold"]])


def _line(threshold: float, place: str, ours: Sequence[Row], base: Sequence[Row]) -> list[str]:
    stops, wrong = (sum(row[name] for row in ours) for name in ("stops", "wrong"))
    runs = sum(len(row["hours"]) for row in ours)
    return [
        f"{threshold:g}" if threshold else "never", place, str(len(ours)),
        f"{stops} of {runs}", f"{wrong}" + (f" ({100 * wrong / stops:.1f} %)" if stops else ""),
        f"{100 * saved_share(ours, base):.0f} %" if threshold else "",
        interval(mean_of(_worths(ours))),
        interval(ratio_of(_worths(ours), _worths(base)), 2) if threshold else "",
    ]  # fmt: skip


def saved_share(ours: Sequence[Row], base: Sequence[Row]) -> float:
    """Return the share of the plant time of `base` that `ours` saves, every loop counting alike."""

    def hours(rows: Sequence[Row]) -> dict[Study, float]:
        return {(r["place"], r["seed"]): sum(r["hours"]) for r in rows}

    mine, theirs = hours(ours), hours(base)
    shares: dict[str, list[float]] = {}
    for key in mine.keys() & theirs.keys():
        shares.setdefault(key[0], []).append(1.0 - mine[key] / theirs[key])
    return float(np.mean([np.mean(each) for each in shares.values()])) if shares else 0.0


def _worths(rows: Sequence[Row]) -> dict[Study, float]:
    return {(row["place"], row["seed"]): row["worth"][-1] for row in rows}


if __name__ == "__main__":
    main()
