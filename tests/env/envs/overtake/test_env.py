"""The overtaking: section IV-B, exact in time, and it ends for a stated reason."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.envs.overtake import Course, Mishap, OvertakeEnv
from prefcal_env.errors import PlantError, ProtocolError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.plants.bicycle import KMH

sampling_times = st.floats(0.085, 0.5)
LEFT = {"x0": (0.0, 3.0, 0.0)}


def drive(env, u, seed=0, **options):
    """A whole episode with u held; return its record."""
    env.reset(seed=seed, options=options)
    while env.end is None:
        env.apply(np.array(u))
    return env.record()


@given(T_s=sampling_times)
@settings(max_examples=10)
def test_time_is_exact(T_s):
    env = OvertakeEnv()
    record = drive(env, (50 * KMH, 0.0), T_s=T_s, **LEFT)
    n = len(record.t_control)
    np.testing.assert_allclose(record.t_control, np.arange(n) * T_s, rtol=0, atol=1e-12)
    assert record.t[-1] == pytest.approx(n * T_s, abs=1e-12)
    assert record.t[-1] - T_s < 15 - 1e-9 <= record.t[-1]
    assert np.diff(record.t).max() <= 0.02 + 1e-12
    assert record.x[-1, 0] == pytest.approx(50 * KMH * record.t[-1], abs=1e-9)
    assert (env.end, env.mishap) == (End.TIME_UP, None)


@given(T_s=sampling_times)
@settings(max_examples=10)
def test_straight_ahead_at_70_kmh_it_hits_the_obstacle_when_it_must(T_s):
    env = OvertakeEnv()
    record = drive(env, (70 * KMH, 0.0), T_s=T_s)
    assert record.t[-1] == pytest.approx(25.5 / (30 * KMH), abs=1e-3)
    assert (env.end, env.mishap) == (End.UNSAFE, Mishap.COLLISION)
    assert 0 <= record.signals["separation"][-1] < 1e-3
    assert np.all(np.diff(record.t) > 0)


def test_a_collision_terminates_and_costs_the_rest_of_the_horizon():
    env = OvertakeEnv()
    env.reset(options={"T_s": 0.5})
    for _ in range(6):
        assert env.step(np.array([1.0, 0.0]))[1:4] == (pytest.approx(-0.5, abs=0.3), False, False)
    *_, reward, terminated, truncated, info = env.step(np.array([1.0, 0.0]))
    assert (terminated, truncated, info["mishap"], info["end"]) == (True, False, "collision", "unsafe")
    assert reward == pytest.approx(-10 * (15 - 3.06), abs=0.2)


@pytest.mark.parametrize("steering", [-0.7, 0.7])
def test_leaving_the_road_by_more_than_a_meter_terminates(steering):
    env = OvertakeEnv()
    record = drive(env, (50 * KMH, steering))
    assert (env.end, env.mishap) == (End.UNSAFE, Mishap.OFF_ROAD)
    assert record.signals["outside"][-2] <= 1 < record.signals["outside"][-1]


def test_the_phases_are_those_of_the_paper():
    env = OvertakeEnv()
    signals = drive(env, (60 * KMH, 0.0), T_s=0.1, **LEFT).signals
    overtaking = np.flatnonzero(signals["phase"])
    # held from the first sample with a gap below 10 m to the one with a clearance above it
    x, t = env.record().x[:, 0], env.record().t
    before, after = overtaking[0], overtaking[-1] + 1
    assert signals["gap"][before] < 10 <= signals["gap"][before] + 0.1 * 20 * KMH
    clearance = x - 4.5 - signals["obstacle_x"]
    assert clearance[after] > 10 >= clearance[after] - 0.1 * 20 * KMH
    assert t[before] == pytest.approx(2.8)  # (25.5 - 10)/(20 km/h) = 2.79 s
    assert set(signals["speed_reference"][overtaking]) == {60 * KMH}
    assert set(signals["speed_low"][:before]) == {40 * KMH}


def test_what_a_controller_knows():
    env = OvertakeEnv()
    env.reset(options={"T_s": 0.5})
    env.apply(np.array([60 * KMH, 0.1]))
    m = env.measurement()
    assert m.t == 0.5
    assert m.x == pytest.approx(env.record().x[-1])
    assert m.u.tolist() == [60 * KMH, 0.1]
    assert m.d == pytest.approx([30 + 40 * KMH * 0.5, 0, 40 * KMH])
    assert m.y_ref.tolist() == [m.x[0], 0, 0]


def test_the_observation_is_scaled_in_the_order_of_the_design():
    observation, info = OvertakeEnv().reset()
    expected = [2 * 10 / 30 - 1, 0, -0.4, 0, 25.5 / 30, 0, -1]
    assert observation == pytest.approx(expected, abs=1e-6)
    assert info["gap"] == 25.5
    assert info["phase"] == 0


def test_inputs_saturate():
    env = OvertakeEnv()
    env.reset()
    env.apply(np.array([1e9, -np.inf]))
    assert env.measurement().u == pytest.approx([70 * KMH, -np.pi / 4])


def test_the_total_reward_does_not_depend_on_the_sampling_time():
    totals = []
    for T_s in (0.1, 0.25, 0.5):
        env, total = OvertakeEnv(), 0.0
        env.reset(options={"T_s": T_s, **LEFT})
        while env.end is None:
            total += env.step(np.array([-1 / 3, 0.0]))[1]
        totals.append(total)
    assert totals == pytest.approx([totals[0]] * 3, rel=0.05)  # a phase begins at a sample


def test_ending_an_episode_early_never_pays():
    totals = []
    for action in ([-1 / 3, 0.0], [1.0, 1.0]):
        env, total = OvertakeEnv(), 0.0
        env.reset(options=LEFT)
        while env.end is None:
            total += env.step(np.array(action))[1]
        totals.append(total)
    assert totals[1] < totals[0]


def test_an_impossible_start_is_refused():
    env = OvertakeEnv()
    for x0, why in [((26.0, 0, 0), "collision"), ((0, 9.0, 0), "off the road"), ((0, 0), "shape")]:
        with pytest.raises(PlantError, match=why):
            env.reset(options={"x0": x0})
    for options in ({"T_s": 0.08}, {"T_s": "fast"}, {"T_s": np.nan}, {"speed": 3}):
        with pytest.raises(SettingsError):
            env.reset(options=options)


IMPOSSIBLE = (
    *({"policy_frequency": hertz} for hertz in (0, 1, 100)),
    *({"T_s": seconds} for seconds in (0, 1.0, "fast")),
    *({"observation": seen} for seen in ("Kinematics", {"type": "TimeToCollision"})),
    {"action": {"type": "DiscreteMetaAction"}},
    ["traffic"],
)


@pytest.mark.parametrize(
    "keywords", [*({"config": config} for config in IMPOSSIBLE), {"render_mode": "human"}, {"T_s": 1.0}]
)
def test_an_impossible_configuration_or_keyword_is_refused(keywords):
    with pytest.raises(SettingsError):
        OvertakeEnv(**keywords)


def test_a_wrong_input_or_one_out_of_turn_is_refused():
    env = OvertakeEnv()
    with pytest.raises(ProtocolError, match="reset"):
        Course().apply(np.zeros(2))
    for bad in (np.zeros(3), np.array([np.nan, 0.0]), "fast"):
        with pytest.raises(PlantError, match="input u"):
            env.apply(bad)
    drive(env, (70 * KMH, 0.0))
    with pytest.raises(ProtocolError, match="over"):
        env.step(np.zeros(2))


def test_an_experiment_in_the_papers_scene_loads_neither_highway_env_nor_pygame():
    code = (
        "import sys, numpy as np\n"
        "from prefcal_scenarios import load\n"
        "e = load('overtake').run(np.array([0.3, 0.5, 12, -1, 1]))\n"
        "print({'highway_env', 'pygame', 'matplotlib'} & set(sys.modules))"
    )
    program = f"import sys; sys.path[:0] = {sys.path!r}\n{code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
