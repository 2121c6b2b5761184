"""Prove that rebuilding the code changes no study: digests of fixed studies, bit for bit.

    python benchmarks/same_studies.py > before.json            # about a minute
    python benchmarks/same_studies.py --against before.json    # names what differs; exits with 1
    python benchmarks/same_studies.py --only camel --show      # the lines behind the digests
    python benchmarks/same_studies.py --decisions              # what was asked in recorded studies
    python benchmarks/same_studies.py --record mine.prefcal    # one more of them, on standard output

benchmarks/same_studies.json holds the digests of the present code; `--against` without a file
compares with it. Another processor, numpy or scipy may round differently: if that is so, compute
the digests of the revision before your change on the same machine, and compare with those.

A digest covers every query (θ of both sides, exactly), every answer and the best θ. Studies that
only one feature can change are separate, so that the names show what a deliberate change affects.

benchmarks/recorded holds a small study of each kind: at a page, on a rig, robust, on a live plant, by
several raters. `--decisions` goes through their events, and asks the agent of this code for each
decision: the next θ, the next pair, which one is the best, whether it is over. One that differs
is a stated change of results or a fault. Each release adds a study of what is new in it.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded

import argparse
import contextlib
import csv
import io
import json
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from prefcal_agents import GLIS, GLISp, GLISpSettings, RandomSearch, restore
from prefcal_agents.agent import Agent, AgentState
from prefcal_agents.baselines import LatinHypercube
from prefcal_agents.transfer import respaced
from prefcal_app.cli import main as run_prefcal
from prefcal_app.session import actions
from prefcal_app.session.study import ALL_COMPARED, ENOUGH, Ask, Study, agent_of, is_robust, is_simulating
from prefcal_app.simulating import Simulator
from prefcal_env import Answer, Knob, KnobSpace, Mark
from prefcal_env.preferences.answer import Query
from prefcal_env.study import Ended, Event, Led, Shown, State, StudyFile, Suggested, space_of, to_text
from prefcal_env.study.fold import begin, from_text, step
from prefcal_scenarios import load

RECORD = Path(__file__).with_suffix(".json")
Lines = list[str]
Reply = Callable[[Query], Any]
Change = Callable[[Any], Any]


# Two test functions, written out here: this tool must not depend on modules that move.


def camel(x: np.ndarray) -> float:
    """Compute the six-hump camel function."""
    a, b = x
    return float((4 - 2.1 * a**2 + a**4 / 3) * a**2 + a * b + (4 * b**2 - 4) * b**2)


_A = np.array([[3, 10, 30], [0.1, 10, 35], [3, 10, 30], [0.1, 10, 35]])
_P = 1e-4 * np.array([[3689, 1170, 2673], [4699, 4387, 7470], [1091, 8732, 5547], [381, 5743, 8828]])


def hartman3(x: np.ndarray) -> float:
    """Compute the Hartman function of 3 knobs."""
    return float(-np.array([1.0, 1.2, 3.0, 3.2]) @ np.exp(-np.sum(_A * (x - _P) ** 2, axis=1)))


def box(*bounds: tuple[float, float]) -> KnobSpace:
    """Return a space of knobs x1, x2, ... without steps."""
    return KnobSpace([Knob(f"x{k}", *b, step=0) for k, b in enumerate(bounds, start=1)])


CAMEL, HARTMAN3 = box((-2, 2), (-1, 1)), box(*[(0, 1)] * 3)
PROBLEMS = {"camel": (camel, CAMEL), "hartman3": (hartman3, HARTMAN3)}


# Studies in memory: ask, reply, tell.


def drive(agent: Any, reply: Reply, changes: Mapping[int, Change] | None = None) -> Lines:
    """Run `agent` to its end; before answer number `k` (from 0), replace it by `changes[k](it)`."""
    lines: Lines = []
    while True:
        agent = (changes or {}).get(len(lines), lambda same: same)(agent)
        if agent.done:
            return [*lines, f"best {agent.best_index} {exact(agent.best)}"]
        query = agent.ask()
        answer = reply(query)
        agent.tell(query, answer)
        lines.append(line(query, answer))


def line(query: Query, answer: Any) -> str:
    """Return one closed query as text, without rounding."""
    sides = [s for s in (query.challenger, query.incumbent) if s is not None]
    given = answer.preference if isinstance(answer, Answer) else answer
    told = given.hex() if isinstance(given, float) else None if given is None else int(given)
    asked = " against ".join(f"{side.index} {exact(side.theta)}" for side in sides)
    return f"{asked}{' further' if query.further else ''}: {told}"


def exact(values: np.ndarray) -> str:
    """Return floats in base 16."""
    return " ".join(float(value).hex() for value in values)


def by(cost: Callable[[np.ndarray], float], *, tie: float = 0.0) -> Reply:
    """Prefer the lower cost; costs as close as `tie` are a tie."""

    def reply(query: Query) -> int | None:
        if query.incumbent is None:
            return None
        difference = cost(query.challenger.theta) - cost(query.incumbent.theta)
        return 0 if abs(difference) <= tie else int(np.sign(difference))

    return reply


def erring(reply: Reply, rate: float, seed: int) -> Reply:
    """Reverse some of the answers, as a calibrator with this error rate would."""
    rng = np.random.default_rng(seed)

    def wrong(query: Query) -> Any:
        answer, errs = reply(query), rng.random() < rate
        return -answer if answer and errs else answer

    return wrong


def with_kpis(reply: Reply) -> Reply:
    """Tell KPIs of both sides too: some are infinite, some are missing."""

    def kpis(theta: np.ndarray) -> dict[str, float]:
        a, b = float(theta[0]), float(theta[1])
        found = {"sum": a + b, "wave": float(np.sin(3 * a) + b**2)}
        found["late"] = float("inf") if a > 1.5 else 2 * abs(a) + abs(b)
        return found if b < 0.8 else {"sum": a + b}

    def telling(query: Query) -> Answer:
        pair = [None if s is None else kpis(s.theta) for s in (query.challenger, query.incumbent)]
        return Answer(reply(query), outcomes=(pair[0], pair[1]))

    return telling


def marking(reply: Reply, mark: Mark, holds: Callable[[np.ndarray], bool]) -> Reply:
    """Mark the challenger where `holds`."""

    def telling(query: Query) -> Answer:
        return Answer(reply(query), marks=(mark,) if holds(query.challenger.theta) else ())

    return telling


def abstaining(reply: Reply, every: int) -> Reply:
    """Give no answer about each `every`-th experiment."""

    def telling(query: Query) -> Any:
        return None if query.challenger.index % every == every - 1 else reply(query)

    return telling


def weighted(reply: Reply) -> Reply:
    """Give the answer about each third experiment three times the weight."""

    def telling(query: Query) -> Answer:
        weighty = query.challenger.index % 3 == 0
        return Answer(reply(query), strength=3 if weighty else 1)

    return telling


def scored(cost: Callable[[np.ndarray], float]) -> Reply:
    """Tell the cost itself."""
    return lambda query: cost(query.challenger.theta)


# Changes in the middle of a study.


def undone(agent: Any) -> Any:
    """Undo the last answer."""
    agent.undo()
    return agent


def retracted(index: int, agent: Any) -> Any:
    """Forget what answer `index` taught."""
    agent.retract(index)
    return agent


def further_retracted(agent: Any) -> Any:
    """Forget what the first answer to a follow-up comparison taught."""
    agent.retract(0, further=True)
    return agent


def reopened(agent: Any) -> Any:
    """Save the agent as JSON, and restore it."""
    text = json.dumps(agent.state.to_dict())
    return restore(agent.space, AgentState.from_dict(json.loads(text)))


def narrowed(agent: Any) -> Any:
    """Search a part of the space from now on."""
    return respaced(agent, agent.space.narrowed({"x1": (-0.5, 0.5)}))


CHANGES: Mapping[str, Mapping[int, Change]] = {
    "undo and retract": {
        8: undone,
        9: undone,
        14: partial(retracted, 3),
        17: undone,
        19: partial(retracted, 6),
    },
    "reopened": {7: reopened, 15: reopened},
    "narrowed": {13: narrowed},
}
FURTHER: Mapping[int, Change] = {22: further_retracted, 24: undone}


def in_memory() -> dict[str, Callable[[], Lines]]:
    """Return the studies that need no file, by name."""
    studies: dict[str, Callable[[], Lines]] = {}
    for name, (cost, space) in PROBLEMS.items():
        for seed in (0, 1):
            make = partial(GLISp, space, n_max=30, seed=seed)
            sure = by(cost)
            studies[f"{name}, seed {seed}"] = lambda m=make, r=sure: drive(m(), r)
            wrong = partial(erring, sure, 0.15, seed)
            studies[f"{name}, seed {seed}, errors"] = lambda m=make, w=wrong: drive(m(), w())
        for kind in (GLISp.paper, RandomSearch, LatinHypercube, GLIS):
            reply = scored(cost) if kind is GLIS else by(cost)
            make = partial(kind, space, n_max=20, seed=3)
            called = "GLISp.paper" if kind == GLISp.paper else kind.__name__
            studies[f"{name}, {called}"] = lambda m=make, r=reply: drive(m(), r)
    return studies | _on_camel()


def _on_camel() -> dict[str, Callable[[], Lines]]:
    """Return studies of camel, each with something more than plain answers."""
    sure, three = by(camel), GLISpSettings(questions_per_experiment=3)
    replies: dict[str, Callable[[], Reply]] = {
        "KPIs": lambda: with_kpis(sure),
        "KPIs, errors": lambda: with_kpis(erring(sure, 0.15, 5)),
        "unsafe marks": lambda: marking(sure, Mark.CHALLENGER_UNSAFE, lambda x: x[0] > 0.9),
        "good marks": lambda: marking(sure, Mark.CHALLENGER_GOOD_ENOUGH, lambda x: camel(x) < 0),
        "weights of answers": lambda: weighted(sure),
        "ties and abstentions": lambda: abstaining(by(camel, tie=0.2), 5),
    }
    studies: dict[str, Callable[[], Lines]] = {
        f"camel, {name}": lambda r=reply: drive(GLISp(CAMEL, n_max=24, seed=2), r())
        for name, reply in replies.items()
    }
    for name, changes in CHANGES.items():
        for asked, settings in (("", GLISpSettings()), (", 3 questions", three)):
            make = partial(GLISp, CAMEL, n_init=6, n_max=18, seed=4, settings=settings)
            reply = partial(with_kpis, abstaining(by(camel, tie=0.1), 6))
            also = {**changes, **(FURTHER if asked else {})}
            studies[f"camel, {name}{asked}"] = lambda m=make, r=reply, c=also: drive(m(), r(), c)
    for name, kind in (("RandomSearch", RandomSearch), ("LatinHypercube", LatinHypercube)):
        make = partial(kind, CAMEL, n_init=6, n_max=18, seed=4)
        for change in CHANGES:
            studies[f"camel, {name}, {change}"] = lambda m=make, c=CHANGES[change]: drive(m(), sure, c)
    return studies


# Studies in files, driven by the command line.

OWN = """
import numpy as np
from prefcal_env import Channel, Channels, End, Experiment, Knob, KnobSpace
from prefcal_env.calibrators import LatentCost, Thurstone
from prefcal_scenarios import KPI, Scenario

