"""Let the agent think and experiments run, while a study waits for them: what is due, and done."""

import threading
from contextlib import suppress
from typing import Any, Protocol, TypeVar, cast

import numpy as np
from jaxtyping import Float

from prefcal_agents.agent import Agent
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import findings
from prefcal_app.simulating import Abandoned, Screened
from prefcal_env.errors import RunError, ScenarioError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History, Point
from prefcal_env.sources import Run
from prefcal_env.study import Concluded, Failed, Finished, Suggested, Taken
from prefcal_env.wording import as_exception, in_words
from prefcal_scenarios.scenario import Scenario, check_experiment

from .driver import LIKELIEST, LIKELY, Driver, Trying
from .study import Moment, Phase, Question, Recovery

# --- Let the agent choose queries in the background: it may simulate for seconds, without a lock.

Found = TypeVar("Found")
Theta = Float[np.ndarray, " n"]


class Job(Protocol[Found]):
    """A piece of work that was prepared with the interview's lock held."""

    def run(self) -> Found:
        """Do what takes long, without the lock, and return what came of it."""

    def finish(self, driver: Driver, found: Found) -> None:
        """Take what came of it, with the lock held again: the person may have done anything meanwhile."""


class Think:
    """Choose the next query, then show it or run its experiment.

    A copy of the agent does it, since the person may undo or retract an answer meanwhile.
    """

    def __init__(self, driver: Driver) -> None:
        self.history, self.twin = driver.agent.history, driver.agent.copy()
        self.simulates = driver.thoughts.simulator is not None
        driver.thoughts.about = self.history
        driver.thoughts.resume()

    def run(self) -> Screened | Abandoned | None:
        """Return what the query was chosen from, if the agent simulates."""
        try:
            return _let_choose(self.twin, self.simulates)
        except Abandoned as given_up:
            return given_up

    def finish(self, driver: Driver, found: Screened | Abandoned | None) -> None:
        """Show the query, or let its experiment run."""
        if isinstance(found, Abandoned):
            driver.version += 1  # wakes the threads that wait
            return
        driver.thoughts.about = None
        if driver.agent.history.key == self.history.key and driver.phase is Phase.RUNNING:
            driver.thoughts.screened = found or driver.thoughts.screened
            # A question that was already open, before a restart, stays open under its id.
            driver.resume()


class LookAhead:
    """Tell a copy of the agent a likely answer to the open question.

    Errors are ignored here, since that answer may never be given. If it is, the same work is done
    again, and an error is shown.
    """

    def __init__(self, driver: Driver, asked: Question, answer: Answer) -> None:
        self.asked, self.answer, self.twin = asked, answer, driver.agent.copy()
        self.query, self.simulates = self.twin.ask(), driver.thoughts.simulator is not None
        driver.thoughts.prefetch.busy = answer
        driver.thoughts.resume()

    def run(self) -> tuple[History, Screened | None, Theta | None] | None:
        """Return the record with that answer, what is chosen from then, and which θ; None after an error."""
        twin = self.twin
        with suppress(Exception):
            twin.tell(self.query, self.answer)
            told = twin.history
            return told, _let_choose(twin, self.simulates), None if twin.done else twin.ask().challenger.theta
        return None

    def finish(self, driver: Driver, found: tuple[History, Screened | None, Theta | None] | None) -> None:
        """Keep it for the case that this is the answer, and go on if it was given already."""
        driver.thoughts.prefetch.busy = None
        if found is None:
            return
        told, screened, theta = found
        if driver.question is self.asked:
            driver.thoughts.prefetch.keep_screened(self.answer, screened)
            if theta is not None and not _is_known(driver, theta):
                driver.thoughts.prefetch.next = tuple(theta.tolist())
            return
        waits = driver.phase is Phase.RUNNING and driver.agent.history.pending is None
        if waits and driver.agent.history.key == told.key:  # the answer came meanwhile, and it is this one
            driver.thoughts.screened = screened or driver.thoughts.screened
            driver.proceed()


def is_unexplained(driver: Driver) -> bool:
    """Return whether it is not known what the open question was chosen from.

    That is so after a restart, after the last answer, and if the person asked for a θ.
    """
    thoughts = driver.thoughts
    unknown = thoughts.simulator is not None and thoughts.grounds(driver.agent) is None
    return unknown and not thoughts.prefetch.silent


