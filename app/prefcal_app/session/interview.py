"""An agent's questions and a person's answers: what is known, what can be done, and who does it."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from typing import cast

import numpy as np
from jaxtyping import Float

from prefcal_agents import GLISp
from prefcal_agents.glisp.agent import Foresight
from prefcal_agents.learned_cost import LearnedCost
from prefcal_agents.screening.agent import Screening
from prefcal_agents.screening.findings import Findings
from prefcal_app.simulating import (
    UNLIKELY,
    Screened,
    SimulationCounts,
    Simulator,
    chance_left,
    named_twin,
    promise,
    simulates,
    told,
)
from prefcal_app.summary import (
    NONE_SAFE,
    Consistency,
    Counts,
    Outlook,
    Planned,
    answered,
    begin_with,
    falls_outward,
    foreseen,
    list_shown,
    others_unbeaten,
    outlook,
)
from prefcal_env.compiling import Compiling
from prefcal_env.errors import LiveError, SettingsError, StudyError
from prefcal_env.experiments.experiment import End, Experiment, limiting_input
from prefcal_env.preferences.answer import Comparison as Compared
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import StudyFile
from prefcal_env.wording import in_words
from prefcal_scenarios.runs import compile_runs
from prefcal_scenarios.scenario import Scenario, finds_kpis, with_found_kpis

from . import runs
from .actions import Action, Preview, Record, closed, possible
from .driver import Driver, Thoughts
from .study import (
    ExperimentStore,
    Moment,
    Now,
    Phase,
    Question,
    agent_of,
    as_studied,
    index_of,
    is_robust,
    is_simulating,
    known_outcomes,
    why_over,
)

# --- Say what is known of a study: its experiments and answers, what was learned, whether to continue.

Surrogate = Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]]
_LEAST = 5  # smallest number of verdicts for an outlook without simulations


class Known:
    """What is known of an interview, readable from any thread.

    Args:
        scenario: Function that returns its scenario, with KPIs found in its experiments.
    """

    def __init__(self, driver: Driver, scenario: Callable[[], Scenario]) -> None:
        self._driver, self._scenario = driver, scenario
        self.references: Mapping[str, Experiment] = {}
        """Experiments of the scenario's reference θ by name, once they ran for a report."""

    @property
    def counts(self) -> Counts:
        """Return the numbers of experiments and comparisons."""
        return Counts.of(self._driver.state)

    @property
    def planned(self) -> Planned:
        """Return how many questions the study asks."""
        with self._driver.changed:
            return Planned.of(self._driver.agent)

    @property
    def n_max(self) -> int:
        """Return the planned number of experiments; fewer if the space holds fewer θ."""
        return self._driver.agent.n_max

    @property
    def questions(self) -> int | None:
        """Return the maximum number of comparisons per experiment; None if it is fixed at 1."""
        agent = self._driver.agent
        return cast(GLISp, agent).settings.questions_per_experiment if agent.paced else None

    @property
    def simulated(self) -> SimulationCounts | None:
        """Return how many θ were simulated unseen; None if the agent simulates nothing."""
        return simulated(self._driver)

    @property
    def surrogate(self) -> Surrogate | None:
        """Return the learned cost of m physical θ, lower is better; None if nothing is learned."""
        closed = self._driver.state.history.comparisons
        learned = any(c.answer.preference is not None and not c.retracted for c in closed)
        # A copy, since the surrogate must not change while it is shown.
        return getattr(self._driver.agent.copy(), "surrogate", None) if learned else None

    @property
    def _promise(self) -> str | None:
        """Return what the simulated θ still promise; empty without any, None if too early."""
        if self.screens:
            found = self.findings
            return (promise(found) or None) if found is not None else None
        closed = self._driver.state.history.comparisons
        return self.promise if sum(c.verdict is not None for c in closed) >= _LEAST else None

    @property
    def worth_going_on(self) -> bool:
        """Return whether it is said that something better may be left, which no offer to stop follows."""
        if not self._promise:
            return False
        found, learned = self.findings, None if self.screens else self.foresight()
        chance = learned.chance if learned else chance_left(found) if found else None
        return chance is not None and chance >= UNLIKELY

    @property
    def promise(self) -> str:
        """Return what the next experiment can bring; empty if unknown, and if the person chose it."""
        study = self._driver.study
        pending, requested = study.pending, study.state.requested
        index, found = None if pending is None else pending.index, self.foresight()
        return "" if found is None or index in requested else foreseen(found.chance, index)

    def foresight(self, *, learn: bool = False) -> Foresight | None:
        """Return what the next experiment can bring; None if unknown, or not worked out yet.

        With `learn`, or if no threads work in the background, it is worked out here and now.
        """
        agent, learn = self._driver.agent.copy(), learn or not self._driver.has_background
        if not isinstance(agent, GLISp) or not (learn or agent.foresees):
            return None
        return agent.foresight

    @property
    def outlook(self) -> Outlook | None:
        """Return whether to continue, and the knobs at the end of their range; None if unknown."""
        best, promise = self._best(), self._promise
        if best is not None and self.none_safe:
            return Outlook(NONE_SAFE)
        if promise is None or best is None:
            return None
        driver = self._driver
        state, place, by_value = driver.state, driver.file.path, driver.agent.by_value
        space = self._scenario().space
        missed, helps = self.missed, self._helps
        others = (k for k in self._scenario().shown_kpis if k.goal and k.title not in missed and not k.margin)
        never = [k for k in others if np.isinf(best.kpis.get(k.name, 0.0))]
        # What the best misses as it runs; a margin is no matter of the range of an input.
        lacks = any(k.met_by(best) is False for k in self._scenario().shown_kpis if not k.margin)
        found = outlook(
            promise,
            best.theta,
            space,
            place,
            state,
            missed=missed,
            never=[k.title for k in never],
            reached=self._list_reaching([k.name for k in never]),
            unstable=self.unstable,
            limiting=limiting_input(best) if lacks else "",
            keeping=self._keeping() if missed else "",
            helps=helps,
        )
        said = self.findings
        if said is not None and state.ended:
            nominal = self.nominal(state.history.incumbent)
            scenario, run = self._scenario(), self._experiment
            result = told(said, scenario, run, index=self.index, nominal=nominal)
            found = replace(found, result=result)
        if not by_value:
            found = replace(found, unbeaten=others_unbeaten(state.history, robust=is_robust(state)))
        return found if found.sentences else None

    def _keeping(self) -> str:
        """Return which experiment that was answered about, or reference, misses no objective, and its θ."""
        limited = [k for k in self._scenario().shown_kpis if k.met(0.0) is not None]
        named = {f"experiment {k + 1}": each for k, each in self._find_answered().items()}
        return begin_with({**named, **self.references}, self._scenario().space, limited)

    def _find_answered(self) -> dict[int, Experiment]:
        """Return the experiments that were answered about, by number."""
        driver = self._driver
        with driver.changed:
            known = [k for k in list_shown(driver.state) if k < driver.state.history.answered]
            return {k: driver.store.experiment(k) for k in known}

    def _list_reaching(self, kpis: Sequence[str]) -> list[int]:
        """Return the numbers of the experiments, from 1, in which all KPIs of these names are finite."""
        found = self._find_answered().items() if kpis else ()
        return [k + 1 for k, each in found if np.isfinite([each.kpis.get(n, np.inf) for n in kpis]).all()]

    def _helps(self, knob: int, upper: bool) -> bool:
        """Return whether the model expects that going beyond an end of a knob's range helps."""
        if self.screens:
            trend = None if self.findings is None else self.findings.trend
            return trend is not None and bool(trend[knob] > 0) == upper
        surrogate, best = self.surrogate, self._best()
        if surrogate is None or best is None:
            return False
        return falls_outward(surrogate, self._scenario().space, best.theta, knob, upper)

    def _best(self) -> Experiment | None:
        driver = self._driver
        with driver.changed:
            best = driver.study.best
            return None if best is None else driver.store.experiment(best)

    def _experiment(self, index: int) -> Experiment:
        with self._driver.changed:
            return self._driver.store.experiment(index)

    def nominal(self, index: int | None) -> Experiment | None:
        """Return an experiment by its index; None without one, and if not its own plant is perturbed."""
        own = self._scenario().simulated and self._driver.thoughts.twin is None
        return self._experiment(index) if own and index is not None else None

    @property
    def none_safe(self) -> bool:
        """Return whether experiments ended, and each of them unsafe or without a result."""
        best, unsafe = self._best(), (End.UNSAFE, End.FAILED)
        if best is not None and best.end not in unsafe:
            return False
        with self._driver.changed:
            ends = [self._driver.store.end(index) for index in list_shown(self._driver.state)]
        return bool(ends) and all(end in unsafe for end in ends)

    @property
    def why_over(self) -> str:
        """Return why the study is over, in words; "" while it is not."""
        found = None if self.none_safe else self.findings
        return why_over(self._driver.state.ended or "", found)

    @property
    def missed(self) -> list[str]:
        """Return the titles of the KPIs whose objectives the best experiment misses."""
        best = self._best()
        if best is None:
            return []
        limited = (k for k in self._scenario().shown_kpis if k.met(0.0) is not None)
        return [k.title for k in limited if k.met_by(best) is False]

    @property
    def unstable(self) -> bool:
        """Return whether the loop of the best experiment is not stable, as far as its margins say."""
        best = self._best()
        return best is not None and any(k.margin and k.unstable(best) for k in self._scenario().shown_kpis)

    @property
    def screens(self) -> bool:
        """Return whether the agent simulates θ that are not shown."""
        return simulates(self._driver.agent)

    @property
    def findings(self) -> Findings | None:
        """Return what is said of the open question or, at the end, of the result.

        None for agents that simulate nothing, and before it is worked out.
        """
        with self._driver.changed:
            return self._driver.findings

    def screened(self, *, current: bool = True) -> Screened | None:
        """Return what was simulated; None for other agents and before it is known.

        With `current`, what was known before the latest answer counts as unknown.
        """
        with self._driver.changed:
            return (
                self._driver.thoughts.grounds(self._driver.agent)
                if current
                else self._driver.thoughts.screened
            )

    @property
    def is_told(self) -> bool:
        """Return whether all is said that will be, of the open question or of the result."""
        driver = self._driver
        with driver.changed:
            over, found = driver.phase is Phase.OVER, driver.findings
            if driver.thoughts.simulator is None or driver.thoughts.prefetch.silent:
                return True
            return found is not None and (not over or (found.over and found.complete))

    def wait_for_findings(self, timeout: float | None) -> bool:
        """Wait until `is_told`, or for `timeout` s, None for any time; return whether it is.

        It does not wait if nothing works in the background.
        """
        driver = self._driver
        with driver.changed:
            driver.changed.wait_for(
                lambda: self.is_told or driver.closing or not driver.has_background, timeout
            )
            return self.is_told

    @property
    def index(self) -> LearnedCost | None:
        """Return the cost learned from answers and KPIs; None while they say nothing about it."""
        driver = self._driver
        with driver.changed:
            history, seed = known_outcomes(driver.state, driver.store), driver.study.seed
        return index_of(history, seed)

    @property
    def consistency(self) -> Consistency:
        """Return how consistent the answers are."""
        return Consistency.of(self._driver.state)


