"""Apply answers, marks, undo and retractions to the flow; each is saved before it takes effect."""

from typing import cast

import numpy as np
from jaxtyping import Float

from prefcal_agents import GLISp
from prefcal_env.errors import PreferenceError, ProtocolError, StaleError, StudyError
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import Adjusted, Answered, Ended, Marked, Requested, Retracted, Shown, Undone

from . import runs
from .can import CLOSED
from .flow import Flow, Latest
from .study.memory import QUESTIONS
from .study.now import GOOD_ENOUGH, MARKS, Choice, Phase, Question
from .study.study import to_repeat


def open_question(flow: Flow, question: int) -> Question:
    """Return the open question. Raises StaleError unless its id is `question`."""
    asked = flow.question
    if asked is None or asked.id != question:
        raise StaleError(CLOSED)
    return asked


def answer(flow: Flow, question: int, choice: Choice, *, comment: str = "", blind: bool = False) -> None:
    """Answer the open question by side.

    Args:
        flow: Flow of the interview.
        question: Id of the question.
        choice: Verdict.
        comment: Comment on the answer.
        blind: Whether θ and the roles of the sides were hidden.
    """
    asked = open_question(flow, question)
    _close(flow, asked, asked.answer(choice), comment, blind)


def give(flow: Flow, question: int, answer: Answer) -> None:
    """Answer the open question in terms of challenger and incumbent."""
    _close(flow, open_question(flow, question), answer)


def _close(flow: Flow, asked: Question, given: Answer, comment: str = "", blind: bool = False) -> None:
    """Record the answer, teach it to the agent, and proceed."""
    new, old = asked.challenger.index, asked.incumbent.index
    given = asked.completed(given)
    flow.append(Answered(asked.id, new, old, given, comment, blind))
    if asked.repeats is None:
        _go_on(flow, given)
    else:
        flow.proceed()
    flow.latest = Latest(flow.version)


def _go_on(flow: Flow, answer: Answer) -> None:
    """Go on from an answer that is saved: at once if the agent knows what to ask next."""
    flow.thoughts.take(answer)
    if flow.at_once == 1 and flow.agent.knows(flow.agent.history):
        return flow.proceed()
    return flow.move(Phase.RUNNING)  # a proposal takes time, so `work` computes it


def mark(flow: Flow, question: int, side: str, mark: str, on: bool) -> None:
    """Set or clear a mark of the experiment on `side`; one mark replaces the other.

    Raises:
        StudyError: If there is no such side or mark.
        PreferenceError: If a run that was interrupted as unsafe is marked as good enough.
    """
    asked = open_question(flow, question)
    if side not in ("left", "right") or mark not in MARKS:
        raise StudyError(f"a mark is one of {MARKS} on left or right, got {mark!r} on {side!r}")
    which = asked.left if side == "left" else asked.right
    if on and mark == GOOD_ENOUGH and which.counts_as_unsafe:
        raise PreferenceError(
            f"experiment {which.index + 1} was interrupted as unsafe: it cannot be good enough"
        )
    if on != (mark in which.marks):
        flow.append(Marked(which.index, mark, on))
        flow.show()


def undo(flow: Flow, version: int) -> None:
    """Undo the last answer, or skip a repeated question that is open.

    `version` is the one that the person saw.
    """
    if version < flow.latest.version:
        raise StaleError("an answer was given or undone since you looked")
    draft = flow.latest.draft
    if flow.question is None or flow.question.repeats is None:
        draft = flow.state.history.latest[-1].comment
        flow.append(Undone())
    flow.proceed()
    flow.latest = Latest(flow.version, draft)


def closed(flow: Flow, answer: int) -> Comparison:
    """Return answer number `answer`, from 1; -1, -2, ... are follow-up comparisons.

    Raises:
        StaleError: If there is none.
    """
    history = flow.state.history
    answers = history.comparisons if answer >= 0 else (None, *history.follow_ups)
    if not 1 <= abs(answer) < len(answers):
        what = "answer" if answer >= 0 else "answer to a follow-up comparison"
        raise StaleError(f"there is no {what} {abs(answer)}: {max(len(answers) - 1, 0)} are given")
    found = answers[abs(answer)]
    assert found is not None
    return found


