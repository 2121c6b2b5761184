"""Hold the conversation in a terminal: show a question, read the answer, and repeat."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any

from msgspec.structs import replace
from rich.console import Console

from prefcal_app.session import Choice, Interview, Now, Phase, actions
from prefcal_app.session.study import ENOUGH, GOOD_ENOUGH, UNSAFE, PlantNow, Recovery, TrialNow
from prefcal_app.simulating import SimulationCounts
from prefcal_app.summary import kept_on_plant, kept_text
from prefcal_app.view import Seen, brief_view, history_view, now_view, preview_view, status_view, trial_view
from prefcal_env.errors import PrefcalError, StaleError
from prefcal_env.sources import Stage
from prefcal_env.study import Suggested
from prefcal_env.workers import in_time
from prefcal_scenarios.wording import theta_text, with_unit

from .showing import (
    END,
    Tenths,
    ask_line,
    say,
    show_brief,
    show_changes,
    show_history,
    show_keys,
    show_next,
    show_question,
    show_status,
    theta_of,
    typed,
)

ANSWER = "answer"  # words that ask for an answer
# Letters that the page has as keys mean the same there.
CHOICES = {
    "l": Choice.LEFT,
    "left": Choice.LEFT,
    "r": Choice.RIGHT,
    "right": Choice.RIGHT,
    "=": Choice.SAME,
    "same": Choice.SAME,
    "s": Choice.CANNOT_TELL,
}
MARKS: dict[str, tuple[actions.Place, actions.Kind]] = {
    "q": ("left", UNSAFE),
    "e": ("right", UNSAFE),
    "a": ("left", GOOD_ENOUGH),
    "d": ("right", GOOD_ENOUGH),
}
STOP = ("x", "stop")
UNDO = ("z", "undo")
RESTORE = ("g", "again")
_LOOK = 0.2  # interval, in seconds, at which a waiting conversation reads what was typed
_EXPLAINED = 2.0  # longest wait, in seconds, for the reason of a question: it is asked without one then
_LARGEST = 20 << 20  # largest size of a record in bytes, as on the page


@dataclass(slots=True)
class _Conversation:
    interview: Interview
    console: Console
    line: Callable[[str], str]
    blind: bool = False
    comment: str = ""
    shown: object = None  # what was printed last: a question, or the version at which a record was asked for
    seen: Seen = field(default_factory=Seen)
    compiles: bool = False
    paced: bool = False  # whether it was said how long a question takes
    tenths: Tenths = field(default_factory=Tenths)
    dialed: tuple[float, ...] | None = None
    missing: object = None  # where it was last said that the plant lacks its old values
    typed: Callable[[], str | None] = typed

    def run(self) -> None:
        """Ask until the study is over or stopped."""
        if self.interview.scenario.brief and self.interview.now().state.history.answered <= 1:
            show_brief(brief_view(self.interview), self.console)
        while (now := self.interview.now()).phase is not Phase.OVER:
            if now.phase is Phase.RUNNING:
                self._wait(now)
            elif not self._one(now):
                return
        more = f" (--n-max {now.state.n_max + 1} goes on)" if now.state.ended == ENOUGH else ""
        self._say(f"The study is finished: {self.interview.known.why_over}{more}.")
        try:
            self._try_on_plant(trial_view(self.interview, now))
        except PrefcalError as error:
            self._say(str(error))
            self._end_trial()
        if ended := self._while_tried(lambda trial: not trial.moves):
            self._say(f"{ended}.")

    def _try_on_plant(self, trial: Mapping[str, Any] | None) -> None:
        """Show old and new in turn, until one of them is confirmed or the person goes on."""
        if trial is None:
            return None
        self._say(f"{trial['kept']} Try it on the plant?".lstrip())
        kind = {"t": "open", "b": "blind"}.get(
            self._one_of("t: old and new, b: blind, Enter: no", ("t", "b"))
        )
        sides, at = trial.get(kind or "", ()), 0
        if sides and trial["live"] and not self._may_write(trial["best"], kind == "blind"):
            return self._say("Nothing was written.")
        while sides:
            side = sides[at]
            theta = ", ".join(
                f"{knob['name']} = {with_unit(knob['text'], knob['unit'])}" for knob in side["theta"]
            )
            if not trial["live"]:
                self._say(f"{side['name']}: enter {theta}, then watch the plant.")
            elif self._write(actions.TryOnPlant(trial["best"], side["index"], kind == "blind")):
                return None
            else:
                self._say(f"{side['name']} is on the plant: watch it.")
            asked = "o: the other one, keep: this one stays, Enter: confirm nothing"
            said = self._one_of(asked, ("o", "keep"))
            if said == "keep":
                self.interview.do(actions.KeepOnPlant(side["index"], trial["best"], kind == "blind"))
                return self._say(kept_text(kept_on_plant(self.interview.now().state)))
            if not said:
                self._end_trial()
                return self._say("Nothing more is confirmed.")
            at = 1 - at
        return None

    def _may_write(self, best: int, blind: bool) -> bool:
        """Show what a live plant has and what is written in turn; return whether the person wants that."""
        self.interview.do(actions.TryOnPlant(best, blind=blind))
        problem = self._while_tried(lambda trial: bool(trial.changes or trial.problem))
        view = trial_view(self.interview, self.interview.now())
        for change in () if view is None else view["live"]["changes"]:
            limits = f"limits {change['limits']}, at most {change['rate']} per second"
            self._say(f"  {change['name']}: {change['old']} → {change['new']} {change['unit']}   ({limits})")
        if problem:
            return False
        self._say("Only these values are written. The plant gets back what it has now unless you confirm.")
        if told := self.interview.scenario.source.instructions:
            self._say(told)
        return self._one_of("write and try? yes, Enter: no", ("yes",)) == "yes"

    def _write(self, wanted: actions.TryOnPlant) -> str:
        """Have a θ on a live plant; return why that ended, empty if it has it."""
        self.interview.do(wanted)
        return self._while_tried(lambda trial: trial.shown == wanted.index or not trial.moves)

    def _end_trial(self) -> None:
        with suppress(StaleError):  # there is none, or it has just ended
            self.interview.do(actions.EndTrial())

    def _while_tried(self, until: Callable[[TrialNow], bool]) -> str:
        """Wait for the trial on a live plant; return why it ended or could not begin; else nothing."""
        with self.console.status("waiting for the plant"):
            while True:
                now = self.interview.now()
                trial = None if now.plant is None else now.plant.trial
                if trial is None or until(trial):
                    return "" if trial is None else trial.problem
                self.interview.wait(now.version, _LOOK)

    def _one_of(self, asked: str, words: tuple[str, ...]) -> str:
        """Return one of the words, asking again for anything else; empty for Enter, and to stop."""
        while (said := self.line(asked).lower()) not in (*words, *STOP, ""):
            pass
        return said if said in words else ""

    def _wait(self, now: Now) -> None:
        with self.console.status(_waiting(now)) as status:
            while now.phase is Phase.RUNNING:
                # Output without animation, such as a file or a pipe, is told once what compiles.
                if now.preparing is not None and not (self.console.is_terminal or self.compiles):
                    self.compiles = True
                    self._say(now.preparing.words)
                self._tell_pace(now.simulated)
                status.update(_waiting(now))
                asked = self.typed() == "k" and "stop_run" in now.can
                if asked and now.pending is not None:
                    with suppress(StaleError):  # the run has just ended
                        self.interview.do(actions.StopRun(now.pending.index))
                now = self.interview.wait(now.version, _LOOK)

    def _tell_pace(self, found: SimulationCounts | None) -> None:
        """Say once how long questions of a robust study take and, without animation, how far its runs are."""
        if found is None or not found.pace:
            return
        if not self.paced:
            self.paced = True
            self._say(found.pace)
        if self.tenths.passed(*found.varied) and not self.console.is_terminal:
            self._say(found.going_on)

    def _one(self, now: Now) -> bool:
        """Take one step with the person; return False if they stop."""
        steps = {
            Phase.QUESTION: self._question,
            Phase.RECORD: self._record,
            Phase.CONFIRM: self._confirm,
            Phase.FAILED: self._failed,
        }
        try:
            return steps[now.phase](now)
        except PrefcalError as error:
            self._say(str(error))
            return True

    def _question(self, now: Now) -> bool:
        if self.shown is not now.question and self.interview.known.screens:
            self.interview.known.wait_for_findings(_EXPLAINED)
            now = self.interview.now()
        if now.question is None:  # it changed meanwhile
            return True
        if self.shown is not now.question:
            view = now_view(self.interview, blind=self.blind, seen=self.seen)
            if view["question"] is None:
                return True
            show_question(view, self.console)
            self.shown = now.question
        self._unrestored(now)
        said = self._said()
        if said in STOP:
            return False
        if said in CHOICES:
            self._answer(now.question.id, CHOICES[said])
        elif said in MARKS:
            side, mark = MARKS[said]
            on = mark not in now.question.side(side).marks
            self.interview.do(actions.Mark(now.question.id, side, mark, on))
            self._say(f"{side.capitalize()}: {mark}" + ("." if on else ", no longer."))
        elif said in RESTORE and now.plant is not None:
            self._restore()
        else:
            self._other(said, now)
        return True

    def _said(self) -> str:
        return self.line(ANSWER).lower()

    def _answer(self, question: int, choice: Choice) -> None:
        self.interview.do(actions.Answer(question, choice, comment=self.comment, blind=self.blind))
        self.comment = ""  # after the answer is saved: on a full disk it is repeated
        self._say(f"Saved: {choice.value}.")

    def _other(self, said: str, now: Now) -> None:
        if said == "z":
            self._undo(now)
        elif said == "c":
            comment = self.line("comment on the next answer")
            self.comment = "" if comment == END else comment  # END means Ctrl-D
        elif said == "b":
            self.blind, self.shown = not self.blind, None
        elif said == "t":
            self.shown = None
        elif said == "p":
            self.interview.do(actions.Repeat())
        elif said == "f":
            # Asks again, since one letter is easily mistyped.
            self._say("Type f again to finish the study.")
            if self._said() == "f":
                self.interview.do(actions.Finish())
        elif said in ("h", "w") and self.blind:
            self._say("That would show which experiment is which: end blind mode first (b).")
        elif said == "h":
            show_history(history_view(self.interview)["answers"], self.console)
        elif said == "w":
            show_status(now_view(self.interview), status_view(self.interview), self.console)
        elif said:
            show_brief(brief_view(self.interview), self.console)
            show_keys(self.console)

    def _undo(self, now: Now) -> None:
        """Undo the last answer and its comment, or skip a question that was asked again."""
        skipped = now.question is not None and now.question.repeats is not None
        self.comment = self.interview.do(actions.Undo(now.version)).draft or self.comment
        kept = f" Its comment is kept for the next one: {self.comment}" if self.comment else ""
        self._say("Skipped." if skipped else f"The last answer is undone.{kept}")

    def _record(self, now: Now) -> bool:
        assert now.pending is not None
        if self.shown != now.version:
            show_next(self.interview, now, self.console)
            self.shown = now.version
        said = self.line("its file, or: failed, unsafe FILE, set KNOB=VALUE, replace N FILE, undo, stop")
        if said.startswith("set "):
            space = self.interview.scenario.space
            theta = theta_of(said.removeprefix("set "), space, now.pending.theta)
            self.dialed = tuple(theta.tolist())
            self._say(f"Its θ is now {theta_text(space, self.dialed)}.")
        elif said and said not in (*STOP, *UNDO, "failed"):
            self._file(said, now.pending)
        return self._instead_of_a_run(said, now)

    def _instead_of_a_run(self, said: str, now: Now, why: str = "") -> bool:
        """Do what can be said in place of a run or its record; return False to stop."""
        if said in UNDO:
            self.interview.do(actions.Undo(now.version))
        elif said == "failed" and now.pending is not None:
            self.interview.do(actions.Fail(now.pending.index, why))
        return said not in STOP

    def _confirm(self, now: Now) -> bool:
        """Let the person confirm what is written to the live plant."""
        while now.plant is not None and now.plant.changes is None and not now.plant.problem:
            if now.phase is not Phase.CONFIRM:
                break
            now = self.interview.wait(now.version, _LOOK)
        if now.phase is not Phase.CONFIRM or now.pending is None or now.plant is None:
            return True
        show_changes(self.interview, now, self.console)
        choices = "again (read the plant again), failed, undo, stop"
        ready = "write_and_start" in now.can
        said = self.line(f"write and start? yes, {choices}" if ready else choices)
        if said == "yes" and ready:
            self.interview.do(actions.WriteAndStart(now.pending.index))
        elif said == "again":
            self.interview.do(actions.Retry())
        return self._instead_of_a_run(said, now, "it was not run")

    def _unrestored(self, now: Now) -> None:
        """Say once beside each question or failed run that the plant lacks its old values."""
        if now.plant is None or not _lacks_old_values(now.plant):
            return
        here = (now.phase, now.question, now.plant.problem)
        if self.missing != here:
            self._say(f"The plant does not have its old values yet: {now.plant.problem}.")
            self._say("g or again tries to restore them.")
            self.missing = here

    def _restore(self) -> None:
        """Try to restore the plant's old values; a line ends the wait, not the attempt."""
        self.interview.do(actions.Retry())
        self.missing, now = None, self.interview.now()
        words = "restoring the old values on the plant; Enter goes on meanwhile"
        with self.console.status(words):
            while _is_restoring(now.plant) and self.typed() is None:
                now = self.interview.wait(now.version, _LOOK)
        if now.plant is not None and now.plant.recovery is Recovery.DONE:
            self._say("The old values are restored.")

    def _file(self, said: str, pending: Suggested) -> None:
        """Save a record of the pending experiment, or of an earlier one with "replace N"."""
        index, theta = pending.index, self.dialed
        if said.startswith("replace "):
            number, _, said = said.removeprefix("replace ").strip().partition(" ")
            if not number.isdecimal() or not said:
                self._say("Name the record and the right file, for example: replace 2 run-2.csv")
                return
            index, theta = int(number) - 1, None
        unsafe = said.startswith("unsafe ")
        content = self._content(said.removeprefix("unsafe ").strip().strip("\"'"))
        if content is None:
            return
        record = actions.Record(index, content, unsafe, theta)
        view = preview_view(self.interview, record)
        self._say(f"Experiment {index + 1}: {view['text']}.")
        for warning in view["warnings"]:
            self._say(warning)
        if view["warnings"] and self.line("save it anyway? yes or no") != "yes":
            self._say("Nothing was saved.")
            return
        self.interview.do(replace(record, again=True))
        self.dialed = None
        self._say("The record is saved.")

    def _content(self, name: str) -> bytes | None:
        """Return the content of a file; None, after a message, if it cannot be read."""
        try:
            with Path(name).expanduser().open("rb") as file:
                content = file.read(_LARGEST + 1)
        except (OSError, ValueError, RuntimeError) as error:  # no such file, NUL, no such user
            self._say(f"cannot read {name}: {getattr(error, 'strerror', None) or error}")
            return None
        if len(content) > _LARGEST:
            self._say(f"{name} is larger than {_LARGEST >> 20} MiB")
            return None
        return content

    def _failed(self, now: Now) -> bool:
        self._say(f"That did not work: {now.problem}")
        self._unrestored(now)
        keys = {"retry": "t: try again", "fail": "f: count it as failed", "undo": "z: undo"}
        self._say(", ".join([*(words for step, words in keys.items() if step in now.can), "x: stop"]))
        said = self._said()
        if said in STOP:
            return False
        if said in RESTORE and _lacks_old_values(now.plant):
            self._restore()
        elif said == "t":
            self.interview.do(actions.Retry())
        elif said == "f" and now.pending is not None:
            self.interview.do(actions.Fail(now.pending.index, now.problem or ""))
        elif said == "z":
            self.interview.do(actions.Undo(now.version))
        return True

    def _say(self, words: str) -> None:
        say(self.console, words)


