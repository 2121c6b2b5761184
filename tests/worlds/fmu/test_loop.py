import os
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest

from prefcal_env import End, FMULoop, Knob
from prefcal_env.errors import KnobError, PlantError, RunError
from worlds.fmu.building import built, changed

pytest.importorskip("fmpy")
pytest.importorskip("pythonfmu")
pytest.importorskip("pythonfmu3")

KNOBS = (Knob("K_p", 0.1, 10.0, scale="log10"), Knob("T_i", 1.0, 60.0))
GOOD, BAD = np.array([2.0, 10.0]), np.array([4.0, 10.0])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module")
def tank(folder):
    return built(folder, "Tank")


def loop(path, **options):
    return FMULoop(path, KNOBS, ["level"], ["valve"], {"level": 2.0}, **options)


def simulated(K_p, T_i, steps=200, h=0.1):
    """The same tank, here and by hand."""
    level, integral, rows = 1.0, 0.0, [(1.0, 0.0)]
    for _ in range(steps):
        error = 2.0 - level
        integral += error * h / T_i
        valve = K_p * (error + integral)
        level += h * (valve - abs(level) ** 0.5) / 5
        rows.append((level, valve))
    return np.array(rows).T


@pytest.mark.parametrize("version", [2, 3])
def test_a_run_is_what_the_equations_give(folder, version):
    made = loop(built(folder, "Tank", version))
    experiment = made(GOOD)
    level, valve = simulated(*GOOD)
    np.testing.assert_allclose(experiment.output(0), level, rtol=1e-12)
    np.testing.assert_allclose(experiment.u[:, 0], valve, rtol=1e-12)
    np.testing.assert_allclose(experiment.t, np.arange(201) * 0.1, atol=1e-12)
    assert experiment.end is End.TIME_UP
    assert not made.problem
    assert experiment.channels == made.channels
    assert experiment.channels.y[0].target == 2.0
    assert "integrated error of level" in experiment.kpis
    other = made(np.array([0.5, 20.0]))
    np.testing.assert_allclose(other.output(0), simulated(0.5, 20.0)[0], rtol=1e-12)
    assert made(GOOD, seed=7) == experiment


def test_units_come_from_the_fmu_and_a_wrong_one_is_refused(folder):
    path = built(folder, "Tank", 3)
    made = loop(path)
    assert [knob.unit for knob in made.space] == ["", "s"]
    assert made.channels.y[0].unit == "m"
    with pytest.raises(KnobError, match="unit must be 's' as in the FMU, or alike, got 'kg'"):
        FMULoop(path, [Knob("T_i", 1, 60, "kg")], ["level"])
    FMULoop(path, [Knob("T_i", 1, 60, "min")], ["level"]).close()


def test_a_reference_can_be_a_variable_and_names_can_be_chosen(tank):
    made = FMULoop(tank, {"K_p": Knob("gain", 0.1, 10.0)}, {"h": "level"}, {"u": "valve"}, {"h": "target"})
    experiment = made(np.array([2.0]))
    assert made.space.names == ("gain",)
    assert [c.name for c in (*made.channels.y, *made.channels.u)] == ["h", "u"]
    assert (experiment.y_ref == 2.0).all()


def test_stop_time_and_interval_change_what_is_recorded_and_not_the_simulation(tank):
    whole = loop(tank)(GOOD)
    part = loop(tank, stop_time=10.0, output_interval=0.5)(GOOD)
    np.testing.assert_allclose(part.t, np.arange(21) * 0.5, atol=1e-12)
    np.testing.assert_array_equal(part.output(0), whole.output(0)[:101:5])


def test_a_hanging_run_fails_in_time_and_the_next_one_runs(folder):
    made = loop(built(folder, "Hangs"), timeout=1.0)
    before, failed = made(GOOD), made(BAD)
    assert failed.end is End.FAILED
    assert not len(failed.t)
    assert failed.channels == before.channels
    assert made.problem == "the simulation took longer than 1 s and was ended (timeout allows more)"
    assert made(GOOD) == before


