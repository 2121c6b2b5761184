"""`prefcal new`: every starter runs as it is written."""

import json
import shlex
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prefcal_app.cli.starters.new import KINDS
from prefcal_env.live import Journal
from prefcal_scenarios.catalog import load

DOCS = Path(__file__).parents[3] / "docs"
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


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


@pytest.mark.parametrize("kind", [k for k in KINDS if k not in ("fmu", "opcua")])
def test_a_starter_passes_its_check_by_the_command_that_is_told(prefcal, done, kind):
    out = done("new", kind)
    check = next(line for line in out.splitlines() if line.startswith("Check it:"))
    out = done(*shlex.split(check.partition("prefcal ")[2]))
    tune = next(iter(KINDS[kind].source))
    assert f"prefcal calibrate {tune.replace('FILE', kind + KINDS[kind].suffix)}" in out


@pytest.mark.parametrize(
    ("kind", "cost"),
    [("function", "settling time of level"), ("controller", "overshoot of level"), ("pid", "M_s")],
)
def test_a_starter_is_tuned_unattended_by_a_kpi_as_the_refusal_advises(prefcal, done, refused, kind, cost):
    assert prefcal("new", kind)[0] == 0
    words = [w.replace("FILE", f"{kind}.py") for w in KINDS[kind].source]
    words += ["--calibrator", "synthetic", "--n-max", "3", "--simulate", "0"]
    assert "say what to go by: a KPI (--cost " in refused("calibrate", *words)
    out = done("calibrate", *words, "--cost", cost, "--out", "made", "--json")
    found = json.loads(out)
    assert found["experiments"] == 3
    assert found["cost"] >= 0


@pytest.mark.parametrize("kind", ["function", "pid", "controller", "mpc"])
def test_a_scenario_and_so_its_studies_are_called_as_the_file_is(prefcal, done, kind):
    out = done("new", kind, "folder/pump 2.py")
    check = next(line for line in out.splitlines() if line.startswith("Check it:"))
    told = shlex.split(check.partition("prefcal ")[2])
    if kind == "pid":
        assert load(f'pid {{"plant": "{told[-1]}"}}').name == "pid-pump-2"
    else:
        assert load(told[-1]).name == "pump-2"


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


@pytest.fixture
def live(done, tmp_path):
    """The starter of a live plant, at the port of the example server of the docs."""
    port = free_port()
    out = done("new", "opcua", "tank.toml")
    assert "Put the address of your server" in out
    text = (tmp_path / "tank.toml").read_text("utf-8")
    (tmp_path / "tank.toml").write_text(text.replace("127.0.0.1:4840", f"127.0.0.1:{port}"))
    return port


def test_the_starter_of_a_live_plant_runs_on_the_server_of_the_docs(prefcal, done, live, monkeypatch):
    pytest.importorskip("asyncua")
    monkeypatch.syspath_prepend(DOCS)
    from opcua_server import Tank

    with Tank(live, speed=60.0).running() as tank:
        out = done("check", "tank.toml")
        assert "reachable and has K_p = 1, T_i = 20 s, set-point = 1 m" in " ".join(out.split())
        assert "All in order" in out
        rig = replace(load("tank.toml").run, duration=1.0, period=0.1, journal=Journal(Path("old.json")))
        quick = tuple(replace(knob, rate=200.0) for knob in rig.knobs)
        start = tuple(replace(each, rate=10.0) for each in rig.start)
        rig = replace(rig, knobs=quick, start=start)
        driven = rig.drive(np.array([2.0, 10.0]), lambda changes: True)
        rig.plant.close()
        assert driven.why == ""
        assert driven.restored
        assert driven.experiment.y[-1, 0] > 1.2
        wrong = Path("tank.toml").read_text("utf-8").replace("s=Tank.Level", "s=Tank.Pressure")
        Path("tank.toml").write_text(wrong)
        code, out, _ = prefcal("check", "tank.toml")
        assert code == 1
        assert "has no node 'ns=2;s=Tank.Pressure'" in " ".join(out.split())
        assert tank.values["Kp"] == pytest.approx(1.0)


def test_the_check_of_a_live_plant_says_that_its_server_is_not_reachable(prefcal, live):
    pytest.importorskip("asyncua")
    code, out, _ = prefcal("check", "tank.toml", "--json")
    assert code == 1
    found = json.loads(out)
    assert not found["ok"]
    plant = next(each for each in found["checks"] if each["what"] == "plant")
    assert f"not reachable: no connection to opc.tcp://127.0.0.1:{live}/tank" in plant["words"]
    code, out, _ = prefcal("check", "tank.toml")
    assert code == 1
    assert "All in order" not in out
    assert "1 of 2 checks failed" in out


@pytest.mark.parametrize("kind", [kind for kind, row in KINDS.items() if row.suffix == ".py"])
def test_a_starter_is_at_most_30_lines(kind):
    lines = KINDS[kind].text(Path(kind)).splitlines()
    assert len(lines) <= 30
    assert max(map(len, lines)) <= 100


def test_a_file_is_never_replaced(refused, tmp_path):
    (tmp_path / "rig.toml").write_text("mine")
    assert "exists: give another name" in refused("new", "rig")
    assert (tmp_path / "rig.toml").read_text() == "mine"
