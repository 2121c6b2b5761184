"""Run the experiments of an interview, handle failed and stopped runs, and end the study."""

import threading
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from prefcal_agents.screening.agent import Screening
from prefcal_env.errors import RunError, ScenarioError, StaleError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.own_line import as_exception, in_words
from prefcal_env.sources import Run
from prefcal_env.study import Ended, Extended, Failed, Finished, Noted, Reopened, Suggested, Taken
from prefcal_scenarios.own.checks import check_experiment
from prefcal_scenarios.scenario import Scenario

from . import thinking
from .flow import Flow
from .study.memory import agent_of
from .study.now import GOOD_ENOUGH, Phase, Recovery
from .volatile.underway import Attempt

UNBIDDEN = ("late", "died")
"""Reasons for a run without an experiment that neither the person nor their code gave."""
_ONE_AT_A_TIME = threading.Lock()
"""Held during a look: clicking through many θ must not keep every core busy."""


def due(flow: Flow, *, ahead: bool) -> Attempt | None:
    """Return the next piece of work; None if there is none."""
    underway, study = flow.underway, flow.study
    if underway.plant.recovery is Recovery.DUE:
        return _restoring(flow)
    if flow.phase in (Phase.RECORD, Phase.CONFIRM) or underway.moves_plant:
        return _attended(flow)
    if flow.phase is Phase.RUNNING:
        if study.must_think:
            return thinking.think(flow)
        pending = study.pending
        if pending is None or pending.index in flow.state.finished or underway.source.asks:
            return lambda: lambda: _go_on_running(flow)
        if flow.at_once > 1:
            return _beside(flow) if flow.proposed else lambda: lambda: _go_on_running(flow)
        return _running(flow, pending)
    if flow.phase in (Phase.QUESTION, Phase.OVER) and thinking.is_unexplained(flow):
        return thinking.explain(flow)
    if flow.phase is Phase.OVER and thinking.is_untold(flow):
        return thinking.tell(flow)
    if flow.at_once > 1:
        return _beside(flow) if flow.phase in (Phase.QUESTION, Phase.FAILED) else None
    if flow.phase is not Phase.QUESTION:
        return None
    looking = _looking_ahead(flow) if ahead and not underway.source.asks else None
    if looking is None and thinking.is_untold(flow):
        return thinking.tell(flow)
    return looking


def _restoring(flow: Flow) -> Attempt:
    """Restore the plant's old values."""
    restore = flow.underway.plant.recover(flow.underway.changed)

    def advance() -> Callable[[], None]:
        done = restore()

        def tell() -> None:
            done()
            flow.version += 1

        return tell

    return advance


def _attended(flow: Flow) -> Attempt | None:
    """Advance the run that a person attends to, unless it waits for them or for the plant."""
    underway, pending = flow.underway, flow.study.pending
    run = underway.of(pending)
    if run is None or pending is None or run.waits or underway.plant.recovery is not Recovery.DONE:
        return None
    return _running(flow, pending)


def _beside(flow: Flow) -> Attempt | None:
    """Run the first pending sample that does not run yet; None if all do, or enough."""
    if len(flow.underway.going) >= flow.at_once:
        return None
    for sample in flow.study.unfinished:
        theta = np.array(sample.theta)
        failed = flow.phase is not Phase.RUNNING and (
            flow.thoughts.prefetch.is_known(theta) or sample.index in flow.state.failures
        )
        if theta_key(theta) not in flow.underway.going and not failed:
            flow.version += flow.phase is Phase.RUNNING  # so that front ends say how many run
            return _running(flow, sample)
    return None


def _running(flow: Flow, sample: Suggested) -> Attempt:
    """Run a pending sample, or take its result if that is known already."""
    theta = np.array(sample.theta)
    known = flow.thoughts.prefetch.experiment(theta) or flow.thoughts.prefetch.take_failure(theta)
    if known is not None:
        # At once, since another thread would run it again meanwhile.
        flow.underway.end(theta, known)
        _ran(flow, sample, known)
        return lambda: lambda: None
    run = flow.underway.begin(theta)

    def advance() -> Callable[[], None]:
        result = attempt(flow, run, theta)
        given_up = isinstance(result, RunError) and result.why == "given up"

        def done() -> None:
            flow.underway.end(theta, result)
            flow.version += result is None  # front ends show what it asks
            # Not a failure if it was given up: it runs again when it is needed again.
            if result is not None and not given_up:
                _ran(flow, sample, result)

        return done

    return advance


