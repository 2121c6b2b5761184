"""What a worker process does: load its work, run request after request, and end with prefcal."""

import io
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path
from queue import SimpleQueue
from typing import IO, Any, final

from prefcal_env.errors import PrefcalError, RunError
from prefcal_env.wording import as_exception, in_words, own_line

_TIDYING = 1.0  # seconds for the interpreter to end after prefcal ended


class Kind(Enum):
    """The kind of a message."""

    WORK = "work"  # to the process: the work of the requests that follow, perhaps another than before
    REQUESTS = "requests"  # to it: what to run, a list of pickled requests
    READY = "ready"  # from it: the work is loaded
    RESULTS = "results"  # from it: the next pickled results, and the seconds that they took
    ERROR = "error"  # from it: why the work cannot be loaded, or where its code was when it was ended


Message = tuple[Kind, bytes]  # a kind, and pickled content
Work = Callable[[Any], Any]
"""What a worker does with each request. If it has a method `last_words`, the text that this returns
is printed if prefcal is gone while a request runs."""


def send(pipe: IO[bytes], kind: Kind, content: bytes = b"") -> None:
    """Write one message. Raises OSError if the reader is gone."""
    pickle.dump((kind.value, content), pipe)
    pipe.flush()


def receive(pipe: IO[bytes]) -> Message | None:
    """Read the next message; None if the writer is gone, even in the middle of a message.

    Raises:
        ValueError: If it is no message: the user's code wrote to, or read from, the pipe.
    """
    try:
        kind, content = pickle.load(pipe)
        return Kind(kind), content
    except EOFError:
        return None
    except Exception as error:  # pickle raises whatever the first bytes happen to mean
        if "truncated" in str(error):
            return None
        raise ValueError("no message") from error


class Stopped(KeyboardInterrupt):
    """prefcal ends the run; `finally` and `with` of the user's code stop the plant."""


def failure(error: BaseException, what: str = "run", *, here: bool = True) -> RunError:
    """Return what was raised as a RunError, with the user's line and, unless it is ours, a trace.

    `Stopped` is raised again, since nothing that runs may stop it.

    Args:
        what: Name of the code for messages.
        here: Whether this is prefcal's own process, where KeyboardInterrupt may be Ctrl-C: it is
            raised again, too.
    """
    if isinstance(error, KeyboardInterrupt if here else Stopped):
        raise error
    if isinstance(error, RunError):  # an FMU that hung or crashed: no code of the user's
        return error
    trace = "" if isinstance(error, PrefcalError) else "".join(traceback.format_exception(error))
    return RunError(in_words(as_exception(error, what)), "raised", trace)


def main(period: float, tidy: bool) -> None:
    """Run all requests until the other end closes the pipe.

    Args:
        period: Seconds after which results are sent; 0 to send each at once.
        tidy: Whether the code of a request can clean up when it is ended.
    """
    link = Link()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # prefcal handles Ctrl-C
    if tidy:
        signal.signal(signal.SIGTERM, _interrupt)
    with suppress(Stopped):  # while nothing runs
        _serve(link, period)


def _interrupt(*_: object) -> None:
    raise Stopped


def _serve(link: "Link", period: float) -> None:
    while (message := link.messages.get()) is not None:
        kind, content = message
        if kind is Kind.WORK:
            try:
                make, arguments = pickle.loads(content)
                link.work = make(*arguments)
            except BaseException as error:
                link.say(Kind.ERROR, pickle.dumps(failure(error, "its file", here=False)))
                return
            link.ready()
            continue
        try:
            _answer(link, pickle.loads(content), period)
        except Stopped as error:
            link.say(Kind.ERROR, pickle.dumps(own_line(error)))
            return


def _answer(link: "Link", requests: list[bytes], period: float) -> None:
    """Run requests, and send the results in groups with the seconds that they took."""
    assert link.work is not None
    results, begun = list[bytes](), time.perf_counter()
    for number, request in enumerate(requests, 1):
        link.running = True
        results.append(_pickle(link.work, request))
        link.running = False  # before prefcal hears of it, and may end this process
        now = time.perf_counter()
        if now - begun >= period or number == len(requests):
            link.say(Kind.RESULTS, pickle.dumps((results, now - begun)))
            results, begun = [], now


def _pickle(work: Work, request: bytes) -> bytes:
    """Return the pickled result of a pickled request, or what it raised as a RunError, which is data."""
    try:
        return pickle.dumps(work(pickle.loads(request)))
    except BaseException as error:
        return pickle.dumps(failure(error, here=False))


@final
class Link:
    """The connection of a worker process to prefcal; prints are dropped until `ready`."""

    def __init__(self) -> None:
        given, self._out = _pipes()
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="replace")  # what cp1252 lacks fails no run that prints it
        self._process = os.getpid()
        with suppress(OSError):  # if memory runs out, this process ends rather than prefcal
            Path("/proc/self/oom_score_adj").write_text("1000")
        self.work: Work | None = None
        self.running = False
        self.messages: SimpleQueue[Message | None] = SimpleQueue()
        """What arrives; None when prefcal closes the pipe."""
        threading.Thread(target=self._listen, args=(given,), daemon=True).start()

    def ready(self) -> None:
        """Say that the code is loaded; from now on its prints go to standard error."""
        os.dup2(2, 1)
        if isinstance(sys.stdout, io.TextIOWrapper):  # the user's code may have replaced it
            sys.stdout.reconfigure(line_buffering=True)
        self.say(Kind.READY)

    def say(self, kind: Kind, content: bytes = b"") -> None:
        """Send a message to prefcal; if prefcal is gone, this process ends soon.

        A fork of this process, which the user's code forgot to end, ends here.
        """
        if os.getpid() != self._process:
            os._exit(0)
        with suppress(OSError):
            send(self._out, kind, content)

    def _listen(self, given: IO[bytes]) -> None:
        """Pass on requests; end the process soon after prefcal is gone, whatever is running."""
        with suppress(ValueError, OSError):  # the user's code read from the pipe, or closed it
            while (message := receive(given)) is not None:
                self.messages.put(message)
        self.messages.put(None)
        last_words = getattr(self.work, "last_words", None)
        if self.running and last_words is not None:
            with suppress(OSError):
                os.write(2, last_words().encode(errors="backslashreplace"))
        time.sleep(_TIDYING)
        os._exit(1)


def _pipes() -> tuple[IO[bytes], IO[bytes]]:
    """Return the pipes for requests and answers, which the user's code can neither read nor write.

    Output of the file while loading is dropped, since prefcal loads the file too and prints it.
    """
    given, out = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDWR)
    os.dup2(nothing, 0)
    os.dup2(nothing, 1)
    os.close(nothing)
    return given, out
