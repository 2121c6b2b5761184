"""Tasks for the engine: what a worker can do, and what can happen to it."""

import os
import signal
import threading
import time
from pathlib import Path


def double(number):
    return 2 * number


def die(flag=None):
    """Take the process down; with a `flag`, only the first time."""
    if flag is None or not Path(flag).exists():
        if flag is not None:
            Path(flag).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def fail():
    raise OSError("the pump does not answer")


def interrupt(error=KeyboardInterrupt):
    raise error("the pump is stopped")


def leave():
    raise SystemExit(3)


def sleep(seconds, log=None):
    if log is not None:
        Path(log).write_text(str(os.getpid()))
    time.sleep(seconds)
    if log is not None:
        Path(log).write_text("slept")
    return os.getpid()


def spin():
    while True:
        pass


def leave_a_thread(over):
    """Start a thread that makes the file `over` when it ends."""

    def last():
        time.sleep(120)
        Path(over).touch()

    threading.Thread(target=last).start()


def stutter():
    raise OSError("no file b\udce4r")


def shout():
    os.write(1, b"from a worker\n")


def vanish():
    """End the process with exit code 0, as a STOP in Fortran does."""
    os._exit(0)


def count_runs(log):
    with Path(log).open("a") as file:
        file.write("run\n")
    time.sleep(2)
    return "counted"


class OddError(Exception):
    """Cannot be made from its message alone, so that unpickling it fails."""

    def __init__(self, what, bar):
        super().__init__(f"{what}, {bar} bar")


def fail_oddly():
    raise OddError("the pump", 3)


def refuse(*_):
    os._exit(1)
