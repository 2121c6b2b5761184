"""Answer whole studies as people with just noticeable differences would, and check every page.

    python benchmarks/campaigns/replay.py      # 20 seeds of three loops and two people
    python benchmarks/campaigns/replay.py --seeds 2 --simulated 200

Both people are of another form than what Screening learns with. Every sentence that the page says
is compared with the table on the same page, pairs and follow-ups are counted, and so are the
questions, against the number that was promised. What is not true is printed, and the exit code is
then 1.
"""

import argparse
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Protocol

import numpy as np
from jaxtyping import Float

from prefcal_agents.screening.agent import Screening
from prefcal_app.session import Choice, Interview, Now, Phase, Question, actions
from prefcal_app.session.study import agent_as_dict, knobs_as_dicts
from prefcal_app.simulating import Simulator
from prefcal_app.view import now_view
from prefcal_env import Channel
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.plants.plant import Plant
from prefcal_env.study import StudyFile
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.runs import reading
from prefcal_scenarios.scenario import Scenario

LOOPS = ("cstr", "servo", "pid")
_RANDOM = 60  # number of random experiments that tell what differences and values are usual
_TINY = re.compile(r"e[−-]\d")


class Judge(Protocol):
    """Somebody who compares two experiments by their KPIs as read."""

    def prefers(self, a: Mapping[str, float], b: Mapping[str, float]) -> int:
        """Return 1 if `a` is better, -1 if `b` is, 0 if no difference is noticed."""


@dataclass(frozen=True)
class InOrder:
    """Looks at one KPI after the other; the first noticeable difference decides."""

    noticed: Mapping[str, float]  # KPI to its just noticeable difference, most important first

    def prefers(self, a: Mapping[str, float], b: Mapping[str, float]) -> int:
        """Return 1 if `a` is better, -1 if `b` is, 0 if no difference is noticed."""
        signs = (
            _sign(b[name] - a[name], least) for name, least in self.noticed.items() if a[name] != b[name]
        )
        return next((sign for sign in signs if sign), 0)


@dataclass(frozen=True)
class WithinLimits:
    """Looks first how many limits are kept, then at the sum of all KPIs, in usual differences."""

    limits: Mapping[str, float]  # KPI to the largest value that is accepted
    usual: Mapping[str, float]  # KPI to a usual difference
    noticed: float  # just noticeable difference of the sum

    def prefers(self, a: Mapping[str, float], b: Mapping[str, float]) -> int:
        """Return 1 if `a` is better, -1 if `b` is, 0 if no difference is noticed."""
        kept = [sum(kpis[n] <= most for n, most in self.limits.items()) for kpis in (a, b)]
        if kept[0] != kept[1]:
            return 1 if kept[0] > kept[1] else -1
        never = [sum(np.isinf(kpis[n]) for n in self.usual) for kpis in (a, b)]
        if never[0] != never[1]:
            return 1 if never[0] < never[1] else -1
        both = [n for n in self.usual if np.isfinite(a[n])]
        return _sign(sum((b[n] - a[n]) / self.usual[n] for n in both), self.noticed)


def _sign(gain: float, least: float) -> int:
    return 0 if abs(gain) < least else 1 if gain > 0 else -1


PEOPLE = ("in order", "within limits")


def person(kind: str, scenario: Scenario, seed: int) -> Judge:
    """Return person `seed` of a kind, by what is usual among random experiments."""
    rng, table = np.random.default_rng([seed, PEOPLE.index(kind)]), _usual(scenario.name)
    names = list(rng.permutation(list(table)))
    spread = {
        name: float(np.subtract(*np.percentile(v, [75, 25]))) or float(np.ptp(v)) for name, v in table.items()
    }
    if kind == PEOPLE[0]:
        return InOrder({n: spread[n] * rng.uniform(0.05, 0.2) for n in names})
    limits = {n: float(np.quantile(table[n], rng.uniform(0.2, 0.6))) for n in names[:2]}
    return WithinLimits(limits, spread, rng.uniform(0.1, 0.4))


@cache
def scenario_of(name: str) -> Scenario:
    """Return a loop: a scenario of prefcal, or "pid", a PID on a plant with dead time."""
    if name != "pid":
        return replace(load(name), simulated=True)
    valve = Channel("valve", "%", 0, 100)
    plant = Plant.of(([0.8], [20, 1]), delay=6.0, inputs=[valve], outputs=["T"])
    return replace(pid_scenario(plant), name="pid")


@cache
def _usual(name: str) -> Mapping[str, Float[np.ndarray, " r"]]:
    """Return the finite values of each KPI that differs among random experiments, as judged."""
    scenario, rng = scenario_of(name), np.random.default_rng(0)
    points = rng.random((_RANDOM, len(scenario.space)))
    rows = [judged(scenario, scenario.run(scenario.space.decode(z))) for z in points]
    found = {n: np.array([row[n] for row in rows if np.isfinite(row[n])]) for n in rows[0]}
    return {n: values for n, values in found.items() if len(values) > 3 and np.ptp(values) > 0}