LEVEL, VALVE = Channel("level", "m"), Channel("valve", "%")

def run(theta, seed=0):
    a, b = theta
    t = np.arange(5.0)
    level = a + (b - 0.3) * t
    return Experiment(
        theta=theta, t=t, x=level[:, None], u=t[:, None], t_control=t, u_control=t[:, None],
        y_ref=np.zeros((5, 1)), iterations=np.ones(5, dtype=int), solve_time=np.zeros(5),
        solved=np.ones(5, dtype=bool), channels=Channels((LEVEL,), (VALVE,), (LEVEL,), "s"),
        end=End.UNSAFE if a > 0.85 else End.TIME_UP,
        kpis={"error": abs(a - 0.4), "slope": abs(b - 0.3)},
    )

def cost(e):
    return e.kpis["error"] ** 2 + 2 * e.kpis["slope"] ** 2

own = Scenario(
    "own", "Own", KnobSpace([Knob("a", 0, 1, "m", step=0), Knob("b", 0, 1, "m/s", step=0)]), run,
    kpis=(KPI("error", "error", "m"), KPI("slope", "slope", "m/s")),
    cost=cost,
    calibrators={
        "synthetic": lambda seed: LatentCost(cost, seed=seed),
        "unsure": lambda seed: LatentCost(cost, noise=Thurstone(0.05), seed=seed),
    },
)
"""
CALIBRATE = "calibrate own.py:own --study own.prefcal --calibrator synthetic --seed 1 --n-init 4"


def command(folder: Path, words: str) -> str:
    """Run one command of prefcal in `folder`; return what it printed."""
    printed, said = io.StringIO(), io.StringIO()
    places = {"XDG_DATA_HOME": str(folder / "data")}
    with (
        contextlib.chdir(folder),
        mock.patch.object(sys, "argv", ["prefcal", *words.split()]),
        mock.patch.dict(os.environ, places),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(said),
    ):
        try:
            run_prefcal()
        except SystemExit as end:
            if end.code:
                raise RuntimeError(f"prefcal {words}\n{said.getvalue()}") from end
    return printed.getvalue()


def exported(folder: Path, study: str, knobs: int) -> Lines:
    """Return samples and answers of a study file; the first columns of its experiments are θ."""
    command(folder, f"studies export {study} --format csv --out tables")
    rows = csv.reader((folder / "tables" / "experiments.csv").open(encoding="utf-8", newline=""))
    samples = [" ".join(row[: knobs + 1]) for row in rows]
    table = csv.DictReader((folder / "tables" / "comparisons.csv").open(encoding="utf-8"))
    kept = (
        "challenger",
        "incumbent",
        "preference",
        "strength",
        "marks",
        "automatic marks",
        "challenger on the left",
        "retracted",
    )
    return [*samples, *(", ".join(row[name] for name in kept) for row in table)]


def in_file(*steps: str | Callable[[Path], None]) -> Lines:
    """Apply the steps to the study own.prefcal: words of a command, or functions of it."""
    with tempfile.TemporaryDirectory() as name:
        folder, best = Path(name), None
        (folder / "own.py").write_text(OWN, encoding="utf-8")
        for step in steps:
            if callable(step):
                step(folder)
            elif step.startswith("calibrate"):
                best = json.loads(command(folder, f"{step} --json"))["best"]
            else:
                command(folder, step)
        return [*exported(folder, "own.prefcal", 2), f"best {best}"]


def interfere(folder: Path) -> None:
    """Undo, retract and mark, as a person does on the page."""
    from prefcal_app.session import Interview, Phase

    with StudyFile.open(folder / "own.prefcal", clock=lambda: "2026-01-01T00:00:00+00:00") as file:
        interview = Interview(load(f"{folder / 'own.py'}:own"), file, ahead=False)
        for _ in range(2):
            interview.do(actions.Undo(interview.now().version))
        interview.do(actions.Retract(3))
        while interview.now().phase is Phase.RUNNING:
            interview.work()
        question = interview.now().question
        assert question is not None
        interview.do(actions.Mark(question.id, "left", "unsafe", True))
        interview.close()


def reactor() -> Lines:
    """Return the paper's reactor, calibrated without a person."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = "calibrate cstr --agent glisp --calibrator synthetic --n-max 14 --study r.prefcal"
        best = json.loads(command(folder, f"{words} --json"))["best"]
        return [*exported(folder, "r.prefcal", 3), f"best {best}"]


