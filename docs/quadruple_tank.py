"""A quadruple tank with the MPC of prefcal: `prefcal calibrate quadruple_tank.py:tanks`."""

import numpy as np

from prefcal_agents import minimize_by_preference
from prefcal_env import (
    Channel,
    ClosedLoop,
    FunctionPlant,
    Knob,
    KnobSpace,
    LinearMPC,
    MPCSettings,
    PlantEnv,
    Task,
    tracking_kpis,
)
from prefcal_scenarios import Scenario

a, A = np.array([0.071, 0.057, 0.071, 0.057]), np.array([28.0, 32.0, 28.0, 32.0])  # cm²


def f(x, u, d):
    out = a * np.sqrt(2 * 981 * np.maximum(x, 0))  # cm³/s, Torricelli
    pumps = np.array([0.7 * 3.33 * u[0], 0.6 * 3.35 * u[1], 0.4 * 3.35 * u[1], 0.3 * 3.33 * u[0]])
    return (pumps - out + np.array([out[2], out[3], 0, 0])) / A


levels = [Channel(f"level {i}", "cm", 0, 20) for i in (1, 2, 3, 4)]
pumps = [Channel(f"pump {i}", "V", 0, 10) for i in (1, 2)]
plant = FunctionPlant(f, lambda x, u, d: x[:2], states=levels, inputs=pumps, outputs=levels[:2])
task = Task(x0=np.array([12.4, 12.7, 1.8, 1.4]), u0=np.full(2, 3.0), horizon=300.0,
            y_ref=np.array([14.0, 13.5]))  # fmt: skip


def mpc(theta):
    N_p, Q_du = theta
    return LinearMPC(plant, MPCSettings(5.0, int(N_p), 3, Q_y=np.eye(2), Q_du=Q_du * np.eye(2)))


knobs = KnobSpace(
    [Knob("N_p", 3, 40, "steps", integer=True), Knob("Q_du", 1e-3, 10, scale="log10")]
)
tanks = Scenario(
    "tanks", "MPC of four tanks", knobs, ClosedLoop(PlantEnv(plant, task), mpc, tracking_kpis)
)

if __name__ == "__main__":

    def prefer(a, b):
        costs = [sum(tanks.run(t).kpis[k] for k in ("integrated error of level 1",
                 "total move of pump 1")) for t in (a, b)]  # fmt: skip
        return int(np.sign(costs[0] - costs[1]))

    print("best", knobs.named(minimize_by_preference(prefer, knobs, n_max=8).best))
