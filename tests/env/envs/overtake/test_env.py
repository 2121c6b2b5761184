"""The overtaking: section IV-B, exact in time, with its rules and its scenes in plain data."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.overtake import Course, Mishap, OvertakeEnv, OvertakeOptions
from prefcal_env.envs.overtake.scene import (
    DRIVERS,
    DrivePhase,
    beside,
    clearance,
    gap,
    next_phase,
    paper_scene,
)
from prefcal_env.errors import PlantError, ProtocolError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.cases.overtake import compute_kpis
from prefcal_scenarios.cases.overtake.controller import STEERING_LIMITS, controller
from support.new_process import in_a_new_process

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
        "import numpy as np\n"
        "from prefcal_scenarios import load\n"
        "e = load('overtake').run(np.array([0.3, 0.5, 12, -1, 1]))\n"
        "print({'highway_env', 'pygame', 'matplotlib'} & set(sys.modules))"
    )
    assert in_a_new_process(code) == "set()"


BEFORE = np.load(Path(__file__).parent / "before.npz")
NAMES = ("paper_step", "slow_step")


@pytest.mark.parametrize("name", NAMES)
def test_the_same_inputs_drive_the_same_way(name):
    driven = Course()
    driven.reset(options={"T_s": BEFORE[f"{name}.theta"][0]})
    for u in BEFORE[f"{name}.u_control"]:
        driven.apply(u)
    record = driven.record()
    for what, now in [("t", record.t), ("x", record.x), *record.signals.items()]:
        if f"{name}.{what}" in BEFORE:
            np.testing.assert_allclose(now[::9], BEFORE[f"{name}.{what}"], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_has_the_same_indicators(name):
    theta = BEFORE[f"{name}.theta"]
    driver = controller(theta, STEERING_LIMITS["per step"])
    e = rollout(Course(), driver, theta, kpis=compute_kpis)
    np.testing.assert_allclose(list(e.kpis.values()), BEFORE[f"{name}.kpis"], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(e.x[::9], BEFORE[f"{name}.x"], rtol=0, atol=1e-9)


KEEP, PASS = DrivePhase.LANE_KEEPING, DrivePhase.OVERTAKING
positions = st.floats(-200, 200)


def at(*x: float, y: float = 0.0) -> np.ndarray:
    return np.array([(x_o, y, 11.0) for x_o in x]).reshape(-1, 3)


def test_gap_and_clearance_are_between_the_bodies():
    assert gap(0.0, 30.0) == 25.5
    assert clearance(30.0, 0.0) == 25.5
    assert gap(10.0, np.array([30.0, 40.0])).tolist() == [15.5, 25.5]


@pytest.mark.parametrize(
    ("before", "x_f", "after"),
    [
        (KEEP, 0.0, KEEP),
        (KEEP, 15.5, KEEP),  # gap 10
        (KEEP, 15.6, PASS),
        (KEEP, 25.5, KEEP),  # gap 0
        (PASS, 15.0, PASS),  # fell back: it is not passed yet
        (PASS, 30.0, PASS),
        (PASS, 44.5, PASS),  # clearance 10
        (PASS, 44.6, KEEP),
    ],
)
def test_the_paper_overtakes_from_10_m_behind_to_10_m_ahead(before, x_f, after):
    assert next_phase(before, x_f, at(30.0)) is after


def test_on_an_empty_road_the_lane_is_kept():
    assert next_phase(KEEP, 0.0, at()) is KEEP
    assert next_phase(PASS, 0.0, at()) is KEEP


def test_a_second_obstacle_is_overtaken_in_its_turn():
    assert next_phase(PASS, 45.0, at(30.0, 200.0)) is KEEP
    assert next_phase(KEEP, 190.0, at(30.0, 200.0)) is PASS
    assert next_phase(PASS, 45.0, at(30.0, 55.0)) is PASS  # gap 5.5 to the second


def test_who_drives_in_the_left_lane_is_not_overtaken():
    assert next_phase(KEEP, 20.0, at(30.0, y=4.0)) is KEEP
    assert len(beside(20.0, at(30.0, y=4.0))) == 0


@given(phase=st.sampled_from(DrivePhase), x_f=positions, x_o=st.lists(positions, max_size=4))
def test_the_order_of_obstacles_does_not_matter(phase, x_f, x_o):
    assert next_phase(phase, x_f, at(*x_o)) is next_phase(phase, x_f, at(*reversed(x_o)))


@given(x_f=positions, x_o=positions)
def test_one_obstacle_beside_means_overtaking_goes_on(x_f, x_o):
    if len(beside(x_f, at(x_o))):
        assert next_phase(PASS, x_f, at(x_o)) is PASS


def test_a_scene_is_plain_data():
    scene = {"lanes_count": 3, "vehicles_count": 2, "duration": 20, "x0": [1, 0, 0]}
    options = OvertakeOptions.of(json.loads(json.dumps(scene)))
    assert options == OvertakeOptions((1, 0, 0), 20, lanes_count=3, vehicles_count=2)
    assert options.other_vehicles_type == DRIVERS[0]


def test_the_papers_scene_is_the_default():
    assert OvertakeOptions.of(json.loads(json.dumps(paper_scene()))) == OvertakeOptions()
    assert OvertakeOptions.of({}) == OvertakeOptions()


def test_the_road_is_as_wide_as_its_lanes():
    assert OvertakeOptions().road == (-2, 6)
    assert OvertakeOptions(lanes_count=4).road == (-2, 14)


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ({"lanes": 2}, "unknown keys \\['lanes'\\]"),
        ({"lanes_count": 0}, "lanes_count"),
        ({"lanes_count": True}, "lanes_count"),
        ({"duration": 0}, "duration"),
        ({"vehicles_count": -1}, "vehicles_count"),
        ({"vehicles_count": 1.5}, "vehicles_count"),
        ({"vehicles_density": 0}, "vehicles_density"),
        ({"simulation_frequency": "fast"}, "simulation_frequency"),
        ({"other_vehicles_type": "os.system"}, "other_vehicles_type"),
        ({"other_vehicles_type": ["IDMVehicle"]}, "other_vehicles_type"),
    ],
)
def test_what_cannot_be_is_refused_by_name(scene, says):
    with pytest.raises(SettingsError, match=says):
        OvertakeOptions.of(scene)


def test_a_start_that_is_no_pose_is_refused():
    with pytest.raises(PlantError, match="x0"):
        OvertakeOptions.of({"x0": [0, 0]})
