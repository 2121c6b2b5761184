"""A plant and a task as an environment, and the closed loop around it."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import prefcal_env
from prefcal_env.controllers.pid import PID
from prefcal_env.envs import PlantEnv, Task
from prefcal_env.envs.closed_loop import ClosedLoop, rollout
from prefcal_env.envs.plant_env import observed_of
from prefcal_env.envs.task import StepSignal
from prefcal_env.errors import PlantError, ProtocolError, SettingsError
from prefcal_env.experiments.experiment import Channel, End
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.plants import FunctionPlant
from prefcal_env.plants.plant import Plant
from support.short_runs import short_run
from support.tank import INFLOW, LEVEL, RAIN, TANK, pi_of, tank_env, tank_task


def level_after(u: float, t: np.ndarray | float, d: float = 0.0) -> np.ndarray | float:
    return 2 * (u + d) * (1 - np.exp(-np.asarray(t) / 2))


def test_a_controller_cannot_move_the_plant_by_what_it_is_given():
    env = tank_env()
    env.reset()
    env.step(np.array([-0.5]))
    known = env.measurement()
    with pytest.raises(ValueError, match="read-only"):
        known.x -= 1.0  # as in deviations from a set point, computed in place
    assert env.measurement().x == pytest.approx([level_after(1.0, 0.5)], abs=1e-9)


def test_one_step_holds_the_input_for_one_sampling_period():
    env = tank_env()
    env.reset()
    observation, reward, terminated, truncated, info = env.step(np.array([-0.5]))
    assert info["t"] == 0.5
    assert info["u"] == pytest.approx([1.0])  # -0.5 of [0, 4]
    assert info["x"] == pytest.approx([level_after(1.0, 0.5)], abs=1e-9)
    assert observation == pytest.approx([info["x"][0] / 4 - 1, -0.5, 0.0, 0.0], abs=1e-6)
    assert reward == pytest.approx(-0.5 * (2.0 - info["x"][0]))
    assert (terminated, truncated) == (False, False)


def test_inputs_saturate_at_the_limits():
    env = tank_env()
    env.reset()
    assert env.step(np.array([7.0]))[4]["u"] == [4.0]
    assert env.apply(np.array([-np.inf])).u == [0.0]


def test_a_task_may_limit_the_moves():
    env = tank_env(max_move=np.array([0.75]))
    env.reset()
    inputs = [float(env.apply(np.array([u])).u[0]) for u in (4.0, 4.0, 1.4, -5.0)]
    assert inputs == [0.75, 1.5, 1.4, pytest.approx(0.65)]


def test_observations_saturate_at_the_box():
    env = tank_env(unsafe=lambda x: False)
    env.reset(options={"x0": [100.0]})
    assert env.step(np.array([0.0], np.float32))[0][0] == 1.0
    assert env.observation_space.contains(env.step(np.zeros(1))[0])


def test_the_dense_trajectory_is_on_a_grid_whatever_the_sampling_time():
    records = []
    for T_s in (0.3, 0.25, 3.0):
        env = tank_env(settled=lambda s: False)
        env.reset(options={"T_s": T_s})
        while env.end is None:
            env.apply(np.array([0.9]))
        records.append(env.record())
        on_grid = np.isin(np.round(records[-1].t, 9), np.round(np.arange(101) * 0.1, 9))
        assert np.sum(on_grid & (records[-1].t <= 10.0 + 1e-9)) == 101
        assert records[-1].x[:, 0] == pytest.approx(level_after(0.9, records[-1].t), abs=1e-9)


def test_time_is_up_at_the_first_sample_at_or_after_the_horizon():
    for T_s, end in ((0.5, 10.0), (0.3, 10.2), (0.1, 10.0), (3.0, 12.0)):
        env = tank_env(settled=lambda s: False)
        env.reset(options={"T_s": T_s})
        steps = 0
        truncated = False
        while not truncated:
            *_, terminated, truncated, info = env.step(np.zeros(1) - 1)
            steps += 1
            assert not terminated
        assert info["t"] == pytest.approx(end)
        assert steps == round(end / T_s)
        assert info["end"] == "time is up"


def test_a_settled_plant_truncates():
    env = tank_env()
    env.reset(options={"x0": [2.0]})
    *_, terminated, truncated, info = env.step(np.array([-0.5]))
    assert (terminated, truncated, info["end"]) == (False, True, "settled")
    assert env.end is End.SETTLED


def test_an_unsafe_state_ends_the_episode_where_it_appears_and_costs_the_rest():
    env = tank_env()
    env.reset(options={"T_s": 3.0, "x0": [4.0]})
    *_, reward, terminated, truncated, info = env.step(np.array([1.0]))
    # 8 - 4 exp(-t/2) = 6 at t = 1.386; the first instant of the grid after it is 1.4.
    assert (terminated, truncated, info["end"]) == (True, False, "unsafe")
    assert info["t"] == pytest.approx(1.4)
    assert reward == pytest.approx(-1.4 * (info["x"][0] - 2) - 5.0 * 8.6)
    assert env.record().x[-1, 0] > 6.0 >= env.record().x[-2, 0]


def overflows(x):
    return x[0] > 6.0


@pytest.mark.parametrize("T_s", [0.5, 3.0])
def test_a_vectorized_rule_ends_the_episode_at_the_same_state(T_s):
    records = []
    for vectorized in (False, True):
        env = tank_env(unsafe=overflows, vectorized=vectorized)
        env.reset(options={"T_s": T_s, "x0": [4.0]})
        while env.end is None:
            env.apply(np.array([4.0]))
        records.append(env.record())
    assert [record.end for record in records] == [End.UNSAFE] * 2
    assert records[0].t.tolist() == records[1].t.tolist()
    assert records[0].x.tolist() == records[1].x.tolist()


def test_a_vectorized_rule_must_judge_each_state():
    env = tank_env(unsafe=lambda x: bool(np.any(x > 6.0)), vectorized=True)
    env.reset()
    with pytest.raises(SettingsError, match=r"one value for each state, shape \(5,\), got \(\)"):
        env.apply(np.zeros(1))


def test_outputs_that_are_the_states_are_recorded_without_calling_g():
    def records(**changes):
        env = PlantEnv(TANK, tank_task(), **changes)
        env.reset()
        env.apply(np.ones(1))
        return env.record()

    assert records().y.tolist() == records(outputs_are_states=True).y.tolist()


@pytest.mark.parametrize("T_s", [0.5, 3.0])
def test_a_state_that_is_not_finite_is_unsafe_and_not_recorded(T_s):
    bomb = FunctionPlant(
        lambda x, u, d: [1 + x[0] ** 4], states=[LEVEL], inputs=[INFLOW], disturbances=[RAIN]
    )
    env = PlantEnv(bomb, tank_task(unsafe=lambda x: False))
    env.reset(options={"T_s": T_s})
    terminated = False
    while not terminated:
        observation, reward, terminated, _, info = env.step(np.zeros(1))
        assert np.isfinite(reward)
        assert env.observation_space.contains(observation)
        assert np.isfinite(info["x"]).all()
    record = env.record()
    assert record.end is End.UNSAFE
    assert np.isfinite(record.x).all()
    assert np.all(np.diff(record.t) > 0)


def _env_of(rate):
    channels = {"states": [LEVEL], "inputs": [INFLOW], "disturbances": [RAIN]}
    return PlantEnv(FunctionPlant(lambda x, u, d: [rate], **channels, name="pond"), tank_task())


def test_a_plant_whose_f_is_nan_at_the_start_is_refused_with_its_state():
    env = _env_of(np.nan)
    env.reset()
    words = r"'pond'.* got NaN for \['level'\] at x = \[0.0\], u = \[2.0\], d = \[0.0\]"
    with pytest.raises(PlantError, match=words):
        env.step(np.zeros(1))


def test_a_first_step_that_fails_at_once_leaves_one_instant():
    env = _env_of(1e308)
    env.reset()
    assert env.step(np.zeros(1))[2] is True
    assert env.record().t.tolist() == [0.0]
    assert env.record().t_control.tolist() == [0.0]


def test_inputs_in_the_record_change_at_their_instants():
    env = tank_env(dense_step=0.25)
    env.reset(options={"T_s": 0.5})
    for u in (1.0, 3.0):
        env.apply(np.array([u]))
    record = env.record()
    assert record.t.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert record.u[:, 0].tolist() == [1.0, 1.0, 3.0, 3.0, 3.0]
    assert record.t_control.tolist() == [0.0, 0.5]
    assert record.end is None


def test_references_and_disturbances_may_vary_and_are_held_over_a_period():
    env = tank_env(y_ref=lambda t: np.array([2.0 + t]), d=lambda t: np.array([t]), settled=lambda s: False)
    env.reset()
    env.apply(np.zeros(1))
    env.apply(np.zeros(1))
    assert env.record().y_ref[:, 0].tolist() == [2.0, 2.5]
    assert env.record().x[-1, 0] == pytest.approx(level_after(0.0, 0.5, d=0.5), abs=1e-9)
    assert env.measurement().y_ref.tolist() == [3.0]
    assert env.measurement().d.tolist() == [1.0]


def test_a_preview_starts_at_the_next_sample_for_outputs_and_now_for_disturbances():
    env = tank_env(y_ref=lambda t: np.array([2.0 + t]), d=lambda t: np.array([t]), preview=3)
    env.reset()
    env.apply(np.zeros(1))
    assert env.measurement().y_ref[:, 0].tolist() == [3.0, 3.5, 4.0]
    assert env.measurement().d[:, 0].tolist() == [0.5, 1.0, 1.5]


def test_a_constant_reference_becomes_the_target_of_its_output():
    (output,) = tank_env().channels.y
    assert (output.target, output.band) == (2.0, 0.1)
    assert tank_env(y_ref=lambda t: np.array([2.0])).channels.y[0].target is None


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(-1, 1), min_size=1, max_size=5))
def test_float64_actions_are_not_rounded(actions):
    env = tank_env()
    env.reset()
    for a in actions:
        if env.end is None:
            assert env.step(np.array([a]))[4]["u"][0] == 2 * (a + 1)


@pytest.mark.parametrize(
    ("options", "error", "reason"),
    [
        ({"T_s": 0.05}, SettingsError, r"T_s must be a number in \[0.1, 3.0\].*got 0.05"),
        ({"T_s": np.nan}, SettingsError, "got nan"),
        ({"T_s": "fast"}, SettingsError, "got 'fast'"),
        ({"T_s": True}, SettingsError, "got True"),
        (5, SettingsError, "reset options must be a dict, got 5"),
        ({"dt": 0.5}, SettingsError, r"must be among .*got \['dt'\]"),
        ({"x0": [1.0, 2.0]}, PlantError, r"x0 must have shape \(1,\), got \(2,\)"),
        ({"x0": [np.inf]}, PlantError, "x0 must be finite"),
        ({"x0": "empty"}, PlantError, "x0 must be numbers, got 'empty'"),
        ({"x0": [7.0]}, PlantError, "x0 is unsafe"),
    ],
)
def test_bad_reset_options_are_refused(options, error, reason):
    with pytest.raises(error, match=reason):
        tank_env().reset(options=options)


def test_a_step_without_an_episode_is_refused():
    env = tank_env()
    with pytest.raises(ProtocolError, match=r"call reset\(\)"):
        env.step(np.zeros(1))
    with pytest.raises(ProtocolError, match=r"call reset\(\)"):
        env.record()
    env.reset(options={"x0": [2.0]})
    env.step(np.array([-0.5]))
    with pytest.raises(ProtocolError, match="no episode is running"):
        env.step(np.zeros(1))


NO_NUMBERS = {"max_move": "a", "x0": [None], "horizon": "long", "noise": 1j}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"x0": np.zeros(2)}, r"x0 must have shape \(1,\) for plant 'tank', got \(2,\)"),
        ({"y_ref": lambda t: np.zeros(2)}, "y_ref must have shape"),
        ({"d": np.zeros(0)}, "d must have shape"),
        ({"observed": np.array([(0, 1)])}, r"observed must have shape \(4, 2\)"),
        ({"tracked": (1,), "bands": None}, "tracked must be outputs 0 to 0"),
        ({"max_move": np.array([0.0])}, "max_move must be 1 positive"),
        ({"horizon": 0.0}, "horizon must be positive"),
        ({"dense_step": np.inf}, "dense_step must be positive"),
        ({"T_s": 5.0}, "got 5.0"),
        ({"T_s_range": (0.0, 3.0)}, "T_s must be"),
        ({"x0": [np.nan]}, "x0 must be finite"),
        ({"observed": np.ones((4, 2))}, "low below high"),
        ({"preview": -1}, "preview must be 0 or more"),
        *(({name: v}, f"task: {name} must be ") for name, v in NO_NUMBERS.items()),
    ],
)
def test_a_task_that_is_impossible_or_does_not_fit_the_plant_is_refused(change, reason):
    with pytest.raises(SettingsError, match=reason):
        tank_env(**change)


def test_actions_for_inputs_without_limits_are_refused_but_not_the_inputs_themselves():
    plant = FunctionPlant(
        lambda x, u, d: u, states=[LEVEL], inputs=[Channel("inflow", "m/s")], disturbances=[RAIN]
    )
    env = PlantEnv(plant, tank_task())
    env.reset(seed=0)
    env.apply(np.array([0.1]))
    for use in (lambda: env.action_space, lambda: env.step(np.zeros(1))):
        with pytest.raises(SettingsError, match=r"'inflow'.*finite limits"):
            use()


def test_x0_u0_y_ref_and_horizon_are_enough_of_a_task():
    task = Task(x0=np.zeros(1), u0=np.zeros(1), y_ref=np.array([2.0]), horizon=10.0)
    assert (task.T_s, task.dense_step) == (0.05, 0.02)
    assert task.sampling_time(10.0) == 10.0
    with pytest.raises(SettingsError, match="T_s must be"):
        task.sampling_time(10.1)
    plant = FunctionPlant(lambda x, u, d: [u[0] - x[0]], states=[LEVEL], inputs=[INFLOW])
    env = PlantEnv(plant, task)
    observation, _ = env.reset()
    assert env.channels.y[0].target == 2.0
    # The level reaches ten times 2 m either way; the input its limits; its reference ten times 2.
    assert observation == pytest.approx([0.0, -1.0, 0.0])
    assert env.step(np.ones(1))[0] == pytest.approx([env.record().x[-1, 0] / 20, 1.0, 0.0])


def test_an_environment_needs_a_plant_a_task_and_a_known_render_mode():
    needs = "needs a plant and a Task, got"
    for parts, why in (
        ((5, tank_task()), needs),
        ((TANK, 5), needs),
        ((TANK, tank_task(), "human"), "got 'human'"),
    ):
        with pytest.raises(SettingsError, match=why):
            PlantEnv(*parts)


def test_all_outputs_with_a_reference_are_tracked():
    plant = FunctionPlant(
        lambda x, u, d: [u[0] - x[0], x[0]],
        states=[LEVEL, Channel("total", "m s", low=-1.0)],
        inputs=[INFLOW],
    )
    both = Task(x0=np.zeros(2), u0=np.zeros(1), y_ref=np.array([2.0, 3.0]), horizon=1.0)
    assert [c.target for c in PlantEnv(plant, both).channels.y] == [2.0, 3.0]
    one = replace(both, y_ref=np.array([2.0, np.nan]))
    env = PlantEnv(plant, one)
    assert [c.target for c in env.channels.y] == [2.0, None]
    assert observed_of(plant, one).tolist() == [[-20, 20], [-1, 10], [0, 4], [-18, 22]]
    assert env.observation_space.shape == (4,)
    with pytest.raises(SettingsError, match="that have a reference"):
        PlantEnv(plant, replace(one, tracked=(1,)))


def test_each_value_holds_from_its_time_on():
    signal = StepSignal((0.0, 1.0), ((2.0, (3.0, 4.0)), (5.0, (-1.0, 1.0))))
    t = np.array([0.0, 1.9, 2.0, 4.9, 5.0, 9.0])
    wanted = [[0, 1], [0, 1], [3, 4], [3, 4], [-1, 1], [-1, 1]]
    assert signal.over(t).tolist() == [signal(at).tolist() for at in t] == wanted


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


@pytest.mark.parametrize("lag", [0.05, 0.4, 1.0, 10.0])
def test_a_lag_of_the_actuators_acts_like_a_state_that_the_input_passes(lag):
    """Held at its mean, the input would leave x up to 5 % of the move away after a period."""
    x, limits = [Channel("x"), Channel("v")], {"low": -5.0, "high": 5.0}
    twice = FunctionPlant(lambda x, u, d: [x[1], u[0]], states=x, inputs=[Channel("u", **limits)])
    behind = FunctionPlant(
        lambda x, u, d: [x[1], x[2], (u[0] - x[2]) / lag],
        states=[*x, Channel("actuator")],
        inputs=[Channel("u", **limits)],
    )
    inputs, ends = (4.0, -3.0, 0.5, 0.5, -4.5), []
    for plant, own in ((twice, lag), (behind, 0.0)):
        n = len(plant.states)
        task = Task(x0=np.zeros(n), u0=np.zeros(1), y_ref=np.full(n, np.nan), horizon=5.0, T_s=1.0, lag=own)
        env = PlantEnv(plant, task)
        env.reset()
        ends.append([env.apply(np.array([u])).x[-1][:2] for u in inputs])
    assert np.array(ends[0]) == pytest.approx(np.array(ends[1]), abs=1e-5)