def simulated(driver: Driver) -> SimulationCounts | None:
    """Return how many θ were simulated unseen; None if the agent simulates nothing."""
    simulator, screened = driver.thoughts.simulator, driver.thoughts.screened
    if simulator is None:
        return None
    agent = cast(Screening, driver.agent)
    planned = agent.n_simulated
    # What was simulated for answers that were not given is not counted.
    state = driver.study.state
    # While it goes on, what ran ahead may still be shown.
    shown = len(list_shown(state) if state.ended else state.finished)
    count, failed = min(simulator.count, planned), simulator.failed
    if screened is not None:
        count, failed = len(screened.bank.failed), int(screened.bank.failed.sum())
    # Equal θ run once: where nothing is simulated any more, fewer than that were.
    twin, due = driver.thoughts.twin is not None, agent.due if simulator.busy else 0
    why = simulator.failure if failed else ""
    seconds, varied = simulator.seconds, simulator.varied
    return SimulationCounts(count, planned, failed, shown, twin, due, seconds, varied, why)


class Past:
    """Experiments and answers of an interview, readable from any thread."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver

    def still(self) -> AbstractContextManager[object]:
        """Return a context in which nobody takes a step, so that what is read in it belongs together."""
        return self._driver.changed

    def experiment(self, index: int) -> Experiment:
        """Return experiment `index`, from 0. Raises StudyError if there is none."""
        with self._driver.changed:
            return self._driver.store.experiment(index)

    def end(self, index: int) -> End:
        """Return how experiment `index`, from 0, ended. Raises StudyError if there is none."""
        with self._driver.changed:
            return self._driver.store.end(index)

    def asked(self, answer: int) -> Question:
        """Return answered question `answer` as it was shown. Raises StaleError if there is none."""
        with self._driver.changed:
            return self._driver.store.asked(closed(self._driver, answer))

    def closed(self, answer: int) -> Comparison:
        """Return answer number `answer`, from 1; -1, -2, ... are follow-up comparisons.

        Raises:
            StaleError: If there is none.
        """
        return closed(self._driver, answer)

    def comparisons(self, start: int = 0) -> tuple[Compared, ...]:
        """Return every closed query from number `start` on, including the first experiment's."""
        with self._driver.changed:
            return tuple(
                self._driver.store.comparison(i) for i in range(start, self._driver.state.history.answered)
            )

    def answered(self) -> tuple[Compared, ...]:
        """Return the comparisons whose answers stand, in order, follow-up comparisons included."""
        with self._driver.changed:
            return tuple(self._driver.store.compared(closed) for closed in answered(self._driver.state))


