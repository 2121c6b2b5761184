"""Load the user's file in its own process, run θ after θ, and end with prefcal."""

import faulthandler
import json
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from prefcal_env.errors import PrefcalError, RunError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.study import space_of
from prefcal_env.study.codec import encode
from prefcal_scenarios.catalog import load
from prefcal_scenarios.own.checks import returned
from prefcal_scenarios.own.own_line import as_exception, in_words, own_line
from prefcal_scenarios.processes.messages import Kind, Message
from prefcal_scenarios.processes.serving import Link
from prefcal_scenarios.scenario import Scenario, with_ranges

_BEYOND = 30.0
"""Seconds after the time limit when the process ends itself, in case prefcal is gone."""
_LONGEST = 1e6
"""Longest time limit in seconds that the process can watch itself."""


class _Stopped(KeyboardInterrupt):
    """prefcal ends the run; `finally` and `with` of the user's code stop the plant."""


def main(source: str, limit: float) -> None:
    """Run all requests until the other end closes the pipe.

    Args:
        source: Source of the scenario, path/to/own.py:NAME.
        limit: Maximum number of seconds of a run.
    """
    with suppress(_Stopped):  # while nothing runs
        _serve(source, limit)


def _serve(source: str, limit: float) -> None:
    link = Link()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # prefcal handles Ctrl-C
    signal.signal(signal.SIGTERM, _interrupt)
    sys.argv = [_file_of(source)]
    scenario, problem = _loaded(source)
    link.ready()
    while (request := link.requests.get()) is not None:
        if limit < _LONGEST:
            faulthandler.dump_traceback_later(limit + _BEYOND, exit=True)
        try:
            answer = problem if scenario is None else _attempted(scenario, json.loads(request))
        except _Stopped as error:  # report where the code was
            return link.say(*_error(error))
        faulthandler.cancel_dump_traceback_later()
        link.say(*answer)
    return None


def _file_of(source: str) -> str:
    """Return the user's own file in the source of a scenario."""
    name = source.partition("{")[0].strip()
    return name.rpartition(":")[0] or name


def _interrupt(number: int, frame: Any) -> None:
    raise _Stopped


def _loaded(source: str) -> tuple[Scenario | None, Message]:
    """Return the scenario, or the error that answers every run if its file does not load."""
    try:
        return load(source), (Kind.READY, b"")
    except _Stopped:
        raise
    except BaseException as error:
        return None, _error(error, "its file")


def _attempted(scenario: Scenario, request: dict[str, Any]) -> Message:
    """Run θ and return its experiment, or the error that the code raised."""
    try:
        theta = np.array(request["theta"], dtype=float)
        result = run_of(scenario, request["space"])(theta, seed=request["seed"])
        return Kind.EXPERIMENT, encode(returned(result))
    except _Stopped:
        raise
    except BaseException as error:
        return _error(error)


def run_of(scenario: Scenario, space: dict[str, Any] | None) -> Callable[..., Any]:
    """Return the run of the scenario with the current ranges of the study."""
    if space is None:
        return scenario.run
    by_now = space_of(space)
    within = dict(zip(by_now.names, by_now.within, strict=True))
    constraints = scenario.space.constraints
    return with_ranges(scenario, KnobSpace(by_now.knobs, constraints, within=within)).run


def _error(error: BaseException, what: str = "run") -> Message:
    if isinstance(error, RunError):  # an FMU that hung or crashed: no code of the user's
        said = {"words": str(error), "line": "", "trace": "", "why": error.why}
        return Kind.ERROR, json.dumps(said).encode()
    known = isinstance(error, PrefcalError)  # its words say it all
    trace = "" if known else "".join(traceback.format_exception(error))
    said = {"words": in_words(as_exception(error, what)), "line": own_line(error), "trace": trace}
    said["why"] = "raised"
    return Kind.ERROR, json.dumps(said).encode()
