"""Run requests in processes that may die, hang or be stopped, and that are replaced, one or several."""

import json
import os
import pickle
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from queue import Empty, Queue
from statistics import median
from typing import IO, Any, final

import numpy as np

from prefcal_env.errors import RunError

from .inside import Kind, Message, receive, send

GRACE = 2.0  # seconds for the user's code to stop its plant (finally, with) before it is killed
MARK = "PREFCAL_WORKER"
"""Variable of the environment with the mark of a worker process; "prefcal-...-MARK-..." in the temporary
folder is removed when the process has ended, however it did."""
_LAST_WORDS = 0.2  # seconds for reading the last messages of an ended process
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables from which libraries of linear algebra read their number of threads."""
_POLITE = 10  # how much lower the priority of a gentle process is (its niceness)
_BOOT = (
    "import json, os, sys; path, args, nice = json.loads(sys.argv[1]); "
    "nice and hasattr(os, 'nice') and os.nice(nice); "
    "sys.path[:] = path; from prefcal_env.workers.inside import main; main(*args)"
)


@dataclass(frozen=True, slots=True)
class Terms:
    """On what terms a worker process runs requests."""

    what: str = "the run"  # what a request is, for messages
    allows: str = ""  # option that allows more time, for messages; empty for none
    again: bool = True  # whether a request whose process died runs once more; not what moves a real plant
    grace: float = 0.0  # seconds for the code of a request to clean up when it is ended; 0 to kill at once
    # Whether it works behind a person's back: it leaves the processor to whatever they wait for, and in a
    # pool its time limit follows the usual time of a request
    gentle: bool = False
    threads: int | None = 1  # number of threads of linear algebra; None for as many as in this process
    quiet: bool = False  # whether what it prints is kept from people, but for the last line before a crash


@final
class Process:
    """A process from its start to its end.

    Args:
        work: Pickled function, and its arguments, that return the function of each request.
        period: Seconds after which results are sent; 0 to send each at once.
        bell: Event that is set when there is something to `hear`.
    """

    def __init__(self, work: bytes, period: float, terms: Terms, bell: threading.Event) -> None:
        limited = {} if terms.threads is None else dict.fromkeys(_THREADS, str(terms.threads))
        arguments = [sys.path, [period, terms.grace > 0], _POLITE if terms.gentle else 0]
        self._said: IO[bytes] | None = tempfile.TemporaryFile() if terms.quiet else None  # noqa: SIM115
        self._mark = secrets.token_hex(4)
        # In its own process group, it gets no Ctrl-C from the terminal and ends with its children.
        self._process = subprocess.Popen(
            # -P: a file json.py in the folder of the shell hides no library.
            [sys.executable, "-P", "-c", _BOOT, json.dumps(arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            start_new_session=os.name == "posix",
            env=os.environ | limited | {MARK: self._mark},
        )
        self.pid, self.owner, self.unloaded = self._process.pid, os.getpid(), 0
        self._grace, self._bell = terms.grace, bell
        self._inbox: Queue[Message] = Queue()
        self._silent = self._damaged = False
        self._thread = threading.Thread(target=self._listen, name="worker", daemon=True)
        self._thread.start()
        self.load(work)

    @property
    def loaded(self) -> bool:
        """Return whether it can run requests: it has said so of each work that it was sent."""
        return not self.unloaded

    def load(self, work: bytes) -> None:
        """Send the work of the requests that follow, as it was made with; nothing may run."""
        self.unloaded += 1
        self._send(Kind.WORK, work)

    def ask(self, requests: list[bytes]) -> None:
        """Send pickled requests; `hear` returns the answers."""
        self._send(Kind.REQUESTS, pickle.dumps(requests))

    def hear(self) -> Message | None:
        """Return the next message; None if there is none yet."""
        with suppress(Empty):
            return self._inbox.get_nowait()
        return None

    @property
    def gone(self) -> bool:
        """Return whether the process has ended and all of its messages were read.

        The pipe alone cannot tell, since children of the user's code may hold it open.
        """
        if not self._silent and self._process.poll() is not None:
            self._thread.join(_LAST_WORDS)
            self._silent = True
        return self._silent and self._inbox.empty()

    def ended(self) -> str:
        """Wait for the process to end, and return how it ended."""
        if self._damaged:
            return "its code used a file that it had not opened, and so disturbed prefcal"
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(GRACE)
        code = self._process.poll()
        if code is None:
            return "its process no longer answers"
        if code >= 0:
            return f"its process ended with exit code {code}{self._last_line()}"
        name = signal.Signals(-code).name
        hint = {"SIGKILL": " (out of memory?)", "SIGSEGV": " (a crash in compiled code)"}
        return f"its process was ended by {name}{self._last_line() or hint.get(name, '')}"

    def end(self) -> str:
        """End the process and its children, gently if there is time; return the line it was in.

        It is the last line of the user's own code, "own.py:12: x = 1 / 0", or empty.
        """
        try:
            with suppress(subprocess.TimeoutExpired):
                if self._grace:
                    self._process.terminate()
                    self._process.wait(self._grace)
        finally:
            self.kill()
        self._thread.join(_LAST_WORDS)
        while (message := self.hear()) is not None:
            self.unloaded -= message[0] is Kind.READY  # nobody has heard it yet
            if message[0] is Kind.ERROR and self.loaded:
                return str(pickle.loads(message[1]))
        return ""

    def dismiss(self) -> None:
        """Tell the process that there is nothing more to run, so that it ends."""
        assert self._process.stdin is not None
        with suppress(OSError):
            self._process.stdin.close()

    def leave(self) -> None:
        """End the process while nothing runs; the user's code can clean up at exit."""
        try:
            with suppress(subprocess.TimeoutExpired):
                self.dismiss()
                self._process.wait(GRACE)
        finally:
            self.kill()

    def kill(self) -> None:
        """End the process at once; in a fork of its owner, do nothing."""
        if self.owner != os.getpid():
            return
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)
        else:
            self._process.kill()
        self._process.wait()
        for left in Path(tempfile.gettempdir()).glob(f"prefcal-*-{self._mark}-*"):
            shutil.rmtree(left, ignore_errors=True)
        if self._said is not None:
            self._said.close()

    def _send(self, kind: Kind, content: bytes) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it is gone: `hear` will say so
            send(self._process.stdin, kind, content)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with suppress(OSError), self._process.stdout as pipe:
            try:
                while (message := receive(pipe)) is not None:
                    self._inbox.put(message)
                    self._bell.set()
            except ValueError:  # a result could not be told from what the code wrote
                self._damaged = True
        self.dismiss()  # however it ended: a session of hundreds of workers keeps no pipe open
        self._silent = True
        self._bell.set()

    def _last_line(self) -> str:
        """Return the last line that a quiet process printed, in brackets."""
        if self._said is None:
            return ""
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").replace("\0", "").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f" ({last[-300:]})" if last else ""