def judged(scenario: Scenario, experiment: Experiment) -> Mapping[str, float]:
    """Return the KPIs of an experiment as a person reads them, lower is better."""
    kpis = [kpi for kpi in scenario.shown_kpis if kpi.goal is not None]
    if experiment.end.interrupted:
        return {kpi.name: np.inf for kpi in kpis}
    return {kpi.name: kpi.judged(float(experiment.kpis.get(kpi.name, np.inf))) for kpi in kpis}


@dataclass
class ReplayedStudy:
    """What happened in one study."""

    untrue: list[str] = field(default_factory=list)  # what was not true, in words
    questions: int = 0
    ties: int = 0  # number of answers "about the same"
    # For each question with a stated chance, that chance and whether the new one won
    said: list[tuple[float, bool]] = field(default_factory=list)
    # For each answer, the chance that something better is left, and whether any of all simulated experiments
    # is in fact better than the best so far
    promised: list[tuple[float, bool]] = field(default_factory=list)


def replay(
    scenario: Scenario, who: Judge, seed: int, simulator: Simulator, simulated: int = 1000
) -> ReplayedStudy:
    """Answer a whole study, and return what happened."""
    interview, found, asked = _begun(scenario, seed, simulator, simulated), ReplayedStudy(), []
    promise = interview.known.planned
    while (now := _next(interview)).question is not None:
        found.questions += 1
        found.untrue += [
            f"question {found.questions}: {words}" for words in _untrue(interview, now, now.question, asked)
        ]
        verdict = _verdict(scenario, who, now.question)
        _note_chances(found, interview, now.question, who, verdict)
        asked.append({now.question.left.index, now.question.right.index})
        found.ties += verdict is Choice.SAME
        interview.do(actions.Answer(now.question.id, verdict))
    if found.questions != promise.total:
        found.untrue.append(f"{found.questions} questions, {promise.total} promised")
    return found


def _begun(scenario: Scenario, seed: int, simulator: Simulator, simulated: int) -> Interview:
    agent = Screening(scenario.space, n_simulated=simulated, n_max=11, seed=seed)
    configuration = {
        "scenario": scenario.name,
        "name": scenario.name,
        "title": scenario.title,
        "knobs": knobs_as_dicts(scenario.space),
        "agent": agent_as_dict(agent),
        "n_max": agent.n_max,
        "seed": seed,
        "kpis": [],
        "options": {},
        "versions": {},
    }
    file = StudyFile.create(":memory:", configuration, clock=lambda: "2026-01-01T00:00:00+00:00")
    return Interview(scenario, file, ahead=False, simulator=simulator)


def _next(interview: Interview) -> Now:
    """Work until a question is open with its reason, or the study is over."""
    while interview.now().phase is Phase.RUNNING or interview.known.findings is None:
        if not interview.work():
            break
    return interview.now()


def _verdict(scenario: Scenario, who: Judge, question: Question) -> Choice:
    left, right = (judged(scenario, s.experiment) for s in (question.left, question.right))
    return {1: Choice.LEFT, -1: Choice.RIGHT, 0: Choice.SAME}[who.prefers(left, right)]


def _note_chances(
    found: ReplayedStudy, interview: Interview, question: Question, who: Judge, verdict: Choice
) -> None:
    """Note what the page says of the future, and what is the case."""
    screened, said = interview.known.screened(), interview.known.findings
    if screened is None or said is None or said.chance_of_better is None or question.further:
        return
    new = Choice.LEFT if question.challenger is question.left else Choice.RIGHT
    if said.reason is not None:
        found.said.append((said.reason.chance, verdict is new))
    scenario, bank = interview.scenario, screened.bank
    best = judged(scenario, question.incumbent.experiment)
    rows = [dict(zip(bank.names, row, strict=True)) for row in bank.kpis]
    better = any(who.prefers({**best, **row}, best) > 0 for row in rows)
    found.promised.append((said.chance_of_better, better))


