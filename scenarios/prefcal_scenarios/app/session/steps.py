"""What an answer, a mark, an undo and a retraction do to the flow. Each is durable first."""

from prefcal_agents import GLISp
from prefcal_env.errors import PreferenceError, SettingsError, StaleError, StudyError
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import Adjusted, Answered, Marked, Retracted, Shown, Undone

from .flow import Flow
from .memory import QUESTIONS
from .order import to_repeat
from .view import GOOD_ENOUGH, MARKS, Phase, Question


def open_question(flow: Flow, question: int) -> Question:
    """The open question. Raises StaleError unless its id is `question`."""
    asked = flow.question
    if asked is None or asked.id != question:
        raise StaleError(
            f"question {question} is no longer open: it was answered or taken back already, "
            "and nothing was recorded twice"
        )
    return asked


def close(flow: Flow, asked: Question, given: Answer, comment: str, blind: bool) -> None:
    """Record the answer, teach it, and go on."""
    new, old = asked.challenger.index, asked.incumbent.index
    given = asked.completed(given)
    flow.study.append(Answered(asked.id, new, old, given, comment, blind))
    if asked.repeats is None:
        flow.tell(given)
    else:
        flow.proceed()
    flow.draft, flow.answered_at = "", flow.version


def mark(flow: Flow, asked: Question, side: str, mark: str, on: bool) -> None:
    """Mark the experiment on `side`, or take the mark away; one mark replaces the other.

    Raises:
        StudyError: there is no such side or mark.
        PreferenceError: a run that was interrupted as unsafe is to be good enough.
    """
    if side not in ("left", "right") or mark not in MARKS:
        raise StudyError(f"a mark is one of {MARKS} on left or right, got {mark!r} on {side!r}")
    which = asked.left if side == "left" else asked.right
    if on and mark == GOOD_ENOUGH and which.counts_as_unsafe:
        raise PreferenceError(
            f"experiment {which.index + 1} was interrupted as unsafe: it cannot be good enough"
        )
    if on != (mark in which.marks):
        flow.study.append(Marked(which.index, mark, on))
        flow.refresh()


def can_undo(flow: Flow) -> bool:
    """Whether there is an answer to take back: one to a repeated question taught nothing."""
    if flow.question is not None and flow.question.repeats is not None:
        return True
    state, repeats = flow.state, flow.state.history.repeats
    last_was_repeat = bool(repeats) and state.answers[-1] is repeats[-1]
    return state.history.answered > 1 and not last_was_repeat


def undo(flow: Flow, version: int) -> None:
    """Take the last answer back; a repeated question that is open is only put away."""
    if not can_undo(flow):
        raise StaleError("there is no answer to undo")
    if version < flow.answered_at:
        raise StaleError("an answer was given or taken back since you looked")
    if flow.question is None or flow.question.repeats is None:
        comment = flow.state.history.latest[-1].comment
        flow.study.append(Undone())
        flow.agent.undo()
        flow.draft = comment
    flow.proceed()
    flow.answered_at = flow.version


def closed(flow: Flow, answer: int) -> Comparison:
    """The compared answer of this number, from 1; -1, -2 ... are further ones.

    Raises:
        StaleError: there is none.
    """
    history = flow.state.history
    answers = history.comparisons if answer >= 0 else (None, *history.follow_ups)
    if not 1 <= abs(answer) < len(answers):
        what = "answer" if answer >= 0 else "further answer"
        raise StaleError(f"there is no {what} {abs(answer)}: {max(len(answers) - 1, 0)} are given")
    found = answers[abs(answer)]
    assert found is not None
    return found


def retract(flow: Flow, answer: int) -> None:
    """Forget what an answer taught; every sample stays, the open one too."""
    if closed(flow, answer).retracted:
        raise StaleError(f"answer {answer} is retracted already")
    if flow.phase is Phase.RUNNING and flow.pending is None:
        # The open sample was due before: it must not come to depend on this.
        flow.proceed()
    flow.study.append(Retracted(answer))
    if answer > 0:
        flow.agent.retract(answer)
    else:
        flow.agent.retract(-answer - 1, further=True)
    if flow.phase is Phase.QUESTION:
        flow.proceed()
    else:
        flow.version += 1


def pace(flow: Flow, questions: int) -> None:
    """Ask at most `questions` comparisons per experiment from now on."""
    agent = flow.agent
    if not isinstance(agent, GLISp):
        raise SettingsError("only the agent glisp asks more questions per experiment")
    if flow.phase is Phase.FAILED:
        # What is written and what the agent has in mind may differ until that is done.
        raise StaleError("something has failed: try that again first")
    changed = agent.with_questions(questions)
    if questions == agent.settings.questions_per_experiment:
        return
    flow.study.append(Adjusted({QUESTIONS: questions}))
    flow.agent = changed
    if flow.phase is not Phase.QUESTION:
        flow.version += 1
    elif flow.is_overtaken():
        flow.proceed()
    else:
        flow.refresh()  # what was foreseen for this question is no longer what follows


def repeat(flow: Flow) -> None:
    """Show an earlier question again, with its sides swapped."""
    again = to_repeat(flow.state, flow.seed)
    if again is None or flow.phase is not Phase.QUESTION:
        raise StaleError("there is no earlier question to ask again now")
    assert again.incumbent is not None
    left = not again.challenger_left
    flow.show_again(Shown(again.challenger, again.incumbent, left, again.question))