def is_unsaid(driver: Driver) -> bool:
    """Return whether something is left to be said of the open question or, at the end, of the result."""
    known, found = driver.thoughts.grounds(driver.agent), driver.findings
    if known is None or found is None or driver.thoughts.prefetch.silent:
        return is_unexplained(driver)
    return not found.complete or found.over is not (driver.phase is Phase.OVER)


class Say:
    """Work out the next part of what is said of the open question or, at the end, of the result.

    Errors are ignored: the question can be answered, and the result is one without it.
    """

    def __init__(self, driver: Driver) -> None:
        self.asked, self.twin, self.found = (
            driver.question,
            cast(Screening, driver.agent.copy()),
            driver.findings,
        )
        self.over, self.explains = driver.phase is Phase.OVER, is_unexplained(driver)
        driver.thoughts.resume()

    def run(self) -> Screened | None:
        """Return what is known with that part; None after an error."""
        with suppress(Exception):
            # After a restart, what was said is known, but not what was simulated.
            said = self.found if self.explains else None
            return Screened.of(self.twin, said or findings(self.twin, self.found, over=self.over))
        return None

    def finish(self, driver: Driver, found: Screened | None) -> None:
        """Let it be seen and, once all is said of the result, keep that in the study file."""
        if driver.question is not self.asked:
            return
        driver.thoughts.screened = found or driver.thoughts.screened
        driver.thoughts.prefetch.silent = found is None
        driver.version += 1
        said, over = driver.findings, driver.phase is Phase.OVER and driver.state.concluded is None
        if over and said is not None and said.over and said.complete:
            with suppress(StudyError):  # it is shown all the same, and follows from the record
                driver.append(Concluded(said.to_dict()))


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


# --- Run the experiments of an interview, and take what comes of them.

UNBIDDEN = ("late", "died")
"""Reasons for a run without an experiment that neither the person nor their code gave."""
_ONE_AT_A_TIME = threading.Lock()  # held during a look: clicking through many θ must not keep every core busy


def due(driver: Driver, *, ahead: bool) -> Job[Any] | None:
    """Return the next piece of work; None if there is none, or if it is done already.

    What the study needs next is said by `Study.next` alone: while it runs, this only says who does
    it. What nobody waits for, such as looking ahead, is no matter of the study, so it is decided here.
    """
    underway, study, phase = driver.underway, driver.study, driver.study.phase
    if underway.plant.recovery is Recovery.DUE:
        return Restore(driver)
    tried = underway.plant.tried
    if tried is not None and not tried.run.waits:
        return TryOut(driver, tried)
    if phase in (Phase.RECORD, Phase.CONFIRM) or underway.moves_plant:
        return _attend(driver)
    if phase is Phase.RUNNING:
        if study.must_think:
            return Think(driver)
        if study.proposed and study.pending is not None:
            return _run(driver, study.pending) if driver.at_once == 1 else _run_another(driver)
        driver.proceed()  # a proposal takes up to a second, for which the lock is held
        return None
    if phase is Phase.OVER:
        return Say(driver) if is_unsaid(driver) else None
    if phase is Phase.QUESTION:
        return _due_while_asking(driver, ahead=ahead)
    return _run_another(driver) if driver.at_once > 1 else None


def _due_while_asking(driver: Driver, *, ahead: bool) -> Job[Any] | None:
    """Return what to do while a person looks at a question: nobody waits for it."""
    if driver.memory.is_due(driver.agent):
        return Keep(driver)
    if is_unexplained(driver):
        return Say(driver)
    if driver.at_once > 1:
        return _run_another(driver)
    looking = _look_ahead(driver) if ahead and not driver.underway.source.asks else None
    return Say(driver) if looking is None and is_unsaid(driver) else looking


class Restore:
    """Restore a plant's old values, or what was confirmed last."""

    def __init__(self, driver: Driver) -> None:
        self.settle = driver.settle
        self.recovery = driver.underway.plant.recover()
        self.recovery.changed = driver.underway.changed
        driver.version += 1  # front ends show that it has begun

    def run(self) -> str:
        """Return why it failed; empty if it did not."""
        try:
            self.settle()
            self.recovery.advance()
        except Exception as error:  # whatever it is, the old values may be missing
            return str(error) or type(error).__name__
        return ""

    def finish(self, driver: Driver, found: str) -> None:
        """Tell front ends."""
        driver.underway.plant.recovered(found)
        driver.version += 1


