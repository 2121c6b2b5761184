"""Closed loops in FMUs: what a run gives, and what a run that hangs, crashes or fails gives."""

import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from prefcal_env import End, FMULoop, Knob
from prefcal_env.errors import KnobError, PlantError, RunError
from support.fmus import CRASHES, HANGS, NAN, RAISES, built

GAIN = Knob("K_p", 0.1, 100, scale="log10")
MODE = Knob("mode", 0, 4, integer=True)


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    return built(tmp_path_factory.mktemp("fmu"))


@pytest.fixture(scope="module")
def loop(tank):
    made = FMULoop(tank, [GAIN, MODE], ["level"], ["valve"], {"level": 2}, timeout=20)
    yield made
    made.close()


def simulated(K_p, T_i):
    """Level and valve of the tank, at 0, 0.1, ... 60 s."""
    level, valve, integral, rows = 1.0, 0.0, 0.0, [(1.0, 0.0)]
    for _ in range(600):
        error = 2.0 - level
        integral += error * 0.1 / T_i
        valve = min(max(K_p * (error + integral), 0.0), 10.0)
        level += 0.1 * (valve - level**0.5) / 5
        rows.append((level, valve))
    return np.array(rows)


def test_a_run_is_what_the_model_computes(loop):
    experiment = loop(np.array([3.0, 0]))
    expected = simulated(3.0, 10.0)
    assert experiment.end is End.TIME_UP
    assert loop.problem == ""
    np.testing.assert_allclose(experiment.t, np.arange(601) * 0.1, atol=1e-9)
    np.testing.assert_allclose(experiment.y[:, 0], expected[:, 0], rtol=1e-9)
    assert experiment.x.shape == (601, 0)
    assert experiment.channels.y[0].target == 2
    assert experiment.kpis["overshoot of level"] == pytest.approx(
        max(expected[:, 0].max() - 2, 0), abs=1e-9
    )


def test_the_same_theta_gives_the_same_run_whatever_ran_before(loop):
    first = loop(np.array([3.0, 0]))
    assert loop(np.array([9.0, 0])) != first
    assert loop(np.array([3.0, 0])) == first


def test_many_runs_take_one_process(loop):
    loop(np.array([3.0, 0]))
    pid = loop.pid
    for gain in np.geomspace(0.1, 100, 100):
        assert loop(np.array([gain, 0])).end is End.TIME_UP
    assert loop.pid == pid


def test_a_process_that_was_replaced_runs_on(tank, monkeypatch):
    monkeypatch.setattr("prefcal_env.fmu.process._RUNS", 2)
    loop = FMULoop(tank, [GAIN], ["level"])
    assert len({tuple(loop(np.array([3.0])).y[:, 0]) for _ in range(5)}) == 1
    loop.close()


def test_files_that_were_tidied_away_are_unpacked_again(tank, monkeypatch):
    monkeypatch.setattr("prefcal_env.fmu.process._RUNS", 1)
    loop = FMULoop(tank, [GAIN], ["level"])
    first = loop(np.array([3.0]))
    shutil.rmtree(loop._process._held.home)
    assert loop(np.array([3.0])) == first
    loop.close()


def test_a_crash_is_a_failed_experiment_and_the_next_run_goes_on(loop):
    experiment = loop(np.array([3.0, CRASHES]))
    assert experiment.end is End.FAILED
    assert "SIGABRT" in loop.problem
    assert loop(np.array([3.0, 0])).end is End.TIME_UP


def test_a_hang_is_a_failed_experiment_and_the_next_run_goes_on(tank):
    loop = FMULoop(tank, [GAIN, MODE], ["level"], timeout=2)
    loop(np.array([3.0, 0]))
    pid = loop.pid
    with pytest.raises(RunError, match="took longer than 2 s"):
        loop.attempt(np.array([3.0, HANGS]))
    assert not os.path.exists(f"/proc/{pid}")
    assert loop(np.array([3.0, HANGS])).end is End.FAILED
    assert loop(np.array([3.0, 0])).end is End.TIME_UP
    loop.close()


