"""Bring your own: a plant environment and a controller, or just a run."""

import gymnasium as gym
import numpy as np
import pytest

import prefcal_env
from prefcal_env.envs import PlantEnv
from prefcal_env.envs.closed_loop import ClosedLoop, rollout
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.knobs import Knob, KnobSpace
from support.short_runs import short_run
from support.tank import TANK, pi_of, tank_env, tank_task

SPACE = KnobSpace([Knob("K_p", 0.1, 2.0), Knob("K_i", 0.0, 1.0)])
ID = "prefcal/Experiment-v0"


@pytest.mark.parametrize("source", [tank_env, tank_env()])
def test_an_environment_and_a_controller_make_an_experiment(source):
    env = gym.make(
        ID,
        space=SPACE,
        run=ClosedLoop(source, pi_of, lambda e: {"final": float(e.x[-1, 0])}),
        score=lambda e: e.duration,
    )
    env.reset()
    _, reward, *_, info = env.step(np.array([0.0, 0.0]))
    e = info["experiment"]
    assert e == rollout(tank_env(), pi_of(info["theta"]), info["theta"], kpis=lambda _: e.kpis)
    assert e.end is End.SETTLED
    assert e.kpis["final"] == pytest.approx(2.0, abs=0.01)
    assert reward == -e.duration


def test_the_environment_may_be_an_id():
    class Constant:
        T_s = 1.0

        def __init__(self, theta):
            self.u = theta

        def move(self, m):
            return prefcal_env.Move(self.u)

    space = KnobSpace([Knob("T_c", 284, 310, "K")])
    env = gym.make(ID, space=space, run=ClosedLoop("prefcal/CSTR-v0", Constant))
    env.reset()
    e = env.step(np.array([0.0]))[4]["experiment"]
    assert np.all(e.u == 297.0)
    assert e.channels.time_unit == "h"


def test_a_run_alone_is_enough():
    env = gym.make(ID, space=SPACE, run=lambda theta, seed: short_run(theta))
    env.reset()
    assert env.step(np.zeros(2))[4]["experiment"] == short_run([1.05, 0.5])


@pytest.mark.parametrize("parts", [(3, pi_of), (tank_env, 3)])
def test_what_is_neither_environment_nor_factory_is_refused(parts):
    with pytest.raises(SettingsError, match="got 3"):
        ClosedLoop(*parts)


def test_the_last_experiment_is_drawn():
    env = gym.make(
        ID, space=SPACE, run=ClosedLoop(PlantEnv(TANK, tank_task()), pi_of), render_mode="rgb_array"
    )
    env.reset()
    blank = env.render()
    env.step(np.zeros(2))
    drawn = env.render()
    assert blank.dtype == drawn.dtype == np.uint8
    assert drawn.shape == blank.shape  # of one size, for videos
    assert drawn.std() > blank.std()
