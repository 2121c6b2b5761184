"""`prefcal new opcua`: the starter runs as it is written."""

import json
import socket
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from prefcal_env.worlds.live import Journal
from prefcal_scenarios.catalog import load

pytest.importorskip("asyncua")
DOCS = Path(__file__).parents[3] / "docs"


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as free:
        return free.getsockname()[1]


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