class TryOut:
    """Read a live plant, or have on it what a person tries until they confirm it or end the trial."""

    def __init__(self, driver: Driver, tried: Trying) -> None:
        self.run_of_trial = tried.run

    def run(self) -> str:
        """Return why the plant may lack its old values; empty if all is well."""
        try:
            self.run_of_trial.advance()
        except Exception as error:  # whatever it is, the old values may be missing
            return str(error) or type(error).__name__
        return ""

    def finish(self, driver: Driver, found: str) -> None:
        """Tell front ends, and let the old values be restored if they may be missing."""
        run, plant = self.run_of_trial, driver.underway.plant
        run.waits, run.problem = True, found or run.problem
        if run.moves_plant:
            run.moves_plant, run.changes = False, None
            plant.tried = plant.tried if run.problem else None
        if found:
            plant.is_due(found)
        driver.version += 1


class Keep:
    """Keep what the agent has learned beside the study, while the person looks at a question."""

    def __init__(self, driver: Driver) -> None:
        self.memory, self.twin = driver.memory, driver.agent.copy()
        self.memory.begun(self.twin)

    def run(self) -> None:
        """Keep it."""
        self.memory.keep(self.twin)

    def finish(self, driver: Driver, found: None) -> None:
        """Do nothing."""


class RunTheta:
    """Run θ, physical: what comes of it is recorded for the pending `sample`; without one, it is kept."""

    def __init__(self, driver: Driver, theta: Point, sample: Suggested | None = None) -> None:
        self.driver, self.theta, self.sample = driver, theta, sample
        self.going = driver.underway.begin(theta)

    def run(self) -> Experiment | Exception | None:
        """Return its experiment, its error, or None if it asks a person first."""
        return attempt(self.driver, self.going, np.array(self.theta))

    def finish(self, driver: Driver, found: Experiment | Exception | None) -> None:
        """Take the result, or keep it for the case that it is needed."""
        driver.underway.end(self.theta, found)
        why = found.why if isinstance(found, RunError) else ""
        if self.sample is not None:
            driver.version += 1  # front ends show what it asks, or that it is over
            # Not a failure if it was given up: it runs again when it is needed again.
            if found is not None and why != "given up":
                _take(driver, self.sample, found)
        elif isinstance(found, Experiment):
            driver.thoughts.prefetch.keep(self.theta, found)
        elif isinstance(found, RunError) and why in (*UNBIDDEN, "stopped"):
            driver.thoughts.prefetch.keep_failure(self.theta, found)


def _attend(driver: Driver) -> RunTheta | None:
    """Advance the run that a person attends to, unless it waits for them or for the plant."""
    underway, pending = driver.underway, driver.study.pending
    run = underway.of(pending)
    if run is None or pending is None or run.waits or underway.plant.recovery is not Recovery.DONE:
        return None
    return _run(driver, pending)


def _run_another(driver: Driver) -> RunTheta | None:
    """Run the first pending sample that does not run yet; None if all do, or enough."""
    if len(driver.underway.going) >= driver.at_once:
        return None
    for sample in driver.study.unfinished:
        failed = driver.phase is not Phase.RUNNING and (
            driver.thoughts.prefetch.is_known(sample.theta) or sample.index in driver.state.failures
        )
        if sample.theta not in driver.underway.going and not failed:
            driver.version += 1  # so that front ends say how many run
            return _run(driver, sample)
    return None


def _run(driver: Driver, sample: Suggested) -> RunTheta | None:
    """Run a pending sample; None if its result is known already, and taken now."""
    known = driver.thoughts.prefetch.take_result(sample.theta)
    if known is None:
        return RunTheta(driver, sample.theta, sample)
    # At once, since another thread would run it again meanwhile.
    driver.underway.end(sample.theta, known)
    _take(driver, sample, known)
    return None


def _take(driver: Driver, sample: Suggested, result: Experiment | Exception) -> None:
    """Take the result of running `sample`, if it is still pending."""
    if isinstance(result, Experiment):
        driver.thoughts.prefetch.keep(sample.theta, result)
    # While it ran, another one may have been answered, which changes its number.
    study, indices = driver.study, {s.theta: s.index for s in driver.study.unfinished}
    index = indices.get(sample.theta)
    if index is None or study.phase is Phase.OVER:
        return None
    if study.phase not in (Phase.RUNNING, Phase.RECORD, Phase.CONFIRM):
        return _take_early(driver, index, result, sample.theta)
    try:
        if isinstance(result, Experiment):
            driver.append((Finished(index), result))
            return driver.proceed()
        due = driver.state.history.answered
        driver.append(*([] if index == due else [Taken(index)]), Failed(due, in_words(result)))
    except StudyError as error:
        return driver.feed(Moment.BROKEN, error)
    return driver.feed(Moment.BROKEN, result)