def in_files() -> dict[str, Callable[[], Lines]]:
    """Return the studies that are kept in a file, by name."""
    half, whole = f"{CALIBRATE} --n-max 7", f"{CALIBRATE} --n-max 14"
    noise = " --calibrator unsure --questions-per-experiment 3"
    respace = "studies respace own.prefcal --scenario own.py:own --knob a=0.5:0.9"
    return {
        "file": partial(in_file, whole),
        "file, resumed": partial(in_file, half, whole),
        "file, noise, 3 questions": partial(in_file, half + noise, whole + noise),
        "file, undo and retract": partial(in_file, half, interfere, whole),
        "file, respaced": partial(in_file, half, respace, whole),
        "cstr": reactor,
    }


# Decisions of recorded studies, taken again after each event.

RECORDED = Path(__file__).parent / "recorded"


def recorded(study: Path) -> Lines:
    """Return the events of a study file, a line each, without trajectories: decisions need none."""
    with StudyFile.open(study, clock=str, reading=True) as file:
        return [to_text(each.event) for each in file.events()]


def decisions(lines: Iterable[str]) -> Iterator[tuple[int, Event, Event | None]]:
    """Yield the number of each decision in a recorded study, what was decided, and what is now.

    What people decided, such as a θ of their own or an early end, is no decision of an agent.
    """
    strategy: Agent | None = None
    configuration: tuple[Mapping[str, Any], int] = {}, 0
    state = State({}, "", 0)
    with contextlib.ExitStack() as stack:
        for seq, event in enumerate(map(from_text, lines), start=1):
            if _is_decision(event):
                if strategy is None or (state.configuration, state.n_max) != configuration:
                    configuration = state.configuration, state.n_max
                    strategy = agent_of(state, space_of(state.configuration), _simulator(state, stack))
                todo = Study(strategy, state).next()
                now = todo.shown if isinstance(todo, Ask) else getattr(todo, "event", None)
                yield seq, event, now
            state = begin(seq, "", event) if seq == 1 else step(state, seq, "", event)


