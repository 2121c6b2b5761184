"""Tune the PI controller of a heated tank for three maneuvers with the same θ."""

import numpy as np

from prefcal_env import Channel, ClosedLoop, Knob, KnobSpace, Maneuvers, Move, PlantEnv, Task
from prefcal_env.plants import FunctionPlant
from prefcal_scenarios import KPI, Panel, Scenario

# 100 L of water lose 0.05 kW per K; the inflow is cold. Temperatures are above that of the room.
plant = FunctionPlant(
    lambda x, u, d: [0.143 * (u[0] - 0.05 * x[0]) - d[0] / 100 * x[0]],
    states=[Channel("temperature", "K", symbol="T")],
    inputs=[Channel("heater", "kW", low=0.0, high=60.0, symbol="P")],
    disturbances=[Channel("cold inflow", "L/min")],
    time_unit="min",
)
K_p, T_i = Knob("K_p", 0.1, 30, "kW/K", scale="log10"), Knob("T_i", 0.5, 30, "min", scale="log10")


class PI:
    T_s = 0.25  # min

    def __init__(self, theta):
        self.K_p, self.T_i = theta
        self.sum = None

    def move(self, m):
        error = m.y_ref[0] - m.x[0]
        if self.sum is None:  # start without a bump
            self.sum = m.u[0]
        u = self.sum + self.K_p * error
        if 0 < u < 60:  # no windup while the heater is at a limit
            self.sum += self.K_p * self.T_s / self.T_i * error
        return Move(np.array([np.clip(u, 0, 60)]))


def maneuver(start, target, inflow_before, inflow):
    """Return a task of 30 min that starts in a steady state."""
    u0 = np.array([start * (0.05 + inflow_before / 14.3)])  # holds the temperature
    return Task(np.array([start]), u0, np.array([target]), 30.0, d=np.array([inflow]))


tasks = {
    "step": maneuver(30.0, 40.0, 5.0, 5.0),  # 10 K more
    "load": maneuver(40.0, 40.0, 5.0, 9.0),  # much more cold water
    "warm": maneuver(70.0, 75.0, 2.0, 2.0),  # another operating point
}


def kpis(e):
    error = e.x[:, 0] - e.y_ref[0]
    outside = np.flatnonzero(np.abs(error) > 0.5)
    found = {
        "settling time": float(e.t[outside[-1]]) if len(outside) else 0.0,
        "largest move": float(np.max(np.abs(np.diff(e.u_control[:, 0])))),
    }
    if error[0] < 0:  # a step up
        return found | {"overshoot": max(float(np.max(error)), 0.0)}
    return found | {"largest error": float(np.max(np.abs(error)))}


heated_tank = Scenario(
    "heated-tank",
    "Heated tank: three maneuvers with the same θ",
    KnobSpace([K_p, T_i]),
    Maneuvers({n: ClosedLoop(PlantEnv(plant, t), PI, kpis) for n, t in tasks.items()}),
    kpis=(
        KPI("settling time", "settling time", "min", at_most=10.0),
        KPI("overshoot", "overshoot", "K", at_most=1.0),
        KPI("largest error", "largest error", "K", at_most=2.0),
        KPI("largest move", "largest move", "kW", better="lower"),
    ),
    panels=(Panel("temperature"), Panel("heater")),
    simulated=True,
    brief="Heat the tank by 10 K, hold it when more cold water comes, and work hot, too.",
)

if __name__ == "__main__":
    worst = {k: heated_tank.run(np.array([k, 5.0])).kpis["settling time"] for k in (2.0, 5.0, 10.0)}
    print("best of three gains:", min(worst, key=worst.get), "kW/K")
