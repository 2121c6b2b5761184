"""A scene in plain data."""

import json

import pytest

from prefcal_env.envs.overtake import OvertakeOptions
from prefcal_env.envs.overtake.scene import DRIVERS, paper_scene
from prefcal_env.errors import PlantError, SettingsError


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
