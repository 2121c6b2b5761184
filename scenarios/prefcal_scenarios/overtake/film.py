"""An overtaking in motion: the best run above the first, seen from above, as a GIF."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from prefcal_env.envs.overtake.geometry import corners
from prefcal_env.experiment import Experiment
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.overtake.scene import lines_of, obstacles, road_of
from prefcal_scenarios.overtake.shown import (
    ASPHALT,
    DASH,
    OBSTACLE,
    PAINT,
    PERIOD,
    Shown,
    runs,
    windows,
)
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.style import FAINT, INK

RATE = 8
"""Frames a second."""
_FINE = 2
"""Drawn so many times as large, then made smaller: smooth edges."""
_SCALE = 10
"""Pixels a metre."""
_BEHIND, _AHEAD = 42.0, 42.0
"""What is seen of the road behind and ahead of the front end [m]."""
_WORDS, _MARGIN = 34, 26
"""Heights of the line of text above a road, and of the marks below it [pixels]."""
_WIDTH = int((_BEHIND + _AHEAD) * _SCALE)
_WHITE = "#ffffff"
_PALE = 0.55
"""How much of the path's colour the asphalt takes."""


@dataclass(frozen=True, slots=True)
class Instant:
    """Where everything is at a time: own pose [m, rad], speed [km/h], front ends [m]."""

    pose: Float[np.ndarray, " 3"]
    speed: float
    others: Float[np.ndarray, "n 2"]


def instant(experiment: Experiment, time: float) -> Instant:
    """At `time` [s], between samples linearly; after the end as it was there."""
    t = experiment.t
    pose = np.array([np.interp(time, t, experiment.x[:, i]) for i in range(3)])
    others = [[np.interp(time, t, c) for c in o.T] for o in obstacles(experiment)]
    k = max(int(np.searchsorted(t, time + 1e-9, side="right")) - 1, 0)
    speed = float(experiment.u[k, 0] / KMH)
    return Instant(pose, speed, np.array(others).reshape(-1, 2))


def gif(record: Record) -> bytes:
    """The animation, `RATE` frames a second in real time, without end."""
    shown = runs(record)
    last = max(s.experiment.t[-1] for s in shown)
    frames = [_frame(shown, k / RATE) for k in range(int(np.ceil(last * RATE)) + 1)]
    palette = frames[len(frames) // 2].quantize(64, dither=Image.Dither.NONE)
    flat = [f.quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    # Times in a GIF are whole hundredths: 12 and 13 in turn are an eighth on average.
    ends = [round(100 * (k + 1) / RATE) for k in range(len(flat))]
    durations = [10 * (b - a) for a, b in zip([0, *ends], ends, strict=False)]
    durations[-1] = 2000
    buffer = BytesIO()
    flat[0].save(
        buffer, format="GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0,
        optimize=False, disposal=1,
    )  # fmt: skip
    return buffer.getvalue()


def _frame(shown: Sequence[Shown], time: float) -> Image.Image:
    scenes = [_scene(run, time) for run in shown]
    image = Image.new("RGB", (_WIDTH, sum(scene.height for scene in scenes)), _WHITE)
    top = 0
    for scene in scenes:
        image.paste(scene, (0, top))
        top += scene.height
    return image


def _scene(run: Shown, time: float) -> Image.Image:
    now = instant(run.experiment, time)
    low, high = road_of(run.experiment)
    view = _View(float(now.pose[0]), (low, high))
    height = int((high - low) * _SCALE) + _WORDS + _MARGIN
    image = Image.new("RGB", (_WIDTH * _FINE, height * _FINE), _WHITE)
    draw = ImageDraw.Draw(image)
    _road(draw, view)
    x, y = run.experiment.x[:, 0], run.experiment.x[:, 1]
    seen = np.abs(x - now.pose[0]) < _BEHIND + 5
    if seen.sum() > 1:
        path = view.points(np.column_stack([x, y])[seen])
        draw.line(path, fill=_mixed(run.color, ASPHALT, _PALE), width=2 * _FINE, joint="curve")
    for other in now.others:
        _body(draw, view, np.append(other, 0.0), OBSTACLE)
    _body(draw, view, now.pose, run.color)
    _words(draw, run, min(time, float(run.experiment.t[-1])), now.speed)
    return image.reduce(_FINE)


@dataclass(frozen=True, slots=True)
class _View:
    """The camera: from meters to pixels of the fine picture, around `x` [m]; edges of the road."""

    x: float
    road: tuple[float, float]

    def points(self, at: Float[np.ndarray, "n 2"]) -> list[tuple[float, float]]:
        across = (at[:, 0] - self.x + _BEHIND) * _SCALE * _FINE
        down = ((self.road[1] - at[:, 1]) * _SCALE + _WORDS) * _FINE
        return list(zip(across.tolist(), down.tolist(), strict=True))


def _road(draw: ImageDraw.ImageDraw, view: _View) -> None:
    start, end = view.x - _BEHIND, view.x + _AHEAD
    low, high = view.road
    draw.rectangle(view.points(np.array([[start, high], [end, low]])), fill=ASPHALT)
    for side in view.road:
        line = view.points(np.array([[start, side], [end, side]]))
        draw.line(line, fill=PAINT, width=2 * _FINE)
    for dash in np.arange(np.floor(start / PERIOD) * PERIOD, end, PERIOD):
        for y in lines_of(view.road):
            line = view.points(np.array([[dash, y], [dash + DASH, y]]))
            draw.line(line, fill=PAINT, width=2 * _FINE)
    for mark in np.arange(np.ceil(start / 20) * 20, end, 20.0):
        ((x, y),) = view.points(np.array([[mark, low]]))
        draw.line([(x, y), (x, y + 4 * _FINE)], fill=PAINT, width=_FINE)
        draw.text((x, y + 5 * _FINE), f"{mark:.0f} m", FAINT, _font(11), anchor="ma")


def _body(
    draw: ImageDraw.ImageDraw, view: _View, pose: Float[np.ndarray, " 3"], color: str
) -> None:
    """Outline of 4.5 x 1.8 m, with windscreen and rear window."""
    outline = corners(pose[None])[0]
    draw.polygon(view.points(outline), fill=color, outline=_WHITE, width=_FINE)
    for part in windows(outline):
        draw.polygon(view.points(part), fill=_mixed(color, _WHITE, 0.78))


def _words(draw: ImageDraw.ImageDraw, run: Shown, time: float, speed: float) -> None:
    line = 22 * _FINE
    draw.text((10 * _FINE, line), run.label, run.color, _font(15, bold=True), anchor="ls")
    right = (_WIDTH - 10) * _FINE
    draw.text((right, line), f"{speed:.0f} km/h", INK, _font(15), anchor="rs")
    # A cross says that the run was stopped.
    ended = run.experiment.end.interrupted and time >= run.experiment.t[-1]
    text = f"× stopped at {time:.1f} s" if ended else f"{time:.1f} s"
    draw.text((right - 90 * _FINE, line), text, INK, _font(15), anchor="rs")


@cache
def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(Path(get_data_path()) / "fonts" / "ttf" / name, size * _FINE)


def _mixed(color: str, other: str, share: float) -> tuple[int, int, int]:
    """`color` with a share of `other`."""
    pairs = [(int(color[i : i + 2], 16), int(other[i : i + 2], 16)) for i in (1, 3, 5)]
    r, g, b = (round((1 - share) * a + share * o) for a, o in pairs)
    return r, g, b
