"""Own runs that never return, on the command line: Ctrl-C, kill, check, and the end."""

import signal
from pathlib import Path

import pytest

from support.browser import serve
from support.processes import finished, is_running, start, wait_until

WILD = Path(__file__).parents[2] / "support" / "wild_runs.py"
ENDLESS = """
import os, sys
from dataclasses import replace
from pathlib import Path
from prefcal_scenarios.catalog import load
toy = load({wild!r} + ":TOY")
def run(theta, seed=0):
    Path("running").write_text(str(os.getpid()))
    while True:
        try:
            while True:
                pass
        except BaseException:
            pass
plant = replace(toy, run=run)
"""


@pytest.fixture
def endless(tmp_path):
    """A folder with a scenario that does not even let itself be interrupted."""
    (tmp_path / "own.py").write_text(ENDLESS.format(wild=str(WILD)))
    return tmp_path


def pid_in(folder):
    """The process that runs own code, once it does."""
    flag = folder / "running"
    wait_until(lambda: flag.exists() and flag.read_text())
    return int(flag.read_text())


def test_ctrl_c_ends_the_page_and_leaves_no_process(endless):
    served = serve(endless, "own.py:plant")
    pid = pid_in(endless)
    served.stop()  # fails if it does not end
    assert not is_running(pid)


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks processes up in /proc")
def test_a_killed_prefcal_leaves_no_process(endless):
    served = serve(endless, "own.py:plant")
    pid = pid_in(endless)
    served.kill()
    wait_until(lambda: not is_running(pid))


def test_check_says_that_the_run_takes_too_long(endless):
    code, out, _ = finished(endless, "check", "own.py:plant", "--run-timeout", "1")
    assert code == 1
    assert "the run took longer than 1 s and was ended" in " ".join(out.split())


@pytest.mark.parametrize("handed_down", [signal.default_int_handler, signal.SIG_IGN])  # as "&" in a script
@pytest.mark.parametrize("command", [("calibrate", "--no-browser"), ("check",)])
def test_a_file_that_never_ends_loading_is_told_and_ctrl_c_ends_it_at_once(tmp_path, command, handed_down):
    path = tmp_path / "own.py"
    path.write_text("import time\nwhile True:\n    time.sleep(0.01)\n")
    before = signal.signal(signal.SIGINT, handed_down)
    process = start(tmp_path, *command, f"{path}:plant")
    signal.signal(signal.SIGINT, before)
    try:
        assert "loading own.py takes a while, it is in own.py:3" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)  # on a busy machine
    finally:
        process.kill()
    assert process.returncode == 130
