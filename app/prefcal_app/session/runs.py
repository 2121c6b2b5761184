"""Run the experiments of an interview, handle failed and stopped runs, and end the study."""

import threading
from collections.abc import Callable
from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_agents.screening.agent import Screening
from prefcal_env.errors import RunError, ScenarioError, StaleError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.own_line import as_exception
from prefcal_env.study import Ended, Extended, Finished, Noted, Reopened, Suggested
from prefcal_env.workers import Worker
from prefcal_scenarios.isolated import IsolatedRun
from prefcal_scenarios.own.checks import check_experiment
from prefcal_scenarios.scenario import Scenario

from . import thinking
from .flow import Flow
from .live import driving
from .memory import agent_of
from .thinking import Attempt
from .view import GOOD_ENOUGH, Phase

UNBIDDEN = ("late", "died")
"""Reasons for a run without an experiment that neither the person nor their code gave."""
_COURTESY = 2.0
"""Seconds that a prefetched run may continue while another one is waited for: it may be almost
done, and a fresh process takes a second."""
_ONE_AT_A_TIME = threading.Lock()
"""Held during a look: clicking through many θ must not keep every core busy."""


def due(flow: Flow, *, ahead: bool) -> Attempt | None:
    """Return the next piece of work; None if there is none."""
    rig = driving.live_of(flow)
    if rig is not None and (work := driving.due(flow, rig)) is not None:
        return work
    if flow.phase is Phase.RUNNING:
        if flow.must_think:
            return thinking.think(flow)
        pending = flow.pending
        if pending is None or pending.index in flow.state.finished or rig is not None:
            return lambda: lambda: _go_on_running(flow)
        if flow.at_once > 1:
            return _beside(flow) if flow.asked else lambda: lambda: _go_on_running(flow)
        known = _known(flow, pending)
        if known is None:
            reserve(flow, np.array(pending.theta))
        return lambda: _running(flow, pending, known)
    if flow.phase in (Phase.QUESTION, Phase.OVER) and thinking.is_unexplained(flow):
        return thinking.explain(flow)
    if flow.at_once > 1:
        return _beside(flow) if flow.phase in (Phase.QUESTION, Phase.FAILED) else None
    if flow.phase is Phase.QUESTION and ahead and rig is None:
        return _looking_ahead(flow)
    return None


def _beside(flow: Flow) -> Attempt | None:
    """Run the first pending sample that does not run yet; None if all do, or enough."""
    if len(flow.running) >= flow.at_once:
        return None
    for sample in flow.unfinished:
        key, theta = theta_key(sample.theta), np.array(sample.theta)
        failed = flow.phase is not Phase.RUNNING and (
            flow.prefetch.is_known(theta) or sample.index in flow.state.failures
        )
        if key not in flow.running and not failed:
            known = _known(flow, sample)
            flow.running.add(key)
            flow.version += flow.phase is Phase.RUNNING  # so that front ends say how many run
            return partial(_run_beside, flow, sample, known)
    return None


def _run_beside(flow: Flow, sample: Suggested, known: Experiment | Exception | None) -> Callable[[], None]:
    finish = _running(flow, sample, known)

    def ended() -> None:
        flow.running.discard(theta_key(sample.theta))
        finish()

    return ended


def _known(flow: Flow, sample: Suggested) -> Experiment | Exception | None:
    """Return the result of running `sample` if it is already known."""
    if flow.stopped == sample.index:
        flow.stopped = None
        return RunError("you stopped the run before it began", "stopped")
    theta = np.array(sample.theta)
    return flow.prefetch.experiment(theta) or flow.prefetch.take_failure(theta)


def _go_on_running(flow: Flow) -> None:
    """Proceed, unless an undo, a retraction or the end did so before the lock was acquired.

    Proceeding twice would show the same question again under another id.
    """
    if flow.phase is Phase.RUNNING:
        flow.proceed()