def _take_early(driver: Driver, index: int, result: Experiment | Exception, theta: Point) -> None:
    """Save the experiment of pending sample `index`; its failure is shown when it is due."""
    if driver.at_once == 1:
        return
    if isinstance(result, Experiment):
        driver.append((Finished(index), result))
    else:
        driver.thoughts.prefetch.keep_failure(theta, result)


def attempt(
    driver: Driver, run: Run, theta: Float[np.ndarray, " n"], twin: Scenario | None = None
) -> Experiment | Exception | None:
    """Advance a run of θ; return its experiment, its error, or None if it asks a person first.

    Until one experiment passed without interruption, each is checked against the scenario, and
    always if it is one of the `twin` or of a plant. SystemExit and the like of a user's code are
    caught, too: a function that calls exit() would end the thread without notice. Only
    KeyboardInterrupt is raised again: it may be Ctrl-C. What ends the process ends a run on a plant.
    """
    scenario = twin or driver.store.scenario
    attended = bool(scenario.source.asks)
    try:
        result: object = run.advance()
        if result is None and run.waits:
            return None
        if driver.underway.checked and twin is None and not attended and isinstance(result, Experiment):
            return result
        experiment = check_experiment(scenario, theta, result)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if attended and not isinstance(error, Exception | SystemExit):
            raise
        return as_exception(error)
    if twin is None:
        driver.underway.checked = not experiment.end.interrupted
    return experiment


def look_at(driver: Driver, theta: Float[np.ndarray, " n"]) -> Experiment:
    """Return the experiment of a simulated θ, physical, shape (n,), and record nothing.

    It runs without the lock. A question about θ then finds the experiment.

    Raises:
        ScenarioError: If the agent does not simulate, or the simulation failed.
        KnobError: If the space does not hold θ.
    """
    with driver.changed:
        if not isinstance(driver.agent, Screening):
            raise ScenarioError("only an experiment that is simulated unseen can be looked at")
        theta = driver.agent.space.check_allowed(theta)
        known = driver.file.find_experiment(theta)
        found = driver.thoughts.prefetch.experiment(tuple(theta.tolist()))
    if known is not None:
        return driver.file.experiment(known)
    if found is not None:
        return found
    with _ONE_AT_A_TIME:
        result = _run_look(driver, theta)
    if not isinstance(result, Experiment):
        raise ScenarioError(f"this simulation failed: {result}") from result
    if driver.thoughts.twin is None:
        with driver.changed:
            driver.thoughts.prefetch.keep(tuple(theta.tolist()), result)
    return result


def _run_look(driver: Driver, theta: Theta) -> Experiment | Exception | None:
    key = (np.inf, *theta.tolist())  # not the θ itself, which may run for the study at the same time
    with driver.changed:
        run = (driver.thoughts.twin or driver.store.scenario).source.begin(
            theta.copy(), seed=driver.study.seed
        )
        driver.underway.going[key] = run  # so that it makes way for what is waited for
    try:
        return attempt(driver, run, theta, driver.thoughts.twin)
    finally:
        with driver.changed:
            del driver.underway.going[key]


def _look_ahead(driver: Driver) -> RunTheta | LookAhead | None:
    """Run the θ that a copy of the agent proposes after a likely answer, or let one propose it."""
    asked, theta = driver.question, driver.thoughts.prefetch.next
    assert asked is not None
    if asked.repeats is not None:
        return None
    if theta is not None:
        driver.thoughts.prefetch.next = None
        return RunTheta(driver, theta)
    most = len(LIKELY) if driver.thoughts.simulator is None else LIKELIEST
    answer = driver.thoughts.prefetch.missing(asked, most)
    return None if answer is None else LookAhead(driver, asked, answer)


def _is_known(driver: Driver, theta: Float[np.ndarray, " n"]) -> bool:
    """Return whether θ has run: in the study, for example before an undo, or as a prefetch."""
    known = driver.thoughts.prefetch.is_known(tuple(theta.tolist()))
    return known or driver.file.find_experiment(theta) is not None
