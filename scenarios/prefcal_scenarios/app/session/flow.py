"""Advance an interview from an answer to the next question."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent, rematch
from prefcal_env.compiling import Compiling
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.live import LiveRig
from prefcal_env.preferences.answer import Answer, Query
from prefcal_env.preferences.history import History, Sample
from prefcal_env.preferences.run_facts import completed
from prefcal_env.rig import Rig
from prefcal_env.study import (
    Answered,
    Ended,
    Event,
    Failed,
    Finished,
    Requested,
    Shown,
    State,
    StudyFile,
    Suggested,
)
from prefcal_scenarios.app.simulating import Basis, Simulator, named_twin, past_of
from prefcal_scenarios.own.own_line import in_words
from prefcal_scenarios.scenario import Scenario

from .experiments import ExperimentStore
from .live.state import Live
from .order import challenger_left
from .prefetch import Prefetch, Prepared
from .view import Phase, Question, Side


@dataclass(slots=True)
class Flow:
    """Mutable part of an interview; callers must hold the interview's lock."""

    study: StudyFile
    store: ExperimentStore
    agent: Agent
    simulator: Simulator | None = None
    """What the agent simulates with; None if it simulates nothing."""
    prefetch: Prefetch = field(default_factory=Prefetch)
    phase: Phase = Phase.RUNNING
    question: Question | None = None
    problem: Exception | None = None
    checked: bool = False
    """Whether an experiment of this process was checked against its scenario."""
    preparing: Compiling | None = None
    version: int = 0
    answered_at: int = 0
    """Version at which an answer was last given or undone."""
    stopped: int | None = None
    """Sample whose run the person stopped before it began."""
    draft: str = ""
    """Comment of the answer that was undone last, until another answer is given."""
    basis: Basis | None = None
    """What the latest question was chosen from, by simulations."""
    knows: tuple[Agent, History] | None = None
    """The agent and the record for which it knows its next query."""
    thinking: tuple[Agent, History] | None = None
    """The agent and the record whose next query is being chosen in the background."""

    live: Live = field(default_factory=Live)
    """What is known of the live plant, if the scenario has one."""

    @property
    def twin(self) -> Scenario | None:
        """Return the model that θ are simulated on; None if that is the scenario itself."""
        twin = named_twin(self.state.configuration)
        return None if twin is None or self.simulator is None else self.simulator.scenario

    @property
    def state(self) -> State:
        """Return the state of the study file."""
        return self.study.state

    @property
    def seed(self) -> int:
        """Return the seed of the study."""
        return int(self.state.configuration["seed"])

    @property
    def best(self) -> int | None:
        """Return the index of the agent's best experiment so far; None before the first."""
        if not self.state.history.comparisons or self.agent.by_value:
            return self.state.history.incumbent
        return self.agent.best_index

    @property
    def pending(self) -> Suggested | None:
        """Return the sample that has no answer yet; None until it is proposed."""
        sample, index = self.state.history.pending, self.state.history.answered
        return None if sample is None else Suggested(index, sample.z, sample.theta)

    @property
    def must_think(self) -> bool:
        """Return whether choosing the next query may take simulations, so no lock may be held."""
        agent, history = self.agent, self.agent.history
        if self.simulator is None or history.pending is not None or rematch(history) is not None:
            return False
        return self.knows is None or self.knows[0] is not agent or self.knows[1] != history

    @property
    def grounds(self) -> Basis | None:
        """Return what the open question was chosen from; None while it is not known."""
        basis = self.basis
        if basis is None or basis.past != past_of(self.agent):
            return None
        # The person may have asked for another challenger since.
        return basis if basis.pending == self.agent.history.pending else None

    def adopt(self, prepared: Prepared) -> None:
        """Continue with an agent that knows its next query."""
        self.agent = prepared.agent
        self.knows = (prepared.agent, prepared.agent.history)
        self.basis = prepared.basis or self.basis

    def move(self, phase: Phase, problem: Exception | None = None) -> None:
        """Enter `phase`, without a question."""
        self.phase, self.problem, self.question = phase, problem, None
        self.version += 1

    def resume(self) -> None:
        """Resume from the state of the study file; an open question stays open."""
        if self.state.ended or self.is_overtaken():
            self.proceed()
        else:
            self.refresh()

    def is_overtaken(self) -> bool:
        """Return whether the agent would now ask another question than the one shown, if any.

        A retraction, a changed setting or a newer algorithm can change the agent's question, and
        after a crash the old one is still shown: an answer to it would be about the wrong pair.
        """
        if self.state.open is None:
            return True
        _, shown = self.state.open
        if shown.repeats is not None:
            return False
        if shown.challenger < self.state.history.answered:
            if self.must_think:
                return True  # until it is known, see `runs.think`
            asked = None if self.agent.done else self.agent.ask()
            return asked is None or pair_of(asked) != (shown.challenger, shown.incumbent)
        return shown.incumbent != self.best

    def proceed(self) -> None:
        """Continue until an experiment must run, a question must be answered, or the study ends.

        The answer that led here is already saved. So an error from here on, such as a full disk,
        is shown as a problem that can be retried. It is not raised to the person who answered,
        whose question is already closed.
        """
        self.prefetch.forget()
        try:
            self._proceed()
        except Exception as error:
            self.move(Phase.FAILED, error)

    def _proceed(self) -> None:
        if not self.state.ended and self.must_think:
            return self.move(Phase.RUNNING)
        if not self.state.ended and self.agent.done:
            self.study.append(Ended("all compared"))
        if self.state.ended:
            return self.move(Phase.OVER)
        query = self.agent.ask()
        self._suggest(query)
        index = query.challenger.index
        if index not in self.state.finished:
            return self._wait_for(index)
        if query.incumbent is not None:
            return self._show(query)
        if self.agent.by_value:
            rival, answer = self.store.scored(index)
            self.study.append(Answered(None, index, rival, answer))
            self.agent.tell(query, Answer(None, value=answer.value))
        else:
            alone = self.store.experiment(index)
            first = completed(Answer(None), alone, None, self.store.outcomes(index, None))
            self.study.append(Answered(None, index, None, first))
            self.agent.tell(query, first)
        return self._proceed()

    def _suggest(self, query: Query) -> None:
        """Store the sample, and its experiment if it is already known, in one step."""
        index, theta = query.challenger.index, query.challenger.theta
        if len(self.state.history.samples) > index:
            return
        sample = self.agent.state.history.samples[index]
        self.study.append(Suggested(index, sample.z, sample.theta), *self._finished(index, theta))

    def request(self, sample: Sample) -> None:
        """Store a sample that the person asks for in place of the pending one."""
        index = self.state.history.answered
        known = self._finished(index, np.array(sample.theta))
        self.study.append(Requested(index, sample.z, sample.theta), *known)

    def _finished(
        self, index: int, theta: Float[np.ndarray, " n"]
    ) -> list[Event | tuple[Finished, Experiment]]:
        """Return the event that adds the experiment of θ, if it is already known."""
        earlier = self.study.find_experiment(theta)
        if earlier is not None:
            return [Finished(index, same_as=earlier)]
        prefetched = self.prefetch.experiment(theta)
        return [] if prefetched is None else [(Finished(index), prefetched)]

    def _wait_for(self, index: int) -> None:
        if isinstance(self.store.scenario.run, Rig):
            self.move(Phase.RECORD)
        elif isinstance(self.store.scenario.run, LiveRig):
            self.live.ask()
            self.move(Phase.CONFIRM)
        else:
            # Also if its run failed before: the person may have fixed the plant since.
            self.move(Phase.RUNNING)

    def _show(self, query: Query) -> None:
        assert query.incumbent is not None
        new, old = query.challenger.index, query.incumbent.index
        left = challenger_left(self.seed, new, old if query.further else None)
        shown = Shown(new, old, left)
        self._put(self.study.append(shown)[0], shown)

    def show_again(self, shown: Shown) -> None:
        """Put an earlier question on show again."""
        self.prefetch.forget()
        self._put(self.study.append(shown)[0], shown)

    def refresh(self) -> None:
        """Show the open question with the current marks."""
        assert self.state.open is not None
        self.prefetch.forget()
        self._put(*self.state.open)

    def _put(self, id_: int, shown: Shown) -> None:
        question = self.store.question(id_, self.state.history.answered, shown)
        if shown.repeats is None:
            known = self.store.outcomes(shown.challenger, shown.incumbent)
            further = shown.challenger < self.state.history.answered
            left, right = (
                self._with_role(side, further) for side in (question.left, question.right)
            )
            question = replace(question, left=left, right=right, outcomes=known, further=further)
        else:
            further = any(c.question == shown.repeats for c in self.state.history.follow_ups)
            question = replace(question, further=further)
        self.move(Phase.QUESTION)
        self.question = question

    def _with_role(self, side: Side, further: bool) -> Side:
        """Return `side` with its role: "best so far", "new" or none."""
        role = "new" if side.challenger and not further else ""
        return replace(side, role="best so far" if side.index == self.best else role)

    def tell(self, answer: Answer) -> None:
        """Teach the agent `answer`, which is already saved; proceed if the next step is known."""
        if self.simulator is not None and self.prefetch.busy not in (None, answer):
            self.simulator.abandon()
        twin = self.prefetch.take(answer)
        if twin is None:
            self.agent.tell(self.agent.ask(), answer)
            # A proposal takes time, so `work` computes it.
            return self.move(Phase.RUNNING)
        self.adopt(twin)
        return self.proceed()

    def ran(self, sample: Suggested, result: Experiment | Exception) -> None:
        """Take the result of running `sample`, if it is still the pending one."""
        self.stopped = None
        if isinstance(result, Experiment):
            self.prefetch.keep(np.array(sample.theta), result)
        if self.phase is not Phase.RUNNING or self.pending != sample:
            return None
        try:
            if isinstance(result, Experiment):
                self.study.append((Finished(sample.index), result))
            else:
                self.study.append(Failed(sample.index, in_words(result)))
        except StudyError as error:
            return self.move(Phase.FAILED, error)
        if isinstance(result, Experiment):
            return self.proceed()
        return self.move(Phase.FAILED, result)


def pair_of(query: Query) -> tuple[int, int | None]:
    """Return the indices of the challenger and the incumbent."""
    return query.challenger.index, None if query.incumbent is None else query.incumbent.index