def _ran(flow: Flow, sample: Suggested, result: Experiment | Exception) -> None:
    """Take the result of running `sample`, if it is still pending."""
    theta = np.array(sample.theta)
    if isinstance(result, Experiment):
        flow.thoughts.prefetch.keep(theta, result)
    # While it ran, another one may have been answered, which changes its number.
    index = next((s.index for s in flow.study.unfinished if s.theta == sample.theta), None)
    if index is None or flow.phase is Phase.OVER:
        return None
    if flow.phase not in (Phase.RUNNING, Phase.RECORD, Phase.CONFIRM):
        return _ran_beside(flow, index, result, theta)
    try:
        if isinstance(result, Experiment):
            flow.append((Finished(index), result))
            return flow.proceed()
        due = flow.state.history.answered
        flow.append(*([] if index == due else [Taken(index)]), Failed(due, in_words(result)))
    except StudyError as error:
        return flow.move(Phase.FAILED, error)
    return flow.move(Phase.FAILED, result)


def _ran_beside(
    flow: Flow, index: int, result: Experiment | Exception, theta: Float[np.ndarray, " n"]
) -> None:
    """Save the experiment of pending sample `index`; its failure is shown when it is due."""
    if flow.at_once == 1:
        return
    if isinstance(result, Experiment):
        flow.append((Finished(index), result))
    else:
        flow.thoughts.prefetch.keep_failure(theta, result)
    flow.version += 1


def _go_on_running(flow: Flow) -> None:
    """Proceed, unless an undo, a retraction or the end did so before the lock was acquired.

    Proceeding twice would show the same question again under another id.
    """
    if flow.phase is Phase.RUNNING:
        flow.proceed()


def attempt(
    flow: Flow, run: Run, theta: Float[np.ndarray, " n"], twin: Scenario | None = None
) -> Experiment | Exception | None:
    """Advance a run of θ; return its experiment, its error, or None if it asks a person first.

    Until one experiment passed without interruption, each is checked against the scenario, and
    always if it is one of the `twin` or of a plant. SystemExit and the like of a user's code are
    caught, too: a function that calls exit() would end the thread without notice. Only
    KeyboardInterrupt is raised again: it may be Ctrl-C. What ends the process ends a run on a plant.
    """
    scenario = twin or flow.store.scenario
    attended = bool(scenario.source.asks)
    try:
        result: object = run.advance()
        if result is None and run.waits:
            return None
        if flow.underway.checked and twin is None and not attended and isinstance(result, Experiment):
            return result
        experiment = check_experiment(scenario, theta, result)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if attended and not isinstance(error, Exception | SystemExit):
            raise
        return as_exception(error)
    if twin is None:
        flow.underway.checked = not experiment.end.interrupted
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
        known = flow.file.find_experiment(theta)
        found = flow.thoughts.prefetch.experiment(theta)
    if known is not None:
        return flow.file.experiment(known)
    if found is not None:
        return found
    with _ONE_AT_A_TIME:
        result = _looked_at(flow, lock, theta)
    if not isinstance(result, Experiment):
        raise ScenarioError(f"this simulation failed: {result}") from result
    if flow.thoughts.twin is None:
        with lock:
            flow.thoughts.prefetch.keep(theta, result)
    return result


def _looked_at(
    flow: Flow, lock: threading.Condition, theta: Float[np.ndarray, " n"]
) -> Experiment | Exception | None:
    key = b"look " + theta_key(theta)
    with lock:
        run = (flow.thoughts.twin or flow.store.scenario).source.begin(theta.copy(), seed=flow.study.seed)
        flow.underway.going[key] = run  # so that it makes way for what is waited for
    try:
        return attempt(flow, run, theta, flow.thoughts.twin)
    finally:
        with lock:
            del flow.underway.going[key]


def _looking_ahead(flow: Flow) -> Attempt | None:
    """Run the θ that a copy of the agent proposes after a likely answer, or let one propose it."""
    asked = flow.question
    assert asked is not None
    if asked.repeats is not None:
        return None
    if flow.thoughts.prefetch.next is not None:
        return _running_ahead(flow, flow.thoughts.prefetch.next)
    return thinking.look_ahead(flow, asked, lambda theta: _is_known(flow, theta))