def _waiting(now: Now) -> str:
    """Return a description of what the conversation waits for."""
    if now.preparing is not None:
        return now.preparing.words
    if now.pending is None:
        found = now.simulated
        unseen = "" if found is None else f" ({found.going_on or found.line})"
        return f"choosing the next experiment{unseen}"
    if now.running > 1:
        return f"running {now.running} experiments"
    words = f"running experiment {now.pending.index + 1}"
    if now.plant is not None:
        return f"{words}{_words_of_run(now.plant)}"
    if now.run_limit is None:
        return words
    limit = f"at most {in_time(now.run_limit)}; " if isfinite(now.run_limit) else ""
    return f"{words} ({limit}k and Enter stops it)"


def _lacks_old_values(plant: PlantNow | None) -> bool:
    return plant is not None and plant.recovery is Recovery.FAILED


def _is_restoring(plant: PlantNow | None) -> bool:
    return plant is not None and plant.recovery in (Recovery.DUE, Recovery.RUNNING)


def _words_of_run(plant: PlantNow) -> str:
    """Return how far a run on a live plant is."""
    progress = plant.progress
    if progress is None:
        return ""
    left = max(progress.duration - progress.elapsed, 0.0)
    time = f", {left:.0f} s left" if progress.stage is Stage.RECORDING else ""
    values = ", ".join(
        f"{key.split(' ', 1)[1]} {v:.4g}"
        for key, v in progress.values.items()
        if not key.startswith("reference")
    )
    shown = f" ({values})" if values else ""
    problem = f"; {progress.problem}" if progress.problem else ""
    return f": {progress.stage.value}{time}{shown}{problem}; k and Enter stops it"


def converse(interview: Interview, console: Console, line: Callable[[str], str] | None = None) -> None:
    """Ask in a terminal until the study is over or the person stops.

    Args:
        interview: Interview whose background work runs elsewhere, for example in a `Background`.
        console: Console to print to, at least 80 columns wide.
        line: Function that asks for a line of text; None to read standard input.
    """
    _Conversation(interview, console, line or partial(ask_line, console)).run()
