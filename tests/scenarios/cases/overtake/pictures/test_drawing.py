"""The drawing of an overtaking: what every picture and animation of the road shows."""

import json
from dataclasses import replace

import numpy as np
import pytest
from prefcal_scenarios.cases.overtake.pictures.drawing import BODY, Drawing, animation

from prefcal_env.envs.overtake.road.geometry import corners
from prefcal_scenarios import load
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.own.source import joined_source

RUN = overtake.run(overtake.references["paper, preferences"])
DRAWING = Drawing.of(RUN)
CUTS_IN = [{"type": "cut-in", "x": 40.0, "speed": 13.8, "moves_at": 1.0, "moves_within": 2.0}]


def polygons(frame, role):
    return [p.points for p in frame.polygons if p.role == role]


def test_between_samples_cars_move_linearly_and_after_the_end_they_stay():
    t = RUN.t
    middle = DRAWING.at((t[10] + t[11]) / 2)
    assert middle.own == pytest.approx((RUN.x[10, :3] + RUN.x[11, :3]) / 2)
    assert np.array_equal(DRAWING.at(100.0).own, RUN.x[-1, :3])


def test_a_frame_shows_both_cars_to_scale_where_they_are():
    time = float(RUN.t[-1]) / 2
    frame = DRAWING.frame(time, 0.0, 300.0)
    now = DRAWING.at(time)
    for role, pose in (("own", now.own), ("other", now.others[0])):
        (outline,) = polygons(frame, role)
        # Round corners lie inside the rectangle, and touch its sides.
        back = (outline - pose[:2]) @ np.array(
            [[np.cos(pose[2]), -np.sin(pose[2])], [np.sin(pose[2]), np.cos(pose[2])]]
        )
        rectangle = corners(np.zeros((1, 3)))[0]
        assert back.min(axis=0) == pytest.approx(rectangle.min(axis=0))
        assert back.max(axis=0) == pytest.approx(rectangle.max(axis=0))
    assert len(polygons(frame, "glass")) == 4


def test_the_trace_ends_at_the_car_and_the_path_goes_on():
    frame = DRAWING.frame(5.0, -10.0, 400.0)
    lines = {line.role: line.points for line in frame.lines}
    assert lines["trace"][-1] == pytest.approx(DRAWING.at(5.0).own[:2])
    assert lines["path"][-1] == pytest.approx(RUN.x[-1, :2])


def test_the_road_has_its_edges_its_dashes_and_distance_marks():
    ground = DRAWING.ground(-10.0, 50.0)
    paint = [line.points for line in ground.lines]
    assert [p[0, 1] for p in paint[:2]] == list(DRAWING.road)
    dashes = paint[2:]
    assert {float(p[0, 1]) for p in dashes} == {2.0}
    assert all(-10 <= x <= 50 for p in dashes for x in p[:, 0])
    assert [label.text for label in ground.labels] == ["0 m", "20 m", "40 m"]


def test_browsers_get_the_same_bodies_positions_and_lines():
    data = json.loads(json.dumps(animation(RUN), allow_nan=False))
    assert [part["role"] for part in data["body"]] == [part.role for part in BODY]
    k = 37
    x, y, heading, _, *other = data["rows"][k]
    now = DRAWING.at(k * data["step"])
    assert [x, y, np.radians(heading)] == pytest.approx(now.own.tolist(), abs=0.006)
    assert other[:2] == pytest.approx(now.others[0, :2].tolist(), abs=0.006)
    assert data["lines"] == [2.0]


def test_an_obstacle_that_turns_is_drawn_turned():
    run = load(joined_source("overtake", {"traffic": CUTS_IN})).run(RUN.theta)
    headings = np.array(animation(run)["rows"])[:, 6]
    assert np.abs(headings).max() > 1  # degrees
    turned = Drawing.of(run).at(2.0).others[0, 2]
    assert turned == pytest.approx(np.radians(headings[20]), abs=1e-3)


def test_a_run_without_an_obstacle_has_one_car():
    signals = {k: v for k, v in RUN.signals.items() if not k.startswith("obstacle")}
    drawing = Drawing.of(replace(RUN, signals=signals))
    assert polygons(drawing.frame(1.0, 0.0, 50.0), "other") == []
    assert len(drawing.as_json()["rows"][0]) == 4
