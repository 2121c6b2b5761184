"""What users of highway-env expect of an environment of theirs and of its pictures, on ours."""

import gymnasium as gym
import numpy as np
import pytest
from highway_env.envs.common.abstract import AbstractEnv
from highway_env.vehicle.behavior import IDMVehicle
from highway_env.vehicle.kinematics import Vehicle

from prefcal_env.envs.overtake import Course, Mishap, OvertakeEnv
from prefcal_env.envs.overtake.vehicles import CRASHED, OTHER, OWN, OwnVehicle, Track
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.plants.bicycle import KMH

TRAFFIC = {
    "the paper's": {},
    "drivers": {"vehicles_count": 3},
    "on three lanes": {"vehicles_count": 4, "vehicles_density": 2, "lanes_count": 3},
    "aggressive": {
        "vehicles_count": 3,
        "other_vehicles_type": "highway_env.vehicle.behavior.AggressiveVehicle",
    },
}
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
    env.reset(options={"config": {"lanes_count": 4, "vehicles_count": 1}, "T_s": 0.3})
    env.step(np.zeros(2))
    assert env.unwrapped.time == 0.3
    env.reset()
    env.step(np.zeros(2))
    assert env.unwrapped.time == 0.1
    assert len(env.unwrapped.road.network.lanes_list()) == 4
    assert isinstance(env.unwrapped.road.vehicles[2], IDMVehicle)


KINDS = [{"type": kind} for kind in ("Kinematics", "OccupancyGrid", "LidarObservation")]


@pytest.mark.parametrize("seen", [*KINDS, {"type": "TupleObservation", "observation_configs": KINDS[:2]}])
def test_it_observes_as_highway_env_does(seen):
    env = make({"observation": seen, **TRAFFIC["on three lanes"]}, x0=[10.0, 0.0, 0.0])
    before, _ = env.reset(seed=0)
    assert env.observation_space.contains(before)
    for _ in range(3):
        observation, *_ = env.step(np.zeros(2))
    assert env.observation_space.contains(observation)
    assert not np.array_equal(before[0], observation[0])


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
    drawn = "vehicles_count" in config
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


@pytest.mark.parametrize("T_s", [0.085, 0.123456, 0.31, 0.5])
def test_no_part_of_a_period_is_lost_to_drivers(T_s):
    env = OvertakeEnv({"vehicles_count": 1}, T_s=T_s)
    env.reset(seed=0)
    while env.end is None:
        env.apply(np.array([40 * KMH, 0.0]))
    record = env.record()
    x, v = record.signals["obstacle2_x"], record.signals["obstacle2_v"]
    assert env.end is End.TIME_UP
    assert x[-1] - x[0] == pytest.approx(np.trapezoid(v, record.t), rel=0.01)
    assert record.t[-1] >= 15 - 1e-9


def test_drivers_are_ahead_at_most_as_fast_and_as_large_as_we():
    env = OvertakeEnv({"vehicles_count": 4})
    env.reset(seed=0)
    drivers = env.road.vehicles[2:]
    ahead = [driver.position[0] for driver in drivers]
    assert min(ahead) > 30 - 2.25
    assert ahead == sorted(ahead)
    assert all(42 * KMH <= driver.speed <= 48 * KMH for driver in drivers)
    assert {(driver.LENGTH, driver.WIDTH) for driver in drivers} == {(4.5, 1.8)}
    assert len({driver.DELTA for driver in drivers}) == 4


def test_a_driver_whom_we_hit_is_shown_where_we_hit_him():
    env = OvertakeEnv({"vehicles_count": 12, "vehicles_density": 5}, T_s=0.5)
    env.reset(seed=1, options={"x0": (0.0, 4.0, 0.0)})
    while env.end is None:
        env.apply(np.array([70 * KMH, 0.0]))
    assert env.mishap is Mishap.COLLISION
    signals = env.record().signals
    for i, vehicle in enumerate(env.road.vehicles[1:], start=1):
        name = "obstacle" if i == 1 else f"obstacle{i}"
        front = vehicle.position[0] + 2.25 * np.cos(vehicle.heading)
        assert front == pytest.approx(signals[f"{name}_x"][-1], abs=1e-9)
    assert env.road.vehicles[0].crashed


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


