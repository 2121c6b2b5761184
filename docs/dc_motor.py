"""A scenario of your own: the PID of a DC motor. `prefcal calibrate dc_motor.py:motor` asks you."""

import numpy as np

from prefcal_agents import minimize_by_preference
from prefcal_env import PID, Channel, ClosedLoop, FunctionPlant, Knob, KnobSpace, PlantEnv, Task
from prefcal_scenarios import KPI, Panel, Scenario

ANGLE = Channel("angle", "rad", target=1.0, band=0.02)
VOLTAGE = Channel("voltage", "V", low=-12, high=12)

# The plant: dx/dt = f(x, u, d) and y = g(x, u, d), with named channels.
plant = FunctionPlant(
    lambda x, u, d: [x[1], 40 * x[2] - 2 * x[1], (u[0] - 0.05 * x[1] - 2 * x[2]) / 0.1],
    lambda x, u, d: [x[0]],
    states=[ANGLE, Channel("speed", "rad/s"), Channel("current", "A")],
    inputs=[VOLTAGE],
    outputs=[ANGLE],
)
# The experiment: turn by 1 rad within 4 s.
task = Task(x0=np.zeros(3), u0=np.zeros(1), y_ref=np.array([1.0]), horizon=4.0)


# The controller of θ: prefcal's PID, or anything with `T_s` and `move`.
def pid(theta):
    K_p, K_i, K_d = theta
    return PID.of_gains(K_p, K_i, K_d, T_s=0.01, plant=plant)


# What you read beside the curves.
def kpis(experiment):
    t, error = experiment.t, np.abs(experiment.x[:, 0] - 1)
    outside = np.flatnonzero(error > 0.02)
    return {
        "settled": np.inf if outside[-1] == len(t) - 1 else t[outside[-1]],
        "overshoot": 100 * max(experiment.x[:, 0].max() - 1, 0.0),
        "itae": np.trapezoid(t * error, t),
    }


motor = Scenario(
    name="motor",
    title="PID of a DC motor",
    space=KnobSpace(
        [
            Knob("K_p", 1, 20, "V/rad", scale="log10"),
            Knob("K_i", 0.01, 1, "V/(rad s)", scale="log10"),
            Knob("K_d", 0.1, 3, "V s/rad", scale="log10"),
        ]
    ),
    run=ClosedLoop(PlantEnv(plant, task), pid, kpis),
    kpis=(
        KPI("settled", "settled within 2 %", "s", at_most=1.0),
        KPI("overshoot", "overshoot", "%", at_most=5.0),
        KPI("itae", "error times time (ITAE)", "rad s²", better="lower"),
    ),
    panels=(Panel("angle"), Panel("voltage")),
    # Only for unattended runs. The last term tells two runs apart that do not settle.
    cost=lambda e: e.kpis["overshoot"] / 5 + min(e.kpis["settled"], 4.0) + 10 * e.kpis["itae"],
)

if __name__ == "__main__":

    def prefer(a, b):
        return int(np.sign(motor.cost(motor.run(a)) - motor.cost(motor.run(b))))

    found = minimize_by_preference(prefer, motor.space, n_max=15)
    print("best", motor.space.named(found.best), dict(motor.run(found.best).kpis))
