"""A heated tank whose PI controller must master three maneuvers with the same θ."""

import numpy as np

from prefcal_env import Channel, ClosedLoop, Knob, KnobSpace, Maneuvers, Move, Panel, PlantEnv, Task
from prefcal_env.plants import FunctionPlant
from prefcal_scenarios import KPI, Scenario

TEMPERATURE = Channel("temperature", "K", band=0.5, symbol="T")
HEATER = Channel("heater", "kW", low=0.0, high=60.0, symbol="P")
COLD = Channel("cold inflow", "L/min", symbol="q")


def tank(x, u, d):
    """Return the change in K/min of the water in a 100 L tank that loses 0.05 kW per K."""
    return [0.143 * (u[0] - 0.05 * x[0]) - d[0] / 100 * x[0]]


plant = FunctionPlant(
    tank, states=[TEMPERATURE], inputs=[HEATER], disturbances=[COLD], time_unit="min"
)
knobs = KnobSpace(
    [Knob("K_p", 0.1, 30, "kW/K", scale="log10"), Knob("T_i", 0.5, 30, "min", scale="log10")]
)


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


def held(level, inflow):
    """Return the heater's power in kW that holds a temperature in K."""
    return level * (0.05 + inflow / 14.3)


def maneuver(start, target, inflow_before, inflow_now):
    """Return a task of 30 min that starts in a steady state."""
    return Task(
        x0=np.array([start]), u0=np.array([held(start, inflow_before)]), d=np.array([inflow_now]),
        y_ref=np.array([target]), horizon=30.0, dense_step=0.05,
    )  # fmt: skip


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


tasks = {
    "step": maneuver(30.0, 40.0, 5.0, 5.0),  # 10 K more
    "load": maneuver(40.0, 40.0, 5.0, 9.0),  # much more cold water
    "warm": maneuver(70.0, 75.0, 2.0, 2.0),  # another operating point
}
heated_tank = Scenario(
    name="heated-tank",
    title="Heated tank: three maneuvers with the same θ",
    space=knobs,
    run=Maneuvers({n: ClosedLoop(PlantEnv(plant, t), PI, kpis) for n, t in tasks.items()}),
    kpis=(
        KPI("settling time", "settling time", "min", at_most=10.0),
        KPI("overshoot", "overshoot", "K", at_most=1.0),
        KPI("largest error", "largest error", "K", at_most=2.0),
        KPI("largest move", "largest move", "kW", better="lower"),
    ),
    panels=(Panel("temperature"), Panel("heater")),
    controller=PI,
    simulated=True,
    brief="Heat the tank by 10 K, hold it when more cold water comes, and work at 70 °C, too.",
)

if __name__ == "__main__":
    tried = {K_p: heated_tank.run(np.array([K_p, 5.0])) for K_p in (2.0, 5.0, 10.0)}
    best = min(tried, key=lambda K_p: tried[K_p].kpis["settling time"])
    print(f"best of three: K_p = {best:g} kW/K, at worst {tried[best].kpis['settling time']:g} min")
