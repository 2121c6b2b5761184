"""What a person can do in a study: each action is one class, with its fields, its rule and its step.

The page reads an action from JSON, the terminal and Python make it, and `Interview.do` takes it.
"""

import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from jaxtyping import Float
from msgspec import Meta, Struct

from prefcal_agents import GLISp
from prefcal_env import study as events
from prefcal_env.errors import (
    KnobError,
    PrefcalError,
    PreferenceError,
    ProtocolError,
    RecordError,
    ScenarioError,
    SettingsError,
    StaleError,
    StudyError,
)
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences import answer as preferences
from prefcal_env.preferences.answer import Outcome, Preference, counts_as_unsafe
from prefcal_env.preferences.history import Comparison
from prefcal_env.sources import Table
from prefcal_env.study import Suggested
from prefcal_scenarios.runs import outcome
from prefcal_scenarios.scenario import check_experiment

from .driver import Driver, Latest
from .study import (
    FINISHED,
    GOOD_ENOUGH,
    MARKS,
    QUESTIONS,
    Choice,
    Moment,
    Phase,
    Question,
    Recovery,
    Study,
    agent_of,
    to_repeat,
    tried_on_plant,
)

# --- Say what an action is: bounded fields, when it can be taken, and what it does.

LARGEST_NUMBER = 2**53 - 1  # largest whole number that JavaScript, JSON and SQLite all hold exactly
LONGEST_TEXT = 10_000  # maximum number of characters of a comment or note

