"""The conversation in a terminal: show, read a key, do it; until the study is over or stopped."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from prefcal_env.errors import PrefcalError
from prefcal_env.preference import Strength
from prefcal_scenarios.interview import Choice, Interview, Now, Phase
from prefcal_scenarios.interview.moment import GOOD_ENOUGH, UNSAFE

from .keys import END, ask_line
from .looking import show_history, show_status
from .showing import show_keys, show_next, show_question

# A key that the page has too means the same there; only R, which asks again there, is right here.
CHOICES = {
    "l": Choice.LEFT, "left": Choice.LEFT, "r": Choice.RIGHT, "right": Choice.RIGHT,
    "=": Choice.SAME, "same": Choice.SAME, "s": Choice.CANNOT_TELL,
}  # fmt: skip
MUCH = {
    "L": Choice.LEFT, "much left": Choice.LEFT, "R": Choice.RIGHT, "much right": Choice.RIGHT,
}  # fmt: skip
MARKS = {
    "q": ("left", UNSAFE), "e": ("right", UNSAFE),
    "a": ("left", GOOD_ENOUGH), "d": ("right", GOOD_ENOUGH),
}  # fmt: skip
STOP = ("x", "stop")
_LARGEST = 20 << 20
"""Bytes of a record, as on the page."""


@dataclass(slots=True)
class _Conversation:
    interview: Interview
    console: Console
    keys: Callable[[], str]
    line: Callable[[str], str]
    blind: bool = False
    comment: str = ""
    shown: int = -1

    def run(self) -> None:
        """Go on until it is over or stopped."""
        while (now := self.interview.now()).phase is not Phase.OVER:
            if now.phase is Phase.RUNNING:
                self._wait(now)
            elif not self._one(now):
                return
        self._say(f"The study is over: {now.state.ended}.")

    def _wait(self, now: Now) -> None:
        words = "choosing the next experiment"
        if now.pending is not None:
            words = f"running experiment {now.pending.index + 1}"
        with self.console.status(f"{words} (the first run on a machine compiles)"):
            while now.phase is Phase.RUNNING:
                now = self.interview.wait(now.version, 1.0)

    def _one(self, now: Now) -> bool:
        """One step of the person; False if he stops."""
        try:
            if now.phase is Phase.QUESTION:
                return self._question(now)
            if now.phase is Phase.RECORD:
                return self._record(now)
            return self._failed(now)
        except PrefcalError as error:
            self._say(f"{error}")
            return True

    def _question(self, now: Now) -> bool:
        assert now.question is not None
        if self.shown != now.version:
            show_question(self.interview, now, self.console, blind=self.blind)
            self.shown = now.version
        key = self.keys()
        if key in STOP:
            return False
        if key in CHOICES:
            self._answer(now.question.id, CHOICES[key], Strength.BETTER)
        elif key in MUCH:
            self._answer(now.question.id, MUCH[key], Strength.MUCH_BETTER)
        elif key in MARKS:
            side, mark = MARKS[key]
            on = mark not in getattr(now.question, side).marks
            self.interview.mark(now.question.id, side, mark, on)
            self._say(f"{side.capitalize()}: {mark}" + ("." if on else ", no longer."))
        else:
            self._other(key, now)
        return True

    def _answer(self, question: int, choice: Choice, strength: Strength) -> None:
        self.interview.answer(
            question, choice, strength=strength, comment=self.comment, blind=self.blind
        )
        self.comment = ""  # not before: on a full disk the answer is given again
        much = ", much better" if strength is Strength.MUCH_BETTER else ""
        self._say(f"Saved: {choice.value}{much}.")

    def _other(self, key: str, now: Now) -> None:
        if key == "z":
            self.interview.undo(now.version)
            self._say("The last answer is taken back.")
        elif key == "c":
            said = self.line("comment on the next answer")
            # Ctrl-D says END: the person wants no comment.
            self.comment = "" if said == END else said
        elif key == "b":
            self.blind, self.shown = not self.blind, -1
        elif key == "p":
            self.interview.repeat()
        elif key == "f":
            # It lies beside the keys of the marks.
            self._say("Press f again to finish the study.")
            if self.keys() == "f":
                self.interview.finish()
        elif key in ("h", "w") and self.blind:
            self._say("That would show which experiment is which: end blind first (b).")
        elif key == "h":
            show_history(self.interview, self.console)
        elif key == "w":
            show_status(self.interview, self.console)
        else:
            show_keys(self.console)

    def _record(self, now: Now) -> bool:
        assert now.pending is not None
        if self.shown != now.version:
            show_next(self.interview, now, self.console)
            self.shown = now.version
        said = self.line("its file, or: failed, unsafe FILE, undo, stop")
        if said in STOP:
            return False
        if said in ("z", "undo"):
            self.interview.undo(now.version)
        elif said == "failed":
            self.interview.fail(now.pending.index)
        elif said:
            content = self._content(said.removeprefix("unsafe ").strip().strip("\"'"))
            if content is not None:
                unsafe = said.startswith("unsafe ")
                self.interview.record(now.pending.index, content, unsafe=unsafe)
                self._say("The record is saved.")
        return True

    def _content(self, name: str) -> bytes | None:
        """Of a file; None, said in words, if it cannot be read."""
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
        self._say("[t] try again   [f] count it as failed   [z] undo   [x] stop")
        key = self.keys()
        if key in STOP:
            return False
        if key == "t":
            self.interview.retry()
        elif key == "f" and now.pending is not None:
            self.interview.fail(now.pending.index, now.problem or "")
        elif key == "z":
            self.interview.undo(now.version)
        return True

    def _say(self, words: str) -> None:
        self.console.print(words, markup=False, highlight=False, soft_wrap=True)


def converse(
    interview: Interview,
    console: Console,
    keys: Callable[[], str],
    line: Callable[[str], str] | None = None,
) -> None:
    """Ask in a terminal until the study is over or the person stops.

    Args:
        interview: Whose background work is done by somebody else, a `Background` say.
        console: Where to print; 80 columns are enough.
        keys: Gives the next key.
        line: Asks for a whole line; from standard input if None.
    """
    asks = line or (lambda words: ask_line(console, words))
    _Conversation(interview, console, keys, asks).run()
