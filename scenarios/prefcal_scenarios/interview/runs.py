"""Experiments of an interview: what has to run, a rig's record, a run that failed; and the end."""

from collections.abc import Callable

import numpy as np

from prefcal_env.errors import ScenarioError, StaleError
from prefcal_env.experiment import Experiment
from prefcal_env.rig import Rig
from prefcal_env.studies import Ended, Extended, Finished, Noted, Reopened, Suggested

from .flow import Flow
from .memory import agent_of, incumbent
from .moment import GOOD_ENOUGH, Phase

Attempt = Callable[[], Callable[[], None]]
"""What is long, to be called without the lock; it gives what is to be done with the lock."""


def due(flow: Flow, *, ahead: bool) -> Attempt | None:
    """The next piece of work; None if there is none."""
    if flow.phase is Phase.RUNNING:
        pending = flow.pending
        if pending is None or pending.index in flow.state.finished:
            return lambda: flow.proceed
        known = flow.ahead.experiment(np.array(pending.theta))
        return lambda: _running(flow, pending, known)
    if flow.phase is Phase.QUESTION and ahead:
        return _looking_ahead(flow)
    return None


def _running(flow: Flow, sample: Suggested, known: Experiment | None) -> Callable[[], None]:
    result = known or attempt(flow, sample.theta)
    return lambda: flow.ran(sample, result)


def attempt(flow: Flow, theta: tuple[float, ...]) -> Experiment | Exception:
    """Run θ. Whatever the user's plant raises is a result too."""
    try:
        result: object = flow.album.scenario.run(np.array(theta), seed=flow.seed)
    except Exception as error:
        return error
    if isinstance(result, Experiment):
        return result
    return ScenarioError(f"run must return an Experiment, got {type(result).__name__}")


def _looking_ahead(flow: Flow) -> Attempt | None:
    """Tell a twin the next likely answer, and run what it would propose."""
    asked = flow.question
    assert asked is not None
    if asked.repeats is not None:
        return None
    answer = flow.ahead.missing(asked.marks)
    if answer is None:
        return None
    query, twin = flow.agent.ask(), flow.agent.copy()

    def look() -> Callable[[], None]:
        twin.tell(query, answer)
        theta = None if twin.done else tuple(twin.ask().challenger.theta.tolist())
        run = theta is not None and flow.ahead.experiment(np.array(theta)) is None
        result = attempt(flow, theta) if run and theta is not None else None

        def keep() -> None:
            if isinstance(result, Experiment):
                flow.ahead.keep(result)
            if flow.question is asked:
                flow.ahead.keep_twin(answer, twin)

        return keep

    return look


def awaited(flow: Flow, index: int, *phases: Phase) -> Suggested:
    """The pending sample. Raises StaleError unless it is `index`, and waited for in a phase."""
    pending = flow.pending
    if pending is None or pending.index != index or flow.phase not in phases:
        raise StaleError(f"experiment {index + 1} is not waited for (any more)")
    return pending


def record(flow: Flow, index: int, content: bytes, *, unsafe: bool) -> None:
    """Take the record of the pending sample."""
    sample, rig = awaited(flow, index, Phase.RECORD), flow.album.scenario.run
    assert isinstance(rig, Rig)
    experiment = rig.read(rig.read_bytes(content), np.array(sample.theta), unsafe=unsafe)
    flow.study.append((Finished(index), experiment))
    flow.proceed()


def fail(flow: Flow, index: int, reason: str) -> None:
    """Count the run of the pending sample as failed."""
    awaited(flow, index, Phase.RECORD, Phase.FAILED)
    noted = [Noted(f"experiment {index + 1} failed: {reason}")] if reason else []
    flow.study.append(*noted, (Finished(index), flow.album.failed(index)))
    flow.proceed()


def retry(flow: Flow) -> None:
    """Try again what has failed."""
    if flow.phase is not Phase.FAILED:
        raise StaleError("nothing has failed that could be tried again")
    flow.move(Phase.RUNNING)


def finish(flow: Flow) -> None:
    """End the study, since the person says so."""
    if flow.phase is Phase.OVER:
        raise StaleError("the study has ended already")
    best, marks = incumbent(flow.state), flow.state.marks
    good = best is not None and GOOD_ENOUGH in marks.get(best, frozenset())
    flow.study.append(Ended(GOOD_ENOUGH if good else "stopped"))
    flow.proceed()


def go_on(flow: Flow, more: int) -> None:
    """Reopen the study, with `more` further experiments."""
    state = flow.state
    if flow.phase is not Phase.OVER:
        raise StaleError("the study has not ended")
    if more < 0 or (more == 0 and len(state.closed) >= state.n_max):
        raise StaleError(f"all {state.n_max} experiments are compared: say how many more")
    extended = [Extended(state.n_max + more)] if more else []
    flow.study.append(*extended, Reopened())
    flow.agent = agent_of(flow.state, flow.album.scenario.space)
    flow.proceed()