def test_a_crashing_run_fails_and_says_how(folder):
    made = loop(built(folder, "Crashes"))
    before, failed = made(GOOD), made(BAD)
    assert failed.end is End.FAILED
    assert "SIGABRT" in made.problem
    assert made(GOOD) == before
    with pytest.raises(
        RunError, match=r"the simulation crashed, and again when it ran alone: .*SIGABRT.*narrow the ranges"
    ):
        made.attempt(BAD)


@pytest.mark.parametrize(("name", "why"), [("Errs", "error after t = 5 s"), ("Diverges", "NaN")])
def test_a_run_that_stops_in_the_middle_is_an_unsafe_one_up_to_there(folder, name, why):
    made = loop(built(folder, name))
    stopped = made(BAD)
    assert stopped.end is End.UNSAFE
    assert why in made.problem
    assert stopped.t[-1] == pytest.approx(5.0)
    np.testing.assert_allclose(stopped.output(0), simulated(*BAD)[0][:51], rtol=1e-12)
    after = made(GOOD)
    assert after.end is End.TIME_UP
    np.testing.assert_allclose(after.output(0), simulated(*GOOD)[0], rtol=1e-12)


def test_an_error_in_the_first_step_leaves_the_first_instant(folder):
    made = loop(built(folder, "Starts"))
    stopped = made(BAD)
    assert stopped.end is End.UNSAFE
    assert len(stopped.t) == 1


def test_a_pickled_loop_runs_the_same_in_a_process_of_its_own(tank):
    made = loop(tank)
    copy = pickle.loads(pickle.dumps(made))
    assert copy(GOOD) == made(GOOD)
    assert copy.pid != made.pid
    assert os.getpid() not in (copy.pid, made.pid)