def _running(flow: Flow, sample: Suggested, known: Experiment | Exception | None) -> Callable[[], None]:
    result = known or attempt(flow, np.array(sample.theta))
    if isinstance(result, RunError) and result.why == "given up":
        return lambda: None  # not a failure: it runs again when it is needed again
    return lambda: flow.ran(sample, result)


def attempt(
    flow: Flow, theta: Float[np.ndarray, " n"], twin: Scenario | None = None
) -> Experiment | Exception:
    """Run θ and return its experiment, or the error that the user's code raised.

    Until one experiment passed without interruption, each is checked against the scenario, and
    always if it is one of the `twin`.
    SystemExit and the like are caught, too: a plant that calls exit() would end the thread without
    notice. Only KeyboardInterrupt is raised again: it may be Ctrl-C.
    """
    scenario = twin or flow.store.scenario
    try:
        result: object = scenario.run(theta.copy(), seed=flow.seed)
        if flow.checked and twin is None and isinstance(result, Experiment):
            return result
        experiment = check_experiment(scenario, theta, result)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        return as_exception(error)
    if twin is None:
        flow.checked = not experiment.end.interrupted
    return experiment


def look_at(flow: Flow, lock: threading.Condition, theta: Float[np.ndarray, " n"]) -> Experiment:
    """Return the experiment of a simulated θ, physical, shape (n,), and record nothing.

    It runs without `lock`, that of the interview. A question about θ then finds the experiment.

    Raises:
        ScenarioError: If the agent does not simulate, or the simulation failed.
        KnobError: If the space does not hold θ.
    """
    with lock:
        if not isinstance(flow.agent, Screening):
            raise ScenarioError("only an experiment that is simulated unseen can be looked at")
        theta = flow.agent.space.check_allowed(theta)
        known = flow.study.find_experiment(theta)
        found = flow.prefetch.experiment(theta)
    if known is not None:
        return flow.study.experiment(known)
    if found is not None:
        return found
    with _ONE_AT_A_TIME:
        result = attempt(flow, theta, flow.twin)
    if isinstance(result, Exception):
        raise ScenarioError(f"this simulation failed: {result}") from result
    if flow.twin is None:
        with lock:
            flow.prefetch.keep(theta, result)
    return result


def _looking_ahead(flow: Flow) -> Attempt | None:
    """Run the θ that a copy of the agent proposes after a likely answer, or let one propose it."""
    asked = flow.question
    assert asked is not None
    if asked.repeats is not None:
        return None
    if flow.prefetch.next is not None:
        return _running_ahead(flow, flow.prefetch.next)
    return thinking.look_ahead(flow, asked, lambda theta: _is_known(flow, theta))


def _running_ahead(flow: Flow, theta: Float[np.ndarray, " n"]) -> Attempt:
    """Run θ before it is needed."""
    flow.prefetch.next = None
    reserve(flow, theta)

    def run() -> Callable[[], None]:
        result = attempt(flow, theta)

        def keep() -> None:
            if isinstance(result, Experiment):
                flow.prefetch.keep(theta, result)
            elif isinstance(result, RunError) and result.why in UNBIDDEN:
                flow.prefetch.keep_failure(theta, result)

        return keep

    return run


def _is_known(flow: Flow, theta: Float[np.ndarray, " n"]) -> bool:
    """Return whether θ has run: in the study, for example before an undo, or as a prefetch."""
    return flow.study.find_experiment(theta) is not None or flow.prefetch.is_known(theta)


def awaited(flow: Flow, index: int, *phases: Phase) -> Suggested:
    """Return the pending sample. Raises StaleError unless its index and the phase match."""
    pending = flow.pending
    if pending is None or pending.index != index or flow.phase not in phases:
        raise StaleError(f"experiment {index + 1} is no longer waited for: nothing was changed")
    return pending


def worker_of(flow: Flow) -> Worker | None:
    """Return the process that runs the experiments; None if they run in this one."""
    return next(iter(workers_of(flow)), None)


def workers_of(flow: Flow) -> tuple[Worker, ...]:
    """Return all processes that run experiments; none if they run in this one."""
    run = flow.store.scenario.run
    return run.workers if isinstance(run, IsolatedRun) else ()


