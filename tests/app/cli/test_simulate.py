"""Many experiments are simulated unseen where they are quick, and none where they are not."""

import json
import os
import signal
from pathlib import Path

import pytest

from prefcal_app.cli.options import Options
from support import unseen as unseen_module
from support.processes import is_running, start, wait_until

UNSEEN = f"{unseen_module.__file__}:unseen"
UNATTENDED = ["--calibrator", "synthetic", "--json", "--out", "out"]


def chosen(simulated=True, **given):
    options = Options.of({"scenario": "x", **given}, 3, simulated=simulated)
    return options.agent, options.simulate, options.n_init, options.n_max


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, ("screening", 1000, 1, 11)),
        ({"simulate": 300}, ("screening", 300, 1, 11)),
        ({"n_max": 20}, ("screening", 1000, 1, 20)),
        ({"agent": "screening"}, ("screening", 1000, 1, 11)),
        ({"simulate": 0}, ("glisp", 0, 6, 50)),
        ({"agent": "glisp"}, ("glisp", 0, 6, 50)),
        ({"agent": "glisp", "simulate": 0}, ("glisp", 0, 6, 50)),
        ({"agent": "glisp-paper"}, ("glisp-paper", 0, 10, 50)),
        ({"agent": "random", "n_max": 8}, ("random", 0, 4, 8)),
    ],
)
def test_where_experiments_are_quick_most_are_simulated_unseen(given, expected):
    assert chosen(**given) == expected


def test_elsewhere_all_experiments_are_shown():
    assert chosen(simulated=False) == ("glisp", 0, 6, 50)
    assert chosen(simulated=False, agent="glisp-paper") == ("glisp-paper", 0, 10, 50)
    assert chosen(simulated=False, twin="model") == ("screening", 1000, 1, 11)


def test_a_terminal_is_told_at_once_what_is_loaded(prefcal, monkeypatch):
    words = ["calibrate", UNSEEN, *UNATTENDED, "--simulate", "9", "--n-max", "2"]
    assert "Loading" not in prefcal(*words)[2]
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert prefcal(*words)[2].startswith(f"Loading {UNSEEN} ...\n")


def test_an_unattended_study_says_how_many_it_simulated(prefcal, tmp_path):
    words = ["calibrate", UNSEEN, *UNATTENDED, "--simulate", "40", "--n-max", "4"]
    code, out, err = prefcal(*words, "--study", "mine")
    assert code == 0, err
    result = json.loads(out)
    assert result["agent"] == "screening"
    assert result["experiments"] == 4
    assert 4 < result["simulated"] <= 40
    assert "simulated, 4 shown" in err
    assert "simulated unseen" in (tmp_path / "out" / "report.html").read_text("utf-8")
    again = json.loads(prefcal(*words[:-2], "--n-max", "4", "--out", "again")[1])
    assert (again["best"], again["simulated"]) == (result["best"], result["simulated"])


def test_a_finished_study_goes_on_without_simulating_anything_twice(prefcal, done, monkeypatch):
    words = ["calibrate", UNSEEN, "--simulate", "40", "--study", "mine", *UNATTENDED]
    assert prefcal(*words, "--n-max", "12")[0] == 0
    monkeypatch.setattr("prefcal_env.workers.Pool.start", None)  # it would be called
    out = done(*words, "--n-max", "13")
    assert json.loads(out)["experiments"] == 13


def children(pid):
    """The processes that `pid` has started."""
    tasks = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for path in tasks for child in path.read_text().split()]


@pytest.mark.usefixtures("own_process")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_command(tmp_path, monkeypatch, how):
    line = f"calibrate {UNSEEN} --calibrator synthetic --simulate 100000 --out out"
    process = start(tmp_path, *line.split(), PREFCAL_TEST_SECONDS="0.01")
    try:
        wait_until(lambda: len(children(process.pid)) >= 2)  # experiments, and simulations
        workers = children(process.pid)
        os.kill(process.pid, how)
        _, err = process.communicate(timeout=30)
        assert "Traceback" not in err
        wait_until(lambda: not any(map(is_running, workers)), 10.0)
    finally:
        process.kill()
