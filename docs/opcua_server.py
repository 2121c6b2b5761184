"""A tank with a PI controller behind an OPC UA server, to try `prefcal` on: `docs/live.md`."""

import asyncio
import threading
from contextlib import contextmanager

from asyncua import Server, ua

NODES = {"Kp": 1.0, "Ti": 20.0, "Setpoint": 1.0, "Level": 1.0, "Valve": 50.0}
"""Nodes "ns=2;s=Tank.NAME" and their values at the beginning."""


class Tank:
    """A tank, 2 m high, that is simulated `speed` times as fast as real time."""

    def __init__(self, port=4840, speed=10.0, step=0.02):
        self.url, self.values = f"opc.tcp://127.0.0.1:{port}/tank", dict(NODES)
        self.speed, self.step = speed, step
        self._integral, self._stop = 50.0, threading.Event()

    def simulate(self, seconds):
        """Move on by `seconds`: 5 m³/s flow in with the valve open; the outlet drains the tank."""
        v = self.values
        error = v["Setpoint"] - v["Level"]
        wanted = 100 * v["Kp"] * error + self._integral
        v["Valve"] = min(max(wanted, 0.0), 100.0)
        if v["Valve"] == wanted:  # else the integral would wind up
            self._integral += seconds * 100 * v["Kp"] / max(v["Ti"], 0.1) * error
        v["Level"] += seconds * (v["Valve"] / 50 - v["Level"]) / 20

    async def serve(self, ready):
        """Serve until `close` is called."""
        server = Server()
        await server.init()
        server.set_endpoint(self.url)
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace("prefcal-example")
        folder = await server.nodes.objects.add_folder(space, "Tank")
        nodes = {}
        for name, value in NODES.items():
            address = ua.NodeId(f"Tank.{name}", space)
            nodes[name] = await folder.add_variable(address, name, value)
            await nodes[name].set_writable(name in ("Kp", "Ti", "Setpoint"))
        async with server:
            ready.set()
            while not self._stop.is_set():
                for name in ("Kp", "Ti", "Setpoint"):
                    self.values[name] = await nodes[name].read_value()
                self.simulate(self.step * self.speed)
                for name in ("Level", "Valve"):
                    await nodes[name].write_value(self.values[name])
                await asyncio.sleep(self.step)

    @contextmanager
    def running(self):
        """Serve from a thread inside the block."""
        ready = threading.Event()
        thread = threading.Thread(target=lambda: asyncio.run(self.serve(ready)), daemon=True)
        thread.start()
        if not ready.wait(30):
            raise RuntimeError(f"the example server did not start at {self.url}")
        try:
            yield self
        finally:
            self._stop.set()
            thread.join(10)


if __name__ == "__main__":
    tank = Tank()
    print(f"A tank at {tank.url}; end it with Ctrl-C")
    with tank.running():
        threading.Event().wait()