# --- Run requests in a process that may die, hang or be stopped, and that is replaced then.

ATTEMPTS = 2  # number of processes that a request may cost: the first may have been killed from outside
_UNLOADED = 3  # number of processes that may die in a row without loading the work
_PERIOD = 0.05  # seconds after which results are sent, if no request has a time limit
_AHEAD = 0.1  # seconds of work that a process has at hand
_AT_HAND, _SHORT = 2, 1.0
"""Number of requests that a process has at hand, so that it never waits, and their longest time:
after a longer one, it gets one at a time, which nobody else could run meanwhile."""
_LOADING = 120.0  # minimum time limit in seconds for loading the work, however short its requests are
_LONG = 5.0  # seconds after which a request that was ended counts as hanging
LOOK = 0.2  # longest wait in seconds: after it, the process is looked at

Found = tuple[int, Any]  # number of a request, and its result, or the RunError that says why it has none


@dataclass(slots=True)
class _Item:
    """A request: its number, its content, and how many processes it may have cost."""

    number: int
    content: bytes
    cost: int = 0


@final
class Worker:
    """Requests, one after the other, and the process that runs them.

    `run` may be called from any thread, one at a time, and returns one result; `give` and `poll`
    are for a pool, which never waits. `start`, `reserve`, `stop`, `close` and what is read can be
    called meanwhile. After a request was ended or its process died, there is no process until
    `start`, or the next request.

    Args:
        work: Function that returns, for each process that is started, the pickled function and its
            arguments that return the function of each request.
        limit: Time limit of a request in seconds; infinite for none. It starts once the work is
            loaded.
        bell: Event that is set when there is something to `poll`.

    Attributes:
        hangs: Whether the last `run` had to be ended, so that the next one may hang, too.
        pace: Seconds that a request took in the latest message; infinite before the first.
    """

    def __init__(
        self, work: Callable[[], bytes], limit: float, terms: Terms, bell: threading.Event | None = None
    ) -> None:
        self._work, self.limit, self._terms = work, limit, terms
        self._bell = bell or threading.Event()
        self._running = threading.Lock()  # held during `run`
        self._lock = threading.Lock()  # of what follows; never held for long
        self._process: Process | None = None
        self._name: Hashable | None = None
        self._due, self._why, self._closed = np.inf, "late", False
        self._given: deque[_Item] = deque()
        self._again: deque[_Item] = deque()  # what a process that ended has not answered
        self._room, self._unloaded, self._since = 1, 0, 0.0
        self._in_groups = False
        self.pace, self.hangs = np.inf, False

    @property
    def pid(self) -> int | None:
        """Return the id of the process; None while there is none."""
        return None if self._process is None else self._process.pid

    @property
    def loaded(self) -> bool:
        """Return whether there is a process that has loaded the work."""
        return self._process is not None and self._process.loaded

    def busy_with(self, name: Hashable) -> bool | None:
        """Return whether what is running has this name; None if nothing is running."""
        running = self._name
        return None if running is None else running == name

    def start(self) -> None:
        """Start the process if there is none, so that it loads the work meanwhile."""
        with self._lock:
            if self._process is not None and self._process.owner != os.getpid():
                self._process = None  # this is a fork: the process belongs to the parent
            if self._process is None and not self._closed:
                # With a time limit each result is sent at once: so the first one is the late one.
                self._in_groups = self.limit == np.inf
                period = _PERIOD if self._in_groups else 0.0
                self._since = time.monotonic()
                self._process = Process(self._work(), period, self._terms, self._bell)

    def renew(self) -> None:
        """Load what the function of the work returns now, in the same process; nothing may run."""
        with self._lock:
            self._room, self.pace, self._since = 1, np.inf, time.monotonic()
            if self._process is not None:
                self._process.load(self._work())

    def reserve(self, name: Hashable) -> None:
        """Announce what runs next: from now on `busy_with` says so, and `stop` stops it."""
        with self._lock:
            self._name, self._why, self._due = name, "late", np.inf

    def stop(self, why: str, within: float = 0.0) -> None:
        """End what is running in `within` seconds: "stopped" by a person, or "given up"."""
        with self._lock:
            due = time.monotonic() + within
            if self._name is not None and due < self._due:
                self._due, self._why = due, why
                self._bell.set()

    def run(self, request: Any, name: Hashable = "", begin: Callable[[], None] = lambda: None) -> Any:
        """Run a request, and return its result.

        Args:
            name: What `busy_with` and `stop` know it by.
            begin: Function that is called once it is this request's turn, and may raise instead.

        Raises:
            RunError: If it has none; the message says why.
        """
        with self._running:
            if not self.busy_with(name):
                self.reserve(name)
            try:
                begin()
            except BaseException:
                self._name = None
                raise
            begun, found = time.monotonic(), list[Found]()
            try:
                self.give([(0, request)])
                while not found:
                    self._bell.wait(min(max(self.left, 0.0), LOOK))
                    self._bell.clear()
                    found = self.poll()
            except BaseException:  # Ctrl-C, too: its answer would be taken for the next one's
                self._end()
                raise
            finally:
                ended = not found or (isinstance(found[0][1], RunError) and not self.loaded)
                self.hangs = ended and time.monotonic() - begun > _LONG
                with self._lock:
                    self._name = None
        result = found[0][1]
        if isinstance(result, RunError):
            # A new one: in a cycle with this frame, `result` would keep whatever called this.
            raise RunError(str(result), result.why, result.trace)
        return result

    @property
    def room(self) -> int:
        """Number of requests that it can be given now; what runs again runs alone."""
        if self._again or any(item.cost for item in self._given):
            return 0
        at_hand = _AT_HAND if self.pace < _SHORT else 1
        return max(max(self._room, at_hand) - len(self._given), 0)

    @property
    def given(self) -> int:
        """Number of requests that it has not answered."""
        return len(self._given) + len(self._again)

    def give(self, requests: Sequence[tuple[int, Any]]) -> None:
        """Run requests with these numbers; `poll` returns the results.

        Raises:
            RunError: If it is closed.
        """
        self._send([_Item(number, pickle.dumps(request)) for number, request in requests])

    def poll(self) -> list[Found]:
        """Return what has arrived, in any order.

        Raises:
            RunError: If the work cannot be loaded.
        """
        process, found = self._process, list[Found]()
        if process is None:
            return found
        while (message := process.hear()) is not None:
            self._since = time.monotonic()
            found += self._read(process, message)
        if process.gone:
            found += self._died(process)
        elif self.left <= 0:
            found += self._late(process)
        if self._again and not self._given:
            self._send([self._again.popleft()])
        return found

    @property
    def left(self) -> float:
        """Seconds until what runs, or loading the work, is too late; infinite if nothing runs."""
        if self.loaded and not self._given:
            return np.inf
        limit = self.limit if self.loaded else max(self.limit, _LOADING)
        return min(self._since + limit, self._due) - time.monotonic()

    def close(self, *, gently: bool = False) -> None:
        """End the process, perhaps so that its code can clean up; nothing can run afterwards."""
        self.stop("given up")
        with self._lock:
            self._closed, process = True, self._process
        if process is None:
            return
        try:
            if gently and self._running.acquire(timeout=2 * GRACE):
                self._running.release()
                process.leave()
        finally:
            process.kill()

    def dismiss(self) -> None:
        """Let the process end by itself, since nothing more will be asked."""
        if self._process is not None:
            self._process.dismiss()

    def release(self) -> None:
        """End the process gently while nothing runs; the next request gets a fresh one."""
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            process.leave()

    def _send(self, items: list[_Item]) -> None:
        self.start()
        process = self._process
        if process is None or self._closed:
            raise RunError("prefcal is closing", "given up")
        if not self._given and process.loaded:
            self._since = time.monotonic()
        self._given.extend(items)
        process.ask([item.content for item in items])

    def _read(self, process: Process, message: Message) -> list[Found]:
        kind, content = message
        if kind is Kind.ERROR:
            self._end()
            raise pickle.loads(content)
        if kind is Kind.READY:
            process.unloaded, self._unloaded = process.unloaded - 1, 0
            return []
        results, seconds = pickle.loads(content)
        self.pace = seconds / len(results)
        if self._in_groups:
            self._room = max(int(_AHEAD * len(results) / max(seconds, 1e-6)), 1)
        return [(self._given.popleft().number, pickle.loads(result)) for result in results]

    def _died(self, process: Process) -> list[Found]:
        """Replace a process that has ended: what may have ended it runs again, and alone."""
        words, items = process.ended(), list(self._given)
        self._end()
        most = ATTEMPTS if self._terms.again else 1
        if not process.loaded:
            self._unloaded += 1
            if self._unloaded >= (_UNLOADED if self._terms.again else 1):
                raise RunError(f"{self._terms.what} crashed while it was loaded: {words}", "died")
        else:
            for item in items if self._in_groups else items[:1]:
                item.cost += 1
        self._again.extend(item for item in items if item.cost < most)
        alone = ", and again when it ran alone" if self._terms.again else ""
        error = RunError(f"{self._terms.what} crashed{alone}: {words}", "died")
        return [(item.number, error) for item in items if item.cost >= most]

    def _late(self, process: Process) -> list[Found]:
        """End a request that takes too long, or that was stopped."""
        items, took = list(self._given), time.monotonic() - self._since
        why = self._why if time.monotonic() >= self._due else "late"
        line = self._end()
        if not process.loaded and why == "late":
            raise RunError("loading takes too long", "late")
        words = self._words(why, in_time(max(round(took), 1)))
        words = f"{words}. It was in {line}" if line else words
        self._again.extend(items[1:])
        return [(items[0].number, RunError(words, why))]

    def _words(self, why: str, after: str) -> str:
        what, allows = self._terms.what, self._terms.allows
        if why == "late":
            hint = f" ({allows} allows more)" if allows else ""
            return f"{what} took longer than {in_time(self.limit)} and was ended{hint}"
        if why == "stopped":
            return f"you stopped {what} after {after}"
        return f"{what} was ended after {after}: its result was no longer needed"

    def _end(self) -> str:
        """End the process and what it runs; return the user's line it was in."""
        with self._lock:
            process, self._process = self._process, None
        self._given.clear()
        return "" if process is None else process.end()


