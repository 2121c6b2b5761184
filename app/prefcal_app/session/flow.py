"""Advance an interview from an answer to the next question."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from prefcal_agents.protocol.agent import Agent
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.own_line import in_words
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.loop import completed
from prefcal_env.study import Answered, Event, Failed, Finished, Shown, State, StudyFile, Suggested, Taken

from .study.experiments import ExperimentStore
from .study.now import Phase
from .study.question import Question, Side
from .study.study import Ask, Over, Settle, Study, Think, Wait, Write
from .volatile.thoughts import Thoughts
from .volatile.underway import UnderWay


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

    def tell_change(self) -> None:
        """Take note of a change for front ends."""
        self.version += 1

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

    def answered(self, answer: Answer) -> None:
        """Go on from an answer that is saved: at once if the agent knows what to ask next."""
        self.thoughts.take(answer)
        if self.at_once == 1 and self.agent.knows(self.agent.history):
            return self.proceed()
        return self.move(Phase.RUNNING)  # a proposal takes time, so `work` computes it

    def ran(self, sample: Suggested, result: Experiment | Exception) -> None:
        """Take the result of running `sample`, if it is still pending."""
        theta = np.array(sample.theta)
        if isinstance(result, Experiment):
            self.thoughts.prefetch.keep(theta, result)
        # While it ran, another one may have been answered, which changes its number.
        index = next((s.index for s in self.study.unfinished if s.theta == sample.theta), None)
        if index is None or self.phase is Phase.OVER:
            return None
        if self.phase not in (Phase.RUNNING, Phase.RECORD, Phase.CONFIRM):
            return self._ran_beside(index, result, theta)
        try:
            if isinstance(result, Experiment):
                self.append((Finished(index), result))
                return self.proceed()
            due = self.state.history.answered
            self.append(*([] if index == due else [Taken(index)]), Failed(due, in_words(result)))
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
            self.thoughts.prefetch.keep_failure(theta, result)
        self.version += 1
