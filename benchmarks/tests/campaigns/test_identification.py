"""The campaign that judges identification: its plants are simulated rightly, and its judge can say no."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def identification(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("identification")


def test_a_lag_with_dead_time_is_simulated_as_by_hand(identification):
    t = np.linspace(0, 10, 101)
    made = identification.simulated(np.array([2.0]), np.array([3.0, 1.0]), 0.35, t, np.ones(101))
    late = np.maximum(t - 0.35, 0)
    assert made == pytest.approx(2 * (1 - np.exp(-late / 3)), abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_every_record_has_a_step_after_a_start_at_rest_and_noise_within_its_range(identification, seed):
    plant = identification.truth(seed)
    assert plant.kind == identification.KINDS[seed % 4]
    assert len({*plant.u.tolist()}) in (2, 3)
    first = int(np.argmax(plant.u != plant.u[0]))
    assert 0.05 * len(plant.t) < first < 0.15 * len(plant.t)
    assert 0 <= plant.noise <= 0.05
    assert np.std(plant.y[:first]) <= 0.08 * np.ptp(plant.y)


def test_truths_are_in_the_sample_of_their_records_and_near_the_best_model(identification):
    found = [*identification.campaign(range(203, 208))]
    inside = [one for _, one, _ in found if one is not None and one.inside]
    assert len(inside) >= 4
    assert all(one.error < 0.1 for _, one, _ in found if one is not None)


def highest_gain(model):
    """The gain of a P controller at which a loop begins to swing."""
    s = 1j * np.geomspace(1e-3, 1e3, 4000)
    response = np.polyval(model.num, s) / np.polyval(model.den, s) * np.exp(-s * model.delay)
    lag = -np.unwrap(np.angle(response / np.sign(model.num[-1])))
    return 1 / np.abs(response[np.searchsorted(np.maximum.accumulate(lag), np.pi)])


def test_the_best_model_bears_no_gain_that_the_plant_does_not_where_the_record_hides_its_dead_time(
    identification,
):
    plant = identification.truth(6033)
    found = identification.identify(plant.t, plant.u, plant.y, resolution=plant.resolution, seed=6033)
    assert highest_gain(found.models[found.best]) == pytest.approx(highest_gain(plant), rel=0.7)


def test_the_judge_says_no_to_another_plant(identification):
    plant = identification.truth(203)
    made = identification.identify(plant.t, plant.u, plant.y, count=60)
    assert identification.judged(plant, made).inside
    assert not identification.judged(replace(plant, num=1.3 * plant.num), made).inside
