"""Advance an interview from an answer to the next question."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_app.simulating import Basis, Simulator, named_twin, past_of
from prefcal_env.compiling import Compiling
from prefcal_env.errors import RunError, StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.own_line import in_words
from prefcal_env.preferences.answer import Answer, Query
from prefcal_env.preferences.history import History, Sample
from prefcal_env.preferences.loop import completed
from prefcal_env.preferences.runs import first_ready
from prefcal_env.sources import Run, Source
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
from .order import challenger_left
from .plant import PlantCare
from .prefetch import Prefetch
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
    runs: dict[bytes, Run] = field(default_factory=dict)
    """Runs in progress by the key of their θ."""
    awaited: tuple[bytes, Run] | None = None
    """The run that is waited for, and the key of its θ: due, in progress, or asking a person."""
    partial: Experiment | None = None
    """What the run that failed last had recorded until then."""
    changed: Callable[[], None] = lambda: None
    """Function that tells front ends, from any thread, that there is news of a run."""
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
    draft: str = ""
    """Comment of the answer that was undone last, until another answer is given."""
    basis: Basis | None = None
    """What the latest question was chosen from, by simulations."""
    thinking: History | None = None
    """The record whose next query is being chosen in the background."""
    source: Source = field(init=False)
    """What turns θ into experiments."""
    plant: PlantCare = field(init=False)
    """What must be done on the plant before anything else."""

    def __post_init__(self) -> None:
        self.source = self.store.scenario.source
        self.plant = PlantCare(self.source)

    @property
    def run(self) -> Run | None:
        """Return the run of the pending sample; None unless it is waited for or in progress."""
        if self.pending is None:
            return None
        key = theta_key(self.pending.theta)
        return self.awaited[1] if self.awaited and self.awaited[0] == key else self.runs.get(key)

    @property
    def moves_plant(self) -> bool:
        """Return whether a run changes a plant, or is about to."""
        awaited = self.awaited  # read once, since no lock is held
        return awaited is not None and awaited[1].moves_plant

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
        return self.state.history.incumbent

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
        history = self.agent.history
        return self.simulator is not None and history.pending is None and not self.agent.knows(history)

    @property
    def grounds(self) -> Basis | None:
        """Return what the open question was chosen from; None while it is not known."""
        basis = self.basis
        if basis is None or basis.past != past_of(self.agent):
            return None
        # The person may have asked for another challenger since.
        return basis if basis.pending == self.agent.history.pending else None

    def append(self, *events: Event | tuple[Finished, Experiment]) -> tuple[int, ...]:
        """Save events before anything follows from them; return their numbers.

        The record that the agent goes by is set here and nowhere else.

        Raises:
            StudyError: If they cannot be saved; then nothing has changed.
        """
        numbers = self.study.append(*events)
        self.agent.history = self.agent.recorded(self.state.history)
        return numbers

    def tell_change(self) -> None:
        """Take note of a change for front ends."""
        self.version += 1

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
            asked = None if self.agent.done else self.agent.open(self.agent.history)[1][0]
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
        if not self.state.ended:
            self._keep_best()
        if not self.state.ended and self.agent.done:
            self.append(Ended("all compared"))
        if self.state.ended:
            return self.move(Phase.OVER)
        opened, queries = self.agent.open(self.agent.history, self.at_once)
        for index in range(len(self.state.history.samples), len(opened.samples)):
            z, theta = opened.samples[index].z, opened.samples[index].theta
            # With its experiment, if that is known already.
            self.append(Suggested(index, z, theta), *self._finished(index, np.array(theta)))
        query = self._ready(queries)
        if query is None:
            return self._wait_for()
        index = query.challenger.index
        if query.incumbent is not None:
            return self._show(query)
        if self.agent.by_value:
            self.append(Answered(None, index, *self.store.scored(index)))
        else:
            alone = self.store.experiment(index)
            first = completed(Answer(None), alone, None, self.store.outcomes(index, None))
            self.append(Answered(None, index, None, first))
        return self._proceed()

    def _keep_best(self) -> None:
        """Store which sample the agent holds for the best, if the answers name another."""
        best = self.agent.best_index
        if best is not None and best != self.state.history.incumbent:
            self.append(Led(best))

    def _ready(self, queries: Sequence[Query]) -> Query | None:
        """Return the query to show now, and give its sample the next number; None if none is ready.

        A query about two known experiments comes first, then the experiment that ended first.
        """
        ready = first_ready(queries, lambda side: self.state.finished.get(side.index))
        if ready is None or ready.further:
            return ready
        self.take(ready.challenger.index)
        return self.agent.open(self.agent.history)[1][0]

    def take(self, index: int) -> None:
        """Give pending sample `index` the number of the next one to be answered."""
        if index != self.state.history.answered:
            self.append(Taken(index))

    def request(self, sample: Sample) -> None:
        """Store a sample that the person asks for in place of the pending one."""
        index = self.state.history.answered
        known = self._finished(index, np.array(sample.theta))
        self.append(Requested(index, sample.z, sample.theta), *known)

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
        self.partial = None
        self.wait_anew()
        if self.source.asks:
            self.move(Phase(self.source.asks))
            return
        # Also if its run failed before: the person may have fixed the plant since.
        self.move(Phase.RUNNING)
        self.asked = True

    def wait_anew(self) -> None:
        """Wait for a new run of the pending sample, which can be stopped from now on."""
        assert self.pending is not None
        key, theta = theta_key(self.pending.theta), np.array(self.pending.theta)
        if key not in self.runs:
            self.awaited = (key, self._start(theta))

    def begin(self, theta: Float[np.ndarray, " n"]) -> Run:
        """Return the run of θ, physical, shape (n,), which counts as in progress from now on."""
        key = theta_key(theta)
        waits = self.awaited is not None and self.awaited[0] == key
        self.runs[key] = self.awaited[1] if self.awaited and waits else self._start(theta)
        return self.runs[key]

    def _start(self, theta: Float[np.ndarray, " n"]) -> Run:
        run = self.source.begin(theta.copy(), seed=self.seed)
        run.changed = self.changed
        return run

    def end(self, theta: Float[np.ndarray, " n"], result: Experiment | Exception | None) -> None:
        """Take note that the run of θ is over or, without a result, asks something of a person."""
        key = theta_key(theta)
        run = self.runs.pop(key, None)
        if result is None:
            self.version += 1
            return
        if self.awaited is None or self.awaited[0] != key:
            return
        run, self.awaited = run or self.awaited[1], None
        if isinstance(result, Exception):
            self.partial = run.partial
        # After an error nobody knows how far the run came, but what it left on the disk tells.
        unknown = isinstance(result, Exception) and not isinstance(result, RunError)
        if run.moves_plant and (run.problem or unknown):
            self.plant.is_due(run.problem)

    def _show(self, query: Query) -> None:
        assert query.incumbent is not None
        new, old = query.challenger.index, query.incumbent.index
        left = challenger_left(self.seed, new, old if query.further else None)
        shown = Shown(new, old, left)
        self._put(self.append(shown)[0], shown)

    def show_again(self, shown: Shown) -> None:
        """Put an earlier question on show again."""
        self.prefetch.forget()
        self._put(self.append(shown)[0], shown)

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

    def answered(self, answer: Answer) -> None:
        """Go on from an answer that is saved: at once if the agent knows what to ask next."""
        if self.simulator is not None and self.prefetch.busy not in (None, answer):
            self.simulator.abandon()
        self.basis = self.prefetch.take(answer) or self.basis
        if self.at_once == 1 and self.agent.knows(self.agent.history):
            return self.proceed()
        return self.move(Phase.RUNNING)  # a proposal takes time, so `work` computes it

    def ran(self, sample: Suggested, result: Experiment | Exception) -> None:
        """Take the result of running `sample`, if it is still pending."""
        theta = np.array(sample.theta)
        if isinstance(result, Experiment):
            self.prefetch.keep(theta, result)
        # While it ran, another one may have been answered, which changes its number.
        index = next((s.index for s in self.unfinished if s.theta == sample.theta), None)
        if index is None or self.phase is Phase.OVER:
            return None
        if self.phase not in (Phase.RUNNING, Phase.RECORD, Phase.CONFIRM):
            return self._ran_beside(index, result, theta)
        try:
            if isinstance(result, Experiment):
                self.append((Finished(index), result))
                return self.proceed()
            self.take(index)
            self.append(Failed(self.state.history.answered, in_words(result)))
        except StudyError as error:
            return self.move(Phase.FAILED, error)
        return self.move(Phase.FAILED, result)

    def _ran_beside(self, index: int, result: Experiment | Exception, theta: Float[np.ndarray, " n"]) -> None:
        """Save the experiment of pending sample `index`; its failure is shown when it is due."""
        if self.at_once == 1:
            return
        if isinstance(result, Experiment):
            self.append((Finished(index), result))
        else:
            self.prefetch.keep_failure(theta, result)
        self.version += 1


def pair_of(query: Query) -> tuple[int, int | None]:
    """Return the indices of the challenger and the incumbent."""
    return query.challenger.index, None if query.incumbent is None else query.incumbent.index