def test_a_track_is_straight_between_two_instants():
    track = Track()
    track.add(0.0, 10.0, 0.0, 0.0, 12.0)
    track.add(0.5, 16.0, 1.0, 0.1, 14.0)
    expected = np.array([[10, 0, 0, 12], [13, 0.5, 0.05, 13], [16, 1, 0.1, 14]])
    assert track.at(np.array([0.0, 0.25, 0.5])) == pytest.approx(expected)


SIZE = (960, 176)


def where(frame: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the pixels of one color, shape (n, 2)."""
    return np.argwhere(np.all(frame == color, axis=2))


def picture(x0, **config) -> np.ndarray:
    env = OvertakeEnv(config, T_s=0.3, x0=x0, render_mode="rgb_array")
    env.reset()
    frame = env.render()
    env.close()
    return frame


@pytest.mark.parametrize("driver", ["dummy", None])
def test_a_picture_needs_no_display(driver, monkeypatch):
    monkeypatch.delenv("SDL_VIDEODRIVER", raising=False)
    if driver is not None:
        monkeypatch.setenv("SDL_VIDEODRIVER", driver)
    frame = picture((0.0, 0.0, 0.0))
    assert frame.shape == (SIZE[1], SIZE[0], 3)
    assert frame.dtype == np.uint8
    assert frame.mean() > 50
    assert len(where(frame, OWN)) > 300
    assert len(where(frame, OTHER)) > 300


@pytest.mark.parametrize("T_s", [0.123456, 0.5])
def test_the_own_car_goes_ahead_and_left_is_up(T_s):
    env = OvertakeEnv(render_mode="rgb_array")
    env.reset(options={"T_s": T_s, "x0": (0.0, 3.0, 0.0)})
    ahead = []
    while env.end is None:
        env.apply(np.array([70 * KMH, 0.0]))
        frame = env.render()
        own, other = where(frame, OWN), where(frame, OTHER)
        if len(other):
            assert own[:, 0].max() < other[:, 0].min()
            ahead.append(other[:, 1].mean() - own[:, 1].mean())
    assert ahead[0] > 300
    assert ahead[-1] < 0
    assert np.all(np.diff(ahead) < 0)


@pytest.mark.parametrize("lanes", [2, 4])
def test_the_picture_is_to_scale_and_as_high_as_its_lanes(lanes):
    frame = picture((0.0, 0.0, 0.0), lanes_count=lanes)
    assert frame.shape[0] == SIZE[1] + (lanes - 2) * 4 * 12
    own, other = (where(frame, color)[:, 1].min() for color in (OWN, OTHER))
    assert other - own == pytest.approx(30 * 12, abs=2)
    assert own == pytest.approx(0.3 * SIZE[0] - 2.25 * 12, abs=3)  # the left third


def test_turning_left_turns_left():
    yaw = 0.3
    own = where(picture((0.0, 3.0, yaw)), OWN)
    front, rear = own[own[:, 1] > own[:, 1].mean()], own[own[:, 1] < own[:, 1].mean()]
    assert front[:, 0].mean() < rear[:, 0].mean()


def test_a_collision_is_seen():
    env = OvertakeEnv(render_mode="rgb_array")
    env.reset(options={"T_s": 0.5})
    while env.end is None:
        env.apply(np.array([70 * KMH, 0.0]))
    assert len(where(env.render(), CRASHED)) > 300


@pytest.mark.parametrize("T_s", [0.1, 0.25, 0.5])
def test_a_video_plays_in_real_time(T_s):
    class Video:
        frames_per_sec = None

    env, video = OvertakeEnv(T_s=T_s, render_mode="rgb_array"), Video()
    env.set_record_video_wrapper(video)
    env.reset()
    for _ in range(4):
        env.render()
        env.step(np.zeros(2))
    assert 4 / video.frames_per_sec == pytest.approx(4 * T_s)