def test_the_process_and_its_files_are_gone_after_the_end(tank, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    made = loop(tank)
    made(GOOD)
    assert list(tmp_path.iterdir())
    pid = made.pid
    made.close()
    assert not list(tmp_path.iterdir())
    assert not Path(f"/proc/{pid}").exists()
    assert made(GOOD).end is End.TIME_UP  # it starts anew
    del made
    assert not list(tmp_path.iterdir())


def test_memory_stays_flat_over_many_runs(tank):
    made = loop(tank)
    thetas = np.random.default_rng(0).uniform([0.1, 1.0], [3.0, 60.0], (300, 2))
    used = []
    for number, theta in enumerate(thetas):
        made(theta)
        if number in (99, 299):
            used.append([resident(pid) for pid in (os.getpid(), made.pid)])
    assert np.all(np.array(used[1]) <= 1.05 * np.array(used[0]))


def resident(pid):
    """Memory of a process in kB."""
    statm = Path(f"/proc/{pid}/statm")
    if not statm.exists():
        pytest.skip("only Linux tells it in this way")
    return 4 * int(statm.read_text().split()[1])


def test_an_fmu_that_runs_only_once_in_a_process_gets_a_new_one_for_each_run(folder):
    once = loop(built(folder, "Once"))
    for _ in range(3):
        np.testing.assert_allclose(once(GOOD).y[:, 0], simulated(2.0, 10.0)[0], rtol=1e-12)


@pytest.mark.parametrize("forgets", [False, True])
def test_an_fmu_is_reset_only_if_that_gives_the_same_record(tank, tmp_path, forgets):
    module = pytest.importorskip("prefcal_env.worlds.fmu.simulation")
    with zipfile.ZipFile(tank) as content:
        content.extractall(tmp_path)
    instants, shown = np.arange(21) * 0.1, (("Real", 3), ("Real", 4))
    job = module.FMUJob(str(tmp_path), (("Real", 0), ("Real", 1)), shown, instants, 1, None)
    simulation, resets = module.FMUSimulation(job), []
    reset = simulation._fmu.reset

    def counted():
        resets.append(reset())
        if forgets:
            simulation._fmu.setReal([3], [1.5])

    simulation._fmu.reset = counted
    first = simulation.run([2.0, 10.0])
    np.testing.assert_allclose(first.values.T, simulated(2.0, 10.0, 20), rtol=1e-12)
    assert simulation.try_reset()
    for _ in range(3):
        np.testing.assert_array_equal(simulation.run([2.0, 10.0]).values, first.values)
    assert len(resets) == (1 if forgets else 4)
    simulation.close()


@pytest.mark.parametrize(
    ("knobs", "outputs", "options", "error", "words"),
    [
        ([Knob("Kp", 1, 2)], ["level"], {}, KnobError, "no parameter 'Kp'. Did you mean 'K_p'?"),
        ([Knob("level", 1, 2)], ["level"], {}, KnobError, "not a tunable or fixed parameter"),
        ([Knob("order", 1, 2)], ["level"], {}, KnobError, "needs integer=True"),
        ([], ["level"], {}, KnobError, "it can tune 'K_p', 'T_i', 'order'"),
        (KNOBS, ["levl"], {}, PlantError, "no numeric variable 'levl'. Did you mean 'level'?"),
        (KNOBS, "level", {}, PlantError, "must be a sequence of names"),
        (KNOBS, [], {}, PlantError, "outputs must name one or more"),
        (KNOBS, ["level"], {"inputs": ["level"]}, PlantError, "both an output and an input"),
        (KNOBS, ["level"], {"reference": {"valve": 1}}, PlantError, "not among the outputs"),
        (KNOBS, ["level"], {"reference": {"level": np.nan}}, PlantError, "finite number"),
        (KNOBS, ["level"], {"stop_time": 0.0}, PlantError, "above the start time 0 s"),
        (KNOBS, ["level"], {"output_interval": -1.0}, PlantError, "output_interval must be"),
        (KNOBS, ["level"], {"timeout": 0.0}, PlantError, "timeout must be above 0 s"),
    ],
)
def test_what_does_not_fit_the_fmu_is_refused_before_anything_runs(
    tank, knobs, outputs, options, error, words
):
    with pytest.raises(error) as found:
        FMULoop(tank, knobs, outputs, **options)
    assert words in str(found.value)
    assert "\n" not in str(found.value)


def test_files_that_cannot_be_used_are_refused_in_one_sentence(tank, folder):
    text = folder / "text.fmu"
    text.write_text("not an archive")
    coupled = [("<CoSimulation", "<ModelExchange"), ('fmiVersion="2.0"', 'fmiVersion="2.0"')]
    cases = {
        folder / "nowhere.fmu": "no FMU at",
        text: "is no FMU that can be read",
        changed(tank, folder / "me.fmu", replace=coupled): "no co-simulation interface",
        changed(tank, folder / "win.fmu", without="binaries/linux64"): "is built for win64",
        changed(tank, folder / "one.fmu", replace=[('fmiVersion="2.0"', 'fmiVersion="1.0"')]): "FMI",
    }
    for path, words in cases.items():
        with pytest.raises(PlantError, match=words) as found:
            loop(path)
        assert "\n" not in str(found.value)


def test_an_fmu_without_a_stop_time_needs_one(tank, folder):
    path = changed(tank, folder / "endless.fmu", replace=[(' stopTime="20.0"', "")])
    with pytest.raises(PlantError, match="declares no stop time"):
        loop(path)
    assert loop(path, stop_time=1.0)(GOOD).t[-1] == pytest.approx(1.0)


def test_a_theta_of_the_wrong_shape_is_refused(tank):
    with pytest.raises(KnobError, match="2 finite numbers"):
        loop(tank)(np.array([1.0]))


def test_a_loop_that_was_deleted_while_its_fmu_hung_leaves_nothing(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    made = loop(built(folder, "Hangs"), timeout=0.5)
    made(BAD)
    assert made.pid is None
    del made
    assert not list(tmp_path.iterdir())


def test_files_that_were_tidied_away_are_unpacked_again(tank, monkeypatch):
    monkeypatch.setattr("prefcal_env.worlds.fmu.loop._RUNS", 1)
    made = loop(tank)
    first = made(GOOD)
    shutil.rmtree(made._process._started.home)
    assert made(GOOD) == first
    made.close()


def test_ctrl_c_while_an_fmu_is_unpacked_leaves_no_files(tank, tmp_path, monkeypatch):
    made = loop(tank)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))

    def extract(content, folder):
        folder.mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr(zipfile.ZipFile, "extractall", extract)
    with pytest.raises(KeyboardInterrupt):
        made(GOOD)
    assert not list(tmp_path.iterdir())
