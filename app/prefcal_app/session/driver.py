"""Drive a study: what is under way, and each event saved before it counts."""

import inspect
import platform
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

import prefcal_agents
from prefcal_agents.agent import Agent
from prefcal_agents.screening.findings import Findings
from prefcal_app.simulating import Screened, Simulator, past_of
from prefcal_env import preferences, qp
from prefcal_env.errors import RunError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.plain import digest
from prefcal_env.preferences.answer import Answer, Preference, completed
from prefcal_env.preferences.history import History, Point
from prefcal_env.sources import PlantTrial, Run, Source
from prefcal_env.study import Answered, Event, Finished, Shown, State, StudyFile, Suggested
from prefcal_env.study.beside import read_learned, write_learned
from prefcal_scenarios.scenario import Scenario

from .study import (
    QUESTIONS,
    Ask,
    ExperimentStore,
    Moment,
    Phase,
    PlantFacts,
    PlantNow,
    Question,
    Recovery,
    Settle,
    Study,
    TrialNow,
    Write,
    mark_of_trial,
)

# --- Hold what is thought of in advance; it can be lost at any time without changing a result.

LIKELY = (Preference.CHALLENGER, Preference.INCUMBENT, Preference.TIE, None)
"""Possible answers, the most likely first."""
LIKELIEST = 3  # number of answers to prepare if each of them takes simulations
_KEPT = 36  # number of experiments in memory: a few questions' worth, so that an undo finds them, too


@dataclass(slots=True)
class Prefetch:
    """What likely answers would lead to, and experiments run in advance; none of it is saved.

    What the agent would ask next is remembered by the agent itself.
    """

    _screened: dict[Answer, Screened | None] = field(default_factory=dict)
    _tried: set[Answer] = field(default_factory=set)
    _experiments: OrderedDict[Point, Experiment] = field(default_factory=OrderedDict)
    _failures: dict[Point, Exception] = field(default_factory=dict)
    next: Point | None = None  # θ that a copy proposes and that should run next, physical
    busy: Answer | None = None  # answer that a copy is learning now, in the background
    silent: bool = False  # whether what is said of the open question or the result could not be worked out

    def missing(self, asked: Question, most: int = len(LIKELY)) -> Answer | None:
        """Return the next of the `most` likeliest answers to `asked`; None if all were tried."""
        for preference in LIKELY[:most]:
            answer = asked.completed(Answer(preference, marks=asked.marks))
            if answer not in self._tried:
                self._tried.add(answer)
                return answer
        return None

    def keep_screened(self, answer: Answer, screened: Screened | None) -> None:
        """Keep what the question after `answer` would be chosen from."""
        self._screened[answer] = screened

    def take(self, answer: Answer) -> Screened | None:
        """Return what the question after `answer` is chosen from, and drop the others."""
        screened = self._screened.get(answer)
        self.forget()
        return screened

    def forget(self) -> None:
        """Drop what likely answers lead to, since the question has changed."""
        self._screened.clear()
        self._tried.clear()
        self.next, self.silent = None, False

    def keep(self, theta: Point, experiment: Experiment) -> None:
        """Keep the experiment of the requested θ; the plant may report a rounded one."""
        self._experiments[theta] = experiment
        while len(self._experiments) > _KEPT:
            self._experiments.popitem(last=False)

    def keep_failure(self, theta: Point, error: Exception) -> None:
        """Keep the error of a θ that crashed or took too long, to avoid waiting for it twice."""
        self._failures[theta] = error

    def is_known(self, theta: Point) -> bool:
        """Return whether θ has run, with or without an experiment."""
        return theta in self._experiments or theta in self._failures

    def take_result(self, theta: Point) -> Experiment | Exception | None:
        """Return what came of θ; None if it has not run. An error is forgotten, so a retry runs θ again."""
        return self._experiments.get(theta) or self._failures.pop(theta, None)

    def experiment(self, theta: Point) -> Experiment | None:
        """Return the experiment of θ; None if it has not run."""
        return self._experiments.get(theta)


