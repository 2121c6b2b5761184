"""Offer what a person can do in an interview."""

from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec

from prefcal_env.errors import StaleError

from . import records, runs, steps
from .flow import Flow
from .guarded import Guarded
from .study.now import Now

P = ParamSpec("P")


def _step(step: Callable[Concatenate[Flow, P], None]) -> Callable[Concatenate["Steps", P], Now]:
    """Return a method that takes a step, and returns what is to be seen after it."""

    @wraps(step)
    def take(self: "Steps", /, *args: P.args, **kwargs: P.kwargs) -> Now:
        with self._guarded.changing() as flow:
            if flow.underway.moves_plant and step is not runs.stop:
                raise StaleError("a run on the plant is in progress: stop it first")
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

    answer, give = _step(steps.answer), _step(steps.give)
    mark, undo, retract = _step(steps.mark), _step(steps.undo), _step(steps.retract)
    repeat, pace, ask_for = _step(steps.repeat), _step(steps.pace), _step(steps.ask_for)
    record, write_and_start = _step(records.record), _step(runs.confirm)
    fail, stop_run, retry = _step(runs.fail), _step(runs.stop), _step(runs.retry)
    finish, go_on = _step(runs.finish), _step(runs.go_on)