def in_time(seconds: float) -> str:
    """Return a time in words: "90 s", "10 min", "1 h"."""
    for size, unit in ((3600, "h"), (60, "min")):
        if seconds >= size and seconds % size == 0:
            return f"{seconds / size:g} {unit}"
    return f"{seconds:g} s"


# --- Several workers with one queue: requests run as they come, whatever happens to some of them.

_KNOWN = 5  # number of messages after which the time of a request is known
_UNKNOWN = 60.0  # time limit of a gentle request in seconds until then
_SHORTEST, _TIMES = 5.0, 10.0
"""Time limit afterwards: this many seconds, or this many times the median if that is more."""

Arrived = tuple[int, Any, Any]  # number, request and result, which is a RunError if there is none


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@final
class Pool:
    """Workers that run requests as they come. All methods but `wake` are for one thread.

    Args:
        work: Function that returns the pickled work, as for a `Worker`; it is called once.
        jobs: Number of workers, 1 or more.
        longest: Largest time limit of a request in seconds; infinite for none.
        read: Function of request and result that returns what `collect` returns.
        unloadable: Function that returns what to raise if no process can load the work.
    """

    def __init__(
        self,
        work: Callable[[], bytes],
        jobs: int,
        longest: float,
        terms: Terms,
        *,
        read: Callable[[Any, Any], Any] = lambda request, result: result,
        unloadable: Callable[[RunError], Exception] = lambda error: error,
    ) -> None:
        self._work, self._longest, self._terms = work, longest, terms
        self._read, self._unloadable = read, unloadable
        self._bell = threading.Event()
        self._content: bytes | None = None
        self._workers = self._more(jobs)
        self._spare = list[Worker]()  # those that a renewed pool leaves idle
        self._requests: dict[int, Any] = {}  # waiting or running
        self._waiting: deque[int] = deque()
        self._seconds: deque[float] = deque(maxlen=100)
        self._count, self._closed = 0, False

    @property
    def loaded(self) -> bool:
        """Return whether a worker has loaded the work, so that requests run elsewhere."""
        return any(worker.loaded for worker in self._workers)

    @property
    def limit(self) -> float:
        """Return the time limit of a request in seconds."""
        if not self._terms.gentle:
            return self._longest
        usual = _UNKNOWN
        if len(self._seconds) >= _KNOWN:
            usual = max(_SHORTEST, _TIMES * median(self._seconds))
        return min(usual, self._longest)

    @property
    def room(self) -> int:
        """Return how many more requests the workers can be given now, or when one is ready."""
        room = sum(worker.room for worker in self._workers if worker.loaded)
        return max((room or len(self._workers)) - len(self._waiting), 0)

    def start(self) -> None:
        """Start the workers that are missing, so that they load the work meanwhile."""
        for worker in () if self._closed else self._workers:
            if worker.pid is None:
                worker.limit = self.limit
                worker.start()

    def renew(self, work: Callable[[], bytes], jobs: int) -> None:
        """Once all requests are answered, run other work in the same processes, and in new ones if needed."""
        self._work, self._content, self._count = work, None, 0
        self._seconds.clear()
        workers = [*self._workers, *self._spare]
        workers += self._more(jobs - len(workers))
        self._workers, self._spare = workers[:jobs], workers[jobs:]
        for worker in self._workers:
            worker.renew()

    def give(self, requests: Sequence[Any]) -> None:
        """Add requests to those that wait; they are numbered from 0 on."""
        for request in requests:
            self._requests[self._count] = request
            self._waiting.append(self._count)
            self._count += 1

    def take_back(self) -> Any | None:
        """Return a request that waits, which the caller runs; None if there is none."""
        return self._requests.pop(self._waiting.pop()) if self._waiting else None

    def drop(self) -> None:
        """Forget what waits; what runs goes on, and `collect` returns its results."""
        while self.take_back() is not None:
            pass

    def collect(self, *, patient: bool) -> list[Arrived]:
        """Hand out what waits, and return what has arrived, in any order.

        Args:
            patient: Whether to wait for something to arrive, for a moment.

        Raises:
            RunError: If no worker can load the work, or what `unloadable` returns.
        """
        if self._closed:
            return []
        self.start()
        self._hand_out()
        if patient:
            left = min(worker.left for worker in self._workers)
            self._bell.wait(min(max(left, 0.0), LOOK))
        self._bell.clear()
        try:
            return [arrived for worker in self._workers for arrived in self._heard(worker)]
        except RunError as error:
            if self._closed:
                return []
            raise self._unloadable(error) from error

    def wake(self) -> None:
        """Let `collect` return at once."""
        self._bell.set()

    def close(self, *, gently: bool = False) -> None:
        """End all workers, perhaps so that their code can clean up; nothing can run afterwards."""
        self._closed, workers = True, [*self._workers, *self._spare]
        for worker in workers if gently else ():  # all end at the same time
            worker.dismiss()
        for worker in workers:
            worker.close(gently=gently)

    def _more(self, count: int) -> list[Worker]:
        return [Worker(self._packed, self._longest, self._terms, self._bell) for _ in range(count)]

    def _packed(self) -> bytes:
        if self._content is None:
            self._content = self._work()
        return self._content

    def _hand_out(self) -> None:
        # Until a worker is ready, its share is better left to others.
        limit, ready = self.limit, [worker for worker in self._workers if worker.loaded]
        for most in (1, np.inf):  # the first one for everybody, then the next ones
            for worker in ready:
                worker.limit = limit
                room = min(worker.room, max(most - worker.given, 0), len(self._waiting))
                if numbers := [self._waiting.popleft() for _ in range(int(room))]:
                    worker.give([(number, self._requests[number]) for number in numbers])

    def _heard(self, worker: Worker) -> list[Arrived]:
        found = worker.poll()
        if found and worker.loaded:
            self._seconds.append(worker.pace)
        requests = [(number, self._requests.pop(number), result) for number, result in found]
        return [(number, request, self._read(request, r)) for number, request, r in requests]


def run_all(
    pool: Pool, requests: Iterable[Any], ahead: float = np.inf, *, keep: bool = False
) -> Generator[list[tuple[int, Any]], None, None]:
    """Run all requests, and yield numbers and results as they arrive; then close the pool.

    Closing the generator ends what runs.

    Args:
        pool: Pool that has run nothing yet, or nothing since it was renewed.
        requests: Requests, numbered from 0 on; read only as far as needed.
        ahead: Largest number of results that may have arrived before an earlier one.
        keep: Whether the pool stays open if all requests are answered.
    """
    source, waiting, given, close = iter(requests), set[int](), 0, True
    try:
        while True:
            allowed = min(pool.room, ahead + min(waiting, default=given) - given)
            new = list(islice(source, int(max(allowed, 0))))
            pool.give(new)
            waiting.update(range(given, given + len(new)))
            given += len(new)
            if not waiting:
                break
            if arrived := pool.collect(patient=True):
                waiting.difference_update(number for number, _, _ in arrived)
                yield [(number, result) for number, _, result in arrived]
        close = not keep
        if close:
            pool.close(gently=True)
    finally:
        if close:
            pool.close()
