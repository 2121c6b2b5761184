"""A live rig over OPC UA, against a server in this process."""

import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from prefcal_env import End
from prefcal_env.errors import ConnectionLostError, LiveError
from prefcal_env.worlds.live import OPCUAPlant, live_rig

pytest.importorskip("asyncua")
DOCS = Path(__file__).parents[3] / "docs"


def description(url, folder):
    return {
        "url": url,
        "duration": 1.0,
        "period": 0.1,
        "timeout": 2.0,
        "journal": str(folder / "old.json"),
        "knobs": {
            "K_p": {"node": "ns=2;s=Tank.Kp", "low": 0.2, "high": 10, "rate": 20},
            "T_i": {"node": "ns=2;s=Tank.Ti", "low": 1, "high": 60, "rate": 200, "unit": "s"},
        },
        "outputs": {"level": {"node": "ns=2;s=Tank.Level", "unit": "m", "abort": [0, 2]}},
        "inputs": {"valve": {"node": "ns=2;s=Tank.Valve", "unit": "%"}},
        "references": {"level": {"node": "ns=2;s=Tank.Setpoint"}},
        "start": {
            "set-point": {
                "node": "ns=2;s=Tank.Setpoint",
                "value": 1.2,
                "low": 0.5,
                "high": 1.8,
                "rate": 10,
                "unit": "m",
            }
        },
    }


@pytest.fixture(scope="module")
def tank():
    sys.path.insert(0, str(DOCS))
    try:
        from opcua_server import Tank
    finally:
        sys.path.remove(str(DOCS))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with Tank(port).running() as tank:
        yield tank


def test_a_run_over_opc_ua_records_and_restores(tank, tmp_path):
    rig = live_rig(description(tank.url, tmp_path))
    driven = rig.drive(np.array([2.0, 10.0]), lambda changes: True)
    changes = rig.look(np.array([2.0, 10.0]))
    rig.plant.close()
    assert driven.why == ""
    assert driven.experiment.end is End.TIME_UP
    assert driven.experiment.y[-1, 0] > 1.0
    assert [change.old for change in changes] == pytest.approx([1.0, 20.0, 1.0])


def test_a_server_that_stalls_for_less_than_the_time_limit_is_not_lost(tank, monkeypatch):
    """The library's own watchdog gives up after 1 s, unless it is told otherwise."""
    plant, simulate, stalls = OPCUAPlant(tank.url, timeout=8.0), tank.simulate, threading.Event()
    plant.connect()

    def stall(seconds):
        if not stalls.is_set():
            stalls.set()
            time.sleep(2.5)
        simulate(seconds)

    monkeypatch.setattr(tank, "simulate", stall)
    assert stalls.wait(10)
    time.sleep(3.0)
    try:
        assert plant.read(["ns=2;s=Tank.Kp"]) == [1.0]
        assert plant.connected
    finally:
        plant.close()


def test_what_the_library_logs_is_not_printed(tank):
    """The server grants a shorter session than was asked for, which the library warns of."""
    words = "from prefcal_env.worlds.live import OPCUAPlant as P; p = P({!r}); p.connect(); p.close()"
    code = words.format(tank.url)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")


def test_a_node_that_does_not_exist_or_is_not_writable_is_named(tank, tmp_path):
    plant = OPCUAPlant(tank.url, timeout=2.0)
    plant.connect()
    with pytest.raises(LiveError, match=r"has no node 'ns=2;s=Tank\.Nothing'"):
        plant.read(["ns=2;s=Tank.Nothing"])
    with pytest.raises(LiveError, match="refuses"):
        plant.write("ns=2;s=Tank.Level", 1.0)
    assert plant.connected
    plant.close()


def test_a_mistyped_node_is_named_and_no_lost_connection(tank):
    plant = OPCUAPlant(tank.url, timeout=2.0)
    plant.connect()
    for wrong in ("Tank.Level", "ns=x;s=Tank.Level", "ns=2;Tank.Level"):
        for use in (lambda node: plant.read([node]), lambda node: plant.write(node, 1.0)):
            with pytest.raises(LiveError, match=f"looks like .*, got '{wrong}'") as caught:
                use(wrong)
            assert not isinstance(caught.value, ConnectionLostError)
    assert plant.connected
    plant.close()


def test_a_whole_number_node_gets_no_rounded_value_and_must_be_declared(tank, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules["opcua_server"].NODES, "Kp", 2)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with type(tank)(port).running() as other:
        rig = live_rig(description(other.url, tmp_path))
        driven = rig.drive(np.array([2.6, 10.0]), lambda changes: True)
        with pytest.raises(LiveError, match=r"cannot hold 2\.6: declare integer = true"):
            rig.plant.write("ns=2;s=Tank.Kp", 2.6)
        rig.plant.write("ns=2;s=Tank.Kp", 3.0)
        assert rig.plant.read(["ns=2;s=Tank.Kp"]) == [3.0]
        rig.plant.close()
    assert "'ns=2;s=Tank.Kp' of K_p holds whole numbers only" in driven.why
    assert not len(driven.experiment.t)


def test_a_server_that_is_not_there_is_a_lost_connection():
    plant = OPCUAPlant("opc.tcp://127.0.0.1:1", timeout=1.0)
    with pytest.raises(ConnectionLostError, match=r"no connection to opc\.tcp://127\.0\.0\.1:1"):
        plant.connect()
    plant.close()


def test_a_connection_that_is_closed_at_once_is_lost_at_once():
    with socket.create_server(("127.0.0.1", 0)) as tunnel:
        port, stop = tunnel.getsockname()[1], threading.Event()

        def close_all():
            while not stop.is_set():
                tunnel.accept()[0].close()

        threading.Thread(target=close_all, daemon=True).start()
        plant, began = OPCUAPlant(f"opc.tcp://127.0.0.1:{port}", timeout=20.0), time.monotonic()
        with pytest.raises(ConnectionLostError):
            plant.connect()
        stop.set()
        plant.close()
    assert time.monotonic() - began < 5
