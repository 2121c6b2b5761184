"""Run random sessions on a simulated live plant and check what must never happen.

The tests of live plants `run` some hundreds of them.

In each session the connection is lost at random instants, the plant may lose or apply a write
whose answer is lost, values may be of bad quality, an output may cross its abort limit, a person
may stop the run, and prefcal may be killed and started again. Time is simulated. Checked, by the
plant itself and afterward:

- no write is outside the limits, or faster than the rate;
- the old values are back in the end, also after a kill;
- after a lost connection is regained, they are back within two samples and the time that the rates
  demand for the way.
"""

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import ceil, nan
from pathlib import Path

import numpy as np

from prefcal_env import Knob
from prefcal_env.errors import ConnectionLostError
from prefcal_env.worlds.live import Driven, Journal, LiveKnob, LiveRig, LiveStart, Tag


class Killed(BaseException):
    """The process is killed: nothing after it runs."""


class Broken(Exception):
    """An invariant is violated."""


@dataclass
class World:
    """A tank with a PI controller, its connection and the clock, all simulated.

    Args:
        rng: Source of every random choice.
        written: Nodes that may be written to, by address.
        period: Sampling period in seconds.
        values: Value of each node.
        down: Intervals (from, until) in which the connection is lost, in seconds.
        killed_at: Time at which the process is killed; None for never.
    """

    rng: np.random.Generator
    written: dict[str, LiveKnob]
    period: float
    values: dict[str, float]
    down: tuple[tuple[float, float], ...] = ()
    killed_at: float | None = None
    address: str = "simulated"
    now: float = 0.0
    connected: bool = False
    writes: list[tuple[float, str, float, float]] = field(default_factory=list)
    noticed: set[int] = field(default_factory=set)
    level: float = 1.0
    integral: float = 1.0

    def clock(self) -> float:
        """Return the simulated time in seconds."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Let time pass, and the tank with it."""
        self._alive()
        self.now += seconds
        for _ in range(2):
            error = self.values["setpoint"] - self.level
            valve = min(max(self.values["K"] * error + self.integral, 0.0), 4.0)
            self.integral += seconds / 2 * 0.3 * error
            self.level += seconds / 2 * 0.5 * (valve - self.level)
        self.values["level"], self.values["valve"] = self.level, valve
        self._alive()

    def _alive(self) -> None:
        if self.killed_at is not None and self.now >= self.killed_at:
            raise Killed

    def lost(self) -> int | None:
        """Return which interval without a connection it is now; None if it stands."""
        for number, (start, end) in enumerate(self.down):
            if start <= self.now < end:
                return number
        return None

    def _reach(self) -> None:
        self._alive()
        number = self.lost()
        if number is not None or not self.connected:
            if number is not None and self.connected:
                self.noticed.add(number)
            self.connected = False
            raise ConnectionLostError("the connection is lost")

    def connect(self) -> None:
        """Connect."""
        self.connected = True
        self._reach()

    def read(self, nodes: Sequence[str]) -> list[float]:
        """Return the values of nodes, sometimes of bad quality."""
        self._reach()
        bad = self.rng.random(len(nodes)) < 0.02
        return [
            nan if b and n in ("level", "valve") else self.values[n] for n, b in zip(nodes, bad, strict=True)
        ]

    def write(self, node: str, value: float) -> None:
        """Take a value; sometimes its answer is lost."""
        number = self.lost()
        if number is None and self.rng.random() < 0.02:
            # Lost while writing: the value may have arrived.
            self.down += ((self.now, self.now + self.rng.uniform(0.1, 6) * self.period),)
            if self.rng.random() < 0.5:
                self._apply(node, value)
        self._reach()
        self._apply(node, value)

    def _apply(self, node: str, value: float) -> None:
        """Take a value, after checking it without any help of prefcal's."""
        part, before = self.written[node], self.values[node]
        last = max((t for t, n, _, _ in self.writes if n == node), default=-np.inf)
        allowed = part.rate * min(self.now - last, self.period)
        if part.knob.integer:
            allowed = max(allowed, 1.0 if part.rate * (self.now - last) >= 1 - 1e-9 else 0.0)
        if not part.knob.low <= value <= part.knob.high:
            raise Broken(f"{node} = {value} is outside [{part.knob.low}, {part.knob.high}]")
        if abs(value - before) > allowed * (1 + 1e-6):
            raise Broken(f"{node}: {before} to {value} is faster than {part.rate} per second")
        self.values[node] = value
        self.writes.append((self.now, node, before, value))

    def close(self) -> None:
        """Disconnect."""
        self.connected = False

    def at(self, node: str, when: float, first: float) -> float:
        """Return the value of a node at a time, from the writes."""
        value = first
        for t, name, _, new in self.writes:
            if name == node and t <= when:
                value = new
        return value


@dataclass(frozen=True)
class Session:
    """What one session is about."""

    world: World
    rig: LiveRig
    theta: np.ndarray
    stops_at: float
    confirms: bool


