"""Advance an interview from an answer to the next question."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_app.simulating import Basis, Simulator, named_twin, past_of
from prefcal_env.compiling import Compiling
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.live import LiveRig
from prefcal_env.own_line import in_words
from prefcal_env.preferences.answer import Answer, Query
from prefcal_env.preferences.history import History, Sample
from prefcal_env.preferences.loop import completed
from prefcal_env.rig import Rig
from prefcal_env.study import (
    Answered,
    Ended,
    Event,
    Failed,
    Finished,
    Led,
    Requested,
    Shown,
    State,
    StudyFile,
    Suggested,
    Taken,
)
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
    at_once: int = 1
    """Number of experiments that run at the same time."""
    running: set[bytes] = field(default_factory=set)
    """Keys of the θ that run now, if several do."""
    asked: bool = False
    """Whether the agent has proposed what can run until the next answer, if several do."""
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
        return self.agent.history.incumbent

    @property
    def pending(self) -> Suggested | None:
        """Return the sample that has no answer yet; None until it is proposed."""
        sample, index = self.state.history.pending, self.state.history.answered
        return None if sample is None else Suggested(index, sample.z, sample.theta)

    @property
    def unfinished(self) -> tuple[Suggested, ...]:
        """Return all samples that have no experiment yet, in the order proposed."""
        samples = enumerate(self.state.history.samples)
        return tuple(Suggested(i, s.z, s.theta) for i, s in samples if i not in self.state.finished)

    @property
    def must_think(self) -> bool:
        """Return whether choosing the next query may take simulations, so no lock may be held."""
        return self.simulator is not None and not self.agent.knows(self.agent.history)

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
        self.basis = prepared.basis or self.basis

    def move(self, phase: Phase, problem: Exception | None = None) -> None:
        """Enter `phase`, without a question."""
        self.asked = False
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
        if self.simulator is not None and not self.state.ended:
            self._keep_best()
        if not self.state.ended and self.agent.done:
            self.study.append(Ended("all compared"))
        if self.state.ended:
            return self.move(Phase.OVER)
        queries = self.agent.ask(self.at_once)
        self._suggest()
        query = self._ready(queries)
        if query is None:
            return self._wait_for()
        index = query.challenger.index
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

    def _keep_best(self) -> None:
        """Store which sample the agent holds for the best, if the answers name another."""
        best = self.agent.best_index
        if best is not None and best != self.state.history.incumbent:
            self.study.append(Led(best))

    def _suggest(self) -> None:
        """Store each new sample, and its experiment if it is already known, in one step."""
        samples = self.agent.history.samples
        for index in range(len(self.state.history.samples), len(samples)):
            z, theta = samples[index].z, samples[index].theta
            known = self._finished(index, np.array(theta))
            self.study.append(Suggested(index, z, theta), *known)

    def _ready(self, queries: Sequence[Query]) -> Query | None:
        """Return the query to show now, and give its sample the next number; None if none is ready.

        A query about two known experiments comes first, then the experiment that ended first.
        """
        if queries[0].further:
            return queries[0]
        finished = self.state.finished
        ready = [q.challenger.index for q in queries if q.challenger.index in finished]
        if not ready:
            return None
        self.take(min(ready, key=finished.__getitem__))
        return self.agent.ask()

    def take(self, index: int) -> None:
        """Give pending sample `index` the number of the next one to be answered."""
        if index != self.state.history.answered:
            self.study.append(Taken(index))
            history = self.agent.history
            self.agent.history = history.arranged(history.taken(index))

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

    def _wait_for(self) -> None:
        if isinstance(self.store.scenario.run, Rig):
            self.move(Phase.RECORD)
        elif isinstance(self.store.scenario.run, LiveRig):
            self.live.ask()
            self.move(Phase.CONFIRM)
        else:
            # Also if its run failed before: the person may have fixed the plant since.
            self.move(Phase.RUNNING)
            self.asked = True

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
            left, right = (self._with_role(side, further) for side in (question.left, question.right))
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
        """Take the result of running `sample`, if it is still pending."""
        self.stopped, theta = None, np.array(sample.theta)
        if isinstance(result, Experiment):
            self.prefetch.keep(theta, result)
        # While it ran, another one may have been answered, which changes its number.
        index = next((s.index for s in self.unfinished if s.theta == sample.theta), None)
        if index is None or self.phase is Phase.OVER:
            return None
        if self.phase is not Phase.RUNNING:
            return self._ran_beside(index, result, theta)
        try:
            if isinstance(result, Experiment):
                self.study.append((Finished(index), result))
                return self.proceed()
            self.take(index)
            self.study.append(Failed(self.state.history.answered, in_words(result)))
        except StudyError as error:
            return self.move(Phase.FAILED, error)
        return self.move(Phase.FAILED, result)

    def _ran_beside(self, index: int, result: Experiment | Exception, theta: Float[np.ndarray, " n"]) -> None:
        """Save the experiment of pending sample `index`; its failure is shown when it is due."""
        if self.at_once == 1:
            return
        if isinstance(result, Experiment):
            self.study.append((Finished(index), result))
        else:
            self.prefetch.keep_failure(theta, result)
        self.version += 1


def pair_of(query: Query) -> tuple[int, int | None]:
    """Return the indices of the challenger and the incumbent."""
    return query.challenger.index, None if query.incumbent is None else query.incumbent.index