def _is_decision(event: Event) -> bool:
    match event:
        case Shown(repeats=repeats):
            return repeats is None
        case Ended(reason=reason):
            return reason in (ENOUGH, ALL_COMPARED)
    return isinstance(event, Suggested | Led)


def _simulator(state: State, stack: contextlib.ExitStack) -> Simulator | None:
    """Return what the agent of a recorded study simulates with; None if it simulates nothing."""
    if not is_simulating(state):
        return None
    scenario, seed = load(state.configuration["scenario"]), int(state.configuration["seed"])
    return stack.enter_context(Simulator(scenario, seed=seed, jobs=0, robust=is_robust(state)))


def decided_anew(path: Path) -> Lines:
    """Return each decision of a recorded study that differs now, as a line, after their number."""
    every = list(decisions(path.read_text(encoding="utf-8").splitlines()))
    wrong = [f"{path.stem}, event {seq}: {then} became {now}" for seq, then, now in every if then != now]
    decided = "1 decision" if len(every) == 1 else f"{len(every)} decisions"
    return [f"{path.stem}: {decided}, {len(wrong)} {'differs' if len(wrong) == 1 else 'differ'}", *wrong]


def digest(lines: Lines) -> str:
    """Return the digest of a study."""
    return sha256("\n".join(lines).encode()).hexdigest()


