"""Trace which files of ours a piece of work enters: a proposal, an answer, a KPI of one's own."""

import os
import sys
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median_low
from types import CodeType, FrameType, ModuleType
from typing import Any, NamedTuple

import prefcal_agents
import prefcal_app
import prefcal_env
import prefcal_scenarios
from prefcal_agents import GLISp, Screening
from prefcal_app.session import Choice, actions
from prefcal_app.view import now_view
from prefcal_scenarios.catalog import load

from .interviews import begin, proceed
from .latent import HARTMAN3

AGENT = (prefcal_env, prefcal_agents)
"""The packages that a proposal takes."""
PACKAGES = (*AGENT, prefcal_scenarios, prefcal_app)
AGENTS = {"GLISp": GLISp, "Screening": partial(Screening, n_simulated=100)}
OWN = """
import numpy as np
from prefcal_env import Knob, KnobSpace, recorded
from prefcal_scenarios import KPI, Scenario


def run(theta, seed=0):
    t = np.arange(0.0, 10.0, 0.1)
    y = 1 - np.exp(-theta[0] * t)
    u = theta[0] * (1 - y)
    return recorded(theta, t, {"level": y}, {"valve": u}, {"level": 1.0},
                    kpis=lambda e: {"effort": float(np.abs(e.u).max())})


knobs = KnobSpace([Knob("K_p", 0.1, 5.0), Knob("T_i", 0.1, 5.0)])
own = Scenario("own", "Own", knobs, run, kpis=(KPI("effort", "Effort", "%", better="lower"),))
"""


class Trace(NamedTuple):
    """What a reader meets who follows some work, call by call; comprehensions count as functions.

    Args:
        files: Number of files that it enters.
        crossings: How often the flow of its calls changes the file.
        functions: Number of functions that it enters.
        stack: How deep a call is in the median, in functions of ours.
    """

    files: int
    crossings: int
    functions: int
    stack: int


def traced(work: Callable[[], Any], packages: tuple[ModuleType, ...] = PACKAGES) -> Trace:
    """The trace of `work`. Modules that it imports for the first time count, so work before."""
    homes = tuple(f"{Path(str(p.__file__)).parent}{os.sep}" for p in packages)
    entered, depths = list[CodeType](), list[int]()

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(homes):
            entered.append(frame.f_code)
            depths.append(sum(code.co_filename.startswith(homes) for code in callers(frame)))

    sys.setprofile(watch)
    try:
        work()
    finally:
        sys.setprofile(None)
    files = [code.co_filename for code in entered]
    changes = sum(a != b for a, b in pairwise(files))
    functions = {(code.co_filename, code.co_qualname) for code in entered}
    return Trace(len({*files}), changes, len(functions), median_low(depths))


def callers(frame: FrameType | None) -> Iterator[CodeType]:
    """Yield the code of a frame, and of those that called it."""
    while frame is not None:
        yield frame.f_code
        frame = frame.f_back


def simulated(theta: Any) -> dict[str, float]:
    """Simple KPIs of a θ."""
    far = (theta - 0.4) ** 2
    return {"first": float(far[0]), "others": float(far[1:].sum()), "size": float(abs(theta[0]))}


PROPOSALS = (
    (partial(GLISp, n_init=6, n_max=50), 30),  # each a kind of proposal of its own
    (partial(GLISp, n_init=6, n_max=50), 31),
    (partial(Screening, simulate=simulated), 4),
    (partial(Screening, simulate=simulated), 8),
)
"""Agents, and the number of the experiment that is proposed."""


def proposal(make: Callable[..., Any], experiment: int) -> Trace:
    """The trace of one proposal and its answer."""
    agent = make(HARTMAN3.space, seed=0)

    def ask_and_tell() -> None:
        query = agent.ask()
        new, best = query.challenger, query.incumbent
        agent.tell(query, None if best is None else HARTMAN3.prefer(new.theta, best.theta))

    for _ in range(experiment - 1):
        ask_and_tell()
    return traced(ask_and_tell, AGENT)


def answer(agent: Callable[..., Any], answered: int = 8) -> Trace:
    """The trace from an answer, through the study and a run of a loop, to the next question."""
    interview = begin(load("servo"), n_max=20, agent=agent)
    question = proceed(interview).question
    for number in range(answered):
        interview.do(actions.Answer(question.id, Choice.LEFT if number % 3 else Choice.RIGHT))
        question = proceed(interview).question

    def answer_one() -> None:
        interview.do(actions.Answer(question.id, Choice.LEFT))
        proceed(interview)

    return traced(answer_one)


def own_kpi(folder: Path, agent: Callable[..., Any]) -> Trace:
    """The trace of a KPI of one's own, from its file to the second question on the screen."""
    for name in ("first", "own"):
        (folder / f"{name}.py").write_text(OWN, encoding="utf-8")
    _from_file_to_the_next_question(folder / "first.py", agent)
    return traced(lambda: _from_file_to_the_next_question(folder / "own.py", agent))


def _from_file_to_the_next_question(file: Path, agent: Callable[..., Any]) -> None:
    """Load the scenario, run two θ, show the question, answer it, and show the next one."""
    interview = begin(load(f"{file}:own"), n_max=8, agent=agent)
    question = proceed(interview).question
    assert "Effort" in str(now_view(interview)["question"]["comparison"])
    interview.do(actions.Answer(question.id, Choice.LEFT))
    proceed(interview)
    assert now_view(interview)["question"]["id"] != question.id
