"""Measure what is said of a result: which answer carries it, a menu of three, and what was wanted.

    python benchmarks/campaigns/result.py --out result.jsonl                  # held-out: an hour
    python benchmarks/campaigns/result.py --out look.jsonl --loops rough-0 --tastes order
    python benchmarks/campaigns/result.py --out smaller.jsonl --start         # the smaller change

Simulated people of six families with just noticeable differences answer ten questions each, with a
thousand simulated θ. Studies that are in the file do not run again.

answer    The answer named as decisive is turned round, the whole record is learned again, and the
          result is compared with the prediction.
stakes    Before each of the last five questions: the chance that its answer changes the result, and
          whether it did.
menu      Whether a candidate on it is not noticeably worse than the best one, the one than which the
          fewest of all simulated are noticeably better; and the share of those that are.
wanted    Whether the person finds the result noticeably worse with a named KPI at the worst value that
          was shown.
smaller   With --start alone, where each study begins with a random θ that ends safely, the current
          tuning: how many knobs of the result that differ from it are put back, and whether the
          person does not find that noticeably worse than the result.
"""

import argparse
import json
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Start, one_thread
from prefcal_agents.result import decisive, turn
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import Findings, findings
from prefcal_bench.cells.simulation import Simulation
from prefcal_bench.people import USUAL, Runs, Taste, runs_of, sample, taste
from prefcal_bench.people.sample import thetas
from prefcal_bench.problems import Problem, prefer, problem
from prefcal_bench.results.words import markdown
from prefcal_env.preferences.answer import Answer

LOOPS = tuple(f"rough-{number}" for number in range(900, 915))
"""Loops on which nothing was developed."""
FAMILIES = ("order", "trade", "ideal", "majority", "ranks", "curves")
_ASKED, _LAST = 10, 5  # numbers of answers, and of those whose stakes are noted
_FEW = 0.01  # share of the candidates that is few
_EDGES = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.9, 1.01)
Row = Mapping[str, Any]


class ToldStudy:
    """One study, and what is true of all that is said at its end.

    Args:
        where: Problem with a scenario.
        person: Taste of the person who answers.
        n_simulated: Number of θ to simulate.
        start: Current tuning that it begins with, to measure the smaller change alone.
    """

    def __init__(self, where: Problem, person: Taste, n_simulated: int, start: Start | None) -> None:
        self._where, self._person, self._judge = where, person, person.calibrator()
        self.agent = Screening(
            where.space,
            simulate=Simulation(where),
            n_simulated=n_simulated,
            n_max=_ASKED + 2,
            seed=person.seed,
            start=start,
        )

    def row(self) -> Row:
        """Answer all questions; return what was said, and what is true."""
        stakes = list(self._answered())
        if self.agent.setup.start:
            return {"smaller": self._smaller()}
        said = self._said(over=True)
        runs = self._runs(self.agent.bank.thetas)
        best = self.agent.bank.find(self.agent.best)
        return {
            "stakes": stakes,
            "answer": self._answer(said),
            **self._menu(said, runs, best),
            "wanted": self._wanted(said, runs.take(np.array([best]))),
        }

    def _said(self, *, over: bool) -> Findings:
        """Return all that is said of the open question or, if the study is over, of the result."""
        found = findings(self.agent, over=over)
        while not found.complete:
            found = findings(self.agent, found, over=over)
        return found

    def _runs(self, thetas: Float[np.ndarray, "m n"]) -> Runs:
        experiments = [self._where.outcome(theta).experiment for theta in thetas]
        return runs_of(self._person.kpis, [e for e in experiments if e is not None])

    def _smaller(self) -> Row:
        """Return how many knobs differ and are put back, and whether that is no worse."""
        agent, said = self.agent, self._said(over=True)
        found = said.smaller if said.explained else None
        thetas = [agent.history.samples[0].theta, found.theta if found else agent.best]
        changed, back = (int(np.sum(agent.best != theta)) for theta in thetas)
        result, smaller = (self._runs(np.array([theta])) for theta in (agent.best, thetas[1]))
        good = bool(self._person.rule.compare(result, smaller)[0] >= 0)
        return {"changed": changed, "back": back, "good": good}

    def _answered(self) -> Iterator[tuple[float, bool]]:
        """Answer all; yield the stated chances of another result, and whether it is another one."""
        agent = self.agent
        while agent.history.answered <= _ASKED:
            query, stakes = agent.ask(), None
            if query.incumbent is not None:
                stakes = self._said(over=False).stakes if query.challenger.index > _ASKED - _LAST else None
            self._answer_next(agent)
            if stakes is not None and query.incumbent is not None:
                yield stakes, agent.best_index != query.incumbent.index

    def _answer_next(self, agent: Screening) -> None:
        query, old, verdict = agent.ask(), None, None
        new = self._where.outcome(query.challenger.theta)
        if query.incumbent is not None:
            old = self._where.outcome(query.incumbent.theta)
            verdict = prefer(self._judge, new, old)
        agent.tell(query, Answer(verdict, outcomes=(new.kpis, None if old is None else old.kpis)))

    def _answer(self, said: Findings) -> Row | None:
        """Return what was predicted of the decisive answer, and what comes of learning again."""
        best, history = self.agent.best_index, self.agent.history
        named = None if best is None else decisive(said.influences, best)
        if named is None:
            return None
        agent = self.agent.copy()
        agent.history = turn(history, named.answer)
        return {"predicted": named.reversed, "found": agent.best_index, "now": best, "sure": named.sure}

    def _menu(self, said: Findings, runs: Runs, best: int) -> Row:
        """Return of result and menu which are no worse than the best, and the shares better."""
        menu = self.agent.bank.rows([other.theta for other in said.menu]).tolist()
        rows, rule = [best, *menu], self._person.rule
        beaten = [np.mean(rule.compare(runs, runs.take(np.array([row]))) < 0) for row in range(len(runs))]
        top = runs.take(np.array([int(np.argmin(beaten))]))
        good = rule.compare(runs.take(np.array(rows)), top) <= 0
        return {"good": good.tolist(), "better": [float(beaten[row]) for row in rows]}

    def _wanted(self, said: Findings, result: Runs) -> list[tuple[float, bool]]:
        """Return the certainty of each wish, and whether the worst value that was shown is noticed."""
        bank, history = self.agent.bank, self.agent.history
        shown = bank.kpis[bank.rows([s.theta for s in history.samples[: history.answered]])]
        found = []
        for name, certainty in said.wishes:
            values = shown[:, bank.names.index(name)]
            changed = _with(result, name, np.array([values[np.isfinite(values)].max()]))
            found.append((certainty, bool(self._person.rule.compare(result, changed)[0] < 0)))
        return found