def differences(found: Mapping[str, str], expected: Mapping[str, str]) -> Lines:
    """Name each study whose digest differs, and each that only one of the two has."""
    return [
        f"{name}: {expected.get(name, 'not recorded')[:12]} became {value[:12]}"
        for name, value in found.items()
        if expected.get(name) != value
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--against", metavar="FILE", type=Path, nargs="?", const=RECORD)
    parser.add_argument("--only", metavar="TEXT", default="", help="studies with this in the name")
    parser.add_argument("--show", action="store_true", help="print the lines behind the digests")
    parser.add_argument(
        "--decisions", metavar="FOLDER", type=Path, nargs="?", const=RECORDED, help="replay recorded studies"
    )
    parser.add_argument("--record", metavar="STUDY", type=Path, help="print a study to be recorded")
    args = parser.parse_args()
    if args.record is not None:
        print("\n".join(recorded(args.record)))
        return
    if args.decisions is not None:
        paths = [path for path in sorted(args.decisions.glob("*.jsonl")) if args.only in path.stem]
        if not paths:  # nothing would differ
            named = f" with {args.only!r} in its name" if args.only else ""
            parser.error(f"{args.decisions} holds no recorded study{named} (NAME.jsonl)")
        told = [decided_anew(path) for path in paths]
        print("\n".join(line for lines in told for line in lines))
        sys.exit(any(len(lines) > 1 for lines in told))
    studies = {n: run for n, run in (in_memory() | in_files()).items() if args.only in n}
    lines = {name: run() for name, run in studies.items()}
    found = {name: digest(one) for name, one in lines.items()}
    print(json.dumps(lines if args.show else found, indent=1))
    if args.against is not None:
        expected = json.loads(args.against.read_text(encoding="utf-8"))
        missing = [n for n in expected if args.only in n and n not in found]
        wrong = [*differences(found, expected), *(f"{name}: not computed" for name in missing)]
        print("\n".join(wrong) or "the same studies, bit for bit", file=sys.stderr)
        sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
