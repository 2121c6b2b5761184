"""The overtaking in other traffic, out of plain data."""

import importlib
import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from prefcal_scenarios.cases.overtake.pictures.drawing import animation
from prefcal_scenarios.cases.overtake.robust import VARIANTS

from prefcal_env.errors import KnobError, ScenarioError, SettingsError
from prefcal_scenarios import load
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.controller import STEERING_LIMITS, mpc_settings
from prefcal_scenarios.cases.overtake.scene import lines_of
from prefcal_scenarios.own.source import joined_source, split_source

ROOT = Path(__file__).parents[4]
PAPER = overtake.references["paper, preferences"]
SLOW = np.array([0.3, 0.5, 12.0, -1.0, 1.0])
DRAWN = {"random_traffic": {"count": 2, "types": ["constant", "braking"]}, "traffic": []}


def configured(config, name="overtake"):
    return load(joined_source(name, config))


def test_the_papers_scene_in_plain_data_is_the_papers_scene():
    spelled = configured({"traffic": [{"type": "constant", "x": 30.0}], "lanes_count": 2})
    assert spelled.run(SLOW) == overtake.run(SLOW)
    assert spelled.name == "overtake"


def test_several_seeded_scenes_are_one_experiment_and_the_worst_counts():
    scenario = configured({**DRAWN, "scenes": 3})
    e = scenario.run(SLOW, seed=1)
    assert len(e.runs) == 3
    starts = {run.signals["obstacle_x"][0] for run in e.runs}
    assert len(starts) == 3
    assert e.kpis["path_peak"] == max(run.kpis["path_peak"] for run in e.runs)
    assert scenario.run(SLOW, seed=1) == e
    assert scenario.run(SLOW, seed=2) != e


def test_the_robust_scenario_has_as_many_scenes_as_before_and_its_estimator():
    scenario = configured(DRAWN, "overtake-robust")
    assert len(scenario.run(SLOW).runs) == len(VARIANTS)
    assert scenario.settings(SLOW)["estimator"] is not None
    assert "estimator" not in configured(DRAWN).settings(SLOW)


def test_a_configured_scenario_is_configured_anew_not_on_top():
    once = configured({"lanes_count": 3})
    assert "road_left" in once.run(SLOW).signals
    assert "road_left" not in once.configured({}).run(SLOW).signals


@pytest.mark.parametrize("limit", STEERING_LIMITS)
def test_the_limit_of_steering_is_a_setting(limit):
    scenario = configured({"steering_limit": limit})
    e = scenario.run(PAPER)
    largest = np.radians(e.kpis["steering_move"])
    allowed = 0.0873 * (PAPER[0] if limit == "per second" else 1)
    assert largest == pytest.approx(allowed, rel=1e-6)
    assert scenario.settings(PAPER)["overtaking"]["du_max"][1] == pytest.approx(allowed)


def test_both_limits_at_the_papers_optimum():
    kpis = {n: configured({"steering_limit": n}).run(PAPER).kpis for n in STEERING_LIMITS}
    assert kpis["per step"]["path_peak"] == pytest.approx(3.036, abs=1e-3)
    assert kpis["per step"]["lateral_distance"] == pytest.approx(2.9998, abs=1e-4)
    assert kpis["per second"]["path_peak"] == pytest.approx(3.13, abs=5e-3)
    assert kpis["per second"]["lateral_distance"] == pytest.approx(2.97, abs=5e-3)
    assert kpis["per second"]["lateral_acceleration"] == pytest.approx(3.3, abs=0.05)


def test_the_fields_of_the_limits_say_what_they_do():
    per_second, per_step = STEERING_LIMITS["per second"], STEERING_LIMITS["per step"]
    for theta in (PAPER, SLOW):
        moves = [mpc_settings(theta, 0, fixed).du_max[1] for fixed in (per_second, per_step)]
        assert moves == pytest.approx([0.0873 * theta[0], 0.0873])


@pytest.fixture(scope="module")
def traffic():
    spec = importlib.util.spec_from_file_location(
        "traffic", ROOT / "benchmarks" / "checks" / "traffic.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("i", range(3))
def test_random_tunings_in_any_traffic_end_with_a_reason_and_on_time(traffic, i):
    """Three θ of the 500 that benchmarks/checks/traffic.py drives."""
    for name in traffic.TRAFFIC:
        end, wrong = traffic.judged(name, i)
        assert wrong == []
        assert end in ("time is up", "collision", "off the road")


def test_other_processes_can_run_it():
    run = pickle.loads(pickle.dumps(configured(DRAWN).run))
    assert run(SLOW, 3) == configured(DRAWN).run(SLOW, 3)


def test_a_source_holds_its_configuration():
    config = {"lanes_count": 3, "traffic": [{"type": "idm"}]}
    assert split_source(joined_source("overtake", config)) == ("overtake", config)
    assert split_source("own.py:mine") == ("own.py:mine", None)


@pytest.mark.parametrize(
    ("source", "error", "says"),
    [
        ("overtake {", ScenarioError, "is not JSON"),
        ('cstr {"lanes_count": 3}', ScenarioError, "'cstr' takes no configuration"),
        ('overtaek {"lanes_count": 3}', ScenarioError, "Did you mean .overtake"),
        ('overtake {"lanes": 3}', SettingsError, "lanes"),
        ('overtake {"scenes": 0}', SettingsError, "scenes"),
        (5, ScenarioError, "loaded by its name, got 5"),
        ('overtake {"steering_limit": "none"}', SettingsError, "per second"),
    ],
)
def test_what_cannot_be_is_refused(source, error, says):
    with pytest.raises(error, match=says):
        load(source)


def test_theta_is_checked_in_every_traffic():
    with pytest.raises(KnobError):
        configured(DRAWN).run(np.zeros(5))


def test_the_example_of_the_docs_is_one(tmp_path):
    config = json.loads((ROOT / "docs" / "traffic.json").read_text())
    assert len(configured(config).run(SLOW).runs) == config["scenes"]


def test_figures_show_the_road_of_the_configuration():
    drawn = animation(configured({"lanes_count": 3}).run(SLOW))
    assert drawn["road"] == [-2.0, 10.0]
    assert drawn["lines"] == lines_of((-2.0, 10.0)) == [2.0, 6.0]
    assert animation(overtake.run(SLOW))["road"] == [-2.0, 6.0]


def test_the_distance_to_who_turns_is_that_of_the_turned_bodies():
    cuts_in = [{"type": "cut-in", "x": 2.0, "speed": 13.8, "moves_at": 1.0, "moves_within": 2.0}]
    e = configured({"traffic": cuts_in}).run(SLOW)
    assert e.kpis["collision"] == 1
    assert e.kpis["clearance"] < 0.05