@dataclass(slots=True)
class Thoughts:
    """What questions are chosen from, and what likely answers would lead to."""

    simulator: Simulator | None = None
    """What the agent simulates with; None if it simulates nothing."""
    twin: Scenario | None = None  # model that θ are simulated on; None if that is the scenario itself
    prefetch: Prefetch = field(default_factory=Prefetch)
    screened: Screened | None = None
    """What the latest question was chosen from, by simulations."""
    about: History | None = None  # the record whose next query is being chosen in the background

    def grounds(self, agent: Agent) -> Screened | None:
        """Return what the open question of `agent` was chosen from; None while it is not known."""
        known = self.screened
        if known is None or known.past.key != past_of(agent).key:
            return None
        # The person may have asked for another challenger since.
        return known if known.pending == agent.history.pending else None

    def take(self, answer: Answer) -> None:
        """Go on with what was thought of the case that this answer is given."""
        if self.simulator is not None and self.prefetch.busy not in (None, answer):
            self.simulator.abandon()
        self.screened = self.prefetch.take(answer) or self.screened

    def resume(self) -> None:
        """Let simulations begin again."""
        if self.simulator is not None:
            self.simulator.resume()

    def make_way(self, history: History | None) -> None:
        """Abandon simulations unless they are for `history`, the record that is waited for."""
        if self.simulator is not None and self.about and (history is None or self.about.key != history.key):
            self.about = None
            self.simulator.abandon()


# --- Keep beside the study what its agent has learned, so that a long study resumes soon.


class Memory:
    """What an agent has learned, in a file beside the study: a cache that only saves time.

    Args:
        file: Study file; nothing is kept of a study in memory.
    """

    _WORTH = 10  # number of answers that are learned from again within a second or two, so nothing is kept

    def __init__(self, file: StudyFile) -> None:
        self._file, self._kept = file, 0
        self._path = None if file.path == ":memory:" else Path(file.path)

    def recall(self, agent: Agent) -> None:
        """Let `agent` use what was kept of the same record, agent and settings; it raises nothing."""
        answered = self._file.state.history.answered
        if self._path is None or answered < self._WORTH:
            return
        with suppress(Exception):  # whatever it is, such as an error of one's own agent, the study opens
            if content := read_learned(self._path, _key(agent)):
                agent.recall(content)
                self._kept = answered

    def is_due(self, agent: Agent) -> bool:
        """Return whether so much was learned since the last time that it should be kept now."""
        return self._path is not None and abs(agent.history.answered - self._kept) >= self._WORTH

    def begun(self, agent: Agent) -> None:
        """Take note that what `agent` has learned is being kept, so that no other thread does that, too."""
        self._kept = agent.history.answered

    def keep(self, agent: Agent) -> None:
        """Keep what `agent` has learned; it raises nothing."""
        if self._path is None or agent.history.answered < self._WORTH or not self._file.in_place:
            return
        with suppress(Exception):  # whatever it is, the study has lost nothing
            if content := agent.remember(agent.history):
                write_learned(self._path, _key(agent), content)


def _key(agent: Agent) -> str:
    """Return hexadecimal digits that change with all that is learned but the record.

    That is agent, version, seed and settings, and what computes: another library or kind of processor
    may add in another order. Raises OSError or TypeError if the agent's own code is in no file.
    """
    libraries = [(name, _version(name)) for name in ("prefcal", "numpy", "scipy", "piqp", "numba")]
    own = sha256(Path(inspect.getfile(type(agent))).read_bytes()).digest()
    content = _without_lengths(agent.configuration), libraries, platform.machine(), _digest_code(), own
    return digest(content).hex()