def retract(flow: Flow, answer: int) -> None:
    """Forget what an answer taught (see `closed`); all samples stay, including the open one."""
    if closed(flow, answer).retracted:
        raise StaleError(f"answer {answer} is retracted already")
    if flow.phase is Phase.RUNNING and flow.study.pending is None:
        # Propose the open sample first: it must not depend on this retraction.
        flow.proceed()
    flow.append(Retracted(answer))
    if flow.phase is Phase.QUESTION:
        flow.proceed()
    else:
        flow.version += 1


def ask_for(flow: Flow, theta: Float[np.ndarray, " n"] | tuple[float, ...]) -> None:
    """Compare physical `theta`, shape (n,), next, in place of the pending sample.

    The θ of that sample is free again.

    Raises:
        ProtocolError: If all experiments are answered, or `theta` was tried before.
        KnobError: If the space does not hold it, or a constraint forbids it.
    """
    twin, pending, asked = flow.agent.copy(), flow.study.pending, flow.question
    twin.replace_pending(np.array(theta))
    sample = twin.history.pending  # others may be pending behind it
    assert sample is not None
    shown = asked is None or asked.challenger.index == flow.state.history.answered
    if pending is not None and pending.theta == sample.theta and shown:
        return  # it is the next one already
    index = flow.state.history.answered
    flow.append(Requested(index, sample.z, sample.theta), *flow.finished(index, np.array(sample.theta)))
    flow.proceed()


def choose(flow: Flow, theta: Float[np.ndarray, " n"] | tuple[float, ...], best: int) -> None:
    """Choose a simulated `theta`, shape (n,), after the end, instead of experiment `best`.

    It is asked for, and the question about it is answered by the choice, if its run is known from a
    look at both; then the study is over again, for the same reason. A plant has to run it first: that
    is all that follows.

    Raises:
        StaleError: If another experiment is the best by now.
        ProtocolError: If `theta` was tried before.
        KnobError: If the space does not hold it, or a constraint forbids it.
    """
    if flow.study.best != best:
        raise StaleError("another experiment is the best by now: look at both again")
    wanted = flow.agent.space.check_allowed(np.array(theta))
    if flow.agent.space.close(wanted, flow.agent.samples).any():
        raise ProtocolError("an experiment was run with this θ: it was compared already")
    reason = flow.state.ended
    assert reason is not None
    runs.go_on(flow, more=int(flow.state.history.answered >= flow.state.n_max))
    ask_for(flow, wanted)
    asked, samples = flow.question, flow.state.history.samples
    if asked is not None and np.array_equal(samples[asked.challenger.index].theta, wanted):
        _close(flow, asked, Answer(Preference.CHALLENGER, marks=asked.marks))
        flow.append(Ended(reason))
        flow.proceed()


def pace(flow: Flow, questions: int) -> None:
    """Ask at most `questions` comparisons per experiment, 1 or more, from now on.

    Raises:
        SettingsError: If that is not valid.
    """
    agent = cast(GLISp, flow.agent)
    changed = agent.with_questions(questions)
    if questions == agent.settings.questions_per_experiment:
        return
    flow.append(Adjusted({QUESTIONS: questions}))
    flow.agent = changed
    if flow.phase is not Phase.QUESTION:
        flow.version += 1
    elif flow.study.is_overtaken:
        flow.proceed()
    else:
        flow.show()  # discards what was prefetched for this question


def repeat(flow: Flow) -> None:
    """Show an earlier question again, with its sides swapped; the answer teaches nothing."""
    again = to_repeat(flow.state, flow.study.seed)
    assert again is not None
    assert again.incumbent is not None
    left = not again.challenger_left
    flow.show(Shown(again.challenger, again.incumbent, left, again.question))
