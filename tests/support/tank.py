"""A tank with one level: ẋ = u - x/2 + d, in environments with every kind of end."""

from typing import Any

import numpy as np

from prefcal_env.envs import Period, PlantEnv, Task
from prefcal_env.experiments.experiment import Channel, Measurement, Move
from prefcal_env.plants import FunctionPlant

LEVEL = Channel("level", "m", symbol="h")
INFLOW = Channel("inflow", "m/s", low=0.0, high=4.0, symbol="q")
RAIN = Channel("rain", "m/s")


def balance(x: Any, u: Any, d: Any) -> list[float]:
    return [u[0] - x[0] / 2 + d[0]]


TANK = FunctionPlant(balance, states=[LEVEL], inputs=[INFLOW], disturbances=[RAIN], name="tank")


def overflow(x: Any) -> bool:
    return bool(x[0] > 6.0)


def still(step: Period) -> bool:
    return bool(abs(step.x[-1, 0] - 2.0) < 0.01 and abs(step.x[-1, 0] - step.x[0, 0]) < 1e-3)


def error(step: Period) -> float:
    return abs(float(step.x[-1, 0]) - 2.0)


def tank_task(**changes: Any) -> Task:
    """Fill the tank to 2 m within 10 s."""
    fields: dict[str, Any] = {
        "x0": np.zeros(1),
        "u0": np.zeros(1),
        "y_ref": np.array([2.0]),
        "d": np.zeros(1),
        "horizon": 10.0,
        "T_s": 0.5,
        "T_s_range": (0.1, 3.0),
        "dense_step": 0.1,
        "observed": np.array([(0, 8), (0, 4), (0, 4), (-1, 1)]),
        "bands": {0: 0.1},
        "unsafe": overflow,
        "settled": still,
        "stage_cost": error,
        "unsafe_cost": 5.0,
    }
    return Task(**fields | changes)


def tank_env(**changes: Any) -> PlantEnv:
    return PlantEnv(TANK, tank_task(**changes))


class PI:
    """u = K_p e + K_i ∫e, and what it was told."""

    def __init__(self, K_p: float, K_i: float = 0.0, T_s: float = 0.5) -> None:
        self.T_s, self._K_p, self._K_i = T_s, K_p, K_i
        self._sum = 0.0
        self.heard: list[Measurement] = []

    def move(self, m: Measurement) -> Move:
        self.heard.append(m)
        e = float(np.ravel(m.y_ref)[0] - m.x[0])
        self._sum += e * self.T_s
        return Move(np.array([self._K_p * e + self._K_i * self._sum]), iterations=3)


def pi_of(theta: Any) -> PI:
    return PI(*(float(v) for v in theta))
