"""Preview, save and replace the records of a rig."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import KnobError, RecordError, StaleError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.kpis import Outcome
from prefcal_env.preferences.loop import counts_as_unsafe
from prefcal_env.sources import Table
from prefcal_env.study import Dialed, Finished, Replaced
from prefcal_scenarios.kpis import outcome
from prefcal_scenarios.own.checks import check_experiment

from .can import refusal
from .flow import Flow
from .study.now import Phase


@dataclass(frozen=True, slots=True)
class Given:
    """Record as the person provides it.

    Args:
        index: Index of the experiment, from 0.
        content: Content of the CSV file.
        unsafe: Whether the run became unsafe and was stopped.
        theta: Physical θ that was really set, one number per knob; None for the proposed one.
        again: Whether to accept the same curves as another experiment's.
    """

    index: int
    content: bytes
    unsafe: bool = False
    theta: tuple[float, ...] | None = None
    again: bool = False


@dataclass(frozen=True, slots=True)
class Preview:
    """Preview of what would be saved.

    Args:
        experiment: Experiment as read from the record.
        same: Index of another experiment with identical curves; None if there is none.
        retracts: Number of answers that would no longer teach anything.
    """

    experiment: Experiment
    same: int | None
    retracts: int


def preview(flow: Flow, given: Given) -> Preview:
    """Read a record, and save nothing.

    Raises:
        StaleError: If the record is not awaited and cannot replace one.
        RecordError: If the record or the θ that was set is refused.
    """
    _check_due(flow, given.index)
    theta = _dialed(flow, given)
    if theta is None:
        theta = np.array(flow.state.history.samples[given.index].theta)
    run = flow.underway.source.begin(theta, seed=flow.study.seed)
    run.supply(Table(given.content, given.unsafe))
    experiment = run.advance()
    experiment = check_experiment(flow.store.scenario, theta, experiment)
    return Preview(experiment, _same(flow, given.index, experiment), len(_about(flow, given.index)))


def record(flow: Flow, given: Given) -> None:
    """Save the record of the pending sample, or replace an earlier experiment's.

    Raises:
        StaleError: As in `preview`.
        RecordError: As in `preview`, or if the curves equal another experiment's and `again` is
            not set.
        StudyError: If the study file cannot be written.
    """
    seen, index = preview(flow, given), given.index
    if seen.same is not None and not given.again:
        raise RecordError(
            f"these are the curves of experiment {seen.same + 1}: is it the file of another run?"
        )
    theta = _dialed(flow, given)
    events: list[Dialed | Replaced] = []
    if theta is not None:
        z = flow.store.scenario.space.encode(theta)
        events.append(Dialed(index, tuple(z.tolist()), tuple(theta.tolist())))
    replaces = index in flow.state.finished
    if replaces:
        known = Outcome(outcome(flow.store.scenario, seen.experiment)).to_dict()
        events.append(Replaced(index, known, counts_as_unsafe(seen.experiment)))
    flow.append(*events, (Finished(index), seen.experiment))
    if not replaces or flow.phase is Phase.QUESTION:
        flow.proceed()  # a question about the wrong curves is asked again, under another id
    else:
        flow.version += 1


def _check_due(flow: Flow, index: int) -> None:
    """Refuse a record that is neither waited for nor can replace one."""
    refused = refusal(flow, "record")
    if refused is not None:
        raise refused
    pending = flow.study.pending
    due = flow.phase is Phase.RECORD and pending is not None and pending.index == index
    if not due and index not in flow.state.finished:
        raise StaleError(f"experiment {index + 1} is no longer waited for: nothing was changed")


def _dialed(flow: Flow, given: Given) -> Float[np.ndarray, " n"] | None:
    """Return the θ that was really set, shape (n,); None if it equals the sample's."""
    if given.theta is None:
        return None
    index, space = given.index, flow.store.scenario.space
    try:
        theta = space.decode(space.encode(space.check_allowed(np.array(given.theta))))
    except KnobError as error:
        raise RecordError(f"what you set cannot be learned from: {error}") from error
    samples = flow.state.history.samples
    if np.array_equal(theta, samples[index].theta):
        return None
    if index != flow.state.history.answered:
        raise RecordError(f"experiment {index + 1} was compared already: its θ stays")
    for i, earlier in enumerate(samples[:index]):
        if np.array_equal(theta, earlier.theta):
            raise RecordError(f"experiment {i + 1} was run with exactly the θ that you set")
    return theta


def _same(flow: Flow, index: int, experiment: Experiment) -> int | None:
    """Return another experiment with the same curves, even if its file was saved again."""
    mine = _curves(experiment)
    for other in sorted(flow.state.finished):
        theirs = _curves(flow.store.experiment(other))
        if other == index or not len(theirs[0]) or len(mine) != len(theirs):
            continue
        if all(map(np.array_equal, mine, theirs)):
            return other
    return None


def _curves(experiment: Experiment) -> list[np.ndarray]:
    """Return everything that a record holds; outputs only if they are no states."""
    arrays = [experiment.t, experiment.x, experiment.u]
    return arrays if experiment.y is None else [*arrays, experiment.y]


def _about(flow: Flow, index: int) -> list[int]:
    """Return the event numbers of the standing answers about experiment `index`."""
    answers = flow.state.history.counting
    return [
        c.seq
        for c in answers
        if c.incumbent is not None and not c.retracted and index in (c.challenger, c.incumbent)
    ]
