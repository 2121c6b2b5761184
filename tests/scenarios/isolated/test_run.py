"""Runs of an own scenario in a process of their own: whatever the code does, the next one runs."""

import os
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from prefcal_env.errors import RunError, SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.key import theta_key
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.workers import in_time
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import IsolatedRun, isolation
from prefcal_scenarios.scenario import with_ranges
from toy_study import toy_scenario

WILD = str(Path(__file__).parents[2] / "support" / "wild_runs.py")
THETA = np.array([0.31, 26, 0.5])
SPINS, COMPILED, EXITS, SEGFAULT, FORKS, TIDY, LEAVES, RAISES, MEMORY, ABORTS, NOTHING = range(
    1, 12
)
TWICE, WRITES, INTERRUPTS, GENERATOR = range(12, 16)


@pytest.fixture(scope="module")
def wild():
    """The wild plant, with a second for each run."""
    source = f"{WILD}:plant"
    with isolation(source, 1.0) as isolated:
        yield isolated(load(source))


@pytest.mark.parametrize(
    ("seed", "why", "words"),
    [
        (SPINS, "late", r"longer than 1 s .*--run-timeout.* was in wild_runs.py:\d+: "),
        (COMPILED, "late", r"longer than 1 s"),
        (EXITS, "died", r"exit code 3"),
        (SEGFAULT, "died", r"SIGSEGV"),
        (FORKS, "died", r"exit code 3"),
        (ABORTS, "died", r"SIGABRT"),
        (LEAVES, "raised", r"run called exit: bye"),
        (RAISES, "raised", r"ZeroDivisionError: division by zero \(in wild_runs.py:\d+: "),
        (MEMORY, "raised", r"MemoryError"),
        (WRITES, "died", r"crashed: its code used a file that it had not opened"),
        (INTERRUPTS, "raised", r"run raised KeyboardInterrupt \(in wild_runs.py:\d+: raise error"),
        (GENERATOR, "raised", r"run raised GeneratorExit \(in wild_runs.py:\d+: "),
        (NOTHING, "raised", r"must return an Experiment, got NoneType: is a return missing"),
    ],
)
def test_whatever_a_run_does_is_told_and_the_next_one_runs(wild, seed, why, words):
    with pytest.raises(RunError, match=words) as raised:
        wild.run(THETA, seed=seed)
    assert raised.value.why == why
    theirs = why == "raised" and seed != NOTHING  # an error of prefcal says it all
    assert theirs == ("Traceback" in raised.value.trace)
    assert wild.run(THETA) == toy_scenario().run(THETA)


def test_a_run_that_forks_and_forgets_it_answers_once(wild):
    other = np.array([0.31, 27, 0.5])
    assert wild.run(THETA, seed=TWICE) == toy_scenario().run(THETA, seed=TWICE)
    assert wild.run(other) == toy_scenario().run(other)


def test_code_that_raises_keyboard_interrupt_keeps_its_process(wild):
    wild.run(THETA)
    before = wild.run.worker.pid
    with pytest.raises(RunError, match="KeyboardInterrupt"):
        wild.run(THETA, seed=INTERRUPTS)
    assert wild.run.worker.pid == before


def test_what_own_code_prints_is_no_result(capfd):
    with isolation(f"{WILD}:plant") as isolated:
        isolated(load(f"{WILD}:plant")).run(THETA)
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "own code is talking\n")


def test_a_run_is_stopped_from_another_thread_and_own_code_puts_its_plant_at_rest(
    tmp_path, monkeypatch
):
    flag = tmp_path / "flag"
    monkeypatch.setenv("PREFCAL_TEST_FLAG", str(flag))
    source = f"{WILD}:plant"
    with isolation(source) as isolated:
        plant = isolated(load(source))
        worker = plant.run.worker

        def stop():
            while not (flag.exists() and flag.read_text() == "running"):
                time.sleep(0.01)
            assert worker.busy_with(theta_key(THETA))
            worker.stop("stopped")

        thread = threading.Thread(target=stop)
        thread.start()
        with pytest.raises(RunError, match="you stopped the run after 1 s") as raised:
            plant.run(THETA, seed=TIDY)
        thread.join()
        assert raised.value.why == "stopped"
        assert worker.busy_with(theta_key(THETA)) is None
        assert plant.run(THETA) == toy_scenario().run(THETA)
    assert flag.read_text() == "left"  # it ended as a program does


def test_a_run_that_is_in_the_way_ends_a_little_later(wild):
    worker = wild.run.worker
    worker.reserve(theta_key(THETA))
    worker.stop("given up", within=0.1)
    with pytest.raises(RunError, match="no longer needed") as raised:
        wild.run(THETA, seed=SPINS)
    assert raised.value.why == "given up"


def test_a_worker_that_is_closed_runs_nothing_and_leaves_no_process():
    source = f"{WILD}:plant"
    with isolation(source) as isolated:
        plant = isolated(load(source))
        plant.run(THETA)
        pid = plant.run.worker.pid
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    with pytest.raises(RunError, match="closing"):
        plant.run(THETA)


def test_a_file_that_loads_only_here_is_told(tmp_path):
    path = tmp_path / "own.py"
    path.write_text(f"from prefcal_scenarios import load\ntoy = load({WILD!r} + ':TOY')\n")
    with isolation(f"{path}:toy", early=False) as isolated:
        scenario = isolated(load(f"{path}:toy"))
        path.write_text("raise OSError('no such port')\n")
        with pytest.raises(RunError, match="no such port"):
            scenario.run(THETA)


def test_a_run_that_checks_its_ranges_is_given_those_of_the_study():
    source = f"{WILD}:takes_space"
    with isolation(source) as isolated:
        scenario = isolated(load(source))
        assert scenario.run(THETA).kpis["largest"] == 0.0
        knobs = scenario.space.knobs
        wider = KnobSpace((Knob("T_s", 0.25, 9.0, "h"), *knobs[1:]), within={"T_s": (1.0, 2.0)})
        assert with_ranges(scenario, wider).run(THETA).kpis["largest"] == 9.0


def test_built_in_scenarios_and_rigs_stay_where_they_are():
    with isolation("cstr") as isolated:
        cstr = load("cstr")
        assert isolated(cstr) is cstr
    with isolation(f"{WILD}:plant", early=False) as isolated:
        assert isinstance(isolated(load(f"{WILD}:plant")).run, IsolatedRun)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_an_impossible_limit_is_refused(limit):
    with pytest.raises(SettingsError, match="--run-timeout"), isolation("cstr", limit):
        pass


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.5, "0.5 s"), (90, "90 s"), (600, "10 min"), (3600, "1 h")],
)
def test_a_time_in_words(seconds, words):
    assert in_time(seconds) == words
