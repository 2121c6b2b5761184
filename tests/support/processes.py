"""prefcal in a process of its own, and waiting for what it does."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

MAIN = "from prefcal_app.cli import main; main()"


def start(folder: Path, *words: str, **options: str) -> subprocess.Popen[str]:
    """Start `prefcal` with these words in `folder`; `options` are variables of its environment.

    It leads a group of processes, so that Ctrl-C can be sent to all of them, as a terminal does.
    """
    environment = {"PYTHONPATH": os.pathsep.join(sys.path), "COLUMNS": "120", **options}
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *words],
        cwd=folder,
        env=os.environ | environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def finished(folder: Path, *words: str) -> tuple[int, str, str]:
    """Run `prefcal` to its end: exit code, stdout and stderr."""
    process = start(folder, *words)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


def wait_until(done: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait until `done()` is true; fail if it hangs."""
    until = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < until, "it never came"
        time.sleep(0.02)


def is_running(pid: int) -> bool:
    """Whether there is such a process; a zombie that nobody waits for has ended."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