@pytest.mark.parametrize(("mode", "words"), [(RAISES, "the FMU"), (NAN, "infinite or NaN")])
def test_a_run_that_fails_on_its_way_is_unsafe_and_kept_up_to_there(loop, mode, words):
    experiment = loop(np.array([3.0, mode]))
    assert experiment.end is End.UNSAFE
    assert 4.9 < experiment.t[-1] < 5.3
    assert np.isfinite(experiment.y).all()
    assert words in loop.problem
    assert loop(np.array([3.0, 0])).end is End.TIME_UP


def test_a_pickled_loop_runs_the_same_in_a_process_of_its_own(loop):
    first = loop(np.array([3.0, 0]))
    copy = pickle.loads(pickle.dumps(loop))
    assert copy(np.array([3.0, 0])) == first
    assert copy.pid != loop.pid
    copy.close()


def test_closing_ends_the_process_and_removes_its_files(tank):
    loop = FMULoop(tank, [GAIN], ["level"])
    loop(np.array([3.0]))
    home, pid = loop._process._held.home, loop.pid
    assert home.exists()
    loop.close()
    assert not home.exists()
    assert not os.path.exists(f"/proc/{pid}")


@pytest.mark.parametrize("mode", [0, HANGS])
def test_the_process_and_its_files_outlive_no_prefcal_that_was_killed(tank, mode):
    code = (
        "import sys, numpy as np\nfrom prefcal_env import FMULoop, Knob\n"
        "loop = FMULoop(sys.argv[1], [Knob('mode', 0, 4, integer=True)], ['level'])\n"
        "loop(np.array([0.0]))\nprint(loop.pid, loop._process._held.home, flush=True)\n"
        "loop(np.array([float(sys.argv[2])]))\nsys.stdin.read()"
    )
    command = [sys.executable, "-c", code, str(tank), str(mode)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as one:
        pid, home = one.stdout.readline().split()
        one.kill()
    for _ in range(300):  # it takes a second; a busy machine takes more
        if not os.path.exists(home) and not alive(pid):
            break
        time.sleep(0.1)
    assert not os.path.exists(home)
    assert not alive(pid)


def alive(pid):
    """Return whether a process runs; one that nobody waits for is a zombie and does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_an_fmi_3_model_brings_its_units(tmp_path):
    fmu = built(tmp_path, 3)
    loop = FMULoop(fmu, [GAIN, Knob("T_i", 1, 60)], ["level"], ["valve"], {"level": 2}, 30)
    experiment = loop(np.array([3.0, 10.0]))
    loop.close()
    np.testing.assert_allclose(experiment.y[:, 0], simulated(3.0, 10.0)[:301, 0], rtol=1e-9)
    assert experiment.channels.y[0].unit == "m"
    assert [knob.unit for knob in loop.space] == ["", "s"]


def test_names_in_the_loop_may_differ_from_those_in_the_fmu(tank):
    loop = FMULoop(tank, {"K_p": Knob("gain", 1, 9)}, {"height": "level"}, stop_time=1)
    experiment = loop(np.array([3.0]))
    loop.close()
    assert loop.space.names == ("gain",)
    assert [c.name for c in experiment.channels.y] == ["height"]


def test_theta_outside_what_the_fmu_takes_is_refused(loop):
    for theta in ([3.0], [3.0, np.nan], [3.0, 0, 0]):
        with pytest.raises(KnobError, match="finite numbers"):
            loop(np.array(theta))


def test_an_fmu_that_is_gone_when_it_runs_is_refused(tank, tmp_path):
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(tank.read_bytes())
    loop = FMULoop(copy, [GAIN], ["level"])
    copy.unlink()
    with pytest.raises(PlantError, match=r"copy\.fmu"):
        loop(np.array([3.0]))
