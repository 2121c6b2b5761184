"""The reactor as an environment: numbers from section IV-A and by hand."""

import gymnasium as gym
import numpy as np
import pytest

from prefcal_env.envs.cstr import cstr_env, settled, stage_cost, unsafe
from prefcal_env.envs.task import Period
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.plants import CSTR


def scaled(T_c: float) -> np.ndarray:
    return np.array([2 * (T_c - 284) / 26 - 1])


def test_an_episode_starts_in_the_papers_steady_state():
    env = cstr_env()
    _, info = env.reset()
    assert info["x"] == pytest.approx([311.23, 8.56], abs=0.01)
    assert info["u"] == pytest.approx([297.62], abs=0.01)
    env.step(scaled(float(info["u"][0])))
    assert env.record().x[-1] == pytest.approx(info["x"], abs=1e-6)


def test_the_observation_is_scaled_in_the_order_of_the_design():
    observation, info = cstr_env().reset()
    T, C_A = info["x"]
    expected = [
        (T - 340) / 60,
        (C_A - 5) / 5,
        (info["u"][0] - 297) / 13,
        (2 - 5) / 5,
        (298.15 - 300) / 20,
        0.0,
    ]
    assert observation == pytest.approx(expected, abs=1e-6)


def test_the_hottest_start_is_unsafe_soon():
    env = cstr_env()
    env.reset(options={"x0": [395.0, 9.0]})
    *_, terminated, truncated, info = env.step(np.ones(1))
    assert (terminated, truncated, info["end"]) == (True, False, "unsafe")
    assert info["t"] < 0.25
    assert unsafe(np.array([400.1, 1.0]))
    assert not unsafe(np.array([399.9, 1.0]))


def test_a_run_that_never_leaves_its_start_is_not_settled():
    env = cstr_env()
    _, info = env.reset(options={"T_s": 0.31})
    while env.end is None:
        env.apply(info["u"])
    assert env.end is End.TIME_UP
    assert env.record().t[-1] == pytest.approx(155 * 0.31)  # 48.05 h, the first after 48


def test_a_run_that_stays_at_the_target_is_settled_after_one_step():
    plant = CSTR()
    x, u = plant.steady_state_at_concentration(2.0)
    env = cstr_env()
    env.reset(options={"x0": x, "T_s": 1.0})
    env.apply(u)  # from T_c = 297.6: not settled
    assert env.end is None
    env.apply(u)
    assert env.end is End.SETTLED


def step(**changes) -> Period:
    fields = {
        "t": np.array([0.0, 0.5]),
        "x": np.array([[373.0, 2.0], [373.0, 2.0]]),
        "u_before": np.array([304.0]),
        "u": np.array([304.0]),
        "y_ref": np.zeros(2),
        "T_s": 0.5,
    }
    return Period(**fields | changes)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, True),
        ({"x": np.array([[373.0, 2.059], [373.0, 2.059]])}, True),
        ({"x": np.array([[373.0, 2.061], [373.0, 2.061]])}, False),
        ({"x": np.array([[373.0, 2.0], [373.0, 2.0019]])}, True),  # 0.0038 kgmol/(m3 h)
        ({"x": np.array([[373.0, 2.0], [373.0, 2.0021]])}, False),
        ({"x": np.array([[373.0, 2.0], [373.019, 2.0]])}, True),  # 0.038 K/h
        ({"x": np.array([[373.0, 2.0], [373.021, 2.0]])}, False),
        ({"u": np.array([304.019])}, True),
        ({"u": np.array([303.979])}, False),
    ],
)
def test_settled_is_inside_the_band_and_at_rest(change, expected):
    assert settled(step(**change)) is expected


def test_the_stage_cost_is_one_at_the_start_and_nothing_at_the_target():
    assert stage_cost(step()) == 0.0
    assert stage_cost(step(x=np.array([[311.0, 8.56], [311.0, 8.56]]))) == pytest.approx(1.0)
    # 10 K in one step of 0.5 h: 0.1 per 10 K over 0.5 h
    assert stage_cost(step(u=np.array([294.0]))) == pytest.approx(0.2)


def test_the_total_reward_does_not_depend_on_the_sampling_time():
    totals = []
    for T_s in (0.25, 0.5, 1.5):
        env = cstr_env()
        env.reset(options={"T_s": T_s})
        total = 0.0
        for k in range(round(6 / T_s)):
            total += env.step(scaled(309.0 if k * T_s < 3 else 300.0))[1]
        totals.append(total)
    assert totals == pytest.approx([totals[0]] * 3, rel=1e-3)


@pytest.mark.parametrize("option", [{"plant": 5}, {"max_move": "a"}])
def test_options_that_are_none_are_refused_by_name(option):
    with pytest.raises(SettingsError, match=f"{next(iter(option))} must be"):
        cstr_env(**option)


def test_ending_an_episode_unsafely_never_pays():
    env = cstr_env()
    env.reset(options={"x0": [395.0, 9.0]})
    assert env.step(np.ones(1))[1] < -400
    env.reset()
    total, done = 0.0, False
    while not done:
        _, reward, *ends, _ = env.step(-np.ones(1))
        total, done = total + reward, any(ends)
    assert total > -100


def test_moves_are_free_unless_limited():
    env = gym.make("prefcal/CSTR-v0")
    env.reset()
    assert env.step(np.array([1.0]))[4]["u"] == [310.0]
    env = gym.make("prefcal/CSTR-v0", max_move=10.0)
    _, info = env.reset()
    assert env.step(np.array([1.0]))[4]["u"] == info["u"] + 10.0
