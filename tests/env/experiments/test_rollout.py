"""One closed-loop experiment."""

from itertools import count

import gymnasium as gym
import numpy as np
import pytest

from prefcal_env.envs import PlantEnv
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.errors import ExperimentError, PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel, End, Move
from prefcal_env.plants import FunctionPlant
from support.tank import INFLOW, LEVEL, PI, RAIN, TANK, tank_env, tank_task

THETA = np.array([1.0, 0.5])


def test_the_controller_acts_once_a_sampling_period_until_the_plant_has_settled():
    e = rollout(tank_env(), PI(1.0, 0.5), THETA)
    assert e.end is End.SETTLED
    assert np.array_equal(e.theta, THETA)
    assert e.x[-1, 0] == pytest.approx(2.0, abs=0.01)
    assert np.diff(e.t_control) == pytest.approx(0.5)
    assert e.duration == pytest.approx(e.t_control[-1] + 0.5)
    assert np.all(e.iterations == 3)
    assert e.solved.all()
    assert len(e.at_control()) == len(e.t_control) + 1


def test_the_sampling_time_is_that_of_the_controller():
    e = rollout(tank_env(), PI(0.5, 0.1, T_s=0.3), THETA)
    assert np.diff(e.t_control) == pytest.approx(0.3)


def test_the_controller_hears_of_the_plant_as_it_is():
    controller = PI(1.0, 0.5)
    e = rollout(tank_env(), controller, THETA)
    assert [m.t for m in controller.heard] == e.t_control.tolist()
    assert np.array_equal([m.x for m in controller.heard], e.at_control()[:-1])
    assert np.array_equal([m.u for m in controller.heard][1:], e.u_control[:-1])
    assert controller.heard[0].u.tolist() == [0.0]


def test_an_unsolved_step_holds_the_last_input_and_is_marked():
    class Sometimes(PI):
        def move(self, m):
            n = len(self.heard)
            move = super().move(m)
            if n in (3, 4):
                return Move(np.array([4.0]), 99, solved=False)
            return Move(np.array([np.nan])) if n == 6 else move

    e = rollout(tank_env(), Sometimes(1.0, 0.5), THETA)
    assert np.flatnonzero(~e.solved).tolist() == [3, 4, 6]
    for n in (3, 4, 6):
        assert e.u_control[n] == e.u_control[n - 1]


def test_time_comes_from_the_clock_that_is_handed_in():
    ticks = count(0, 0.25)
    e = rollout(tank_env(), PI(1.0, 0.5), THETA, clock=lambda: next(ticks))
    assert np.all(e.solve_time == 0.25)


def test_indicators_are_of_the_finished_experiment():
    e = rollout(tank_env(), PI(1.0, 0.5), THETA, kpis=lambda e: {"duration": e.duration})
    assert e.kpis == {"duration": e.duration}


def test_wrapped_environments_are_driven_through_their_core():
    env = gym.wrappers.TimeLimit(PlantEnv(TANK, tank_task()), 3)
    assert rollout(env, PI(1.0, 0.5), THETA).end is End.SETTLED


def test_an_environment_without_the_protocol_is_refused():
    with pytest.raises(ExperimentError, match=r"\['measurement', 'apply', 'end', 'record'\]"):
        rollout(gym.make("CartPole-v1"), PI(1.0), THETA)


def test_inputs_of_the_wrong_shape_are_refused():
    class Wrong(PI):
        def move(self, m):
            return Move(np.zeros(2))

    with pytest.raises(PlantError, match=r"input u must have shape \(1,\), got \(2,\)"):
        rollout(tank_env(), Wrong(1.0), THETA)


class Forgetful(PI):
    def move(self, m):
        return super().move(m).u


class Unpaced:
    def move(self, m):
        return Move(np.zeros(1))


def test_a_controller_that_forgets_the_move_is_told_so():
    words = r"controller Forgetful \(test_rollout.py:\d+\) must return a prefcal_env.Move, got nd"
    with pytest.raises(SettingsError, match=words):
        rollout(tank_env(), Forgetful(1.0), THETA)


def test_a_controller_without_a_sampling_time_is_told_so():
    with pytest.raises(SettingsError, match="a controller needs T_s"):
        rollout(tank_env(), Unpaced(), THETA)


def test_kpis_without_a_return_are_refused():
    def kpis(experiment):
        {"level": 1.0}  # noqa: B018

    with pytest.raises(ExperimentError, match="got None: is a return missing"):
        rollout(tank_env(), PI(1.0), THETA, kpis=kpis)


def test_outputs_are_recorded_with_the_disturbances_and_inputs_that_were_held():
    plant = FunctionPlant(
        lambda x, u, d: [u[0] - x[0] / 2 + d[0]],
        lambda x, u, d: [x[0] + 100 * u[0] + 1000 * d[0]],
        states=[LEVEL],
        inputs=[INFLOW],
        outputs=[Channel("sum")],
        disturbances=[RAIN],
    )
    task = tank_task(d=lambda t: np.array([np.floor(t)]), settled=lambda s: False, horizon=2.0)
    e = rollout(PlantEnv(plant, task), PI(1.0, T_s=0.8), THETA)
    rain = np.where(e.t < 1.6, 0.0, 1.0)  # seen first at 1.6 s, held from there on
    np.testing.assert_allclose(e.y[:, 0], e.x[:, 0] + 100 * e.u[:, 0] + 1000 * rain)
