"""What users of highway-env expect of an environment of theirs, on ours."""

import gymnasium as gym
import numpy as np
import pytest
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from prefcal_env.envs.overtake import Course, Mishap, Obstacle, OvertakeEnv
from prefcal_env.envs.overtake.road.vehicles import CourseVehicle, OwnVehicle
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.plants.bicycle import KMH, Bicycle

TRAFFIC = {
    "the paper's": {},
    "drivers": {"traffic": [{"type": "idm"}, {"type": "idm", "x": 60.0, "changes_lanes": True}]},
    "all kinds": {
        "traffic": [
            {"type": "constant", "x": 40.0}, {"type": "braking", "x": 80.0},
            {"type": "cut-in", "x": 25.0}, {"type": "idm", "x": -15.0, "y": 4.0},
            {"type": "oncoming", "x": 150.0, "y": 8.0},
        ],
        "oncoming_lanes_count": 1,
    },
    "drawn": {"random_traffic": {"count": 4, "types": ["idm", "braking", "constant", "cut-in"]}},
}  # fmt: skip
traffic = pytest.mark.parametrize("config", TRAFFIC.values(), ids=TRAFFIC.keys())


def make(config=None, **settings):
    return gym.make("prefcal/Overtake-v0", config=config, **settings)


@traffic
def test_it_resets_steps_and_renders(config):
    env = make(config, render_mode="rgb_array")
    observation, info = env.reset(seed=3)
    assert env.observation_space.contains(observation)
    assert not info["crashed"]
    over = False
    while not over:
        observation, reward, terminated, truncated, info = env.step(np.array([-1 / 3, 0.0]))
        over = terminated or truncated
        assert env.observation_space.contains(observation)
        assert np.isfinite(reward)
    assert env.render().shape[2] == 3
    assert info["crashed"] == (info.get("mishap") == "collision")
    assert env.unwrapped.time == info["t"] == env.unwrapped.record().t[-1]
    env.close()


def test_it_is_one_of_its_environments():
    env = make()
    env.reset(seed=0)
    road = env.unwrapped
    assert isinstance(road, AbstractEnv)
    assert road.config["duration"] == 15.0
    assert road.vehicle is road.road.vehicles[0]
    assert isinstance(road.vehicle, OwnVehicle)
    (obstacle,) = road.road.vehicles[1:]
    assert isinstance(obstacle, Vehicle)
    assert obstacle.position == pytest.approx([30 - 2.25, 0])
    assert obstacle.speed == 40 * KMH
    env.step(np.zeros(2))
    assert obstacle.position == pytest.approx([30 - 2.25 + 4 * KMH, 0])
    assert road.vehicle.position[0] == pytest.approx(-2.25 + 5.5 * KMH, abs=1e-3)


def test_a_configuration_changes_what_it_names_and_nothing_else():
    env = make({"lanes_count": 3, "policy_frequency": 5}).unwrapped
    assert env.T_s == 0.2
    changed = {k for k, v in env.config.items() if v != OvertakeEnv.default_config()[k]}
    assert changed == {"lanes_count", "policy_frequency", "offscreen_rendering"}
    assert len(env.road.network.lanes_list()) == 3
    assert OvertakeEnv.default_config()["lanes_count"] == 2


def test_reset_takes_a_configuration_from_then_on_and_the_rest_for_once():
    env = make()
    env.reset(options={"config": {"lanes_count": 4, "traffic": [{"type": "idm"}]}, "T_s": 0.3})
    env.step(np.zeros(2))
    assert env.unwrapped.time == 0.3
    env.reset()
    env.step(np.zeros(2))
    assert env.unwrapped.time == 0.1
    assert len(env.unwrapped.road.network.lanes_list()) == 4
    assert isinstance(env.unwrapped.road.vehicles[1], IDMVehicle)


@pytest.mark.parametrize("kind", ["Kinematics", "OccupancyGrid", "LidarObservation"])
def test_it_observes_as_highway_env_does(kind):
    env = make({"observation": {"type": kind}, **TRAFFIC["all kinds"]})
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    before = observation.copy()
    observation, *_ = env.step(np.zeros(2))
    assert env.observation_space.contains(observation)
    assert not np.array_equal(before, observation)


def test_it_observes_several_things_at_once():
    both = [{"type": "Kinematics"}, {"type": "OccupancyGrid"}]
    env = make({"observation": {"type": "TupleObservation", "observation_configs": both}})
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert len(observation) == 2