def _untrue(interview: Interview, now: Now, question: Question, asked: Sequence[set[int]]) -> Iterator[str]:
    """Yield in words what the page says or does that is not true or not allowed."""
    view = now_view(interview)
    rows, why = view["question"]["comparison"], view["screening"]["why"]
    new = "left" if question.challenger is question.left else "right"
    yield from _against_table(why, rows, new)
    texts = (t for row in rows for t in (row["left"]["text"], row["right"]["text"], row["difference"]))
    yield from (f"the table shows {t}" for t in map(str, texts) if _TINY.search(t))
    if "good" in why and not all(row[new]["met"] is not False for row in rows):
        yield f"{why!r} of a run that misses objectives"
    if "Nothing learned" in why and now.state.history.lessons:
        yield f"{why!r} after answers"
    if {question.left.index, question.right.index} in asked:
        yield "a pair that was asked before"
    number, last = map(int, re.findall(r"\d+", view["progress"]["text"]))
    if number != len(asked) + 1 or number > last:
        yield f"{view['progress']['text']!r} at question {len(asked) + 1}"
    if not asked:
        yield from _of_first(interview, question)


def _against_table(why: str, rows: Sequence[Mapping[str, object]], new: str) -> Iterator[str]:
    """Yield each KPI that the sentence calls better or worse, and the table does not."""
    left = why
    for row in sorted(rows, key=lambda row: -len(str(row["title"]))):
        title = str(row["title"])
        for words in (
            f"lower {title}",
            f"{title} nearer to its target",
            f"higher {title}",
            f"{title} farther from its target",
        ):
            if words not in left:
                continue
            place = left.index(words)
            but = left.rfind(", but ", 0, place) > 0 or not _first_part_is_better(why)
            left = left.replace(words, "")
            side = new if not but else {"left": "right", "right": "left"}[new]
            if row["better"] != side:
                yield f"{why!r}, but the better {title} is {row['better']}"
    if "reads like" in why and any(row["size"] for row in rows):
        yield f"{why!r}, but KPIs differ"


def _first_part_is_better(why: str) -> bool:
    """Return whether what the sentence names first is in favor of the new experiment."""
    return ", but " in why or "because most" in why or "has lower" in why or "nearer" in why


def _of_first(interview: Interview, question: Question) -> Iterator[str]:
    """Yield what is wrong with the first pair."""
    scenario, screened = interview.scenario, interview.known.screened()
    assert screened is not None
    kpis = reading(scenario).table(screened.bank.names, screened.bank.kpis)
    missed = reading(scenario).missed(screened.bank.names, kpis)
    for side in (question.left, question.right):
        values = [judged(scenario, side.experiment)[n] for n in screened.bank.names]
        mine = reading(scenario).missed(screened.bank.names, np.array([values]))[0]
        if mine > missed.min():
            yield f"a first run misses {mine} objectives, others {missed.min()}"
    a, b = (judged(scenario, s.experiment) for s in (question.left, question.right))
    if not any(abs(a[n] - b[n]) > 0.1 * max(abs(a[n]), abs(b[n])) for n in a if a[n] != b[n]):
        yield "the first two do not differ by a tenth in any KPI"


def calibration(pairs: Sequence[tuple[float, bool]]) -> Iterator[str]:
    """Yield, for ranges of stated chances, how often it was so."""
    for low, high in ((0.0, 0.15), (0.15, 0.3), (0.3, 0.5), (0.5, 0.7), (0.7, 1.01)):
        some = [(chance, was) for chance, was in pairs if low <= chance < high]
        if some:
            mean, was = np.mean(np.array(some, dtype=float), axis=0)
            yield f"{len(some):5d} stated {100 * mean:3.0f} %, was so {100 * was:3.0f} %"


def main(words: Sequence[str] | None = None) -> int:
    """Run all studies; return 1 if something was not true."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--loops", nargs="+", default=LOOPS, choices=LOOPS)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--simulated", type=int, default=1000)
    options = parser.parse_args(words)
    every: list[ReplayedStudy] = []
    for loop in options.loops:
        scenario = scenario_of(loop)
        with Simulator(scenario, jobs=0) as simulator:
            for kind in PEOPLE:
                some = [
                    replay(scenario, person(kind, scenario, seed), seed, simulator, options.simulated)
                    for seed in range(options.seeds)
                ]
                print(_line(loop, kind, some), flush=True)
                every += some
    print(
        "\n".join(
            [
                "the new one is preferred:",
                *calibration([p for r in every for p in r.said]),
                "one of all simulated is better:",
                *calibration([p for r in every for p in r.promised]),
            ]
        )
    )
    return 1 if any(found.untrue for found in every) else 0


def _line(loop: str, kind: str, some: Sequence[ReplayedStudy]) -> str:
    """Return the figures of a loop and kind, and what was not true."""
    asked, ties = (sum(getattr(r, n) for r in some) for n in ("questions", "ties"))
    words = [
        f"{loop}, {kind}: {len(some)} studies, {asked} questions, {100 * ties / asked:.0f} % "
        f"ties, {sum(len(r.untrue) for r in some)} untrue"
    ]
    return "\n".join([*words, *(f"  seed {s}, {w}" for s, r in enumerate(some) for w in r.untrue)])


if __name__ == "__main__":
    sys.exit(main())