def _safe(where: Problem) -> Float[np.ndarray, " n"]:
    """Return the first random θ whose experiment is not interrupted, shape (n,)."""
    assert where.scenario is not None
    experiments = ((theta, where.outcome(theta).experiment) for theta in thetas(where.scenario, "start", 256))
    return next(theta for theta, e in experiments if e is not None and not e.end.interrupted)


def _with(runs: Runs, name: str, values: Float[np.ndarray, " K"]) -> Runs:
    """Return runs with other values of one KPI."""
    changed = runs.values.copy()
    changed[:, runs.names.index(name)] = values
    return replace(runs, values=changed)


def tables(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the figures of each family and of all, then stated chances against what was true."""
    families = dict.fromkeys(row["taste"] for row in rows)
    groups = {family: [row for row in rows if row["taste"] == family] for family in families}
    if "smaller" in rows[0]:
        heads = ["family", "studies", "offered", "no worse", "knobs that differ", "put back"]
        yield from markdown(heads, [[f, *_changes(some)] for f, some in {**groups, "all": rows}.items()])
        return
    heads = "studies", "named", "as predicted", "result", "menu", "result 1 %", "menu 1 %"
    yield from markdown(
        ["family", *heads], [[family, *_figures(some)] for family, some in {**groups, "all": rows}.items()]
    )
    seen = [row for row in rows if row["taste"] != "curves"]  # which no KPI decides
    for title, key, some in (("result changes", "stakes", rows), ("noticed if worse", "wanted", seen)):
        yield from markdown(["stated", "so often", "was so"], list(_bins(some, key)), title)


def _figures(rows: Sequence[Row]) -> Iterator[str]:
    named = [row["answer"] for row in rows if row["answer"] is not None]
    yield str(len(rows))
    yield _share([row["answer"] is not None for row in rows])
    yield _share([each["predicted"] == each["found"] for each in named])
    yield _share([row["good"][0] for row in rows])
    yield _share([any(row["good"]) for row in rows])
    yield _share([row["better"][0] < _FEW for row in rows])
    yield _share([min(row["better"]) < _FEW for row in rows])


def _changes(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the figures of the smaller change; of knobs the medians where one is offered."""
    offered = [row["smaller"] for row in rows if row["smaller"]["back"]]
    yield str(len(rows))
    yield _share([row["smaller"]["back"] > 0 for row in rows])
    yield _share([each["good"] for each in offered])
    for key in ("changed", "back"):
        yield f"{np.median([each[key] for each in offered]):g}" if offered else "–"


def _share(found: Sequence[bool]) -> str:
    return f"{100 * sum(found) / len(found):.0f} %" if found else "–"


def _bins(rows: Sequence[Row], key: str) -> Iterator[list[str]]:
    said = np.array([pair for row in rows for pair in row[key]], dtype=float).reshape(-1, 2)
    for low, high in pairwise(_EDGES):
        some = said[(low <= said[:, 0]) & (said[:, 0] < high)]
        if len(some):
            mean, was = 100 * some.mean(axis=0)
            yield [f"{mean:.0f} %", str(len(some)), f"{was:.0f} %"]


def main(words: Sequence[str] | None = None) -> None:
    """Run the missing studies, and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("result.jsonl"), metavar="FILE")
    parser.add_argument("--loops", nargs="+", default=list(LOOPS))
    parser.add_argument("--tastes", nargs="+", default=list(FAMILIES))
    parser.add_argument("--seeds", type=int, default=1, help="people of each loop and family")
    parser.add_argument("--simulated", type=int, default=1000, help="θ simulated unseen")
    parser.add_argument("--start", action="store_true", help="begin with a tuning; the smaller change alone")
    options = parser.parse_args(words)
    file = options.out
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    known = {(row["loop"], row["taste"], row["seed"]) for row in rows}
    wanted = [(loop, t, s) for s in range(options.seeds) for loop in options.loops for t in options.tastes]
    for loop, family, seed in wanted:
        if (loop, family, seed) in known:
            continue
        where = problem(loop)
        assert where.scenario is not None
        with one_thread():
            usual = sample(where.scenario, USUAL)
            person = taste(family, where.scenario.kpis, usual, seed)
            start = _safe(where) if options.start else None
            found = ToldStudy(where, person, options.simulated, start).row()
        rows.append({"loop": loop, "taste": family, "seed": seed, **found})
        with file.open("a") as stored:
            stored.write(json.dumps(rows[-1]) + "\n")
    print("\n".join(tables(rows)))


if __name__ == "__main__":
    main()
