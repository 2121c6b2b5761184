"""Offer what a person can do in an interview."""

from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec

from . import records, runs, steps
from .can import refusal
from .flow import Flow, Guarded
from .study.now import Now

P = ParamSpec("P")


def _step(name: str, step: Callable[Concatenate[Flow, P], None]) -> Callable[Concatenate["Steps", P], Now]:
    """Return a method that takes a step if that is possible now, and returns what is then to be seen."""

    @wraps(step)
    def take(self: "Steps", /, *args: P.args, **kwargs: P.kwargs) -> Now:
        with self._guarded.changing() as flow:
            refused = refusal(flow, name)
            if refused is not None:
                raise refused
            step(flow, *args, **kwargs)
            return self._now()

    return take


class Steps:
    """Steps of a person. Each is saved before it takes effect, and returns what is then to be seen.

    A step on an outdated page, for example in a second tab, raises StaleError and records nothing.
    If the file cannot be written, it raises StudyError and changes nothing.

    Args:
        guarded: Flow of the interview.
        now: Function that returns what is to be seen.
    """

    def __init__(self, guarded: Guarded, now: Callable[[], Now]) -> None:
        self._guarded, self._now = guarded, now

    answer = _step("answer", steps.answer)
    give = _step("give", steps.give)
    mark = _step("mark", steps.mark)
    undo = _step("undo", steps.undo)
    retract = _step("retract", steps.retract)
    repeat = _step("repeat", steps.repeat)
    pace = _step("pace", steps.pace)
    ask_for = _step("ask_for", steps.ask_for)
    choose = _step("choose", steps.choose)
    record = _step("record", records.record)
    write_and_start = _step("write_and_start", runs.confirm)
    stop_run = _step("stop_run", runs.stop)
    fail = _step("fail", runs.fail)
    retry = _step("retry", runs.retry)
    finish = _step("finish", runs.finish)
    go_on = _step("go_on", runs.go_on)
