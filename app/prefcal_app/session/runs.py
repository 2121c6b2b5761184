"""Let the agent think and experiments run, while a study waits for them: what is due, done and supplied."""

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import cast

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Agent
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import findings
from prefcal_app.simulating import Abandoned, Screened
from prefcal_env.errors import KnobError, RecordError, RunError, ScenarioError, StaleError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import theta_key
from prefcal_env.preferences.answer import Outcome, counts_as_unsafe
from prefcal_env.sources import Run, Table
from prefcal_env.study import (
    Concluded,
    Dialed,
    Ended,
    Extended,
    Failed,
    Finished,
    Noted,
    Reopened,
    Replaced,
    Suggested,
    Taken,
)
from prefcal_env.wording import as_exception, in_words
from prefcal_scenarios.runs import outcome
from prefcal_scenarios.scenario import Scenario, check_experiment

from .flow import LIKELIEST, LIKELY, Attempt, Flow, refusal
from .study import GOOD_ENOUGH, Phase, Question, Recovery, agent_of

# --- Let the agent choose queries in the background: it may simulate for seconds, without a lock.


def think(flow: Flow) -> Attempt:
    """Choose the next query, then show it or run its experiment.

    A copy of the agent does it, since the person may undo or retract an answer meanwhile.
    """
    history, twin = flow.agent.history, flow.agent.copy()
    flow.thoughts.about = history
    flow.thoughts.resume()

    def choose() -> Callable[[], None]:
        try:
            screened = _screened(flow, twin)
        except Abandoned:
            return lambda: None

        def keep() -> None:
            flow.thoughts.about = None
            if flow.agent.history == history and flow.phase is Phase.RUNNING:
                flow.thoughts.screened = screened or flow.thoughts.screened
                # A question that was already open, before a restart, stays open under its id.
                flow.resume()

        return keep

    return choose


def look_ahead(flow: Flow, asked: Question) -> Attempt | None:
    """Tell a copy of the agent the next likely answer to the open question; None if all were tried.

    Errors are ignored here, since that answer may never be given. If it is, the same work is done
    again, and an error is shown.
    """
    most = len(LIKELY) if flow.thoughts.simulator is None else LIKELIEST
    answer = flow.thoughts.prefetch.missing(asked, most)
    if answer is None:
        return None
    query, twin = flow.agent.ask(), flow.agent.copy()
    flow.thoughts.prefetch.busy = answer
    flow.thoughts.resume()

    def look() -> Callable[[], None]:
        try:
            twin.tell(query, answer)
            told = twin.history
            screened = _screened(flow, twin)
            theta = None if twin.done else twin.ask().challenger.theta
        except Exception:
            return lambda: _rest(flow)

        def keep() -> None:
            _rest(flow)
            if flow.question is asked:
                flow.thoughts.prefetch.keep_screened(answer, screened)
                if theta is not None and not _is_known(flow, theta):
                    flow.thoughts.prefetch.next = theta
                return
            waits = flow.phase is Phase.RUNNING and flow.agent.history.pending is None
            if waits and flow.agent.history == told:  # the answer came meanwhile, and it is this one
                flow.thoughts.screened = screened or flow.thoughts.screened
                flow.proceed()

        return keep

    return look


def is_unexplained(flow: Flow) -> bool:
    """Return whether it is not known what the open question was chosen from.

    That is so after a restart, after the last answer, and if the person asked for a θ.
    """
    thoughts = flow.thoughts
    unknown = thoughts.simulator is not None and thoughts.grounds(flow.agent) is None
    return unknown and not thoughts.prefetch.silent


def is_unsaid(flow: Flow) -> bool:
    """Return whether something is left to be said of the open question or, at the end, of the result."""
    known, found = flow.thoughts.grounds(flow.agent), flow.findings
    if known is None or found is None or flow.thoughts.prefetch.silent:
        return is_unexplained(flow)
    return not found.complete or found.over is not (flow.phase is Phase.OVER)


