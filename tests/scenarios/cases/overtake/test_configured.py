"""The overtaking in other traffic, out of plain data."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from prefcal_env.errors import ScenarioError, SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios import load
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.controller import STEERING_LIMITS
from prefcal_scenarios.own import joined_source

ROOT = Path(__file__).parents[4]
PAPER = overtake.references["paper, preferences"]
SLOW = np.array([0.3, 0.5, 12.0, -1.0, 1.0])
DRAWN = {"vehicles_count": 3, "vehicles_density": 0.5}


def configured(config):
    return load(joined_source("overtake", config))


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


def test_other_processes_can_run_it():
    run = pickle.loads(pickle.dumps(configured(DRAWN).run))
    assert run(SLOW, 3) == configured(DRAWN).run(SLOW, 3)


@pytest.mark.parametrize(
    ("source", "error", "says"),
    [
        ("overtake {", ScenarioError, "is not JSON"),
        ('cstr {"lanes_count": 3}', ScenarioError, "'cstr' takes no configuration"),
        ('overtaek {"lanes_count": 3}', ScenarioError, "Did you mean .overtake"),
        ('overtake {"lanes": 3}', SettingsError, "lanes"),
        (5, ScenarioError, "loaded by its name, got 5"),
        ('overtake {"steering_limit": "none"}', SettingsError, "per second"),
    ],
)
def test_what_cannot_be_is_refused(source, error, says):
    with pytest.raises(error, match=says):
        load(source)


def test_the_example_of_the_docs_is_one():
    config = json.loads((ROOT / "docs" / "traffic.json").read_text())
    e = configured(config).run(SLOW)
    assert e.signals["road_left"][0] == 10
    assert "obstacle4_x" in e.signals


@pytest.mark.parametrize("i", range(3))
def test_random_tunings_in_traffic_end_with_a_reason_and_on_time(i):
    theta = overtake.space.decode(np.random.default_rng([1, i]).random(5))
    e = configured(DRAWN).run(theta, seed=i)
    instants = theta[0] * np.arange(len(e.t_control))
    np.testing.assert_allclose(e.t_control, instants, rtol=0, atol=1e-9)
    assert np.all(np.diff(e.t) > 0)
    assert e.end is End.TIME_UP or e.kpis["collision"] or e.kpis["off_road"] > 1
    assert not np.isnan(list(e.kpis.values())).any()


def test_the_seed_decides_the_traffic_and_nothing_else_does():
    scenario = configured(DRAWN)
    first = scenario.run(SLOW, seed=1)
    assert scenario.run(SLOW, seed=1) == first
    assert scenario.run(SLOW, seed=2) != first
