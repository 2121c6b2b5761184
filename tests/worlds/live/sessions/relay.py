"""Stand between prefcal and an OPC UA server: cut the connection, and note what arrives."""

import asyncio
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from asyncua import Server, ua
from asyncua.common.callback import CallbackType

sys.path.insert(0, str(Path(__file__).parents[4] / "docs"))
import opcua_server

WRITTEN = ("Kp", "Ti", "Setpoint")


@dataclass(frozen=True)
class Write:
    """One write that the server accepted: when, in seconds, which node, and both values."""

    at: float
    name: str
    old: float
    new: float


@dataclass
class Watch:
    """What the server gets from outside, noted by the server itself as it arrives.

    Args:
        values: Present value of each node that may be written to.
        writes: Accepted writes in order.
        reads: Times at which all these nodes were read, in seconds.
    """

    values: dict[str, float] = field(default_factory=lambda: {n: opcua_server.NODES[n] for n in WRITTEN})
    writes: list[Write] = field(default_factory=list)
    reads: list[float] = field(default_factory=list)

    def written(self, event: Any, service: Any) -> None:
        """Note a request to write, of which the server says what it accepted."""
        if not event.is_external:
            return
        for node, code in zip(event.request_params.NodesToWrite, event.response_params, strict=True):
            name, new = node.NodeId.Identifier.removeprefix("Tank."), node.Value.Value.Value
            if code.is_good():
                self.writes.append(Write(time.monotonic(), name, self.values[name], new))
                self.values[name] = new

    def read(self, event: Any, service: Any) -> None:
        """Note a sample: a request to read values, not types."""
        nodes = event.request_params.NodesToRead
        sample = [n for n in nodes if n.AttributeId == ua.AttributeIds.Value]
        if event.is_external and len(sample) >= len(WRITTEN):
            self.reads.append(time.monotonic())

    def forget(self) -> None:
        """Forget what was noted, but not the values."""
        self.writes.clear()
        self.reads.clear()


@contextmanager
def watched_tank(port: int) -> Iterator[Watch]:
    """Serve the example tank of `docs/` at `port` inside the block, and note what it gets."""
    watch, plain = Watch(), opcua_server.Server

    def server() -> Server:
        made = plain()
        made.subscribe_server_callback(CallbackType.PostWrite, watch.written)
        made.subscribe_server_callback(CallbackType.PostRead, watch.read)
        return made

    opcua_server.Server = server
    try:
        with opcua_server.Tank(port).running():
            yield watch
    finally:
        opcua_server.Server = plain


@dataclass(frozen=True)
class Loss:
    """A loss of the connection: when it began and ended, in seconds."""

    began: float
    regained: float


class Relay:
    """A relay to `port` whose connections can be cut, and whose packets can be held back."""

    def __init__(self, port: int) -> None:
        self.port, self._to = 0, port
        self._cut, self._held, self._losses = False, "", 0
        self._open: list[Any] = []
        self._loop = asyncio.new_event_loop()
        self._ready, self._losing = threading.Event(), threading.Lock()

    def lose(self, seconds: float, held: float = 0.0, direction: str = "") -> Loss:
        """Drop all connections, and refuse new ones for some seconds.

        Args:
            seconds: Time without a connection.
            held: Time before that in which packets vanish, in seconds.
            direction: "requests", "answers" or "both", which vanish then.
        """
        with self._losing:  # a loss that ends must not end another one
            began = time.monotonic()
            self._held = direction
            time.sleep(held)
            self._cut, self._losses = True, self._losses + 1
            self._loop.call_soon_threadsafe(self._drop)
            time.sleep(seconds)
            self._held, self._cut = "", False
            return Loss(began, time.monotonic())

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
            self._loop.call_soon_threadsafe(self._drop)
            self._loop.call_soon_threadsafe(self._loop.call_later, 0.1, self._loop.stop)
            thread.join(10)

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._relay, "127.0.0.1", 0)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()

    async def _relay(self, reader: Any, writer: Any) -> None:
        if self._cut:
            writer.transport.abort()
            return
        before = self._losses
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._to)
        if self._losses != before:  # lost while it was being made
            writer.transport.abort()
            far_writer.transport.abort()
            return
        mine = [writer, far_writer]
        self._open += mine
        await asyncio.gather(
            self._pump(reader, far_writer, "requests"), self._pump(far_reader, writer, "answers")
        )
        self._open = [each for each in self._open if each not in mine]

    async def _pump(self, reader: Any, writer: Any, what: str) -> None:
        with suppress(OSError):
            while data := await reader.read(65536):
                if self._held not in (what, "both"):
                    writer.write(data)
                    await writer.drain()
        writer.close()

    def _drop(self) -> None:
        for each in self._open:
            each.transport.abort()
        self._open.clear()


def loss_at_random(rng: np.random.Generator, span: float) -> tuple[float, dict[str, Any]]:
    """Draw when a loss begins within `span` seconds, and the arguments of `Relay.lose`."""
    instant, how = float(rng.uniform(0.0, span)), {"seconds": float(rng.uniform(0.01, 0.25))}
    if rng.random() < 0.15:
        how["held"] = float(rng.uniform(0.02, 0.3))
        how["direction"] = str(rng.choice(["requests", "answers", "both"]))
    return instant, how