def _without_lengths(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return the configuration of an agent without what people change within a study.

    Nothing that was learned follows from how many experiments or questions are to come.
    """
    settings = {name: value for name, value in configuration["settings"].items() if name != QUESTIONS}
    return {**configuration, "n_max": None, "settings": settings}


def _version(package: str) -> str:
    """Return the version of a package; empty if it is not installed, such as in a checkout."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


@cache
def _digest_code() -> bytes:
    """Return a digest of the code that learns: between releases, it changes without a new version."""
    found = sha256()
    for package in (prefcal_agents, preferences, qp):
        for folder in map(Path, package.__path__):
            for path in sorted(folder.rglob("*.py")):
                content = path.read_bytes()
                found.update(f"{path.relative_to(folder)}\0{len(content)}\n".encode() + content)
    return found.digest()


# --- Hold the runs of an interview: those in progress, and those that wait to begin.


@dataclass(frozen=True, slots=True)
class Trying:
    """A trial of the first experiment and the best one on a live plant, and its run."""

    trial: PlantTrial
    run: Run
    best: int
    blind: bool

    @property
    def about(self) -> tuple[str, int, bool]:
        """Return what is tried, and how."""
        return self.trial.mark, self.best, self.blind

    def now(self) -> TrialNow:
        """Return what a front end shows of it."""
        trial, run = self.trial, self.run
        return TrialNow(self.blind, trial.wanted, trial.shown, run.changes, run.problem, run.moves_plant)


class PlantCare:
    """What must be done on a plant before anything else: restore what an interrupted run left.

    Attributes:
        recovery: Whether that is done. Nothing is read or written for a new run before it is.
        problem: What remains to be done on the plant, as a sentence; empty if nothing does.
        tried: What is tried on the plant after the end, or was last; None if nothing was.
    """

    def __init__(self, source: Source) -> None:
        self._source = source
        self.recovery = Recovery.DUE if source.recovers else Recovery.DONE
        self.problem = ""
        self.run: Run | None = None
        self.tried: Trying | None = None

    @property
    def tries(self) -> bool:
        """Return whether a trial changes the plant, or is about to; it takes no lock."""
        return self.tried is not None and self.tried.run.moves_plant

    def is_due(self, problem: str = "") -> None:
        """Let the old values be restored next; `problem` says why they are not."""
        if self._source.recovers:
            self.recovery, self.problem = Recovery.DUE, problem

    def recover(self) -> Run:
        """Return the run that restores the old values, which is in progress from now on."""
        self.recovery, self.run = Recovery.RUNNING, self._source.recovery()
        return self.run

    def recovered(self, problem: str) -> None:
        """Take note that the old values are restored, or of the `problem` that they are not."""
        self.problem, self.run = problem, None
        self.recovery = Recovery.FAILED if problem else Recovery.DONE

    def now(self, run: Run | None) -> PlantNow:
        """Return what a front end shows of a live plant, given the run of the pending sample."""
        shown = self.run or (self.tried.run if self.tried is not None and self.tries else run)
        times, curves = ((), ()) if shown is None else shown.recorded
        return PlantNow(
            changes=None if run is None else run.changes,
            problem=self.problem or ("" if run is None else run.problem),
            progress=None if shown is None else shown.progress,
            times=times,
            curves=curves,
            stopping=False if shown is None else shown.stopping,
            recovery=self.recovery,
            trial=None if self.tried is None else self.tried.now(),
        )


class UnderWay:
    """Runs of a source, by their θ; callers must hold the interview's lock.

    Attributes:
        plant: What must be done on the plant before anything else.
        going: Runs in progress.
        waiting: Runs that have not begun, or that ask a person; they can be stopped already.
        partial: What runs that failed had recorded until then; dropped when they wait again.
        checked: Whether an experiment of this process was checked against its scenario.
        changed: Function that tells front ends, from any thread, that there is news of a run.
    """

    def __init__(self, source: Source, seed: int) -> None:
        self.source, self._seed = source, seed
        self.plant = PlantCare(source)
        self.going: dict[Point, Run] = {}
        self.waiting: dict[Point, Run] = {}
        self.partial: dict[Point, Experiment] = {}
        self.checked = False
        self.changed: Callable[[], None] = lambda: None

    def of(self, sample: Suggested | None) -> Run | None:
        """Return the run of a sample; None unless it waits or is in progress."""
        theta = () if sample is None else sample.theta
        return self.going.get(theta) or self.waiting.get(theta)

    @property
    def every(self) -> list[Run]:
        """Return all runs of θ; it takes no lock."""
        return [*self.going.values(), *self.waiting.values()]

    @property
    def moves_plant(self) -> bool:
        """Return whether a run changes a plant, or is about to; it takes no lock."""
        return self.plant.tries or any(run.moves_plant for run in self.every)

    def facts(self, pending: Suggested | None) -> PlantFacts:
        """Return what decides what a person can do about the run of the pending sample."""
        source, run = self.source, self.of(pending)
        ready = run is not None and run.changes is not None
        tried = self.plant.tried
        holds = tried is not None and self.plant.tries and tried.trial.shown is not None
        recovery = self.plant.recovery
        return PlantFacts(source.asks, source.stops, self.moves_plant, ready, recovery, source.tries, holds)

    def plant_now(self, sample: Suggested | None) -> PlantNow | None:
        """Return what a front end shows of a plant on which each run is confirmed; None without one."""
        return self.plant.now(self.of(sample)) if self.source.asks == "confirm" else None

    def wait_for(self, sample: Suggested, unfinished: Iterable[Suggested], *, anew: bool = False) -> None:
        """Let the run of a sample wait, so that it can be stopped from now on.

        Args:
            unfinished: All samples without an experiment; other runs no longer wait.
            anew: Whether to make its run again, for example to read a plant's present values.
        """
        theta = sample.theta
        self.forget(unfinished)
        self.partial.pop(theta, None)
        if theta not in self.going and (anew or theta not in self.waiting):
            self.waiting[theta] = self._make(theta)

    def forget(self, unfinished: Iterable[Suggested]) -> None:
        """Let no run wait but those of `unfinished` samples: a stop is for the run that was due."""
        due = {sample.theta for sample in unfinished}
        self.waiting = {theta: run for theta, run in self.waiting.items() if theta in due}

    def begin(self, theta: Point) -> Run:
        """Return the run of θ, physical, which is in progress from now on."""
        # Never in neither: whether a run moves the plant is read without a lock.
        self.going[theta] = self.waiting.get(theta) or self._make(theta)
        self.waiting.pop(theta, None)
        return self.going[theta]

    def _make(self, theta: Point) -> Run:
        run = self.source.begin(np.array(theta), seed=self._seed)
        run.changed = self.changed
        return run

    def stop(self, why: str) -> None:
        """Stop all runs, also the one that restores a plant."""
        for run in self.every:
            run.stop(why)
        if self.plant.run is not None:
            self.plant.run.stop(why)
        if self.plant.tried is not None:
            self.plant.tried.run.stop(why)

    def end(self, theta: Point, result: Experiment | Exception | None) -> None:
        """Take note that the run of θ is over or, without a result, asks something of a person."""
        if theta not in self.going:  # the result was known before
            self.waiting.pop(theta, None)
            return
        run = self.going.pop(theta)
        if result is None:
            self.waiting[theta] = run
            return
        if isinstance(result, Exception) and run.partial is not None:
            self.partial[theta] = run.partial
        # After an error nobody knows how far the run came, but what it left on the disk tells.
        unknown = isinstance(result, Exception) and not isinstance(result, RunError)
        if run.moves_plant and (run.problem or unknown):
            self.plant.is_due(run.problem)


# --- Advance an interview from an answer to the next question.

_COURTESY = 2.0
"""Seconds that a prefetched run may continue while another one is waited for: it may be almost
done, and a fresh process takes a second."""


@dataclass(frozen=True, slots=True)
class Latest:
    """What the latest answer or undo left behind."""

    version: int = 0  # version at which it was given
    draft: str = ""  # comment of the answer that was undone, until another answer is given


@dataclass(slots=True)
class Driver:
    """What drives a study, with its lock, and tells of changes.

    The study is a value, so `study` and `state` are read without the lock. Hold `changed` to read
    experiments or thoughts, and make every change within `changing`.
    """

    file: StudyFile
    store: ExperimentStore
    agent: Agent
    thoughts: Thoughts
    at_once: int = 1  # number of experiments that run at the same time
    version: int = 0
    latest: Latest = Latest()
    study: Study = field(init=False)
    memory: Memory = field(init=False)
    underway: UnderWay = field(init=False)
    changed: threading.Condition = field(default_factory=lambda: threading.Condition(threading.RLock()))
    """Lock; it is notified of each change."""
    closing: bool = False  # whether no more work is taken
    has_background: bool = False  # whether threads take work in the background
    _question: Question | None = None
    _problem: Exception | None = None

    def __post_init__(self) -> None:
        source = self.store.scenario.source
        self.study = Study(
            self.agent,
            self.file.state,
            at_once=self.at_once,
            simulates=self.thoughts.simulator is not None,
            plant=PlantFacts(source.asks, source.stops, tries=source.tries),
        )
        self.underway = UnderWay(source, self.study.seed)
        self.underway.changed = self.tell
        self.memory = Memory(self.file)
        self.memory.recall(self.agent)

    @property
    def phase(self) -> Phase:
        """Return what the study waits for."""
        return self.study.phase

    @property
    def question(self) -> Question | None:
        """Return the open question, in phase QUESTION."""
        return self._question if self.phase is Phase.QUESTION else None

    @property
    def problem(self) -> Exception | None:
        """Return what went wrong, in phase FAILED."""
        return self._problem if self.phase is Phase.FAILED else None

    @property
    def state(self) -> State:
        """Return the state of the study file."""
        return self.study.state

    @property
    def standing(self) -> Study:
        """Return the study with what is known now of the plant, which no event tells."""
        plant = self.underway.facts(self.study.pending)
        return self.study if plant == self.study.plant else replace(self.study, plant=plant)

    @property
    def findings(self) -> Findings | None:
        """Return what is said of the open question or the result; None while it is not worked out.

        What was said at the end stays: it is kept in the study file.
        """
        if self.state.concluded is not None:
            with suppress(StudyError):  # another version of prefcal said it: it is worked out anew
                return Findings.from_dict(self.state.concluded)
        known = self.thoughts.grounds(self.agent)
        return None if known is None else known.findings

    def append(self, *events: Event | tuple[Finished, Experiment]) -> tuple[int, ...]:
        """Save events before anything follows from them; return their numbers.

        The agent goes by the record that is saved, also if saving was interrupted right after that.

        Raises:
            StudyError: If they cannot be saved; then nothing has changed.
        """
        state = self.file.state
        try:
            return self.file.append(*events)
        finally:
            if self.file.state is not state:  # recorded, also if Ctrl-C came right after that
                for event in events:
                    happened = event[0] if isinstance(event, tuple) else event
                    self.study = self.study.feed(happened, self.file.state)
                self.agent.history = self.file.state.history
                self.version += 1

    def try_out(self, best: int, *, blind: bool) -> Trying:
        """Return a trial of the first experiment and the best, which has read and written nothing yet."""
        samples, before = self.state.history.samples, self.state.confirmed
        trial = PlantTrial(
            {index: np.array(samples[index].theta) for index in (0, best)},
            mark_of_trial(self.file, before),
            lambda: self.file.state.confirmed > before,
        )
        run = self.store.scenario.source.trial(trial)
        run.changed = self.tell
        return Trying(trial, run, best, blind)

    def settle(self) -> None:
        """Let the plant keep what was confirmed last, also if prefcal was killed right after that.

        Raises:
            LiveError: If the values from before the trial cannot be forgotten.
        """
        if self.state.kept is not None:
            self.store.scenario.source.settle(mark_of_trial(self.file, self.state.confirmed - 1))

    def become(self, agent: Agent) -> None:
        """Go on with an agent, which learns what the study file says."""
        agent.history = self.state.history
        self.agent, self.study = agent, replace(self.study, strategy=agent)

    def feed(self, moment: Moment, problem: Exception | None = None) -> None:
        """Take note of what happened and is no event of the file."""
        self.study, self._problem = self.study.feed(moment), problem
        self.version += 1

    def resume(self) -> None:
        """Resume from the state of the study file; an open question stays open."""
        if self.state.ended or self.study.is_overtaken:
            self.proceed()
        else:
            self.show()

    def proceed(self) -> None:
        """Continue until an experiment must run, a question must be answered, or the study ends.

        The answer that led here is already saved. So an error from here on, such as a full disk,
        is shown as a problem that can be retried. It is not raised to the person who answered,
        whose question is already closed.
        """
        self.thoughts.prefetch.forget()
        self.underway.plant.tried = None
        self.underway.forget(() if self.state.ended else self.study.unfinished)
        try:
            while True:
                match self.study.next():
                    case Write(Suggested(index=index, theta=theta) as event):
                        self.append(event, *self.finished(index, theta))
                    case Write(event):
                        self.append(event)
                    case Settle(index):
                        self.append(self._settle(index))
                    case Ask(shown):
                        return self.show(shown)
                    case moment:
                        if moment in (Moment.RUN, Moment.RECORD, Moment.CONFIRM):
                            self._wait()
                        return self.feed(moment)
        except Exception as error:
            self.feed(Moment.BROKEN, error)

    def finished(self, index: int, theta: Point) -> list[Event | tuple[Finished, Experiment]]:
        """Return the event that adds the experiment of θ as sample `index`, if it is already known."""
        earlier = self.file.find_experiment(np.array(theta))
        if earlier is not None:
            return [Finished(index, same_as=earlier)]
        prefetched = self.thoughts.prefetch.experiment(theta)
        return [] if prefetched is None else [(Finished(index), prefetched)]

    def _settle(self, index: int) -> Answered:
        """Return the answer about experiment `index` that needs no person."""
        if self.agent.by_value:
            return Answered(None, index, *self.store.scored(index))
        experiment, outcomes = self.store.experiment(index), self.store.outcomes(index, None)
        return Answered(None, index, None, completed(Answer(None), experiment, None, outcomes))

    def _wait(self) -> None:
        pending = self.study.pending
        assert pending is not None
        # Also if its run failed before: the person may have fixed the plant since.
        self.underway.wait_for(pending, self.study.unfinished, anew=bool(self.underway.source.asks))

    def show(self, shown: Shown | None = None) -> None:
        """Show a question, by default the open one again with its current marks."""
        self.thoughts.prefetch.forget()
        if shown is not None:
            self.append(shown)
        question = self.store.open_question()
        self.feed(Moment.ASKED)
        self._question = question

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Hold the lock while the study changes, and tell of it afterward."""
        with self.changed:
            version = self.version
            try:
                yield
            finally:
                if self.version != version:
                    self._make_way()
                    self.changed.notify_all()

    def tell(self) -> None:
        """Tell front ends that there is news, such as of a run in progress."""
        with self.changing():
            self.version += 1

    def _make_way(self) -> None:
        """Stop soon what runs or thinks in advance, if something else is waited for."""
        self.thoughts.make_way(self.agent.history if self.phase is Phase.RUNNING else None)
        several = self.at_once > 1
        if self.underway.source.asks or (self.phase is not Phase.RUNNING and not several):
            return
        wanted = self.study.unfinished if several else filter(None, [self.study.pending])
        due = {sample.theta for sample in wanted if self.phase is not Phase.OVER}
        for theta, run in self.underway.going.items():
            if theta not in due:
                run.stop("given up", within=_COURTESY)
