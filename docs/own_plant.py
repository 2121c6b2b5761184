"""Tune the PID of a motor by preferences: own plant, own controller, own taste."""

import gymnasium as gym
import numpy as np

from prefcal_agents import minimize_by_preference
from prefcal_env import Channel, ClosedLoop, Knob, KnobSpace, Move, PlantEnv, Task
from prefcal_env.plants import FunctionPlant

# A DC motor that turns a load: angle, speed and current, driven by a voltage.
motor = FunctionPlant(
    lambda x, u, d: [x[1], 40 * x[2] - 2 * x[1], (u[0] - 0.05 * x[1] - 2 * x[2]) / 0.1],
    lambda x, u, d: [x[0]],
    states=[Channel("angle", "rad"), Channel("speed", "rad/s"), Channel("current", "A")],
    inputs=[Channel("voltage", "V", low=-12, high=12)],
    outputs=[Channel("angle", "rad")],
)
# Turn by 1 rad within 3 s.
turn = Task(x0=np.zeros(3), u0=np.zeros(1), y_ref=np.array([1.0]), horizon=3.0)


class PID:
    T_s = 0.01

    def __init__(self, theta):
        self.K_p, self.K_i, self.K_d = theta
        self.sum = 0.0

    def move(self, m):
        error = m.y_ref[0] - m.x[0]
        self.sum += error * self.T_s
        return Move(np.array([self.K_p * error + self.K_i * self.sum - self.K_d * m.x[1]]))


knobs = KnobSpace(
    [
        Knob("K_p", 0.1, 100, "V/rad", scale="log10"),
        Knob("K_i", 0.01, 10, "V/(rad s)", scale="log10"),
        Knob("K_d", 0.01, 10, "V s/rad", scale="log10"),
    ]
)
loop = ClosedLoop(PlantEnv(motor, turn), PID)
env = gym.make("prefcal_env:prefcal/Experiment-v0", space=knobs, run=loop)


runs = {}  # θ to its experiment: nothing runs twice


def experiment(theta):
    if tuple(theta) not in runs:
        env.reset()
        runs[tuple(theta)] = env.step(2 * knobs.encode(theta) - 1)[-1]["experiment"]
    return runs[tuple(theta)]


def prefer(a, b):
    """Return -1 if a is better, 1 if b is: no overshoot above 2 % first, then the faster one."""
    overshoot, late = [], []
    for e in (experiment(a), experiment(b)):
        error = np.abs(e.x[:, 0] - 1) > 0.02
        overshoot.append(max(e.x[:, 0].max() - 1.02, 0.0))
        late.append(e.t[np.flatnonzero(error)[-1]])
    return int(np.sign(round(overshoot[0] - overshoot[1], 3) or round(late[0] - late[1], 2)))


if __name__ == "__main__":
    found = minimize_by_preference(prefer, knobs, n_max=30)
    best = experiment(found.best)
    print("best", knobs.named(found.best))
    print(f"peak {best.x[:, 0].max():.3f} rad, angle after 0.5 s {best.x[best.t <= 0.5][-1, 0]:.3f}")
