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


def leave():
    raise SystemExit(3)


def sleep(seconds, log=None):
    if log is not None:
        Path(log).write_text(str(os.getpid()))
    time.sleep(seconds)
    return os.getpid()


def spin():
    while True:
        pass


def leave_a_thread():
    threading.Thread(target=time.sleep, args=(600,)).start()


def stutter():
    raise OSError("no file b\udce4r")


def shout():
    os.write(1, b"from a worker\n")
