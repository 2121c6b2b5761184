"""Say what is known of a study: its experiments and answers, what was learned, whether to continue."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_agents import GLISp
from prefcal_agents.glisp.foresight import Foresight
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_agents.screening.agent import Screening
from prefcal_app.simulating import Screened, Simulated
from prefcal_app.summary.consistency import Consistency
from prefcal_app.summary.counts import Counts, Planned, answered
from prefcal_app.summary.outlook import Outlook, falls_outward, foreseen, others_unbeaten, outlook
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.preferences.history import Comparison
from prefcal_env.preferences.loop import Comparison as Compared
from prefcal_scenarios.scenario import Scenario

from . import steps
from .flow import Flow, Guarded
from .study.memory import index_of, is_robust, known_outcomes
from .study.now import Phase, Question

Surrogate = Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]]
_LEAST = 5
"""Smallest number of verdicts for an outlook without simulations."""


class Known:
    """What is known of an interview, readable from any thread.

    Args:
        guarded: Flow of the interview.
        scenario: Function that returns its scenario, with KPIs found in its experiments.
    """

    def __init__(self, guarded: Guarded, scenario: Callable[[], Scenario]) -> None:
        self._guarded, self._scenario = guarded, scenario

    @property
    def counts(self) -> Counts:
        """Return the numbers of experiments and comparisons."""
        with self._guarded.reading() as flow:
            return Counts.of(flow.state)

    @property
    def planned(self) -> Planned:
        """Return how many questions the study asks."""
        with self._guarded.reading() as flow:
            return Planned.of(flow.agent)

    @property
    def n_max(self) -> int:
        """Return the planned number of experiments; fewer if the space holds fewer θ."""
        with self._guarded.reading() as flow:
            return flow.agent.n_max

    @property
    def questions(self) -> int | None:
        """Return the maximum number of comparisons per experiment; None if it is fixed at 1."""
        with self._guarded.reading() as flow:
            agent = flow.agent
        return agent.settings.questions_per_experiment if isinstance(agent, GLISp) else None

    @property
    def simulated(self) -> Simulated | None:
        """Return how many θ were simulated unseen; None if the agent simulates nothing."""
        with self._guarded.reading() as flow:
            return simulated(flow)

    @property
    def surrogate(self) -> Surrogate | None:
        """Return the learned cost of m physical θ, lower is better; None if nothing is learned."""
        with self._guarded.reading() as flow:
            closed = flow.state.history.comparisons
            learned = any(c.answer.preference is not None and not c.retracted for c in closed)
            # A copy, since the surrogate must not change while it is shown.
            return getattr(flow.agent.copy(), "surrogate", None) if learned else None

    @property
    def _promise(self) -> str | None:
        """Return what the simulated θ still promise; empty without any, None if too early."""
        if self.screens:
            screened = self.screened()
            prospect = None if screened is None else screened.prospect
            return None if prospect is None else prospect.text
        with self._guarded.reading() as flow:
            closed = flow.state.history.comparisons
        return self.promise if sum(c.verdict is not None for c in closed) >= _LEAST else None

    @property
    def promise(self) -> str:
        """Return what the next experiment can bring; empty if unknown, and if the person chose it."""
        with self._guarded.reading() as flow:
            pending, requested = flow.study.pending, flow.state.requested
        index, found = None if pending is None else pending.index, self.foresight()
        return "" if found is None or index in requested else foreseen(found.chance, index)

    def foresight(self, *, learn: bool = False) -> Foresight | None:
        """Return what the next experiment can bring; None if unknown, or not worked out yet.

        With `learn`, or if no threads work in the background, it is worked out here and now.
        """
        with self._guarded.reading() as flow:
            agent, learn = flow.agent.copy(), learn or not self._guarded.has_background
        if not isinstance(agent, GLISp) or not (learn or agent.foresees):
            return None
        return agent.foresight

    @property
    def outlook(self) -> Outlook | None:
        """Return whether to continue, and the knobs at the end of their range; None if unknown."""
        best, promise = self._best(), self._promise
        if promise is None or best is None:
            return None
        with self._guarded.reading() as flow:
            state, place, by_value = flow.state, flow.file.path, flow.agent.by_value
        space = self._scenario().space
        found = outlook(promise, best.theta, space, place, state, missed=self.missed, helps=self._helps)
        screened = self.screened()
        if screened is not None and state.ended:
            found = replace(found, result=screened.result(self._scenario()))
        if not by_value:
            found = replace(found, unbeaten=others_unbeaten(state.history, robust=is_robust(state)))
        return found if found.sentences else None

    def _helps(self, knob: int, upper: bool) -> bool:
        """Return whether the model expects that going beyond an end of a knob's range helps."""
        if self.screens:
            screened = self.screened()
            trend = None if screened is None else screened.basis.trend
            return trend is not None and bool(trend[knob] > 0) == upper
        surrogate, best = self.surrogate, self._best()
        if surrogate is None or best is None:
            return False
        return falls_outward(surrogate, self._scenario().space, best.theta, knob, upper)

    def _best(self) -> Experiment | None:
        with self._guarded.reading() as flow:
            best = flow.study.best
            return None if best is None else flow.store.experiment(best)

    @property
    def missed(self) -> list[str]:
        """Return the titles of the KPIs whose objectives the best experiment misses."""
        best = self._best()
        if best is None:
            return []
        return [k.title for k in self._scenario().shown_kpis if k.met_by(best) is False]

    @property
    def screens(self) -> bool:
        """Return whether the agent simulates θ that are not shown."""
        with self._guarded.reading() as flow:
            return isinstance(flow.agent, Screening)

    def screened(self, *, current: bool = True) -> Screened | None:
        """Return what a screening agent knows; None for other agents and before it is worked out.

        With `current`, what it knew before the latest answer counts as unknown.
        """
        with self._guarded.reading() as flow:
            basis = flow.thoughts.grounds(flow.agent) if current else flow.thoughts.basis
            return None if basis is None else Screened(flow.agent.space, basis)

    def wait_for_screened(self, timeout: float) -> Screened | None:
        """Return what a screening agent knows, as soon as that is known; None after `timeout` s.

        It does not wait if nothing works in the background.
        """
        guarded = self._guarded
        with guarded.changed:
            comes = self.screens and guarded.has_background
            guarded.changed.wait_for(lambda: not comes or guarded.closing or self._worked_out(), timeout)
            return self.screened()

    def _worked_out(self) -> bool:
        """Return whether it is known what the question was chosen from and, at the end, all else."""
        screened = self.screened()
        with self._guarded.reading() as flow:
            over = flow.phase is Phase.OVER
        return screened is not None and (not over or screened.told_result)

    @property
    def index(self) -> LearnedCost | None:
        """Return the cost learned from answers and KPIs; None while they say nothing about it."""
        with self._guarded.reading() as flow:
            history, seed = known_outcomes(flow.state, flow.store), flow.study.seed
        return index_of(history, seed)

    @property
    def consistency(self) -> Consistency:
        """Return how consistent the answers are."""
        with self._guarded.reading() as flow:
            return Consistency.of(flow.state)