def test_kinematics_are_those_of_the_vehicles():
    kinematics = {"type": "Kinematics", "normalize": False, "absolute": True, "vehicles_count": 2}
    env = make({"observation": kinematics})
    (own, other), _ = env.reset(seed=0)
    assert own == pytest.approx([1, -2.25, 0, 50 * KMH, 0])
    assert other == pytest.approx([1, 27.75, 0, 40 * KMH, 0])


def test_continuous_actions_are_acceleration_and_steering_to_the_right():
    env = make({"action": {"type": "ContinuousAction", "acceleration_range": [-2, 2]}}, T_s=0.25)
    env.reset(seed=0)
    info = env.step(np.array([1.0, 0.1]))[4]
    assert info["u"] == pytest.approx([50 * KMH + 2 * 0.25, -0.1 * np.pi / 4])
    assert info["x"][1] < 0
    assert env.step(np.array([1.0, 0.0]))[4]["u"][0] == pytest.approx(50 * KMH + 4 * 0.25)


def test_discrete_actions_are_a_grid_of_these():
    env = make({"action": {"type": "DiscreteAction"}})
    env.reset(seed=0)
    assert env.step(4)[4]["u"] == pytest.approx([50 * KMH, 0])
    with pytest.raises(PlantError, match="action must be in Discrete"):
        env.unwrapped.step(9)


@traffic
def test_the_seed_decides_and_nothing_else(config):
    def positions(seed):
        env = OvertakeEnv(config)
        env.reset(seed=seed)
        for _ in range(20):
            env.step(np.array([-1 / 3, 0.05]))
        return np.array([v.position for v in env.road.vehicles])

    assert np.array_equal(positions(1), positions(1))
    drawn = "random_traffic" in config
    assert np.array_equal(positions(1), positions(2)) == (not drawn)


@traffic
def test_the_environment_shows_what_the_course_drives(config):
    env, course = OvertakeEnv(config), None
    course = Course(env.options)
    for loop in (env, course):
        loop.reset(seed=5, options={"T_s": 0.217})
        for k in range(25):
            if loop.end is None:
                loop.apply(np.array([14.0, 0.03 * np.sin(k)]))
    a, b = env.record(), course.record()
    assert np.array_equal(a.x, b.x)
    assert a.signals.keys() == b.signals.keys()
    assert all(np.array_equal(a.signals[k], b.signals[k], equal_nan=True) for k in a.signals)
    fronts = [v.position[0] + 2.25 * np.cos(v.heading) for v in env.road.vehicles]
    assert fronts[0] == pytest.approx(a.x[-1, 0], abs=1e-9)
    assert fronts[1] == pytest.approx(a.signals["obstacle_x"][-1], abs=1e-9)


def test_its_vehicles_drive_by_themselves_too():
    """As for those who copy the road and look ahead."""
    env = OvertakeEnv()
    env.reset(seed=0)
    env.apply(np.array([15.0, 0.2]))
    own, other = env.road.vehicles
    start, there = env.episode.x.copy(), other.position[0]
    for _ in range(7):
        env.road.act()
        env.road.step(0.1)
    expected = Bicycle().hold(start, np.array([15.0, 0.2]), np.zeros(0), np.array([0.7]))[0]
    assert own.x == pytest.approx(expected, abs=1e-12)
    assert isinstance(other, CourseVehicle)
    assert other.position[0] == pytest.approx(there + 0.7 * 40 * KMH)


@pytest.mark.parametrize("T_s", [0.085, 0.123456, 0.31, 0.5])
def test_no_part_of_a_period_is_lost_to_drivers(T_s):
    env = OvertakeEnv({"traffic": [{"type": "idm", "x": 60.0, "speed": 13.0}]}, T_s=T_s)
    env.reset(seed=0)
    while env.end is None:
        env.apply(np.array([40 * KMH, 0.0]))
    record = env.record()
    assert env.end is End.TIME_UP
    assert record.signals["obstacle_x"][-1] == pytest.approx(60 + 13.0 * record.t[-1], abs=1e-9)


