"""Let the agent think and experiments run, while a study waits for them: what is due, done and supplied."""

import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Agent
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import findings
from prefcal_app.simulating import Abandoned, Screened
from prefcal_env.errors import KnobError, RecordError, RunError, ScenarioError, StaleError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import theta_key
from prefcal_env.preferences.answer import Answer, Outcome, counts_as_unsafe
from prefcal_env.preferences.history import History
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

from .flow import LIKELIEST, LIKELY, Flow, refusal
from .study import GOOD_ENOUGH, Phase, Question, Recovery, agent_of

# --- Let the agent choose queries in the background: it may simulate for seconds, without a lock.

Found = TypeVar("Found")
Theta = Float[np.ndarray, " n"]


class Job(Protocol[Found]):
    """A piece of work that was prepared with the interview's lock held."""

    def run(self) -> Found:
        """Do what takes long, without the lock, and return what came of it."""

    def finish(self, flow: Flow, found: Found) -> None:
        """Take what came of it, with the lock held again: the person may have done anything meanwhile."""


class Choose:
    """Choose the next query, then show it or run its experiment.

    A copy of the agent does it, since the person may undo or retract an answer meanwhile.
    """

    def __init__(self, flow: Flow) -> None:
        self.history, self.twin = flow.agent.history, flow.agent.copy()
        self.simulates = flow.thoughts.simulator is not None
        flow.thoughts.about = self.history
        flow.thoughts.resume()

    def run(self) -> Screened | Abandoned | None:
        """Return what the query was chosen from, if the agent simulates."""
        try:
            return _let_choose(self.twin, self.simulates)
        except Abandoned as given_up:
            return given_up

    def finish(self, flow: Flow, found: Screened | Abandoned | None) -> None:
        """Show the query, or let its experiment run."""
        if isinstance(found, Abandoned):
            return
        flow.thoughts.about = None
        if flow.agent.history.key == self.history.key and flow.phase is Phase.RUNNING:
            flow.thoughts.screened = found or flow.thoughts.screened
            # A question that was already open, before a restart, stays open under its id.
            flow.resume()


class LookAhead:
    """Tell a copy of the agent a likely answer to the open question.

    Errors are ignored here, since that answer may never be given. If it is, the same work is done
    again, and an error is shown.
    """

    def __init__(self, flow: Flow, asked: Question, answer: Answer) -> None:
        self.asked, self.answer, self.query = asked, answer, flow.agent.ask()
        self.twin, self.simulates = flow.agent.copy(), flow.thoughts.simulator is not None
        flow.thoughts.prefetch.busy = answer
        flow.thoughts.resume()

    def run(self) -> tuple[History, Screened | None, Theta | None] | None:
        """Return the record with that answer, what is chosen from then, and which θ; None after an error."""
        twin = self.twin
        with suppress(Exception):
            twin.tell(self.query, self.answer)
            told = twin.history
            return told, _let_choose(twin, self.simulates), None if twin.done else twin.ask().challenger.theta
        return None

    def finish(self, flow: Flow, found: tuple[History, Screened | None, Theta | None] | None) -> None:
        """Keep it for the case that this is the answer, and go on if it was given already."""
        flow.thoughts.prefetch.busy = None
        if found is None:
            return
        told, screened, theta = found
        if flow.question is self.asked:
            flow.thoughts.prefetch.keep_screened(self.answer, screened)
            if theta is not None and not _is_known(flow, theta):
                flow.thoughts.prefetch.next = theta
            return
        waits = flow.phase is Phase.RUNNING and flow.agent.history.pending is None
        if waits and flow.agent.history.key == told.key:  # the answer came meanwhile, and it is this one
            flow.thoughts.screened = screened or flow.thoughts.screened
            flow.proceed()


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


class Say:
    """Work out the next part of what is said of the open question or, at the end, of the result.

    Errors are ignored: the question can be answered, and the result is one without it.
    """

    def __init__(self, flow: Flow) -> None:
        self.asked, self.twin, self.found = flow.question, cast(Screening, flow.agent.copy()), flow.findings
        self.over, self.explains = flow.phase is Phase.OVER, is_unexplained(flow)
        flow.thoughts.resume()

    def run(self) -> Screened | None:
        """Return what is known with that part; None after an error."""
        with suppress(Exception):
            # After a restart, what was said is known, but not what was simulated.
            said = self.found if self.explains else None
            return Screened.of(self.twin, said or findings(self.twin, self.found, over=self.over))
        return None

    def finish(self, flow: Flow, found: Screened | None) -> None:
        """Let it be seen and, once all is said of the result, keep that in the study file."""
        if flow.question is not self.asked:
            return
        flow.thoughts.screened = found or flow.thoughts.screened
        flow.thoughts.prefetch.silent = found is None
        flow.version += 1
        said, over = flow.findings, flow.phase is Phase.OVER and flow.state.concluded is None
        if over and said is not None and said.over and said.complete:
            with suppress(StudyError):  # it is shown all the same, and follows from the record
                flow.append(Concluded(said.to_dict()))


def _let_choose(twin: Agent, simulates: bool) -> Screened | None:
    """Let `twin` choose its next query; return what it was chosen from, if it simulates.

    A question can be answered without its reason, so no error of that is raised; one of the
    simulations is.
    """
    if twin.done:
        return None
    twin.ask()
    if not simulates:
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


