"""A source of one's own: a device that runs θ once a person has confirmed it, and says no more."""

import numpy as np

from prefcal_env import Channel, Channels, Experiment, Knob, KnobSpace, recorded
from prefcal_env.sources import Change, Run, Source

SPACE = KnobSpace([Knob("K_p", 0.5, 20.0), Knob("T_i", 1.0, 60.0, "s")])


class Device(Source):
    """It takes θ and returns samples; nobody can ask what it has now."""

    asks = "confirm"
    channels = Channels((), (Channel("valve", "%"),), (Channel("level", "m", target=2.0),))
    instructions = "Is the tank closed?"
    afterward = "the device keeps the new values"

    def begin(self, theta: np.ndarray, seed: int = 0) -> Run:
        return DeviceRun(theta)


class DeviceRun(Run):
    def __init__(self, theta: np.ndarray) -> None:
        self.theta, self.waits = theta, True
        self.changes = tuple(Change(knob, value) for knob, value in zip(SPACE, theta, strict=True))

    def supply(self, given: object) -> None:
        self.waits, self.moves_plant = False, True

    def advance(self) -> Experiment:
        t = np.linspace(0.0, 10.0, 101)
        level = 2.0 - np.exp(-self.theta[0] * t / 10)
        valve = self.theta[0] * (2.0 - level) + t / self.theta[1]
        return recorded(
            self.theta, t, {"level": level}, {"valve": valve}, {"level": 2.0}, {"level": "m", "valve": "%"}
        )