# --- Run an interview: an agent, a study file, and the open question.


class Interview:
    """Interview that asks questions, takes answers, and lets the agent learn from them.

    Every step is saved in the study file before the next one begins: an answer before the next
    question, an experiment before it is shown. Everything can be called from any thread.
    Experiments are run by `work`, which a `Background` calls while the person compares.

    Args:
        file: Open study file with the same knobs; the interview resumes from its state.
        ahead: Whether `work` also runs the experiments that likely answers would lead to.
        asks: Whether to continue the study, which writes to its file; False only reads it.
        simulator: What an agent that simulates does so with, for the scenario of the study; by
            default, it simulates in this process. It stays open.
        at_once: Number of experiments that run at the same time, each in a thread that calls
            `work`; 1 runs ahead of the answers instead, see `ahead`.

    Raises:
        StudyError: If the study has other knobs, or cannot be written.
        SettingsError: If `at_once` is above 1, and the agent simulates or the plant is a rig.

    Attributes:
        file: Study file.
        known: What is known: counts, what was learned, and whether to continue.
        past: Experiments and answers so far.
    """

    def __init__(
        self,
        scenario: Scenario,
        file: StudyFile,
        *,
        ahead: bool = True,
        asks: bool = True,
        simulator: Simulator | None = None,
        at_once: int = 1,
    ) -> None:
        if at_once > 1:
            _check_at_once(scenario, file)
        scenario = self._scenario = as_studied(scenario, file.state)
        self.file = file
        self._runs_ahead = ahead
        simulator = simulator or (_simulator(scenario, file) if asks else None)
        if simulator is not None:
            simulator.tell = self._simulating
        twin = None
        if simulator is not None and named_twin(file.state.configuration) is not None:
            twin = simulator.scenario
        agent = agent_of(file.state, scenario.space, simulator)
        store = ExperimentStore(scenario, file)
        self._driver = Driver(file, store, agent, Thoughts(simulator, twin), at_once)
        self.past = Past(self._driver)
        self.known = Known(self._driver, lambda: self.scenario)
        self._asks = asks
        self._preparing: Compiling | None = None
        self._seen: Now | None = None
        self._idle_at: int | None = None
        self.simulating: Callable[[], None] = lambda: None
        """Function that is called twice a second while something is simulated that people wait for."""
        if asks:
            with suppress(LiveError):  # before values are restored, this is tried again, and said
                self._driver.settle()
            self._driver.resume()

    @property
    def scenario(self) -> Scenario:
        """Return the scenario of the study; from the first experiment on, with KPIs found in it.

        KPIs are found only if the scenario states none.
        """
        if not finds_kpis(self._scenario):
            return self._scenario
        driver = self._driver
        with driver.changed:
            measured = driver.store.first_measured()
            if measured is not None:
                self._scenario = with_found_kpis(self._scenario, measured)
            return self._scenario

    def now(self) -> Now:
        """Return a consistent view of the latest version, which is made once."""
        driver = self._driver
        with driver.changed:
            # Not at each change: many versions are seen by nobody.
            if self._seen is None or self._seen.version != driver.version:
                self._seen = self._look()
            return self._seen

    def _look(self) -> Now:
        driver, study, underway = self._driver, self._driver.standing, self._driver.underway
        return Now(
            version=driver.version,
            phase=study.phase,
            question=driver.question,
            problem=None if driver.problem is None else in_words(driver.problem),
            pending=study.pending,
            plant=underway.plant_now(study.pending),
            incumbent=study.state.history.incumbent,
            can=possible(study),
            state=study.state,
            preparing=self._preparing,
            draft=driver.latest.draft,
            run_limit=underway.source.limit,
            simulated=simulated(driver),
            running=len(underway.going) if driver.at_once > 1 else 0,
        )

    def wait(self, version: int, timeout: float) -> Now:
        """Return as soon as the version differs from `version`, or after `timeout` seconds."""
        driver = self._driver
        with driver.changed:
            driver.changed.wait_for(lambda: driver.version != version or driver.closing, timeout)
            return self.now()

    @property
    def at_once(self) -> int:
        """Return the number of experiments that run at the same time."""
        return self._driver.at_once

    def look_at(self, theta: Float[np.ndarray, " n"]) -> Experiment:
        """Return the experiment of a simulated `theta`, shape (n,), and record nothing.

        A study with a twin shows what the twin does, unless θ ran on the plant.

        Raises:
            ScenarioError: If the agent does not simulate, or the simulation failed.
            KnobError: If the space does not hold `theta`.
        """
        return runs.look_at(self._driver, theta)

    def do(self, action: Action) -> Now:
        """Take an action if that is possible now, and return what is then to be seen.

        Raises:
            StaleError: If it comes too late, for example from a second tab; nothing is recorded.
            StudyError: If the file cannot be written; nothing has changed then.
        """
        with self._driver.changing():
            action.take(self._driver)
            return self.now()

    def preview(self, record: Record) -> Preview:
        """Read a rig's record, and save nothing. Raises RecordError if it is refused."""
        with self._driver.changed:
            return record.preview(self._driver)

    @property
    def drives(self) -> bool:
        """Return whether a run on a live plant is in progress; it takes no lock."""
        return self._driver.underway.moves_plant

    # Work in the background.

    def prepare(self, report: Callable[[Compiling], None] = lambda part: None) -> None:
        """Compile what is not compiled yet; `report` is called with each part.

        Otherwise, the first experiment compiles while it runs, without showing progress.
        """

        def tell(part: Compiling | None) -> None:
            self._preparing = part
            self._driver.tell()
            if part is not None:
                report(part)

        try:
            compile_runs(self.scenario, tell)
        finally:
            if self._preparing is not None:
                tell(None)

    def work(self) -> bool:
        """Do the next piece of work; False if there is none. The long part holds no lock."""
        driver = self._driver
        with driver.changing():
            # Never start a plant after closing: a person may already stand at it.
            before = driver.version
            job = None if driver.closing else runs.due(driver, ahead=self._runs_ahead)
            took = driver.version != before  # a result that was known already
            self._idle_at = None if job or took else driver.version
        if job is None:
            return took
        try:
            found = job.run()
            with driver.changing():
                job.finish(driver, found)
        except Exception as error:
            # Keep the thread alive: the problem is shown and can be retried.
            with driver.changing():
                driver.feed(Moment.BROKEN, error)
        return True

    def wait_for_work(self, timeout: float = 0.5) -> bool:
        """Wait until there may be work; return False once the interview is closed."""
        driver = self._driver
        with driver.changed:
            driver.has_background = True
            driver.changed.wait_for(lambda: driver.closing or driver.version != self._idle_at, timeout)
            return not driver.closing

    def raise_problem(self) -> None:
        """Raise the problem if the phase is FAILED."""
        if (problem := self._driver.problem) is not None:
            raise problem

    def close(self) -> None:
        """Take no more work and end a run of the user's scenario; the study file stays open."""
        driver = self._driver
        with driver.changed:
            first, driver.closing = not driver.closing, True
            driver.underway.stop("given up")
            if driver.thoughts.simulator is not None:
                driver.thoughts.simulator.abandon()
            driver.changed.notify_all()
            agent = driver.agent.copy() if first and self._asks else None
        # Last and without the lock: it takes time, and a plant must neither wait for it nor, if Ctrl-C
        # interrupts it, miss its stop.
        if agent is not None:
            driver.memory.keep(agent)

    @property
    def is_closed(self) -> bool:
        """Return whether `close` was called."""
        return self._driver.closing

    def _simulating(self) -> None:
        """Tell front ends how far the simulations are while they say nothing else."""
        driver = self._driver
        with driver.changing():
            if driver.phase is Phase.RUNNING or driver.thoughts.screened is None:
                driver.version += 1
                self.simulating()


def _simulator(scenario: Scenario, file: StudyFile) -> Simulator | None:
    """Return what the agent of a study simulates with; None if it simulates nothing.

    Raises:
        StudyError: If it simulates with a twin, which only the caller knows.
    """
    twin = named_twin(file.state.configuration)
    if twin is not None:
        raise StudyError(f"the study needs its twin {twin!r} to simulate with")
    if not is_simulating(file.state):
        return None
    seed = int(file.state.configuration["seed"])
    return Simulator(scenario, seed=seed, jobs=0, robust=is_robust(file.state))


def _check_at_once(scenario: Scenario, file: StudyFile) -> None:
    """Raise SettingsError unless several experiments of the study can run at the same time."""
    if scenario.source.asks:
        raise SettingsError("a rig runs one experiment at a time: leave --at-once out")
    if is_simulating(file.state):
        raise SettingsError(
            "the agent screening simulates on all cores already: leave --at-once out, or choose --agent glisp"
        )