def due(flow: Flow, *, ahead: bool) -> Job[Any] | None:
    """Return the next piece of work; None if there is none, or if it took no time and is done."""
    underway, study = flow.underway, flow.study
    if underway.plant.recovery is Recovery.DUE:
        return Restore(flow)
    if flow.phase in (Phase.RECORD, Phase.CONFIRM) or underway.moves_plant:
        return _attended(flow)
    if flow.phase is Phase.RUNNING:
        if study.must_think:
            return Choose(flow)
        pending = study.pending
        if pending is None or pending.index in flow.state.finished or underway.source.asks:
            return GoOn()
        if flow.at_once > 1:
            return _beside(flow) if flow.proposed else GoOn()
        return _running(flow, pending)
    if flow.phase is Phase.QUESTION and is_unexplained(flow):
        return Say(flow)
    if flow.phase is Phase.OVER and is_unsaid(flow):
        return Say(flow)
    if flow.at_once > 1:
        return _beside(flow) if flow.phase in (Phase.QUESTION, Phase.FAILED) else None
    if flow.phase is not Phase.QUESTION:
        return None
    looking = _looking_ahead(flow) if ahead and not underway.source.asks else None
    return Say(flow) if looking is None and is_unsaid(flow) else looking


class Restore:
    """Restore a plant's old values."""

    def __init__(self, flow: Flow) -> None:
        self.recovery = flow.underway.plant.recover()
        self.recovery.changed = flow.underway.changed

    def run(self) -> str:
        """Return why it failed; empty if it did not."""
        try:
            self.recovery.advance()
        except Exception as error:  # whatever it is, the old values may be missing
            return str(error) or type(error).__name__
        return ""

    def finish(self, flow: Flow, found: str) -> None:
        """Tell front ends."""
        flow.underway.plant.recovered(found)
        flow.version += 1


class GoOn:
    """Proceed, where nothing takes long."""

    def run(self) -> None:
        """Do nothing."""

    def finish(self, flow: Flow, found: None) -> None:
        """Proceed, unless an undo, a retraction or the end did so before the lock was acquired.

        Proceeding twice would show the same question again under another id.
        """
        if flow.phase is Phase.RUNNING:
            flow.proceed()


class RunAhead:
    """Run θ, physical, shape (n,), before it is needed."""

    def __init__(self, flow: Flow, theta: Theta) -> None:
        self.flow, self.theta, self.going = flow, theta, flow.underway.begin(theta)

    def run(self) -> Experiment | Exception | None:
        """Return its experiment, its error, or None if it asks a person first."""
        return attempt(self.flow, self.going, self.theta)

    def finish(self, flow: Flow, found: Experiment | Exception | None) -> None:
        """Keep the result for the case that it is needed."""
        flow.underway.end(self.theta, found)
        if isinstance(found, Experiment):
            flow.thoughts.prefetch.keep(self.theta, found)
        elif isinstance(found, RunError) and found.why in (*UNBIDDEN, "stopped"):
            flow.thoughts.prefetch.keep_failure(self.theta, found)


class RunSample(RunAhead):
    """Run a pending sample: its result is recorded."""

    def __init__(self, flow: Flow, sample: Suggested) -> None:
        super().__init__(flow, np.array(sample.theta))
        self.sample = sample

    def finish(self, flow: Flow, found: Experiment | Exception | None) -> None:
        """Take the result."""
        flow.underway.end(self.theta, found)
        flow.version += found is None  # front ends show what it asks
        # Not a failure if it was given up: it runs again when it is needed again.
        given_up = isinstance(found, RunError) and found.why == "given up"
        if found is not None and not given_up:
            _ran(flow, self.sample, found)


def _attended(flow: Flow) -> RunSample | None:
    """Advance the run that a person attends to, unless it waits for them or for the plant."""
    underway, pending = flow.underway, flow.study.pending
    run = underway.of(pending)
    if run is None or pending is None or run.waits or underway.plant.recovery is not Recovery.DONE:
        return None
    return _running(flow, pending)


def _beside(flow: Flow) -> RunSample | None:
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


def _running(flow: Flow, sample: Suggested) -> RunSample | None:
    """Run a pending sample; None if its result is known already, and taken now."""
    theta = np.array(sample.theta)
    known = flow.thoughts.prefetch.experiment(theta) or flow.thoughts.prefetch.take_failure(theta)
    if known is None:
        return RunSample(flow, sample)
    # At once, since another thread would run it again meanwhile.
    flow.underway.end(theta, known)
    _ran(flow, sample, known)
    return None


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


def _ran_beside(flow: Flow, index: int, result: Experiment | Exception, theta: Theta) -> None:
    """Save the experiment of pending sample `index`; its failure is shown when it is due."""
    if flow.at_once == 1:
        return
    if isinstance(result, Experiment):
        flow.append((Finished(index), result))
    else:
        flow.thoughts.prefetch.keep_failure(theta, result)
    flow.version += 1


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


def _looked_at(flow: Flow, lock: threading.Condition, theta: Theta) -> Experiment | Exception | None:
    key = b"look " + theta_key(theta)
    with lock:
        run = (flow.thoughts.twin or flow.store.scenario).source.begin(theta.copy(), seed=flow.study.seed)
        flow.underway.going[key] = run  # so that it makes way for what is waited for
    try:
        return attempt(flow, run, theta, flow.thoughts.twin)
    finally:
        with lock:
            del flow.underway.going[key]


def _looking_ahead(flow: Flow) -> RunAhead | LookAhead | None:
    """Run the θ that a copy of the agent proposes after a likely answer, or let one propose it."""
    asked, theta = flow.question, flow.thoughts.prefetch.next
    assert asked is not None
    if asked.repeats is not None:
        return None
    if theta is not None:
        flow.thoughts.prefetch.next = None
        return RunAhead(flow, theta)
    most = len(LIKELY) if flow.thoughts.simulator is None else LIKELIEST
    answer = flow.thoughts.prefetch.missing(asked, most)
    return None if answer is None else LookAhead(flow, asked, answer)


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