Whole = Annotated[int, Meta(ge=0, le=LARGEST_NUMBER)]
Signed = Annotated[int, Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
Real = Annotated[float, Meta(ge=-sys.float_info.max, le=sys.float_info.max)]
# Without control characters, and without half a surrogate pair, which UTF-8 does not allow.
Text = Annotated[
    str, Meta(max_length=LONGEST_TEXT, pattern=r"^[^\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]*\Z")
]
Place = Literal["left", "right"]
Kind = Literal["unsafe", "good enough"]

CLOSED = "this question is no longer open: it was already answered or undone, and nothing was recorded twice"
"""What is said of an answer to another question than the open one."""
_FAILED = "the last step failed: try it again first"
_NOT_DUE = "no record is waited for: nothing was changed"
_NOT_FAILING = "no experiment is waited for: nothing was changed"
_NOT_REPEATING = "there is no earlier question to ask again now"


class Action(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all actions. Bounds of the fields are checked where they come from a page.

    On an outdated page, for example in a second tab, an action raises StaleError and records nothing.
    If the file cannot be written, it raises StudyError and changes nothing.
    """

    when: ClassVar[frozenset[Phase]] = frozenset(Phase)  # phases in which it can be taken
    otherwise: ClassVar[str] = ""  # what is said in the other phases
    beside: ClassVar[bool] = False  # whether it can be taken while a plant is being changed

    @classmethod
    def refusal(cls, study: Study) -> PrefcalError | None:
        """Return why nobody can take it now, whatever its fields say; None if it can be taken."""
        if study.plant.moves and not cls.beside:
            return StaleError("a run on the plant is in progress: stop it first")
        return StaleError(cls.otherwise) if study.phase not in cls.when else cls._also(study)

    def take(self, driver: Driver) -> None:
        """Save what follows from it, then let it take effect; raise its `refusal` if there is one."""
        if (refused := self.refusal(driver.standing)) is not None:
            raise refused
        self._take(driver)

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        """Return what else refuses it in these phases."""
        return None

    def _take(self, driver: Driver) -> None:
        raise NotImplementedError


# --- Judge the open question: answers, marks, undo and retractions.


def _open_question(driver: Driver, question: int) -> Question:
    """Return the open question. Raises StaleError unless its id is `question`."""
    asked = driver.question
    if asked is None or asked.id != question:
        raise StaleError(CLOSED)
    return asked


def _close(
    driver: Driver, asked: Question, given: preferences.Answer, comment: str = "", blind: bool = False
) -> None:
    """Record the answer, teach it to the agent, and proceed."""
    new, old = asked.challenger.index, asked.incumbent.index
    given = asked.completed(given)
    driver.append(events.Answered(asked.id, new, old, given, comment, blind))
    if asked.repeats is None:
        _go_on(driver, given)
    else:
        driver.proceed()
    driver.latest = Latest(driver.version)


def _go_on(driver: Driver, answer: preferences.Answer) -> None:
    """Go on from an answer that is saved: at once if the agent knows what to ask next."""
    driver.thoughts.take(answer)
    if driver.at_once == 1 and driver.agent.knows(driver.agent.history):
        return driver.proceed()
    return driver.feed(Moment.THINK)  # a proposal takes time, so `work` computes it


class Answer(Action, frozen=True):
    """Answer the open question by side.

    Args:
        question: Id of the question.
        choice: Verdict.
        comment: Comment on the answer.
        blind: Whether θ and the roles of the sides were hidden.
    """

    question: Whole
    choice: Choice
    comment: Text = ""
    blind: bool = False
    when = frozenset({Phase.QUESTION})
    otherwise = CLOSED

    def _take(self, driver: Driver) -> None:
        asked = _open_question(driver, self.question)
        _close(driver, asked, asked.answer(self.choice), self.comment, self.blind)


class Give(Action, frozen=True):
    """Answer the open question in terms of challenger and incumbent."""

    question: Whole
    answer: preferences.Answer
    when = frozenset({Phase.QUESTION})
    otherwise = CLOSED

    def _take(self, driver: Driver) -> None:
        _close(driver, _open_question(driver, self.question), self.answer)


class Mark(Action, frozen=True):
    """Set or clear a mark of the experiment on `side`; one mark replaces the other.

    Raises PreferenceError if a run that was interrupted as unsafe is marked as good enough.
    """

    question: Whole
    side: Place
    mark: Kind
    on: bool
    when = frozenset({Phase.QUESTION})
    otherwise = CLOSED

    def _take(self, driver: Driver) -> None:
        asked = _open_question(driver, self.question)
        if self.side not in ("left", "right") or self.mark not in MARKS:
            raise StudyError(f"a mark is one of {MARKS} on left or right, got {self.mark!r} on {self.side!r}")
        which = asked.side(self.side)
        if self.on and self.mark == GOOD_ENOUGH and which.counts_as_unsafe:
            raise PreferenceError(
                f"experiment {which.index + 1} was interrupted as unsafe: it cannot be good enough"
            )
        if self.on != (self.mark in which.marks):
            driver.append(events.Marked(which.index, self.mark, self.on))
            driver.show()


class Undo(Action, frozen=True):
    """Undo the last answer, or skip a repeated question that is open.

    `version` is the one that the person saw.
    """

    version: Whole

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.repeats:
            return None  # a repeated question can always be skipped
        repeats = study.state.history.repeats
        last_was_repeat = bool(repeats) and study.state.answers[-1] is repeats[-1]
        has_one = study.state.history.answered > 1 and not last_was_repeat
        return None if has_one else StaleError("there is no answer to undo")

    def _take(self, driver: Driver) -> None:
        if self.version < driver.latest.version:
            raise StaleError("an answer was given or undone since you looked")
        draft = driver.latest.draft
        if not driver.study.repeats:
            draft = driver.state.history.latest[-1].comment
            driver.append(events.Undone())
        driver.proceed()
        driver.latest = Latest(driver.version, draft)


def closed(driver: Driver, answer: int) -> Comparison:
    """Return answer number `answer`, see `Past.closed`."""
    history = driver.state.history
    answers = history.comparisons if answer >= 0 else (None, *history.follow_ups)
    if not 1 <= abs(answer) < len(answers):
        what = "answer" if answer >= 0 else "answer to a follow-up comparison"
        raise StaleError(f"there is no {what} {abs(answer)}: {max(len(answers) - 1, 0)} are given")
    found = answers[abs(answer)]
    assert found is not None
    return found


class Retract(Action, frozen=True):
    """Forget what an answer taught (see `closed`); all samples stay, including the open one."""

    answer: Signed

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.phase is Phase.RUNNING and study.must_think:
            return StaleError("the next experiment is being chosen: retract the answer once it is shown")
        if study.phase is Phase.FAILED and study.must_think:
            # Choosing the next experiment may fail again, after the retraction is written.
            return StaleError(_FAILED)
        has_one = study.state.history.answered > 1
        return None if has_one else StaleError("there is no answer to retract")

    def _take(self, driver: Driver) -> None:
        if closed(driver, self.answer).retracted:
            raise StaleError(f"answer {self.answer} is retracted already")
        if driver.phase is Phase.RUNNING and driver.study.pending is None:
            # Propose the open sample first: it must not depend on this retraction.
            driver.proceed()
        driver.append(events.Retracted(self.answer))
        if driver.phase is Phase.QUESTION:
            driver.proceed()
        else:
            driver.version += 1


# --- Say what is asked next: an earlier question, more or fewer, or about a θ of one's own.


class Repeat(Action, frozen=True):
    """Show an earlier question again, with its sides swapped; the answer teaches nothing."""

    when = frozenset({Phase.QUESTION})
    otherwise = _NOT_REPEATING

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        return StaleError(_NOT_REPEATING) if to_repeat(study.state, study.seed) is None else None

    def _take(self, driver: Driver) -> None:
        again = to_repeat(driver.state, driver.study.seed)
        assert again is not None
        assert again.incumbent is not None
        left = not again.challenger_left
        driver.show(events.Shown(again.challenger, again.incumbent, left, again.question))


class Pace(Action, frozen=True):
    """Ask at most `questions` comparisons per experiment from now on."""

    questions: Annotated[int, Meta(ge=1, le=99)]  # no ranking needs more
    when = frozenset(Phase) - {Phase.FAILED}  # the retry comes first: it may ask under the old limit
    otherwise = _FAILED

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.strategy.paced:
            return None
        return SettingsError("only the agent glisp can ask more than one comparison per experiment")

    def _take(self, driver: Driver) -> None:
        agent = cast(GLISp, driver.agent)
        changed = agent.with_questions(self.questions)
        if self.questions == agent.settings.questions_per_experiment:
            return
        driver.append(events.Adjusted({QUESTIONS: self.questions}))
        driver.become(changed)
        if driver.phase is Phase.QUESTION:
            driver.resume()  # discards what was prefetched for this question
        else:
            driver.version += 1


class AskFor(Action, frozen=True):
    """Compare physical `theta`, one number per knob, next, in place of the pending sample.

    The θ of that sample is free again. Raises ProtocolError if all experiments are answered or `theta`
    was tried before, and KnobError if the space does not hold it.
    """

    theta: tuple[Real, ...]
    when = frozenset(Phase) - {Phase.OVER}
    otherwise = "the study has ended: continue it first"

    def _take(self, driver: Driver) -> None:
        twin, pending, asked = driver.agent.copy(), driver.study.pending, driver.question
        twin.replace_pending(np.array(self.theta))
        sample = twin.history.pending  # others may be pending behind it
        assert sample is not None
        shown = asked is None or asked.challenger.index == driver.state.history.answered
        if pending is not None and pending.theta == sample.theta and shown:
            return  # it is the next one already
        index = driver.state.history.answered
        known = driver.finished(index, sample.theta)
        driver.append(events.Requested(index, sample.z, sample.theta), *known)
        driver.proceed()


class Choose(Action, frozen=True):
    """Choose a simulated `theta`, one number per knob, after the end, instead of experiment `best`.

    It is asked for, and the question about it is answered by the choice, if its run is known from a
    look at both; then the study is over again, for the same reason. A plant has to run it first: that
    is all that follows. Raises the errors of `AskFor`.
    """

    theta: tuple[Real, ...]
    best: Whole
    when = frozenset({Phase.OVER})
    otherwise = "the study has not ended"

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.simulates:
            return None
        return StaleError("nothing is simulated unseen in this study: continue it and ask for a θ")

    def _take(self, driver: Driver) -> None:
        if driver.study.best != self.best:
            raise StaleError("another experiment is the best by now: look at both again")
        wanted = driver.agent.space.check_allowed(np.array(self.theta))
        if driver.agent.space.close(wanted, driver.agent.samples).any():
            raise ProtocolError("an experiment was run with this θ: it was compared already")
        reason = driver.state.ended
        assert reason is not None
        GoOn(int(driver.state.history.answered >= driver.state.n_max)).take(driver)
        AskFor(tuple(wanted.tolist())).take(driver)
        asked, samples = driver.question, driver.state.history.samples
        if asked is not None and np.array_equal(samples[asked.challenger.index].theta, wanted):
            _close(driver, asked, preferences.Answer(Preference.CHALLENGER, marks=asked.marks))
            driver.append(events.Ended(reason))
            driver.proceed()


# --- Supply the record of a rig, which can be previewed and replaced.


@dataclass(frozen=True, slots=True)
class Preview:
    """Preview of what would be saved."""

    experiment: Experiment  # experiment as read from the record
    same: int | None  # index of another experiment with identical curves; None if there is none
    retracts: int  # number of answers that would no longer teach anything


class Record(Action, frozen=True):
    """Save the record of the pending sample, or replace an earlier experiment's.

    Args:
        index: Index of the experiment, from 0.
        content: Content of the CSV file.
        unsafe: Whether the run became unsafe and was stopped.
        theta: Physical θ that was really set, one number per knob; None for the proposed one.
        again: Whether to accept the same curves as another experiment's, else they are refused.
    """

    index: Whole
    content: bytes
    unsafe: bool = False
    theta: tuple[float, ...] | None = None
    again: bool = False
    when = frozenset({Phase.RECORD, Phase.QUESTION})
    otherwise = _NOT_DUE

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.plant.asks != "record":
            return StaleError("the plant is simulated and takes no record")
        due = study.phase is Phase.RECORD or study.state.finished
        return None if due else StaleError(_NOT_DUE)

    def preview(self, driver: Driver) -> Preview:
        """Read the record, and save nothing; raise RecordError if it or the θ that was set is refused."""
        if (refused := self.refusal(driver.standing)) is not None:
            raise refused
        pending, finished, index = driver.study.pending, driver.state.finished, self.index
        due = driver.phase is Phase.RECORD and pending is not None and pending.index == index
        if not due and index not in finished:
            raise StaleError(f"experiment {index + 1} is no longer waited for: nothing was changed")
        theta = self._read_theta(driver)
        if theta is None:
            theta = np.array(driver.state.history.samples[index].theta)
        run = driver.underway.source.begin(theta, seed=driver.study.seed)
        run.supply(Table(self.content, self.unsafe))
        experiment = check_experiment(driver.store.scenario, theta, run.advance())
        standing = [c for c in driver.state.history.counting if c.incumbent is not None and not c.retracted]
        retracts = sum(index in (c.challenger, c.incumbent) for c in standing)
        return Preview(experiment, _same(driver, index, experiment), retracts)

    def _take(self, driver: Driver) -> None:
        seen, index = self.preview(driver), self.index
        if seen.same is not None and not self.again:
            raise RecordError(
                f"these are the curves of experiment {seen.same + 1}: is it the file of another run?"
            )
        theta = self._read_theta(driver)
        before: list[events.Event] = []
        if theta is not None:
            z = driver.store.scenario.space.encode(theta)
            before.append(events.Dialed(index, tuple(z.tolist()), tuple(theta.tolist())))
        replaces, asked = index in driver.state.finished, driver.question is not None
        if replaces:
            known = Outcome(outcome(driver.store.scenario, seen.experiment)).to_dict()
            before.append(events.Replaced(index, known, counts_as_unsafe(seen.experiment)))
        driver.append(*before, (events.Finished(index), seen.experiment))
        if not replaces or asked:
            driver.proceed()  # a question about the wrong curves is asked again, under another id
        else:
            driver.feed(Moment.RECORD)  # that of the pending sample is still waited for

    def _read_theta(self, driver: Driver) -> Float[np.ndarray, " n"] | None:
        """Return the θ that was really set, shape (n,); None if it equals the sample's."""
        if self.theta is None:
            return None
        index, space = self.index, driver.store.scenario.space
        try:
            theta = space.decode(space.encode(space.check_allowed(np.array(self.theta))))
        except KnobError as error:
            raise RecordError(f"what you set cannot be learned from: {error}") from error
        samples = driver.state.history.samples
        if np.array_equal(theta, samples[index].theta):
            return None
        if index != driver.state.history.answered:
            raise RecordError(f"experiment {index + 1} was compared already: its θ stays")
        for i, earlier in enumerate(samples[:index]):
            if np.array_equal(theta, earlier.theta):
                raise RecordError(f"experiment {i + 1} was run with exactly the θ that you set")
        return theta


def _same(driver: Driver, index: int, experiment: Experiment) -> int | None:
    """Return another experiment with the same curves, even if its file was saved again."""
    mine = _curves(experiment)
    for other in sorted(driver.state.finished):
        theirs = _curves(driver.store.experiment(other))
        comparable = other != index and len(theirs[0]) and len(mine) == len(theirs)
        if comparable and all(map(np.array_equal, mine, theirs)):
            return other
    return None


def _curves(experiment: Experiment) -> list[np.ndarray]:
    """Return everything that a record holds; outputs only if they are no states."""
    arrays = [experiment.t, experiment.x, experiment.u]
    return arrays if experiment.y is None else [*arrays, experiment.y]


# --- Attend to a run: let it start, stop it, count it as failed, or try again.


def _pending(driver: Driver, index: int, then: str = "nothing was changed") -> Suggested:
    """Return the pending sample. Raises StaleError unless its index is `index`."""
    pending = driver.study.pending
    if pending is None or pending.index != index:
        raise StaleError(f"experiment {index + 1} is no longer waited for: {then}")
    return pending


class WriteAndStart(Action, frozen=True):
    """Let the run of the pending sample start, with the values that the person was shown."""

    index: Whole
    when = frozenset({Phase.CONFIRM})
    otherwise = "no run is to be confirmed: nothing was written"

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.plant.recovery is Recovery.FAILED:
            return StaleError("the plant does not have its old values yet: nothing was written")
        if not study.plant.ready or study.plant.recovery is not Recovery.DONE:
            return StaleError("the plant's present values are not known yet: nothing was written")
        return None

    def _take(self, driver: Driver) -> None:
        run = driver.underway.of(_pending(driver, self.index, "nothing was written"))
        assert run is not None
        assert run.changes is not None
        run.supply(run.changes)
        run.waits, run.moves_plant = False, True
        driver.feed(Moment.CONFIRMED)


class StopRun(Action, frozen=True):
    """Stop the run of the pending sample, which then counts as failed."""

    index: Whole
    beside = True
    # Also after an error, since a run may move the plant all the same.
    when = frozenset({Phase.RUNNING, Phase.FAILED})
    otherwise = "this experiment is not running: nothing was changed"

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        running = study.plant.moves if study.plant.asks else study.phase is Phase.RUNNING
        if not running or study.pending is None:
            return StaleError(cls.otherwise)
        if study.plant.stops:
            return None
        if study.plant.asks:
            return ScenarioError("this run cannot be stopped from here")
        return ScenarioError("experiments of a built-in scenario run in seconds: wait for this one")

    def _take(self, driver: Driver) -> None:
        underway, pending = driver.underway, _pending(driver, self.index)
        run = underway.of(pending)
        if underway.source.asks:
            driver.version += 1
        elif driver.at_once == 1:
            for other in (run for theta, run in underway.going.items() if theta != pending.theta):
                other.stop("given up")  # it runs in the only process
        if run is not None:
            run.stop("stopped")


class Fail(Action, frozen=True):
    """Count the run of the pending sample as failed: an experiment without a record."""

    index: Whole
    reason: Text = ""
    when = frozenset({Phase.RECORD, Phase.CONFIRM, Phase.FAILED})
    otherwise = _NOT_FAILING

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        pending = study.pending
        if pending is None:
            return StaleError(_NOT_FAILING)
        if pending.index in study.state.finished:
            # A later step failed, for example on a full disk: this experiment must not be replaced.
            return StaleError(f"experiment {pending.index + 1} is saved, it has not failed: try again")
        return None

    def _take(self, driver: Driver) -> None:
        theta = _pending(driver, self.index).theta
        noted = [events.Noted(f"experiment {self.index + 1} failed: {self.reason}")] if self.reason else []
        partial = driver.underway.partial.get(theta)
        driver.append(*noted, (events.Finished(self.index), partial or driver.store.failed(self.index)))
        driver.underway.partial.pop(theta, None)  # not before it is saved: on a full disk this is tried again
        driver.proceed()


class Retry(Action, frozen=True):
    """Retry what failed: a run, writing the study file, or restoring a plant's old values.

    Where a run is to be confirmed, read the live plant's present values again.
    """

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        failed = study.phase in (Phase.FAILED, Phase.CONFIRM) or study.plant.recovery is Recovery.FAILED
        return None if failed else StaleError("nothing has failed, so there is nothing to try again")

    def _take(self, driver: Driver) -> None:
        underway, study = driver.underway, driver.study
        if driver.phase is Phase.CONFIRM or underway.plant.recovery is Recovery.FAILED:
            underway.plant.is_due()
            driver.version += 1
        if driver.phase is Phase.CONFIRM and study.pending is not None:
            underway.wait_for(study.pending, study.unfinished, anew=True)
        if driver.phase is Phase.FAILED:
            driver.feed(Moment.RETRIED)
            if study.pending is not None and not underway.source.asks:
                underway.wait_for(study.pending, study.unfinished)


# --- End the study, and go on with it.


class Finish(Action, frozen=True):
    """End the study at the person's request."""

    when = frozenset(Phase) - {Phase.OVER}
    otherwise = "the study has ended already"

    def _take(self, driver: Driver) -> None:
        best, marks = driver.study.best, driver.state.marks
        good = best is not None and GOOD_ENOUGH in marks.get(best, frozenset())
        driver.append(events.Ended(GOOD_ENOUGH if good else FINISHED))
        driver.proceed()


class GoOn(Action, frozen=True):
    """Reopen the ended study, with `more` additional experiments."""

    more: Annotated[int, Meta(ge=0, le=10_000)] = 0
    when = frozenset({Phase.OVER})
    otherwise = "the study has not ended"

    def _take(self, driver: Driver) -> None:
        state, more = driver.state, self.more
        if more < 0 or (more == 0 and state.history.answered >= state.n_max):
            raise StaleError(f"all {state.n_max} experiments are compared: say how many more")
        extended = [events.Extended(state.n_max + more)] if more else []
        driver.append(*extended, events.Reopened())
        driver.become(agent_of(driver.state, driver.store.scenario.space, driver.thoughts.simulator))
        driver.proceed()


def _in_trial(study: Study) -> PrefcalError | None:
    """Return why old and new cannot be tried on the plant, or which of them stays be confirmed."""
    if not (study.plant.asks == "record" or study.plant.tries):
        return StaleError("old and new can only be tried on a rig or a live plant")
    if tried_on_plant(study.state, study.best) is None:
        return StaleError("no experiment was better than the first: there is nothing to try")
    if study.plant.tries and 0 in study.state.history.unsafe:
        return StaleError("the first experiment was unsafe: it is not written to the plant again")
    return None


def _check_tried(driver: Driver, index: int, best: int) -> None:
    """Raise StaleError unless experiment `index` is the first one or the best, as the person saw it."""
    if driver.study.best != best:
        raise StaleError("another experiment is the best by now: try both again")
    if index not in (0, best):
        raise StaleError(f"experiment {index + 1} was not tried: only the first one and the best are")


class TryOnPlant(Action, frozen=True):
    """Have the θ of the first experiment, 0, or of the best on a live plant; what it had before is kept."""

    best: Whole  # index of the best experiment, as the person saw it
    index: Whole | None = None  # experiment; None to read what the plant has, which the person must see first
    blind: bool = False  # whether the person is not told which is which
    when = frozenset({Phase.OVER})
    otherwise = "the study has not ended"
    beside = True

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if not study.plant.tries:
            return StaleError("only a live plant is written to")
        if study.plant.recovery is not Recovery.DONE:
            return StaleError("the plant does not have its old values yet: nothing was written")
        return _in_trial(study)

    def _take(self, driver: Driver) -> None:
        _check_tried(driver, self.index or 0, self.best)
        plant, tried = driver.underway.plant, driver.underway.plant.tried
        anew = driver.try_out(self.best, blind=self.blind)
        if self.index is None:
            if plant.tries:
                raise StaleError("old and new are being tried already")
            plant.tried = anew
        # An answer that was retracted meanwhile makes another trial of it.
        elif tried is None or tried.about != anew.about or not (plant.tries or tried.run.changes):
            raise StaleError("the plant's present values are not known yet: nothing was written")
        else:
            tried.trial.want(self.index)
            if not plant.tries:
                tried.run.supply(tried.run.changes or ())
        driver.version += 1


class EndTrial(Action, frozen=True):
    """End the trial on a live plant without a confirmation: it gets back what it had before."""

    when = frozenset({Phase.OVER})
    otherwise = "the study has not ended"
    beside = True

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        return None if study.plant.moves else StaleError("nothing is being tried on the plant")

    def _take(self, driver: Driver) -> None:
        tried = driver.underway.plant.tried
        if tried is not None:
            tried.run.stop("stopped")
        driver.version += 1


class KeepOnPlant(Action, frozen=True):
    """Confirm which of two tunings stays on the plant, after both were tried there."""

    index: Whole  # experiment that stays: the first one, 0, or the best
    best: Whole  # index of the best experiment, as the person saw it
    blind: bool = False  # whether the person was not told which was which
    when = frozenset({Phase.OVER})
    otherwise = "the study has not ended"

    beside = True

    @classmethod
    def _also(cls, study: Study) -> PrefcalError | None:
        if study.plant.tries and not study.plant.holds:
            return StaleError("the plant has neither of the two now: nothing was confirmed")
        return _in_trial(study)

    def _take(self, driver: Driver) -> None:
        _check_tried(driver, self.index, self.best)
        tried = driver.underway.plant.tried
        if tried is None:
            driver.append(events.Kept(self.index, self.blind))
        else:
            with tried.trial.confirming(self.index):
                driver.append(events.Kept(self.index, tried.blind))


# --- List all actions.

ACTIONS: Mapping[str, type[Action]] = MappingProxyType(
    # WriteAndStart is "write_and_start".
    {re.sub("(?<!^)(?=[A-Z])", "_", kind.__name__).lower(): kind for kind in Action.__subclasses__()}
)
"""All actions by name: what `Now.can` holds, and the page's addresses."""


def possible(study: Study) -> frozenset[str]:
    """Return the names of the actions that can be taken now; screens offer these and no others."""
    return frozenset(name for name, action in ACTIONS.items() if action.refusal(study) is None)
