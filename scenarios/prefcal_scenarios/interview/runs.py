"""Experiments of an interview: what has to run, a rig's record, a run that failed; and the end."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError, StaleError
from prefcal_env.experiment import Experiment
from prefcal_env.rig import Rig
from prefcal_env.studies import Ended, Extended, Finished, Noted, Reopened, Suggested

from .flow import Flow
from .memory import agent_of
from .moment import GOOD_ENOUGH, Phase

Attempt = Callable[[], Callable[[], None]]
"""What is long, to be called without the lock; it gives what is to be done with the lock."""


def due(flow: Flow, *, ahead: bool) -> Attempt | None:
    """The next piece of work; None if there is none."""
    if flow.phase is Phase.RUNNING:
        pending = flow.pending
        if pending is None or pending.index in flow.state.finished:
            return lambda: lambda: _go_on_running(flow)
        known = flow.ahead.experiment(np.array(pending.theta))
        return lambda: _running(flow, pending, known)
    if flow.phase is Phase.QUESTION and ahead:
        return _looking_ahead(flow)
    return None


def _go_on_running(flow: Flow) -> None:
    """Proceed, unless somebody has done so (undone, retracted, finished) before the lock was had.

    Twice, the question that is on show already would be put on show again, under another id.
    """
    if flow.phase is Phase.RUNNING:
        flow.proceed()


def _running(flow: Flow, sample: Suggested, known: Experiment | None) -> Callable[[], None]:
    result = known or attempt(flow, np.array(sample.theta))
    return lambda: flow.ran(sample, result)


def attempt(flow: Flow, theta: Float[np.ndarray, " n"]) -> Experiment | Exception:
    """Run θ. Whatever the user's plant raises is a result too, and so is what it should not give.

    SystemExit as well: a plant that calls exit() would end the thread, and all would wait for ever.
    """
    try:
        result: object = flow.album.scenario.run(theta.copy(), seed=flow.seed)
    except (Exception, SystemExit) as error:
        return error if isinstance(error, Exception) else ScenarioError(f"run called exit: {error}")
    if isinstance(result, Experiment):
        return result
    return ScenarioError(f"run must return an Experiment, got {type(result).__name__}")


def _looking_ahead(flow: Flow) -> Attempt | None:
    """Tell a twin the next likely answer, and run what it would propose.

    What goes wrong here has cost nothing, and perhaps is never asked for: the question stays open.
    If that answer is given, it is computed again, and told if it fails again.
    """
    asked = flow.question
    assert asked is not None
    if asked.repeats is not None:
        return None
    answer = flow.ahead.missing(asked)
    if answer is None:
        return None
    query, twin = flow.agent.ask(), flow.agent.copy()

    def look() -> Callable[[], None]:
        try:
            twin.tell(query, answer)
            theta = None if twin.done else twin.ask().challenger.theta
        except Exception:
            return lambda: None
        result = None if theta is None or _is_known(flow, theta) else attempt(flow, theta)

        def keep() -> None:
            if theta is not None and isinstance(result, Experiment):
                flow.ahead.keep(theta, result)
            if flow.question is asked:
                flow.ahead.keep_twin(answer, twin)

        return keep

    return look


def _is_known(flow: Flow, theta: Float[np.ndarray, " n"]) -> bool:
    """Whether θ was run: in the study (before an undo, or a night), or on suspicion."""
    known = flow.study.find_experiment(theta) is not None
    return known or flow.ahead.experiment(theta) is not None


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
    if index in flow.state.finished:
        # What failed is the step after it, on a full disk say: its experiment must not be replaced.
        raise StaleError(f"experiment {index + 1} is saved, it has not failed: try again")
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
    best, marks = flow.best, flow.state.marks
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
