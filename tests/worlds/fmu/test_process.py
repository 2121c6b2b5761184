"""An FMU as a scenario: folders of processes, reports, verification, the starter."""

import json
import os
import signal
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from prefcal_env import Knob
from prefcal_env.errors import PlantError, ScenarioError
from prefcal_env.worlds.fmu import read_model
from prefcal_env.worlds.fmu.loop import unpack
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.own import joined_source
from prefcal_scenarios.verification import replay, verify
from prefcal_scenarios.worlds.fmu import fmu_scenario
from worlds.fmu.building import built


@pytest.fixture
def there(tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def test_what_a_killed_process_left_is_removed_after_a_day(there, tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    names = {"old": f"{dead.pid}-a", "new": f"{dead.pid}-b", "alive": f"{os.getpid()}-c"}
    folders = {what: there / f"prefcal-fmu-{name}" for what, name in names.items()}
    folders["foreign"] = there / "prefcal-fmu-mine-d"
    for what, folder in folders.items():
        (folder / "fmu").mkdir(parents=True)
        if what != "new":
            os.utime(folder, (0, 0))
    with zipfile.ZipFile(tmp_path / "loop.fmu", "w") as content:
        content.writestr("modelDescription.xml", "<x/>")
    home = unpack(tmp_path / "loop.fmu")
    assert (home / "fmu" / "modelDescription.xml").read_text() == "<x/>"
    assert {what for what, folder in folders.items() if not folder.exists()} == {"old"}


def test_a_file_that_is_no_zip_leaves_nothing(there, tmp_path):
    (tmp_path / "loop.fmu").write_text("text")
    with pytest.raises(PlantError, match="cannot unpack the FMU"):
        unpack(tmp_path / "loop.fmu")
    assert list(there.iterdir()) == []


def test_the_report_of_an_fmu_is_written_from_another_folder_by_its_file_alone(
    prefcal, done, refused, tmp_path, monkeypatch
):
    pytest.importorskip("fmpy")
    pytest.importorskip("pythonfmu")
    fmu = built(tmp_path, "Tank")
    cost = ("--cost", "integrated error of level")
    line = f"calibrate {fmu.name} --knob K_p=0.1:100:log --reference level=2 --calibrator synthetic "
    line += "--simulate 0 --n-max 3 --study tank.prefcal --out out"
    out = done(*line.split(), *cost)
    assert "--knob K_p=0.1:100:log" in out  # and no emoji for ":100:"
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert "if you trust it, add --scenario Tank2.fmu" in refused("report", "../tank.prefcal", *cost)
    done("report", "../tank.prefcal", *cost, "--scenario", f"../{fmu.name}", "--out", "again")
    best, again = (
        json.loads((folder / "best.json").read_text()) for folder in (tmp_path / "out", elsewhere / "again")
    )
    assert again["theta"] == best["theta"]
    assert (elsewhere / "again" / "report.html").is_file()


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    pytest.importorskip("fmpy")
    pytest.importorskip("pythonfmu")
    return built(tmp_path_factory.mktemp("fmus"), "Tank")


def test_parameters_of_an_fmu_that_are_no_knobs_vary(tank):
    scenario = fmu_scenario(tank, knobs=[Knob("K_p", 0.1, 10.0)], show=["level"], reference={"level": 2})
    theta = np.array([2.0])
    found = verify(scenario, theta, 6, jobs=2)
    assert [(f.name, f.low, f.high) for f in found.factors] == [("T_i", 9.0, 11.0)]
    assert len({tuple(run.kpis.values()) for run in found.runs}) == 6
    assert found.runs == verify(scenario, theta, 6, jobs=1).runs
    assert "no margins" in found.tuning.margins
    assert found.kpis
    assert {kpi.name for kpi in found.kpis} <= set(found.tuning.nominal.kpis)
    nominal, low = (replay(scenario, theta, run) for run in (found.tuning.nominal, found.alone[0]))
    assert nominal.kpis == scenario.run(theta).kpis
    assert np.array_equal(low.theta, theta)
    other = fmu_scenario(
        tank, knobs=[Knob("K_p", 0.1, 10.0), Knob("T_i", 1.0, 60.0)], show=["level"], reference={"level": 2}
    )
    assert low.kpis == other.run(np.array([2.0, 9.0])).kpis


def test_an_fmu_whose_parameters_are_all_knobs_says_so(tank):
    scenario = fmu_scenario(tank, knobs=[Knob("K_p", 0.1, 10.0), Knob("T_i", 1.0, 60.0)], show=["level"])
    with pytest.raises(ScenarioError, match="no other real parameters"):
        verify(scenario, np.array([2.0, 10.0]))


FMU = """
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class Loop(Fmi2Slave):
    default_experiment = DefaultExperiment(start_time=0.0, stop_time=60.0, step_size=0.5)

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K_p, self.T_i, self.level, self.valve, self.sum = 10.0, 20.0, 1.0, 0.0, 0.0
        for name in ("K_p", "T_i"):
            self.register_variable(Real(name, causality=Fmi2Causality.parameter,
                                        variability=Fmi2Variability.tunable))
        for name in ("level", "valve"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, t, h):
        error = 2.0 - self.level
        self.sum += error * h / self.T_i
        self.valve = min(max(self.K_p * (error + self.sum), 0.0), 100.0)
        self.level += h * (0.004 * self.valve - 0.05 * self.level)
        return True
"""


def test_the_starter_of_an_fmu_runs_with_the_fmu_that_it_names(done, tmp_path):
    pytest.importorskip("fmpy")
    builder = pytest.importorskip("pythonfmu.builder")
    (tmp_path / "loop.py").write_text(FMU)
    builder.FmuBuilder.build_FMU(tmp_path / "loop.py", dest=tmp_path)
    (tmp_path / "Loop.fmu").rename(tmp_path / "loop.fmu")
    out = done("new", "fmu", "tank.toml")
    assert "Put the path of your FMU" in out
    out = done("check", "tank.toml")
    assert "settling time of level" in " ".join(out.split())


def zeros(path, size, said=None):
    """Write an FMU with a file of zeros of this size in bytes, whose headers perhaps say another one."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as content:
        content.writestr("modelDescription.xml", "<x/>")
        with content.open("resources/zeros", "w") as file:
            for _ in range(size // 1_000_000):
                file.write(bytes(1_000_000))
        if said is not None:
            content.infolist()[1].file_size = said
    return path


def test_a_bomb_is_refused_before_it_is_unpacked(there, tmp_path):
    pytest.importorskip("fmpy")
    path = zeros(tmp_path / "loop.fmu", 60_000_000)
    words = r"FMU 'loop.fmu' is not unpacked: its 0\.05\d+ MB would become 0\.06 GB; at most 2 GB, and "
    for look in (read_model, unpack):
        with pytest.raises(PlantError, match=words):
            look(path)
    with pytest.raises(PlantError, match="cannot unpack the FMU"):  # and not more than it said
        unpack(zeros(path, 60_000_000, said=1_000_000))
    assert list(there.iterdir()) == []


def test_many_empty_files_are_a_bomb_too(tmp_path, monkeypatch):
    monkeypatch.setattr("prefcal_env.worlds.fmu.model._HARMLESS", 4096 * 1000)
    monkeypatch.setattr("prefcal_env.worlds.fmu.model._RATIO", 10)
    with zipfile.ZipFile(tmp_path / "loop.fmu", "w") as content:
        for number in range(2000):
            content.writestr(f"{number}", "")
    with pytest.raises(PlantError, match=r"would become 0\.00819 GB"):
        unpack(tmp_path / "loop.fmu")


def test_an_fmu_of_the_usual_kind_is_unpacked(there, tmp_path):
    with zipfile.ZipFile(tmp_path / "loop.fmu", "w", zipfile.ZIP_DEFLATED) as content:
        content.writestr("resources/table.csv", "0.1,0.2\n" * 5_000_000)
        content.writestr("binaries/linux64/loop.so", os.urandom(1_000_000))
    assert (unpack(tmp_path / "loop.fmu") / "fmu" / "resources" / "table.csv").stat().st_size == 40_000_000


def test_a_worker_of_an_fmu_that_is_killed_leaves_no_folder(there, tank, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(there))
    scenario = joined_source(str(tank), {"knobs": {"K_p": {"low": 0.1, "high": 10}}})
    with isolation(scenario, 60.0) as isolated:
        source = isolated(fmu_scenario(tank, knobs=[Knob("K_p", 0.1, 10.0)])).source
        assert len(source.run(np.array([1.0])).t)
        assert len(list(there.iterdir())) == 1  # and the one of the simulation that was timed is gone
        os.kill(source._workers[0].pid, signal.SIGKILL)
    assert list(there.iterdir()) == []
