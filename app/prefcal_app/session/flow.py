"""Advance an interview from an answer to the next question."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.key import theta_key
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.loop import completed
from prefcal_env.study import Answered, Event, Finished, Shown, State, StudyFile, Suggested

from .study.experiments import ExperimentStore
from .study.now import Phase, Question, Side
from .study.study import Ask, Over, Settle, Study, Think, Wait, Write
from .volatile.thoughts import Thoughts
from .volatile.underway import UnderWay

_COURTESY = 2.0
"""Seconds that a prefetched run may continue while another one is waited for: it may be almost
done, and a fresh process takes a second."""


@dataclass(frozen=True, slots=True)
class Latest:
    """What the latest answer or undo left behind.

    Args:
        version: Version at which it was given.
        draft: Comment of the answer that was undone, until another answer is given.
    """

    version: int = 0
    draft: str = ""


@dataclass(slots=True)
class Flow:
    """What drives a study, and changes; callers must hold the interview's lock."""

    file: StudyFile
    store: ExperimentStore
    agent: Agent
    thoughts: Thoughts
    at_once: int = 1
    """Number of experiments that run at the same time."""
    phase: Phase = Phase.RUNNING
    question: Question | None = None
    problem: Exception | None = None
    proposed: bool = False
    """Whether the agent has proposed what can run until the next answer, if several do."""
    version: int = 0
    latest: Latest = Latest()
    underway: UnderWay = field(init=False)

    def __post_init__(self) -> None:
        self.underway = UnderWay(self.store.scenario.source, self.study.seed)

    @property
    def state(self) -> State:
        """Return the state of the study file."""
        return self.file.state

    @property
    def study(self) -> Study:
        """Return the study at this moment."""
        simulates = self.thoughts.simulator is not None
        return Study(self.agent, self.agent.history, self.state, self.at_once, simulates)

    def append(self, *events: Event | tuple[Finished, Experiment]) -> tuple[int, ...]:
        """Save events before anything follows from them; return their numbers.

        The record that the agent goes by is set here and nowhere else.

        Raises:
            StudyError: If they cannot be saved; then nothing has changed.
        """
        numbers = self.file.append(*events)
        self.agent.history = self.agent.recorded(self.state.history)
        return numbers

    def move(self, phase: Phase, problem: Exception | None = None) -> None:
        """Enter `phase`, without a question."""
        self.proposed = False
        self.phase, self.problem, self.question = phase, problem, None
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
        self.underway.forget(() if self.state.ended else self.study.unfinished)
        try:
            self._proceed()
        except Exception as error:
            self.move(Phase.FAILED, error)

    def _proceed(self) -> None:
        thought = False
        while True:
            match self.study.todo(thought=thought):
                case Write(event):
                    self.append(event, *self._known(event))
                    thought = True
                case Settle(index):
                    self.append(self._settled(index))
                    thought = False
                case Think():
                    return self.move(Phase.RUNNING)
                case Wait():
                    return self._wait()
                case Ask(shown):
                    return self.show(shown)
                case Over():
                    return self.move(Phase.OVER)

    def _known(self, event: Event) -> list[Event | tuple[Finished, Experiment]]:
        """Return what adds the experiment of a sample that is proposed, if it is known already."""
        return self.finished(event.index, np.array(event.theta)) if isinstance(event, Suggested) else []

    def finished(
        self, index: int, theta: Float[np.ndarray, " n"]
    ) -> list[Event | tuple[Finished, Experiment]]:
        """Return the event that adds the experiment of θ as sample `index`, if it is already known."""
        earlier = self.file.find_experiment(theta)
        if earlier is not None:
            return [Finished(index, same_as=earlier)]
        prefetched = self.thoughts.prefetch.experiment(theta)
        return [] if prefetched is None else [(Finished(index), prefetched)]

    def _settled(self, index: int) -> Answered:
        """Return the answer about experiment `index` that needs no person."""
        if self.agent.by_value:
            return Answered(None, index, *self.store.scored(index))
        outcomes = self.store.outcomes(index, None)
        return Answered(
            None, index, None, completed(Answer(None), self.store.experiment(index), None, outcomes)
        )

    def _wait(self) -> None:
        asks, pending = self.underway.source.asks, self.study.pending
        assert pending is not None
        # Also if its run failed before: the person may have fixed the plant since.
        self.underway.wait_for(pending, self.study.unfinished, anew=bool(asks))
        self.move(Phase(asks) if asks else Phase.RUNNING)
        self.proposed = not asks

    def show(self, shown: Shown | None = None) -> None:
        """Show a question, by default the open one again with its current marks."""
        self.thoughts.prefetch.forget()
        if shown is not None:
            self.append(shown)
        assert self.state.open is not None
        id_, shown = self.state.open
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
        return replace(side, role="best so far" if side.index == self.study.best else role)


class Guarded:
    """A flow with its lock, which also tells of changes.

    Args:
        flow: Flow of the interview.

    Attributes:
        changed: Lock; it is notified of each change.
        closing: Whether no more work is taken.
        has_background: Whether threads take work in the background.
    """

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self.changed = threading.Condition(threading.RLock())
        self.closing = self.has_background = False
        flow.underway.changed = self.tell

    @contextmanager
    def reading(self) -> Iterator[Flow]:
        """Hold the lock while the flow is read."""
        with self.changed:
            yield self._flow

    @contextmanager
    def changing(self) -> Iterator[Flow]:
        """Hold the lock while the flow is changed, and tell of it afterward."""
        with self.changed:
            version = self._flow.version
            try:
                yield self._flow
            finally:
                if self._flow.version != version:
                    self._make_way()
                    self.changed.notify_all()

    def tell(self) -> None:
        """Tell front ends that there is news, such as of a run in progress."""
        with self.changing() as flow:
            flow.version += 1

    def _make_way(self) -> None:
        """Stop soon what runs or thinks in advance, if something else is waited for."""
        flow = self._flow
        flow.thoughts.make_way(flow.agent.history if flow.phase is Phase.RUNNING else None)
        several = flow.at_once > 1
        if flow.underway.source.asks or (flow.phase is not Phase.RUNNING and not several):
            return
        wanted = flow.study.unfinished if several else filter(None, [flow.study.pending])
        keys = {theta_key(sample.theta) for sample in wanted if flow.phase is not Phase.OVER}
        for key, run in flow.underway.going.items():
            if key not in keys:
                run.stop("given up", within=_COURTESY)
