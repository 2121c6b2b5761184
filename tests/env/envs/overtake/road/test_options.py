"""A scene in plain data."""

import json

import numpy as np
import pytest

from prefcal_env.envs.overtake import Driver, Obstacle, OvertakeOptions, RandomTraffic, slipping_car
from prefcal_env.envs.overtake.road.options import paper_scene
from prefcal_env.errors import PlantError, SettingsError


def test_a_scene_is_plain_data():
    scene = {
        "car": "slipping", "lanes_count": 3, "noise": [0.1, 0, 0], "duration": 20,
        "traffic": [{"type": "idm", "x": 20.0}, {"type": "braking"}, {"type": "oncoming", "y": 4}],
        "random_traffic": {"count": 2, "gap": [10, 20]},
    }  # fmt: skip
    options = OvertakeOptions.of(scene)
    assert options.car.plant.name == slipping_car().plant.name
    assert options.traffic == (
        Driver(20.0), Obstacle(deceleration=1.0), Obstacle(y=4, oncoming=True)
    )  # fmt: skip
    assert options.random_traffic == RandomTraffic(2, gap=(10, 20))
    assert OvertakeOptions.of(json.loads(json.dumps(scene))).traffic == options.traffic


def test_the_papers_scene_is_the_default():
    assert OvertakeOptions.of(json.loads(json.dumps(paper_scene()))) == OvertakeOptions()
    assert OvertakeOptions.of({}) == OvertakeOptions()


def test_the_road_is_as_wide_as_its_lanes():
    assert OvertakeOptions().road == (-2, 6)
    assert OvertakeOptions(lanes_count=3, oncoming_lanes_count=1).road == (-2, 14)


def test_drawn_vehicles_are_a_queue_with_the_gaps_asked_for():
    random_traffic = RandomTraffic(5, ("constant", "idm", "braking"), gap=(20, 30), speed=(9, 10))
    vehicles = OvertakeOptions(random_traffic=random_traffic).vehicles(np.random.default_rng(0), 0)
    assert vehicles[0] == Obstacle()
    fronts = np.array([v.x for v in vehicles])
    assert np.all((np.diff(fronts) - 4.5 >= 20) & (np.diff(fronts) - 4.5 <= 30))
    assert all(9 <= v.speed <= 10 for v in vehicles[1:])


def test_drawn_oncoming_vehicles_are_in_the_other_lane():
    both = OvertakeOptions(
        lanes_count=1, oncoming_lanes_count=1, random_traffic=RandomTraffic(3, ("oncoming",))
    )
    drawn = both.vehicles(np.random.default_rng(0), 0.0)[1:]
    assert all(v.oncoming and v.y == 4.0 for v in drawn)


@pytest.mark.parametrize(
    ("scene", "says"),
    [
        ({"lanes": 2}, "unknown keys \\['lanes'\\]"),
        ({"lanes_count": 0}, "lanes_count"),
        ({"lanes_count": True}, "lanes_count"),
        ({"duration": 0}, "duration"),
        ({"traffic": []}, "one or more vehicles"),
        ({"traffic": {"type": "idm"}}, "must be a list"),
        ({"traffic": [{"type": "tank"}]}, "type of a vehicle"),
        ({"traffic": [{"type": "idm", "sped": 3}]}, "sped"),
        ({"traffic": [{"type": "idm", "speed": 0}]}, "speed"),
        ({"traffic": [{"y": 20}]}, "on the road"),
        ({"traffic": [{"x": "far"}]}, "x must be finite"),
        ({"traffic": [3]}, "a vehicle must be like"),
        ({"car": "flying"}, "car must be one of"),
        ({"random_traffic": {"count": -1}}, "count"),
        ({"random_traffic": {"count": 1, "types": ["ufo"]}}, "types"),
        ({"random_traffic": {"count": 1, "types": ["oncoming"]}}, "oncoming_lanes_count"),
        ({"random_traffic": {"count": 1, "gap": [5, 1]}}, "gap"),
        ({"random_traffic": {"count": 1, "types": ["cut-in"]}, "lanes_count": 1}, "2 lanes"),
        ({"other_vehicles_type": "os.system"}, "other_vehicles_type"),
        ({"noise": [0, -1, 0]}, "noise"),
        ({"noise": 1}, "noise must be a list"),
    ],
)
def test_what_cannot_be_is_refused_by_name(scene, says):
    with pytest.raises(SettingsError, match=says):
        OvertakeOptions.of(scene)


def test_a_start_that_is_no_pose_is_refused():
    with pytest.raises(PlantError, match="x0"):
        OvertakeOptions.of({"x0": [0, 0]})
