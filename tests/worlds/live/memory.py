"""A live plant in memory, whose time is simulated, for tests of live rigs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path

import pytest

from prefcal_env import Knob
from prefcal_env.errors import ConnectionLostError, LiveError
from prefcal_env.worlds.live import Journal, LiveKnob, LiveRig, LiveStart, Tag


@dataclass
class Memory:
    """A plant whose level follows its set-point; what happens when is decided by `at`."""

    values: dict[str, float] = field(
        default_factory=lambda: {"kp": 1.0, "ti": 10.0, "sp": 1.0, "level": 1.0, "valve": 40.0}
    )
    at: Callable[["Memory"], None] = lambda plant: None
    now: float = 0.0
    up: bool = True
    address: str = "memory"
    connected: bool = False
    refuses: str = ""
    bad: set[str] = field(default_factory=set)
    writes: list[tuple[float, str, float]] = field(default_factory=list)

    def clock(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.values["level"] += 0.3 * seconds * (self.values["sp"] - self.values["level"])
        self.at(self)

    def connect(self) -> None:
        self.connected = True
        self._reach()

    def _reach(self) -> None:
        if not (self.up and self.connected):
            self.connected = False
            raise ConnectionLostError("no connection to memory")

    def read(self, nodes: Sequence[str]) -> list[float]:
        self._reach()
        return [nan if node in self.bad else self.values[node] for node in nodes]

    def write(self, node: str, value: float) -> None:
        self._reach()
        if node == self.refuses:
            raise LiveError("the server memory refuses")
        self.writes.append((self.now, node, value))
        self.values[node] = value

    def close(self) -> None:
        self.connected = False


def memory_rig(plant: Memory, folder: Path, **changes: object) -> LiveRig:
    """A rig on `plant`: K_p moves by 1 and T_i by 5 s per second."""
    parts: dict[str, object] = {
        "knobs": (
            LiveKnob(Knob("K_p", 0.5, 20.0), "kp", 1.0),
            LiveKnob(Knob("T_i", 1.0, 60.0, "s"), "ti", 5.0),
        ),
        "tags": (
            Tag("level", "level", unit="m", abort=(0.0, 3.0)),
            Tag("valve", "valve", "input", "%"),
            Tag("level", "sp", "reference"),
        ),
        "start": (LiveStart(Knob("set-point", 0.5, 2.5, "m"), "sp", 10.0, value=2.0),),
        "duration": 10.0,
        "period": 1.0,
        "journal": Journal(folder / "old.json"),
    }
    return LiveRig(plant, **(parts | changes))


def simulate_time(plant: Memory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every live rig of a test run by the clock of `plant`."""
    real, recover, trying = LiveRig.drive, LiveRig.recover, LiveRig.try_out

    def drive(self, theta, confirm, **rest):
        return real(self, theta, confirm, clock=plant.clock, sleep=plant.sleep, **rest)

    def recovered(self, **rest):
        return recover(self, clock=plant.clock, sleep=plant.sleep, **rest)

    def tried(self, trial, hands):
        return trying(self, trial, replace(hands, clock=plant.clock, sleep=plant.sleep))

    monkeypatch.setattr(LiveRig, "drive", drive)
    monkeypatch.setattr(LiveRig, "try_out", tried)
    monkeypatch.setattr(LiveRig, "recover", recovered)
