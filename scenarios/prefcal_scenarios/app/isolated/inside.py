"""Load the user's file in its own process, run θ after θ, and end with prefcal."""

import faulthandler
import io
import json
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any, BinaryIO

import numpy as np

from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.study import space_of
from prefcal_env.study.codec import encode
from prefcal_scenarios.own.checks import check_experiment
from prefcal_scenarios.own.own_line import in_words, located, own_line
from prefcal_scenarios.scenario import Scenario, load, with_ranges

from .messages import Kind, Message, receive, send

_TIDYING = 1.0
"""Seconds for the interpreter to end after prefcal ended."""
_BEYOND = 30.0
"""Seconds after the time limit when the process ends itself, in case prefcal is gone."""
_LONGEST = 1e6
"""Longest time limit in seconds that the process can watch itself."""

_Given = SimpleQueue[bytes | None]


def main(source: str, limit: float) -> None:
    """Run all requests until the other end closes the pipe.

    Args:
        source: Source of the scenario, path/to/own.py:NAME.
        limit: Maximum number of seconds of a run.
    """
    with suppress(KeyboardInterrupt):  # stopped while nothing runs
        _serve(source, limit)


def _serve(source: str, limit: float) -> None:
    given, out = _pipes()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # prefcal handles Ctrl-C
    signal.signal(signal.SIGTERM, _interrupt)
    _volunteer()
    sys.argv = [source.rpartition(":")[0]]
    requests: _Given = SimpleQueue()
    threading.Thread(target=_listen, args=(given, requests), daemon=True).start()
    scenario, problem = _loaded(source)
    os.dup2(2, 1)
    if isinstance(sys.stdout, io.TextIOWrapper):  # the user's code may have replaced it
        sys.stdout.reconfigure(line_buffering=True)
    _say(out, Kind.READY)
    while (request := requests.get()) is not None:
        if limit < _LONGEST:
            faulthandler.dump_traceback_later(limit + _BEYOND, exit=True)
        try:
            answer = problem if scenario is None else _attempted(scenario, json.loads(request))
        except KeyboardInterrupt as error:  # stopped: report where the code was
            return _say(out, *_error(error))
        faulthandler.cancel_dump_traceback_later()
        _say(out, *answer)
    return None


def _pipes() -> tuple[BinaryIO, BinaryIO]:
    """Return the pipes for requests and answers, which the user's code can neither read nor write.

    Output of the file while loading is dropped, since prefcal loads the file too and prints it.
    """
    given, out = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.close(nothing)
    return given, out


def _interrupt(number: int, frame: Any) -> None:
    """Raise KeyboardInterrupt, so that `finally` and `with` of the user's code stop the plant."""
    raise KeyboardInterrupt


def _volunteer() -> None:
    """Ask the system to end this process rather than prefcal if memory runs out."""
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("1000")


def _listen(given: BinaryIO, requests: _Given) -> None:
    """Pass on requests; end the process soon after prefcal is gone, whatever is running."""
    while (message := receive(given)) is not None:
        requests.put(message[1])
    requests.put(None)
    time.sleep(_TIDYING)
    os._exit(1)


def _loaded(source: str) -> tuple[Scenario | None, Message]:
    """Return the scenario, or the error that answers every run if its file does not load."""
    try:
        return load(source), (Kind.READY, b"")
    except (Exception, SystemExit) as error:
        return None, _error(error)


def _attempted(scenario: Scenario, request: dict[str, Any]) -> Message:
    """Run θ and return its experiment, or the error that the code raised."""
    try:
        theta = np.array(request["theta"], dtype=float)
        result: object = _run_of(scenario, request["space"])(theta, seed=request["seed"])
        if not isinstance(result, Experiment):
            check_experiment(scenario, theta, result)  # raises
        assert isinstance(result, Experiment)
        return Kind.EXPERIMENT, encode(result)
    except (Exception, SystemExit) as error:
        return _error(error)


def _run_of(scenario: Scenario, space: dict[str, Any] | None) -> Callable[..., Any]:
    """Return the run of the scenario with the current ranges of the study."""
    if space is None:
        return scenario.run
    by_now = space_of(space)
    within = dict(zip(by_now.names, by_now.within, strict=True))
    constraints = scenario.space.constraints
    return with_ranges(scenario, KnobSpace(by_now.knobs, constraints, within=within)).run


def _say(out: BinaryIO, kind: Kind, content: bytes = b"") -> None:
    with suppress(OSError):  # prefcal is gone: `_listen` ends this process
        send(out, kind, content)


def _error(error: BaseException) -> Message:
    trace = "".join(traceback.format_exception(error))
    known = error if isinstance(error, Exception) else ScenarioError(f"run called exit: {error}")
    said = {"words": in_words(located(known)), "line": own_line(error), "trace": trace}
    return Kind.ERROR, json.dumps(said).encode()
