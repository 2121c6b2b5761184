"""What can happen to a worker: each request is a task that does it. Other processes import this."""

import ctypes
import os
import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path


def do(request):
    """Do what the request says: a name here, and perhaps an argument."""
    name, *arguments = request if isinstance(request, tuple) else (request,)
    return globals()[name](*arguments)


def work():
    """The work of a worker."""
    return do


def unloadable(how):
    """Work that cannot be loaded."""
    return {"raises": fail, "dies": lambda: os._exit(4), "hangs": lambda: time.sleep(600)}[how]()


def double(number):
    return 2 * number


def die(flag=None):
    """Take the process down; with a `flag`, only the first time."""
    if flag is None or not Path(flag).exists():
        if flag is not None:
            Path(flag).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "alive"


def die_loudly():
    os.write(2, b"the level\nfrom a worker\n")
    die()


def fail():
    raise OSError("the pump does not answer")


def interrupt():
    raise KeyboardInterrupt("the pump is stopped")


def stop_generator():
    raise GeneratorExit("the pump is stopped")


def leave():
    sys.exit("bye")


def log_pid(log):
    Path(log).write_text(str(os.getpid()))
    time.sleep(60)


def spin():
    while True:
        pass


def hang():
    """As an endless compiled loop: the interpreter's lock is never given back."""
    libc = ctypes.PyDLL(None)
    while libc.usleep(1_000_000) <= 0:
        ctypes.pythonapi.PyErr_Clear()


def spin_tidily(flag):
    Path(flag).write_text("running")
    try:
        spin()
    finally:
        Path(flag).write_text("at rest")


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


def crash():
    ctypes.string_at(0)


def abort():
    os.abort()


def orphan():
    """Leave a child that holds every pipe open."""
    if os.fork():
        os._exit(3)
    spin()


def fork():
    """A fork that is forgotten: it returns, too."""
    os.fork()
    return "once"


def write_everywhere():
    """Into every file that is open, as code that closes and reuses descriptors may do."""
    for descriptor in range(3, 100):
        with suppress(OSError):
            os.write(descriptor, b"the level is 3 m, and the valve is open")


def count_runs(log):
    with Path(log).open("a") as file:
        file.write("run\n")
    time.sleep(2)
    return "counted"


def rest(seconds):
    time.sleep(seconds)
    return "rested"


def lock():
    return threading.Lock()  # which cannot be sent


def threads():
    return os.environ["OPENBLAS_NUM_THREADS"]


class OddError(Exception):
    """Cannot be made from its message alone, so that unpickling it fails."""

    def __init__(self, what, bar):
        super().__init__(f"{what}, {bar} bar")


def fail_oddly():
    raise OddError("the pump", 3)
