"""Run an interview: an agent, a study file, and the open question."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from typing import Concatenate, ParamSpec

import numpy as np
from jaxtyping import Float

from prefcal_agents import GLISp
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_agents.screening.agent import Screening
from prefcal_app.simulating import Screened, Simulated, Simulator, named_twin
from prefcal_app.summary.consistency import Consistency
from prefcal_app.summary.counts import Counts, Planned, answered
from prefcal_app.summary.outlook import Outlook, falls_outward, others_unbeaten, outlook
from prefcal_env.compiling import Compiling, compile_missing
from prefcal_env.errors import SettingsError, StaleError, StudyError
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.own_line import in_words
from prefcal_env.preferences.history import Comparison
from prefcal_env.preferences.loop import Comparison as Compared
from prefcal_env.study import StudyFile
from prefcal_scenarios.scenario import Scenario, finds_kpis, with_found_kpis

from . import records, runs, steps
from .experiments import ExperimentStore
from .flow import Flow
from .memory import agent_of, as_studied, index_of, is_simulating, known_outcomes
from .records import Given, Preview
from .view import Now, Phase, Question

P = ParamSpec("P")
Surrogate = Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]]
_LEAST = 5
"""Smallest number of verdicts for an outlook without simulations."""


def _step(step: Callable[Concatenate[Flow, P], None]) -> Callable[Concatenate["Interview", P], Now]:
    """Return a method that takes a step, and returns what is to be seen after it."""

    @wraps(step)
    def take(interview: "Interview", /, *args: P.args, **kwargs: P.kwargs) -> Now:
        with interview._change() as flow:
            if flow.moves_plant and step is not runs.stop:
                raise StaleError("a run on the plant is in progress: stop it first")
            step(flow, *args, **kwargs)
            return interview.now()

    return take


class Interview:
    """Interview that asks questions, takes answers, and lets the agent learn from them.

    Every step is saved in the study file before the next one begins: an answer before the next
    question, an experiment before it is shown. All methods can be called from any thread.
    Experiments are run by `work`, which a `Background` calls while the person compares.

    An action on an outdated page, for example in a second tab, raises StaleError and records
    nothing. If the file cannot be written, an action raises StudyError and changes nothing.

    Args:
        scenario: Scenario to calibrate.
        study: Open study file with the same knobs; the interview resumes from its state.
        ahead: Whether `work` also runs the experiments that likely answers would lead to.
        asks: Whether to continue the study, which writes to its file; False only reads it.
        simulator: What an agent that simulates does so with, for the scenario of the study; by
            default, it simulates in this process. It stays open.
        at_once: Number of experiments that run at the same time, each in a thread that calls
            `work`; 1 runs ahead of the answers instead, see `ahead`.

    Raises:
        StudyError: If the study has other knobs, or cannot be written.
        SettingsError: If `at_once` is above 1, and the agent simulates or the plant is a rig.
    """

    def __init__(
        self,
        scenario: Scenario,
        study: StudyFile,
        *,
        ahead: bool = True,
        asks: bool = True,
        simulator: Simulator | None = None,
        at_once: int = 1,
    ) -> None:
        if at_once > 1:
            _check_at_once(scenario, study)
        scenario = self._scenario = as_studied(scenario, study.state)
        self.study = study
        self._runs_ahead = ahead
        self._changed = threading.Condition(threading.RLock())
        twin = named_twin(study.state.configuration)
        if simulator is None and asks and twin is not None:
            raise StudyError(f"the study needs its twin {twin!r} to simulate with")
        if simulator is None and asks and is_simulating(study.state):
            seed = int(study.state.configuration["seed"])
            simulator = Simulator(scenario, seed=seed, jobs=0)
        if simulator is not None:
            simulator.tell = self._simulating
        agent = agent_of(study.state, scenario.space, simulator)
        store = ExperimentStore(scenario, study)
        self._flow = Flow(study, store, agent, simulator, at_once)
        self._closing = self._has_background = False
        self._idle_at: int | None = None
        self._flow.changed = self._driving
        if asks:
            self._flow.resume()

    # What front ends show.

    @property
    def scenario(self) -> Scenario:
        """Return the scenario of the study; from the first experiment on, with KPIs found in it.

        KPIs are found only if the scenario states none.
        """
        if not finds_kpis(self._scenario):
            return self._scenario
        with self._changed:
            measured = self._flow.store.first_measured()
            if measured is not None:
                self._scenario = with_found_kpis(self._scenario, measured)
            return self._scenario

    def now(self) -> Now:
        """Return a consistent view of the current state."""
        with self._changed:
            flow = self._flow
            return Now(
                version=flow.version,
                phase=flow.phase,
                question=flow.question,
                problem=None if flow.problem is None else in_words(flow.problem),
                pending=flow.pending,
                incumbent=flow.best,
                can_undo=steps.can_undo(flow),
                state=flow.state,
                preparing=flow.preparing,
                draft=flow.draft,
                run_limit=flow.source.limit,
                simulated=self._simulated(),
                running=len(flow.runs) if flow.at_once > 1 else 0,
                live=flow.plant.now(flow.run) if flow.source.asks == "confirm" else None,
            )

    def wait(self, version: int, timeout: float) -> Now:
        """Return as soon as the version differs from `version`, or after `timeout` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._flow.version != version or self._closing, timeout)
            return self.now()

    def experiment(self, index: int) -> Experiment:
        """Return experiment `index`, from 0. Raises StudyError if there is none."""
        with self._changed:
            return self._flow.store.experiment(index)

    def end(self, index: int) -> End:
        """Return how experiment `index`, from 0, ended. Raises StudyError if there is none."""
        with self._changed:
            return self._flow.store.end(index)

    def asked(self, answer: int) -> Question:
        """Return answered question `answer` as it was shown. Raises StaleError if there is none."""
        with self._changed:
            return self._flow.store.asked(steps.closed(self._flow, answer))

    def closed(self, answer: int) -> Comparison:
        """Return answer number `answer`, from 1; -1, -2, ... are follow-up comparisons.

        Raises:
            StaleError: If there is none.
        """
        with self._changed:
            return steps.closed(self._flow, answer)

    def comparisons(self, start: int = 0) -> tuple[Compared, ...]:
        """Return every closed query from number `start` on, including the first experiment's."""
        with self._changed:
            count = self._flow.state.history.answered
            return tuple(self._flow.store.comparison(i) for i in range(start, count))

    def answered(self) -> tuple[Compared, ...]:
        """Return the comparisons whose answers stand, in order, follow-up comparisons included."""
        with self._changed:
            flow = self._flow
            return tuple(flow.store.compared(closed) for closed in answered(flow.state))

    @property
    def counts(self) -> Counts:
        """Return the numbers of experiments and comparisons."""
        return Counts.of(self.study.state)

    @property
    def planned(self) -> Planned:
        """Return how many questions the study asks."""
        with self._changed:
            return Planned.of(self._flow.agent)

    @property
    def n_max(self) -> int:
        """Return the planned number of experiments; fewer if the space holds fewer θ."""
        return self._flow.agent.n_max

    @property
    def at_once(self) -> int:
        """Return the number of experiments that run at the same time."""
        return self._flow.at_once

    @property
    def questions(self) -> int | None:
        """Return the maximum number of comparisons per experiment; None if it is fixed at 1."""
        with self._changed:
            agent = self._flow.agent
        return agent.settings.questions_per_experiment if isinstance(agent, GLISp) else None

    @property
    def simulated(self) -> Simulated | None:
        """Return how many θ were simulated unseen; None if the agent simulates nothing."""
        with self._changed:
            return self._simulated()

    def _simulated(self) -> Simulated | None:
        flow = self._flow
        if flow.simulator is None or not isinstance(flow.agent, Screening):
            return None
        basis, planned = flow.basis, flow.agent.n_simulated
        # What was simulated for answers that were not given is not counted.
        shown = len(flow.state.finished)
        count, failed = min(flow.simulator.count, planned), flow.simulator.failed
        if basis is not None:
            count, failed = len(basis.bank), int(basis.bank.failed.sum())
        # Equal θ run once: where nothing is simulated any more, fewer than that were.
        twin, due = flow.twin is not None, flow.agent.due if flow.simulator.busy else 0
        return Simulated(count, planned, failed, shown, twin=twin, due=due)

    @property
    def surrogate(self) -> Surrogate | None:
        """Return the learned cost of m physical θ, lower is better; None if nothing is learned."""
        with self._changed:
            closed = self._flow.state.history.comparisons
            learned = any(c.answer.preference is not None and not c.retracted for c in closed)
            # A copy, since the surrogate must not change while it is shown.
            return getattr(self._flow.agent.copy(), "surrogate", None) if learned else None

    @property
    def _promise(self) -> str | None:
        """Return what the simulated θ still promise; empty without any, None if too early."""
        if self.screens:
            screened = self.screened()
            prospect = None if screened is None else screened.prospect
            return None if prospect is None else prospect.text
        closed = self.study.state.history.comparisons
        return "" if sum(c.verdict is not None for c in closed) >= _LEAST else None

    @property
    def outlook(self) -> Outlook | None:
        """Return whether to continue, and the knobs at the end of their range; None if unknown."""
        now, promise = self.now(), self._promise
        if promise is None or now.incumbent is None:
            return None
        best = self.experiment(now.incumbent).theta
        space, place = self.scenario.space, self.study.path
        found = outlook(promise, best, space, place, now.state, missed=self.missed, helps=self._helps)
        if not self._flow.agent.by_value:
            found = replace(found, unbeaten=others_unbeaten(now.state.history))
        return found if found.sentences else None

    def _helps(self, knob: int, upper: bool) -> bool:
        """Return whether the model expects that going beyond an end of a knob's range helps."""
        if self.screens:
            screened = self.screened()
            trend = None if screened is None else screened.basis.trend
            return trend is not None and bool(trend[knob] > 0) == upper
        surrogate, best = self.surrogate, self.now().incumbent
        if surrogate is None or best is None:
            return False
        theta = self.experiment(best).theta
        return falls_outward(surrogate, self.scenario.space, theta, knob, upper)

    @property
    def missed(self) -> list[str]:
        """Return the titles of the KPIs whose objectives the best experiment misses."""
        best = self.now().incumbent
        if best is None:
            return []
        experiment = self.experiment(best)
        return [k.title for k in self.scenario.shown_kpis if k.met_by(experiment) is False]

    @property
    def screens(self) -> bool:
        """Return whether the agent simulates θ that are not shown."""
        return isinstance(self._flow.agent, Screening)

    def screened(self, *, current: bool = True) -> Screened | None:
        """Return what a screening agent knows; None for other agents and before it is worked out.

        With `current`, what it knew before the latest answer counts as unknown.
        """
        with self._changed:
            flow = self._flow
            basis = flow.grounds if current else flow.basis
            return None if basis is None else Screened(flow.agent.space, basis)

    def wait_for_screened(self, timeout: float) -> Screened | None:
        """Return what a screening agent knows, as soon as that is known; None after `timeout` s.

        It does not wait if nothing works in the background.
        """
        with self._changed:
            comes = self.screens and self._has_background
            self._changed.wait_for(lambda: not comes or self._closing or self.screened() is not None, timeout)
            return self.screened()

    @property
    def index(self) -> LearnedCost | None:
        """Return the cost learned from answers and KPIs; None while they say nothing about it."""
        with self._changed:
            history = known_outcomes(self.study.state, self._flow.store)
        return index_of(history, self._flow.seed)

    @property
    def consistency(self) -> Consistency:
        """Return how consistent the answers are."""
        return Consistency.of(self.study.state)

    # What the person does.

    answer, give = _step(steps.answer), _step(steps.give)
    mark, undo, retract = _step(steps.mark), _step(steps.undo), _step(steps.retract)
    repeat, pace, ask_for = _step(steps.repeat), _step(steps.pace), _step(steps.ask_for)
    record, write_and_start = _step(records.record), _step(runs.confirm)
    fail, stop_run, retry = _step(runs.fail), _step(runs.stop), _step(runs.retry)
    finish, go_on = _step(runs.finish), _step(runs.go_on)

    def look_at(self, theta: Float[np.ndarray, " n"]) -> Experiment:
        """Return the experiment of a simulated `theta`, shape (n,), and record nothing.

        A study with a twin shows what the twin does, unless θ ran on the plant.

        Raises:
            ScenarioError: If the agent does not simulate, or the simulation failed.
            KnobError: If the space does not hold `theta`.
        """
        return runs.look_at(self._flow, self._changed, theta)

    def preview(self, given: Given) -> Preview:
        """Read a rig's record, and save nothing. Raises RecordError if it is refused."""
        with self._changed:
            return records.preview(self._flow, given)

    @property
    def drives(self) -> bool:
        """Return whether a run on a live plant is in progress; it takes no lock."""
        return self._flow.moves_plant

    # Work in the background.

    def prepare(self, report: Callable[[Compiling], None] = lambda part: None) -> None:
        """Compile what is not compiled yet; `report` is called with each part.

        Otherwise, the first experiment compiles while it runs, without showing progress.
        """

        def tell(part: Compiling | None) -> None:
            with self._change() as flow:
                flow.preparing = part
                flow.version += 1
            if part is not None:
                report(part)

        try:
            compile_missing(tell)
        finally:
            if self._flow.preparing is not None:
                tell(None)

    def work(self) -> bool:
        """Do the next piece of work; False if there is none. The long part holds no lock."""
        with self._change() as flow:
            # Never start a plant after closing: a person may already stand at it.
            attempt = None if self._closing else runs.due(flow, ahead=self._runs_ahead)
            self._idle_at = flow.version if attempt is None else None
        if attempt is None:
            return False
        try:
            finish = attempt()
            with self._change():
                finish()
        except Exception as error:
            # Keep the thread alive: the problem is shown and can be retried.
            with self._change() as flow:
                flow.move(Phase.FAILED, error)
        return True

    def wait_for_work(self, timeout: float = 0.5) -> bool:
        """Wait until there may be work; return False once the interview is closed."""
        with self._changed:
            self._has_background = True
            self._changed.wait_for(lambda: self._closing or self._flow.version != self._idle_at, timeout)
            return not self._closing

    def raise_problem(self) -> None:
        """Raise the problem if the phase is FAILED."""
        with self._changed:
            if self._flow.phase is Phase.FAILED and self._flow.problem is not None:
                raise self._flow.problem

    def close(self) -> None:
        """Take no more work and end a run of the user's scenario; the study file stays open."""
        with self._changed:
            self._closing = True
            awaited, recovery = self._flow.awaited, self._flow.plant.run
            for run in (*self._flow.runs.values(), awaited and awaited[1], recovery):
                if run is not None:
                    run.stop("given up")
            if self._flow.simulator is not None:
                self._flow.simulator.abandon()
            self._changed.notify_all()

    @property
    def is_closed(self) -> bool:
        """Return whether `close` was called."""
        return self._closing

    def _simulating(self) -> None:
        """Tell front ends how far the simulations are while they say nothing else."""
        with self._change() as flow:
            if flow.phase is Phase.RUNNING or flow.basis is None:
                flow.version += 1

    def _driving(self) -> None:
        """Tell front ends how far a run on the live plant is."""
        with self._change() as flow:
            flow.version += 1

    @contextmanager
    def _change(self) -> Iterator[Flow]:
        with self._changed:
            version = self._flow.version
            try:
                yield self._flow
            finally:
                if self._flow.version != version:
                    runs.make_way(self._flow)
                    self._changed.notify_all()


def _check_at_once(scenario: Scenario, study: StudyFile) -> None:
    """Raise SettingsError unless several experiments of the study can run at the same time."""
    if scenario.source.asks:
        raise SettingsError("a rig runs one experiment at a time: leave --at-once out")
    if is_simulating(study.state):
        raise SettingsError(
            "the agent screening simulates on all cores already: leave --at-once out, or choose --agent glisp"
        )