def reserve(flow: Flow, theta: Float[np.ndarray, " n"]) -> None:
    """Announce the next θ to run while the lock is held; from then on it can be stopped."""
    worker = worker_of(flow)
    if worker is not None:
        worker.reserve(theta_key(theta))


def stop(flow: Flow, index: int) -> None:
    """Stop the run of the pending sample, which then counts as failed.

    Raises:
        ScenarioError: If it runs inside prefcal's own process, as built-in scenarios do.
    """
    if driving.live_of(flow) is not None:
        return driving.stop(flow, index)
    key, workers = theta_key(awaited(flow, index, Phase.RUNNING).theta), workers_of(flow)
    worker = next((w for w in workers if w.busy_with(key)), worker_of(flow))
    if worker is None:
        raise ScenarioError("experiments of a built-in scenario run in seconds: wait for this one")
    if worker.busy_with(key):
        return worker.stop("stopped")
    flow.stopped = index  # an earlier run is still in progress
    return worker.stop("given up")


def make_way(flow: Flow) -> None:
    """Stop soon what runs in advance, if something else is waited for."""
    thinking.give_up_if_useless(flow)
    if flow.at_once > 1:
        _end_dropped(flow)
        return
    worker = worker_of(flow)
    if worker is None or flow.phase is not Phase.RUNNING:
        return
    pending = flow.pending
    if pending is None or worker.busy_with(theta_key(pending.theta)) is False:
        worker.stop("given up", within=_COURTESY)


def _end_dropped(flow: Flow) -> None:
    """End the runs of samples that are no longer pending, after an undo for example."""
    wanted = () if flow.phase is Phase.OVER else flow.unfinished
    for worker in workers_of(flow):
        if worker.is_idle or any(worker.busy_with(theta_key(s.theta)) for s in wanted):
            continue
        worker.stop("given up", within=_COURTESY)


def fail(flow: Flow, index: int, reason: str = "") -> None:
    """Count the run of the pending sample as failed: an experiment without a record."""
    awaited(flow, index, Phase.RECORD, Phase.CONFIRM, Phase.FAILED)
    if index in flow.state.finished:
        # A later step failed, for example on a full disk: this experiment must not be replaced.
        raise StaleError(f"experiment {index + 1} is saved, it has not failed: try again")
    noted = [Noted(f"experiment {index + 1} failed: {reason}")] if reason else []
    partial, flow.live.partial = flow.live.partial, None
    flow.study.append(*noted, (Finished(index), partial or flow.store.failed(index)))
    flow.proceed()


def retry(flow: Flow) -> None:
    """Retry what failed, in phase FAILED: a run, or writing the study file.

    In phase CONFIRM, read the live plant's present values again.
    """
    on_the_plant = flow.phase is Phase.CONFIRM or driving.is_unrestored(flow)
    if on_the_plant:
        driving.look_again(flow)
    if flow.phase is Phase.FAILED:
        flow.move(Phase.RUNNING)
    elif not on_the_plant:
        raise StaleError("nothing has failed, so there is nothing to try again")


def finish(flow: Flow) -> None:
    """End the study at the person's request."""
    if flow.phase is Phase.OVER:
        raise StaleError("the study has ended already")
    best, marks = flow.best, flow.state.marks
    good = best is not None and GOOD_ENOUGH in marks.get(best, frozenset())
    flow.study.append(Ended(GOOD_ENOUGH if good else "stopped"))
    flow.proceed()


def go_on(flow: Flow, more: int = 0) -> None:
    """Reopen the ended study, with `more` additional experiments."""
    state = flow.state
    if flow.phase is not Phase.OVER:
        raise StaleError("the study has not ended")
    if more < 0 or (more == 0 and state.history.answered >= state.n_max):
        raise StaleError(f"all {state.n_max} experiments are compared: say how many more")
    extended = [Extended(state.n_max + more)] if more else []
    flow.study.append(*extended, Reopened())
    flow.agent = agent_of(flow.state, flow.store.scenario.space, flow.simulator)
    flow.proceed()
