"""Let an interview drive its live plant, once the person has confirmed each run."""

from collections.abc import Callable

import numpy as np

from prefcal_app.session.flow import Flow
from prefcal_app.session.thinking import Attempt
from prefcal_app.session.view import Phase
from prefcal_env.errors import LiveError, RunError, StaleError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.live import Driven, LiveRig
from prefcal_env.study import Suggested
from prefcal_scenarios.own.checks import check_experiment

from .state import Recovery


def live_of(flow: Flow) -> LiveRig | None:
    """Return the live rig of the scenario; None if it has none."""
    run = flow.store.scenario.run
    return run if isinstance(run, LiveRig) else None


def is_driving(flow: Flow) -> bool:
    """Return whether a run is in progress, or about to start."""
    return flow.live.confirmed is not None


def is_unrestored(flow: Flow) -> bool:
    """Return whether the plant's old values are missing, and a person must help."""
    return flow.live.recovery is Recovery.FAILED


def due(flow: Flow, rig: LiveRig) -> Attempt | None:
    """Return the next piece of work on the plant; None if there is none."""
    if flow.live.recovery is Recovery.DUE:
        return _recovering(flow, rig)
    if flow.live.recovery is not Recovery.DONE and flow.phase is Phase.CONFIRM:
        return None
    pending = flow.pending
    if flow.phase is Phase.CONFIRM and pending is not None and not flow.live.looked:
        return _looking(flow, rig, pending)
    confirmed = flow.live.confirmed
    if flow.phase is Phase.RUNNING and pending is not None and confirmed == pending.index:
        return _running(flow, rig, pending)
    return None


def confirm(flow: Flow, index: int) -> None:
    """Let the run of the pending sample start, with the values that the person was shown.

    Raises:
        StaleError: If it is not waited for, or the plant's present values are not known.
    """
    pending = flow.pending
    if pending is None or pending.index != index or flow.phase is not Phase.CONFIRM:
        raise StaleError(f"experiment {index + 1} is no longer waited for: nothing was written")
    if is_unrestored(flow):
        raise StaleError("the plant does not have its old values yet: nothing was written")
    if flow.live.changes is None:
        raise StaleError("the plant's present values are not known yet: nothing was written")
    flow.live.confirmed = index
    flow.live.begin()
    flow.move(Phase.RUNNING)


def look_again(flow: Flow) -> None:
    """Read the plant's present values again; first restore the old ones if they are missing."""
    flow.live.ask()
    flow.live.problem, flow.live.recovery = "", Recovery.DUE
    flow.version += 1


def stop(flow: Flow, index: int) -> None:
    """Stop the run of sample `index`; the old values are restored.

    Raises:
        StaleError: If it is not in progress.
    """
    if flow.live.confirmed != index:
        raise StaleError(f"experiment {index + 1} is not running: nothing was changed")
    flow.live.stop.set()
    flow.version += 1


def _recovering(flow: Flow, rig: LiveRig) -> Attempt:
    """Restore what an interrupted run left on the plant."""
    live = flow.live
    live.recovery = Recovery.RUNNING

    def recover() -> Callable[[], None]:
        problem = ""
        try:
            rig.recover(closing=live.closing.is_set, tell=live.tell)
        except Exception as error:  # whatever it is, the old values may be missing
            problem = str(error) or type(error).__name__

        def done() -> None:
            live.problem = problem
            live.recovery = Recovery.FAILED if problem else Recovery.DONE
            live.end()
            flow.version += 1

        return done

    return recover


def _looking(flow: Flow, rig: LiveRig, sample: Suggested) -> Attempt:
    """Read the plant's present values, for the person to compare with the new ones."""
    live = flow.live
    live.looked = True

    def look() -> Callable[[], None]:
        try:
            changes, problem = rig.look(np.array(sample.theta)), ""
        except LiveError as error:
            changes, problem = (), str(error)

        def done() -> None:
            if flow.phase is Phase.CONFIRM and flow.pending == sample:
                live.changes, live.problem = changes or None, problem
                flow.version += 1

        return done

    return look


def _running(flow: Flow, rig: LiveRig, sample: Suggested) -> Attempt:
    live, agreed, theta = flow.live, flow.live.changes, np.array(sample.theta)

    def run() -> Callable[[], None]:
        result: Driven | Exception
        try:
            result = rig.drive(
                theta,
                lambda changes: changes == agreed,
                stop=live.stop.is_set,
                closing=live.closing.is_set,
                tell=live.tell,
            )
        except Exception as error:
            result = error
        return lambda: _finish(flow, sample, result)

    return run


def _finish(flow: Flow, sample: Suggested, result: Driven | Exception) -> None:
    """Save what was recorded, or show why there is nothing to save."""
    live = flow.live
    live.end()
    live.ask()
    if isinstance(result, Exception):
        live.recovery = Recovery.DUE  # nobody knows how far it came; the journal does
        return flow.ran(sample, result)
    if not (result.restored or result.kept):
        live.problem = (
            f"the plant does not have its old values yet: {result.problem}. They are restored first"
        )
        live.recovery = Recovery.DUE
    experiment = result.experiment
    if not result.why or not _has_failed(experiment):
        try:
            flow.ran(sample, check_experiment(flow.store.scenario, experiment.theta, experiment))
        except Exception as error:
            live.partial = experiment
            flow.ran(sample, error)
        return None
    live.partial = experiment if len(experiment.t) else None
    restored = "The old values are restored" if result.restored else live.problem
    words = f"{result.why}. {restored}."
    return flow.ran(sample, RunError(words, "stopped" if result.stopped else "raised"))


def _has_failed(experiment: Experiment) -> bool:
    return experiment.end.value == "failed"
