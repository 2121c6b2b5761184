"""The sampled law in linear loops is the one that the running PID follows."""

import numpy as np
import pytest

from prefcal_env import PID, Channel, Plant, PlantEnv, Task, rollout
from prefcal_env.controllers.margins import sampled
from prefcal_env.controllers.pid import LinearPIDs, PIDLaw, Tuning
from prefcal_env.plants.systems import system_of

LAG = Plant.of(([2.0], [5, 6, 1]), delay=0.7, inputs=[Channel("u")], outputs=[Channel("y")])
TUNING = Tuning(1.2, 4.0, 0.6)


def lag_sampled():
    return sampled(LAG.system, 0.25, np.array([[0.7]]))


def test_a_step_of_the_reference_is_answered_as_by_the_running_pid():
    pid = PID(TUNING.K_p, TUNING.T_i, TUNING.T_d, T_s=0.25, N=8.0)
    task = Task(x0=np.zeros(2), u0=np.zeros(1), y_ref=np.ones(1), horizon=20.0, dense_step=0.25)
    e = rollout(PlantEnv(LAG, task), pid, np.zeros(1))
    plant, law = lag_sampled(), LinearPIDs.of([TUNING], 8.0)
    M, drive = law.loops(plant)[0], law.drive(plant)[:, 0]
    x, step = np.zeros(len(M)), []
    for _ in e.t:
        step.append(plant.C[0] @ x[: len(plant.A)])
        x = M @ x + drive
    assert np.abs(e.output(0) - step).max() < 1e-9


def test_the_response_is_that_of_a_pid_at_low_frequencies():
    law = PIDLaw.of(2.0, 5.0, 1.5, N=10.0, T_s=0.001)
    s = 0.3j
    assert law.at(np.exp(s * 0.001)) == pytest.approx(
        2 * (1 + 1 / (5 * s) + 1.5 * s / (1 + 0.15 * s)), rel=1e-3
    )


def test_one_pid_of_a_pair_is_as_sensitive_as_alone_if_nothing_couples_them():
    two = system_of((-np.diag([1.0, 2.0]), np.eye(2), np.eye(2), np.zeros((2, 2))))
    omega = np.geomspace(1e-3, 30, 200)
    slow, fast = Tuning(1.0, 2.0), Tuning(3.0, 1.0, 0.1)
    both = LinearPIDs.of([slow, fast], 10.0).sensitivity(sampled(two, 0.1), omega)[0]
    alone = [
        LinearPIDs.of([t], 10.0).sensitivity(sampled(two.part([i], [i]), 0.1), omega)[0]
        for i, t in enumerate((slow, fast))
    ]
    assert both == pytest.approx(max(alone))


def test_sets_are_checked_together_as_each_alone():
    omega = np.geomspace(1e-3, 12, 100)
    gains = np.array([[0.5], [1.5], [400.0]])
    together = LinearPIDs(gains, np.full((3, 1), 4.0), np.zeros((3, 1)), 10.0)
    peaks = together.sensitivity(lag_sampled(), omega)
    for gain, peak in zip(gains[:, 0], peaks, strict=True):
        alone = LinearPIDs.of([Tuning(gain, 4.0)], 10.0).sensitivity(lag_sampled(), omega)
        assert peak == pytest.approx(alone[0])
    assert np.isinf(peaks[2])
    assert together.stable(lag_sampled()).tolist() == [True, True, False]
