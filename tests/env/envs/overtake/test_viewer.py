"""Pictures are highway-env's, not black, right side up and in the right colors."""

import numpy as np
import pytest

from prefcal_env.envs.overtake import OvertakeEnv
from prefcal_env.envs.overtake.vehicles import CRASHED, OTHER, OWN
from prefcal_env.plants.bicycle import KMH

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