def drawn(seed: int, folder: Path) -> Session:
    """Draw a session: its rig, its plant, and when things go wrong."""
    rng = np.random.default_rng(seed)
    period = float(rng.choice([0.1, 0.5, 1.0]))
    knobs = [LiveKnob(Knob("K", 0.5, 5.0), "K", rng.uniform(0.3, 10) / period)]
    if rng.random() < 0.5:
        T = Knob("T", 1.0, 50.0, "s", scale="log10")
        knobs.append(LiveKnob(T, "T", rng.uniform(2, 100) / period))
    if rng.random() < 0.3:
        mode = Knob("mode", 0, 4, integer=True)
        knobs.append(LiveKnob(mode, "mode", float(rng.uniform(0.3, 3) / period)))
    start = LiveStart(Knob("set-point", 0.5, 3.0), "setpoint", rng.uniform(0.2, 3) / period, value=2.0)
    tags = [
        Tag("level", "level", abort=(0.0, rng.uniform(1.8, 4.0))),
        Tag("valve", "valve", "input"),
        Tag("level", "setpoint", "reference"),
    ]
    written = {p.node: p for p in (*knobs, start)}
    values = {"K": rng.uniform(0.5, 5), "T": 10.0, "mode": 2.0, "setpoint": 1.0, "level": 1.0, "valve": 1.0}
    duration = period * int(rng.integers(5, 25))
    span = duration + 15 * period
    down = tuple((t, t + rng.uniform(0.05, 8) * period) for t in rng.uniform(0, span, rng.integers(0, 4)))
    killed_at = rng.uniform(0, span) if rng.random() < 0.2 else None
    world = World(rng, written, period, values, down, killed_at)
    rig = LiveRig(
        world,
        tuple(knobs),
        tuple(tags),
        duration,
        period,
        (start,),
        ready={"level": (0.5, 1.5)} if rng.random() < 0.3 else {},
        ready_within=20 * period,
        done={"level": (1.9, 2.1)} if rng.random() < 0.3 else {},
        hold=2 * period,
        journal=Journal(folder / f"{seed}.json"),
    )
    theta = rig.space.decode(rng.random(len(knobs)))
    stops_at = rng.uniform(0, span) if rng.random() < 0.2 else np.inf
    return Session(world, rig, theta, stops_at, bool(rng.random() < 0.97))


def session(seed: int, folder: Path) -> str:
    """Run one session, and return how it went. Raises Broken if an invariant is violated."""
    found = drawn(seed, folder)
    world, rig = found.world, found.rig
    old = {node: world.values[node] for node in world.written}
    try:
        driven: Driven | None = rig.drive(
            found.theta,
            lambda changes: found.confirms,
            clock=world.clock,
            sleep=world.sleep,
            stop=lambda: world.now >= found.stops_at,
        )
    except Killed:
        driven = None
    _check_restored_soon(world, old, killed=world.killed_at if driven is None else None)
    if driven is None:
        world.killed_at, world.connected = None, False
        while rig.left is not None:
            world.sleep(world.rng.uniform(1, 100))
            rig.recover(clock=world.clock, sleep=world.sleep)
    for node, value in old.items():
        if not world.written[node].same(world.values[node], value):
            raise Broken(f"{node} is {world.values[node]} in the end, it was {value}")
    if rig.left is not None:
        raise Broken("the old values are still on the disk")
    if driven is None:
        return "killed"
    if not found.confirms and world.writes:
        raise Broken("something was written without a confirmation")
    return f"{driven.experiment.end.value}{', lost' if world.noticed else ''}"


def _check_restored_soon(world: World, old: dict[str, float], killed: float | None) -> None:
    """Check that the old values are back two samples after a lost connection is regained."""
    ends = [world.now] if killed is None else [killed]
    for number in world.noticed:
        _, regained = world.down[number]
        steps = 1
        for node, value in old.items():
            part, way = world.written[node], abs(world.at(node, regained, value) - value)
            step = part.rate * world.period
            step = max(float(int(step + 1e-9)), min(step, 1.0)) if part.knob.integer else step
            steps = max(steps, ceil(way / step - 1e-6))
        # The first of the steps is among the two samples.
        until = regained + (2 + steps - 1) * world.period + 1e-6
        again = any(
            start < until and end > regained for k, (start, end) in enumerate(world.down) if k != number
        )
        if again or (killed is not None and until > min(ends)):
            continue
        for node, value in old.items():
            if not world.written[node].same(world.at(node, until, value), value):
                raise Broken(
                    f"{node} is {world.at(node, until, value)} at {until:.2f} s, it was {value}; "
                    f"the connection came back at {regained:.2f} s"
                )


def run(sessions: int, first: int = 0) -> Counter[str]:
    """Run `sessions` sessions from seed `first` on, and return how often each outcome occurred."""
    outcomes: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + sessions):
            try:
                outcomes[session(seed, Path(folder))] += 1
            except Broken as error:
                raise Broken(f"session {seed}: {error}") from error
    return outcomes