def test_a_driver_brakes_behind_us_and_another_runs_into_nobody():
    behind = {"type": "idm", "x": -12.0, "speed": 18.0}
    env = OvertakeEnv({"traffic": [{"type": "constant", "x": 200.0}, behind]})
    env.reset(seed=0)
    while env.end is None:
        env.apply(np.array([40 * KMH, 0.0]))
    signals = env.record().signals
    assert env.end is End.TIME_UP
    assert signals["obstacle2_v"][-1] == pytest.approx(40 * KMH, abs=0.5)
    assert np.all(signals["obstacle2_x"] < env.record().x[:, 0] - 4.5)


def test_a_driver_that_changes_lanes_turns():
    slow = {"type": "constant", "x": 40.0, "speed": 2.0}
    driver = {"type": "idm", "x": 15.0, "speed": 12.0, "changes_lanes": True}
    env = OvertakeEnv({"traffic": [slow, driver]})
    env.reset(seed=0)
    while env.end is None:
        env.apply(np.array([40 * KMH, 0.0]))
    signals = env.record().signals
    assert signals["obstacle2_y"].max() == pytest.approx(4.0, abs=0.6)
    assert np.abs(signals["obstacle2_yaw"]).max() > 0.02


def test_who_comes_towards_us_in_our_lane_is_met_when_he_must_be():
    toward = {"type": "oncoming", "x": 100.0, "speed": 15.0}
    env = OvertakeEnv({"traffic": [toward]})
    env.reset(seed=0)
    assert env.road.vehicles[1].heading == pytest.approx(np.pi)
    while env.end is None:
        env.apply(np.array([15.0, 0.0]))
    assert env.mishap is Mishap.COLLISION
    assert env.record().t[-1] == pytest.approx(100 / 30, abs=1e-3)
    assert env.road.vehicles[0].crashed


def test_who_cuts_in_is_in_our_lane_in_the_end():
    course = Obstacle(30.0, 4.0, 12.0, moves_to=0.0, moves_at=2.0)
    poses = course.poses(np.array([0.0, 2.0, 3.5, 5.0, 9.0]))
    assert poses[:, 1] == pytest.approx([4, 4, 2, 0, 0])
    assert poses[:, 2] == pytest.approx([0, 0, np.arctan2(-4 * 1.875 / 3, 12), 0, 0])
    assert poses[:, 0] == pytest.approx(30 + 12 * np.array([0, 2, 3.5, 5, 9]))


def test_frequencies_widths_and_types_that_cannot_be_are_refused():
    for config in (
        {"lanes": 3}, {"observation": {"type": "TimeToCollision"}}, {"observation": "Kinematics"},
        {"action": {"type": "DiscreteMetaAction"}}, {"policy_frequency": 100},
        {"other_vehicles_type": "os.system"}, {"policy_frequency": 0}, {"T_s": 0}, {"T_s": "fast"},
    ):  # fmt: skip
        with pytest.raises(SettingsError):
            OvertakeEnv(config)
    with pytest.raises(SettingsError, match="reset options"):
        OvertakeEnv().reset(options={"speed": 3})


def test_a_refused_configuration_changes_nothing():
    env = OvertakeEnv()
    before = dict(env.config)
    with pytest.raises(SettingsError, match="duration"):
        env.reset(options={"config": {"lanes_count": 3, "duration": -1}})
    assert env.config == before
    assert env.options.lanes_count == 2


def test_what_is_written_into_the_configuration_counts_from_the_next_reset():
    env = OvertakeEnv()
    env.reset()
    before = len(env.road.network.lanes_list())
    env.unwrapped.config["lanes_count"] += 1
    env.reset()
    assert len(env.road.network.lanes_list()) == before + 1


@pytest.mark.parametrize(("key", "value"), [("lanes_count", "many"), ("lane_count", 3)])
def test_what_is_written_wrongly_into_the_configuration_is_refused_by_name(key, value):
    env = OvertakeEnv()
    env.config[key] = value
    with pytest.raises(SettingsError, match=key):
        env.reset()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("manual_control", True),
        ("show_trajectories", "maybe"),
        ("scaling", "large"),
        ("scaling", -1),
        ("screen_width", 0),
        ("screen_width", None),
        ("screen_height", 90.5),
        ("centering_position", 0.5),
        ("centering_position", [0.5, 2]),
    ],
)
def test_pictures_that_cannot_be_drawn_are_refused_by_name(key, value):
    with pytest.raises(SettingsError, match=key):
        OvertakeEnv({key: value})