def _running_ahead(flow: Flow, theta: Float[np.ndarray, " n"]) -> Attempt:
    """Run θ before it is needed."""
    flow.thoughts.prefetch.next = None
    run = flow.underway.begin(theta)

    def advance() -> Callable[[], None]:
        result = attempt(flow, run, theta)

        def keep() -> None:
            flow.underway.end(theta, result)
            if isinstance(result, Experiment):
                flow.thoughts.prefetch.keep(theta, result)
            elif isinstance(result, RunError) and result.why in (*UNBIDDEN, "stopped"):
                flow.thoughts.prefetch.keep_failure(theta, result)

        return keep

    return advance


def _is_known(flow: Flow, theta: Float[np.ndarray, " n"]) -> bool:
    """Return whether θ has run: in the study, for example before an undo, or as a prefetch."""
    return flow.file.find_experiment(theta) is not None or flow.thoughts.prefetch.is_known(theta)


def _pending(flow: Flow, index: int, then: str = "nothing was changed") -> Suggested:
    """Return the pending sample. Raises StaleError unless its index is `index`."""
    pending = flow.study.pending
    if pending is None or pending.index != index:
        raise StaleError(f"experiment {index + 1} is no longer waited for: {then}")
    return pending


def confirm(flow: Flow, index: int) -> None:
    """Let the run of the pending sample start, with the values that the person was shown."""
    run = flow.underway.of(_pending(flow, index, "nothing was written"))
    assert run is not None
    assert run.changes is not None
    run.supply(run.changes)
    run.waits, run.moves_plant = False, True
    flow.move(Phase.RUNNING)


def stop(flow: Flow, index: int) -> None:
    """Stop the run of the pending sample, which then counts as failed."""
    underway, pending = flow.underway, _pending(flow, index)
    run, key = underway.of(pending), theta_key(pending.theta)
    if underway.source.asks:
        flow.version += 1
    elif flow.at_once == 1:
        for other in (run for name, run in underway.going.items() if name != key):
            other.stop("given up")  # it runs in the only process
    if run is not None:
        run.stop("stopped")


def fail(flow: Flow, index: int, reason: str = "") -> None:
    """Count the run of the pending sample as failed: an experiment without a record."""
    key = theta_key(_pending(flow, index).theta)
    noted = [Noted(f"experiment {index + 1} failed: {reason}")] if reason else []
    partial = flow.underway.partial.pop(key, None)
    flow.append(*noted, (Finished(index), partial or flow.store.failed(index)))
    flow.proceed()


def retry(flow: Flow) -> None:
    """Retry what failed, in phase FAILED: a run, or writing the study file.

    In phase CONFIRM, read the live plant's present values again.
    """
    underway, study = flow.underway, flow.study
    on_the_plant = flow.phase is Phase.CONFIRM or underway.plant.recovery is Recovery.FAILED
    if on_the_plant:
        underway.plant.is_due()
        flow.version += 1
    if flow.phase is Phase.CONFIRM and study.pending is not None:
        underway.wait_for(study.pending, study.unfinished, anew=True)
    if flow.phase is Phase.FAILED:
        flow.move(Phase.RUNNING)
        if study.pending is not None and not underway.source.asks:
            underway.wait_for(study.pending, study.unfinished)


def finish(flow: Flow) -> None:
    """End the study at the person's request."""
    best, marks = flow.study.best, flow.state.marks
    good = best is not None and GOOD_ENOUGH in marks.get(best, frozenset())
    flow.append(Ended(GOOD_ENOUGH if good else "stopped"))
    flow.proceed()


def go_on(flow: Flow, more: int = 0) -> None:
    """Reopen the ended study, with `more` additional experiments."""
    state = flow.state
    if more < 0 or (more == 0 and state.history.answered >= state.n_max):
        raise StaleError(f"all {state.n_max} experiments are compared: say how many more")
    extended = [Extended(state.n_max + more)] if more else []
    flow.append(*extended, Reopened())
    flow.agent = agent_of(flow.state, flow.store.scenario.space, flow.thoughts.simulator)
    flow.proceed()
