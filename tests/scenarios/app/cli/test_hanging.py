"""Own runs that never return, on the command line: Ctrl-C, kill, check, and the end."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import httpx
import pytest

from support.browser import serve

WILD = Path(__file__).parents[3] / "support" / "wild_runs.py"
MAIN = "from prefcal_scenarios.app.cli import main; main()"
ENV = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "COLUMNS": "120"}
ENDLESS = """
import os, sys
from dataclasses import replace
from pathlib import Path
from prefcal_scenarios.scenario import load
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
    until = time.monotonic() + 20
    while not (flag.exists() and flag.read_text()):
        assert time.monotonic() < until
        time.sleep(0.02)
    return int(flag.read_text())


def is_there(pid):
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False


def test_ctrl_c_ends_the_page_and_leaves_no_process(endless):
    served = serve(endless, "own.py:plant")
    pid = pid_in(endless)
    served.stop()  # fails if it does not end
    assert not is_there(pid)


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks processes up in /proc")
def test_a_killed_prefcal_leaves_no_process(endless):
    served = serve(endless, "own.py:plant")
    pid = pid_in(endless)
    served.kill()
    until = time.monotonic() + 10
    while is_there(pid):
        assert time.monotonic() < until
        time.sleep(0.05)


def test_the_page_says_how_long_a_run_may_take_and_stops_it(endless):
    served = serve(endless, "own.py:plant", "--run-timeout", "600")
    try:
        pid_in(endless)
        with httpx.Client(follow_redirects=True, timeout=20) as client:
            page = client.get(served.link)
            origin = re.match(r"http://[^/]+", served.link).group()
            now = client.get(f"{origin}/api/now").json()
            assert (now["phase"], now["problem"]) == ("running", None)
            assert "stopped after 10 min (--run-timeout)" in now["stopping"]
            stop = {"index": now["pending"]["index"]}
            client.post(f"{origin}/api/stop_run", json=stop, headers={"Origin": origin})
            until = time.monotonic() + 10
            while (now := client.get(f"{origin}/api/now").json())["phase"] != "failed":
                assert time.monotonic() < until
                time.sleep(0.05)
            assert "you stopped the run after" in now["problem"]
            again = client.post(f"{origin}/api/stop_run", json=stop, headers={"Origin": origin})
            assert (page.status_code, again.status_code) == (200, 409)
    finally:
        served.stop()


def test_check_says_that_the_run_takes_too_long(endless):
    words = ["check", "own.py:plant", "--run-timeout", "1"]
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *words],
        cwd=endless, env=ENV, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    assert "the run took longer than 1 s and was ended" in " ".join(done.stdout.split())


def test_a_study_that_nobody_watches_ends_with_the_reason(endless):
    words = ["calibrate", "own.py:plant", "--calibrator", "synthetic", "--run-timeout", "0.3"]
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *words],
        cwd=endless, env=ENV, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 1
    assert "Experiment 1 failed: the run took longer than 0.3 s" in done.stderr
    assert "prefcal: the run took longer than 0.3 s and was ended" in done.stderr
    assert "Traceback" not in done.stderr