def say(flow: Flow) -> Attempt:
    """Work out the next part of what is said of the open question or, at the end, of the result.

    Errors are ignored: the question can be answered, and the result is one without it.
    """
    asked, twin, found = flow.question, cast(Screening, flow.agent.copy()), flow.findings
    over, explains = flow.phase is Phase.OVER, is_unexplained(flow)
    flow.thoughts.resume()

    def work_out() -> Callable[[], None]:
        screened = None
        with suppress(Exception):
            # After a restart, what was said is known, but not what was simulated.
            more = found if explains and found is not None else findings(twin, found, over=over)
            screened = Screened.of(twin, more)

        def keep() -> None:
            if flow.question is not asked:
                return
            flow.thoughts.screened = screened or flow.thoughts.screened
            flow.thoughts.prefetch.silent = screened is None
            flow.version += 1
            _conclude(flow)

        return keep

    return work_out


def _conclude(flow: Flow) -> None:
    """Keep what is said of the result in the study file, once that is all."""
    found, over = flow.findings, flow.phase is Phase.OVER and flow.state.concluded is None
    if over and found is not None and found.over and found.complete:
        with suppress(StudyError):  # it is shown all the same, and follows from the record
            flow.append(Concluded(found.to_dict()))


def _rest(flow: Flow) -> None:
    flow.thoughts.prefetch.busy = None


def _screened(flow: Flow, twin: Agent) -> Screened | None:
    """Let `twin` choose its next query; return what it was chosen from, if it simulates.

    A question can be answered without its reason, so no error of that is raised; one of the
    simulations is.
    """
    if twin.done:
        return None
    twin.ask()
    if flow.thoughts.simulator is None:
        return None
    screening = cast(Screening, twin)
    _ = screening.bank
    try:
        return Screened.of(screening)
    except Abandoned:
        raise
    except Exception:
        return None


# --- Preview, save and replace the records of a rig.


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
    experiment = check_experiment(flow.store.scenario, theta, run.advance())
    standing = [c for c in flow.state.history.counting if c.incumbent is not None and not c.retracted]
    retracts = sum(given.index in (c.challenger, c.incumbent) for c in standing)
    return Preview(experiment, _same(flow, given.index, experiment), retracts)


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
    if (refused := refusal(flow, "record")) is not None:
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
        comparable = other != index and len(theirs[0]) and len(mine) == len(theirs)
        if comparable and all(map(np.array_equal, mine, theirs)):
            return other
    return None


def _curves(experiment: Experiment) -> list[np.ndarray]:
    """Return everything that a record holds; outputs only if they are no states."""
    arrays = [experiment.t, experiment.x, experiment.u]
    return arrays if experiment.y is None else [*arrays, experiment.y]


# --- Run the experiments of an interview, handle failed and stopped runs, and end the study.

UNBIDDEN = ("late", "died")
"""Reasons for a run without an experiment that neither the person nor their code gave."""
_ONE_AT_A_TIME = threading.Lock()  # held during a look: clicking through many θ must not keep every core busy


def due(flow: Flow, *, ahead: bool) -> Attempt | None:
    """Return the next piece of work; None if there is none."""
    underway, study = flow.underway, flow.study
    if underway.plant.recovery is Recovery.DUE:
        return _restoring(flow)
    if flow.phase in (Phase.RECORD, Phase.CONFIRM) or underway.moves_plant:
        return _attended(flow)
    if flow.phase is Phase.RUNNING:
        if study.must_think:
            return think(flow)
        pending = study.pending
        if pending is None or pending.index in flow.state.finished or underway.source.asks:
            return lambda: lambda: _go_on_running(flow)
        if flow.at_once > 1:
            return _beside(flow) if flow.proposed else lambda: lambda: _go_on_running(flow)
        return _running(flow, pending)
    if flow.phase is Phase.QUESTION and is_unexplained(flow):
        return say(flow)
    if flow.phase is Phase.OVER and is_unsaid(flow):
        return say(flow)
    if flow.at_once > 1:
        return _beside(flow) if flow.phase in (Phase.QUESTION, Phase.FAILED) else None
    if flow.phase is not Phase.QUESTION:
        return None
    looking = _looking_ahead(flow) if ahead and not underway.source.asks else None
    if looking is None and is_unsaid(flow):
        return say(flow)
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
    return look_ahead(flow, asked)


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