def simulated(flow: Flow) -> Simulated | None:
    """Return how many θ were simulated unseen; None if the agent simulates nothing."""
    simulator, basis = flow.thoughts.simulator, flow.thoughts.basis
    if simulator is None or not isinstance(flow.agent, Screening):
        return None
    planned = flow.agent.n_simulated
    # What was simulated for answers that were not given is not counted.
    shown = len(flow.state.finished)
    count, failed = min(simulator.count, planned), simulator.failed
    if basis is not None:
        count, failed = len(basis.bank), int(basis.bank.failed.sum())
    # Equal θ run once: where nothing is simulated any more, fewer than that were.
    twin, due = flow.thoughts.twin is not None, flow.agent.due if simulator.busy else 0
    return Simulated(count, planned, failed, shown, twin=twin, due=due)


class Past:
    """Experiments and answers of an interview, readable from any thread."""

    def __init__(self, guarded: Guarded) -> None:
        self._guarded = guarded

    def experiment(self, index: int) -> Experiment:
        """Return experiment `index`, from 0. Raises StudyError if there is none."""
        with self._guarded.reading() as flow:
            return flow.store.experiment(index)

    def end(self, index: int) -> End:
        """Return how experiment `index`, from 0, ended. Raises StudyError if there is none."""
        with self._guarded.reading() as flow:
            return flow.store.end(index)

    def asked(self, answer: int) -> Question:
        """Return answered question `answer` as it was shown. Raises StaleError if there is none."""
        with self._guarded.reading() as flow:
            return flow.store.asked(steps.closed(flow, answer))

    def closed(self, answer: int) -> Comparison:
        """Return answer number `answer`, from 1; -1, -2, ... are follow-up comparisons.

        Raises:
            StaleError: If there is none.
        """
        with self._guarded.reading() as flow:
            return steps.closed(flow, answer)

    def comparisons(self, start: int = 0) -> tuple[Compared, ...]:
        """Return every closed query from number `start` on, including the first experiment's."""
        with self._guarded.reading() as flow:
            return tuple(flow.store.comparison(i) for i in range(start, flow.state.history.answered))

    def answered(self) -> tuple[Compared, ...]:
        """Return the comparisons whose answers stand, in order, follow-up comparisons included."""
        with self._guarded.reading() as flow:
            return tuple(flow.store.compared(closed) for closed in answered(flow.state))
