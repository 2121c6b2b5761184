"""Sampling instants with jitter: near their times, drawn from the seed, and off by default."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.controllers.pid import PID
from prefcal_env.envs.closed_loop import ClosedLoop
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.task import Task
from prefcal_env.errors import SettingsError
from prefcal_env.plants.plant import Plant

PLANT = Plant.of(([1.0], [1.0, 3.0, 3.0, 1.0]))
TASK = Task(np.zeros(3), np.zeros(1), np.ones(1), horizon=10.0)


def run(jitter, seed=0):
    env = PlantEnv(PLANT, replace(TASK, jitter=jitter))
    return ClosedLoop(env, lambda theta: PID(theta[0], 3.0, T_s=0.1))(np.array([2.0]), seed=seed)


def test_instants_stay_near_their_times():
    made, regular = run(0.2), run(0.0)
    assert regular.t_control == pytest.approx(0.1 * np.arange(100))
    away = made.t_control[1:100] / 0.1 - np.arange(1, 100)
    assert set(np.round(away, 9)) == {-0.2, 0.0, 0.2}
    assert np.diff(made.t).min() > 0
    assert made.t[-1] >= 10.0
    assert made.output(0)[-1] == pytest.approx(regular.output(0)[-1], abs=0.02)


def test_they_follow_from_the_seed():
    assert np.array_equal(run(0.2, 1).t_control, run(0.2, 1).t_control)
    assert not np.array_equal(run(0.2, 1).t_control, run(0.2, 2).t_control)


@pytest.mark.parametrize("jitter", [-0.1, 0.5, np.nan])
def test_a_period_keeps_its_place(jitter):
    with pytest.raises(SettingsError, match="jitter must be"):
        replace(TASK, jitter=jitter)
