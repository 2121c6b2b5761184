"""Run an interview: an agent, a study file, and the open question."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from prefcal_app.simulating import Simulator, named_twin
from prefcal_env.compiling import Compiling, compile_missing
from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.own_line import in_words
from prefcal_env.study import StudyFile
from prefcal_scenarios.scenario import Scenario, finds_kpis, with_found_kpis

from . import records, runs
from .can import possible
from .flow import Flow, Guarded
from .known import Known, Past, simulated
from .person import Steps
from .records import Given, Preview
from .study.experiments import ExperimentStore
from .study.memory import agent_of, as_studied, is_robust, is_simulating
from .study.now import Now, Phase
from .volatile.thoughts import Thoughts


class Interview:
    """Interview that asks questions, takes answers, and lets the agent learn from them.

    Every step is saved in the study file before the next one begins: an answer before the next
    question, an experiment before it is shown. Everything can be called from any thread.
    Experiments are run by `work`, which a `Background` calls while the person compares.

    Args:
        scenario: Scenario to calibrate.
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
        steps: What the person can do.
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
        self._flow = Flow(file, store, agent, Thoughts(simulator, twin), at_once)
        self._guarded = Guarded(self._flow)
        self.steps, self.past = Steps(self._guarded, self.now), Past(self._guarded)
        self.known = Known(self._guarded, lambda: self.scenario)
        self._preparing: Compiling | None = None
        self._idle_at: int | None = None
        if asks:
            self._flow.resume()

    @property
    def scenario(self) -> Scenario:
        """Return the scenario of the study; from the first experiment on, with KPIs found in it.

        KPIs are found only if the scenario states none.
        """
        if not finds_kpis(self._scenario):
            return self._scenario
        with self._guarded.reading() as flow:
            measured = flow.store.first_measured()
            if measured is not None:
                self._scenario = with_found_kpis(self._scenario, measured)
            return self._scenario

    def now(self) -> Now:
        """Return a consistent view of the current state."""
        with self._guarded.reading() as flow:
            study, underway = flow.study, flow.underway
            return Now(
                version=flow.version,
                phase=flow.phase,
                question=flow.question,
                problem=None if flow.problem is None else in_words(flow.problem),
                pending=study.pending,
                incumbent=study.best,
                can=possible(flow),
                state=flow.state,
                preparing=self._preparing,
                draft=flow.latest.draft,
                run_limit=underway.source.limit,
                simulated=simulated(flow),
                running=len(underway.going) if flow.at_once > 1 else 0,
                plant=underway.plant_now(study.pending),
            )

    def wait(self, version: int, timeout: float) -> Now:
        """Return as soon as the version differs from `version`, or after `timeout` seconds."""
        guarded = self._guarded
        with guarded.changed:
            guarded.changed.wait_for(lambda: self._flow.version != version or guarded.closing, timeout)
            return self.now()

    @property
    def at_once(self) -> int:
        """Return the number of experiments that run at the same time."""
        return self._flow.at_once

    def look_at(self, theta: Float[np.ndarray, " n"]) -> Experiment:
        """Return the experiment of a simulated `theta`, shape (n,), and record nothing.

        A study with a twin shows what the twin does, unless θ ran on the plant.

        Raises:
            ScenarioError: If the agent does not simulate, or the simulation failed.
            KnobError: If the space does not hold `theta`.
        """
        return runs.look_at(self._flow, self._guarded.changed, theta)

    def preview(self, given: Given) -> Preview:
        """Read a rig's record, and save nothing. Raises RecordError if it is refused."""
        with self._guarded.reading() as flow:
            return records.preview(flow, given)

    @property
    def drives(self) -> bool:
        """Return whether a run on a live plant is in progress; it takes no lock."""
        return self._flow.underway.moves_plant

    # Work in the background.

    def prepare(self, report: Callable[[Compiling], None] = lambda part: None) -> None:
        """Compile what is not compiled yet; `report` is called with each part.

        Otherwise, the first experiment compiles while it runs, without showing progress.
        """

        def tell(part: Compiling | None) -> None:
            self._preparing = part
            self._guarded.tell()
            if part is not None:
                report(part)

        try:
            compile_missing(tell)
        finally:
            if self._preparing is not None:
                tell(None)

    def work(self) -> bool:
        """Do the next piece of work; False if there is none. The long part holds no lock."""
        guarded = self._guarded
        with guarded.changing() as flow:
            # Never start a plant after closing: a person may already stand at it.
            attempt = None if guarded.closing else runs.due(flow, ahead=self._runs_ahead)
            self._idle_at = flow.version if attempt is None else None
        if attempt is None:
            return False
        try:
            finish = attempt()
            with guarded.changing():
                finish()
        except Exception as error:
            # Keep the thread alive: the problem is shown and can be retried.
            with guarded.changing() as flow:
                flow.move(Phase.FAILED, error)
        return True

    def wait_for_work(self, timeout: float = 0.5) -> bool:
        """Wait until there may be work; return False once the interview is closed."""
        guarded = self._guarded
        with guarded.changed:
            guarded.has_background = True
            guarded.changed.wait_for(lambda: guarded.closing or self._flow.version != self._idle_at, timeout)
            return not guarded.closing

    def raise_problem(self) -> None:
        """Raise the problem if the phase is FAILED."""
        with self._guarded.reading() as flow:
            if flow.phase is Phase.FAILED and flow.problem is not None:
                raise flow.problem

    def close(self) -> None:
        """Take no more work and end a run of the user's scenario; the study file stays open."""
        with self._guarded.reading() as flow:
            self._guarded.closing = True
            flow.underway.stop("given up")
            if flow.thoughts.simulator is not None:
                flow.thoughts.simulator.abandon()
            self._guarded.changed.notify_all()

    @property
    def is_closed(self) -> bool:
        """Return whether `close` was called."""
        return self._guarded.closing

    def _simulating(self) -> None:
        """Tell front ends how far the simulations are while they say nothing else."""
        with self._guarded.changing() as flow:
            if flow.phase is Phase.RUNNING or flow.thoughts.basis is None:
                flow.version += 1


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
