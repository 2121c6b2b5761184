"""Run random sessions over a real OPC UA server whose connection breaks during the run.

    python benchmarks/checks/outside/live_opcua.py --seconds 120

A relay between prefcal and the example server of `docs/` drops every connection at a random
instant, and refuses new ones for a random time. Checked: the old values are back on the server
after each run.
"""

import argparse
import asyncio
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.live import LiveRig, live_rig

sys.path.insert(0, str(Path(__file__).parents[3] / "docs"))
from opcua_server import Tank


class Broken(Exception):
    """The old values are not back."""


class Relay:
    """A relay to `port` whose connections can be cut."""

    def __init__(self, port: int) -> None:
        self.port, self.cut, self._to = 0, False, port
        self._open: list[Any] = []
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._relay, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()

    async def _relay(self, reader: Any, writer: Any) -> None:
        if self.cut:
            writer.close()
            return
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._to)
        self._open += [writer, far_writer]
        await asyncio.gather(_pump(reader, far_writer), _pump(far_reader, writer))

    def _drop(self) -> None:
        self.cut = True
        for each in self._open:
            each.transport.abort()
        self._open.clear()

    def lose(self, seconds: float) -> None:
        """Drop all connections, and refuse new ones for some seconds."""
        self._loop.call_soon_threadsafe(self._drop)
        time.sleep(seconds)
        self.cut = False

    @contextmanager
    def running(self) -> Iterator["Relay"]:
        """Relay from a thread inside the block."""
        self._loop.create_task(self._serve())
        thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        thread.start()
        self._ready.wait(10)
        try:
            yield self
        finally:
            self._loop.call_soon_threadsafe(self._loop.stop)
            thread.join(10)


async def _pump(reader: Any, writer: Any) -> None:
    with suppress(OSError):
        while data := await reader.read(65536):
            writer.write(data)
            await writer.drain()
    writer.close()


def rig_at(port: int, folder: Path) -> LiveRig:
    """Return a rig on the example server behind `port`."""
    node, setpoint = "ns=2;s=Tank.", "ns=2;s=Tank.Setpoint"
    start = {"node": setpoint, "value": 1.3, "low": 0.5, "high": 1.8, "rate": 20}
    return live_rig({
        "url": f"opc.tcp://127.0.0.1:{port}/tank", "duration": 0.8, "period": 0.05,
        "timeout": 1.0, "journal": str(folder / "old.json"),
        "knobs": {
            "K_p": {"node": f"{node}Kp", "low": 0.2, "high": 10, "rate": 40},
            "T_i": {"node": f"{node}Ti", "low": 1, "high": 60, "rate": 400, "unit": "s"},
        },
        "outputs": {"level": {"node": f"{node}Level", "unit": "m"}},
        "references": {"level": {"node": setpoint}},
        "start": {"set-point": start},
    })  # fmt: skip


def session(seed: int, tank: Tank, relay: Relay, folder: Path) -> str:
    """Run once, with one loss of the connection; return how it ended.

    Raises:
        Broken: If the server does not have its old values afterward.
    """
    rng, rig = np.random.default_rng(seed), rig_at(relay.port, folder)
    theta = np.array([rng.uniform(0.5, 3.0), rng.uniform(5.0, 40.0)])
    rig.look(theta)
    instant, length = rng.uniform(0.0, 1.2), rng.uniform(0.05, 0.6)

    def lose() -> None:
        time.sleep(instant)
        relay.lose(length)

    loser = threading.Thread(target=lose)
    loser.start()
    try:
        driven = rig.drive(theta, lambda changes: True)
    finally:
        loser.join()
        rig.plant.close()
    time.sleep(0.1)  # the server reads its nodes every 0.02 s
    values = [tank.values[name] for name in ("Kp", "Ti", "Setpoint")]
    if not (driven.restored and np.allclose(values, [1.0, 20.0, 1.0])):
        raise Broken(f"session {seed}: {values} after {driven.why!r}")
    return driven.why.split(":")[0] or "completed"


def run(seconds: float, most: int = 10**6) -> dict[str, int]:
    """Return how often sessions ended how, as many as `seconds` and `most` allow."""
    with closing(socket.create_server(("127.0.0.1", 0))) as free:
        port = free.getsockname()[1]
    ends: dict[str, int] = {}
    until = time.monotonic() + seconds
    with Tank(port).running() as tank, Relay(port).running() as relay:
        for seed in range(most):
            if time.monotonic() > until:
                break
            with tempfile.TemporaryDirectory() as folder:
                end = session(seed, tank, relay, Path(folder))
            ends[end] = ends.get(end, 0) + 1
    return ends


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=120.0)
    print(run(parser.parse_args().seconds))
