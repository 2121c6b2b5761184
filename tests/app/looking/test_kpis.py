"""The settling time of a record names its band: noise does not count, an oscillation does."""

import numpy as np
import pytest

from prefcal_app.looking.pair import measured_run
from prefcal_env import recorded
from prefcal_env.experiments.events import entry_time

T = np.linspace(0, 500, 501)
NAME = "settling time of T"


def settled(y, t=T):
    """The settling time of a record that should reach 40, and its title."""
    run = recorded([1.0], t, {"T": y}, reference={"T": 40.0}, units={"T": "°C"})
    found, kpis = measured_run(run)
    assert found.kpis[NAME] == run.kpis[NAME]  # the same by every door
    naive = entry_time(t - t[0], y - 40, 0.03 * abs(y[0] - 40))
    return found.kpis[NAME], naive, kpis[0].title


def rising(noise, seed=0, t=T):
    """A rise of 20 °C that is within 3 % of it after 193 s."""
    random = np.random.default_rng(seed).standard_normal(len(t))
    return 40 - 20 * np.exp(-t / 55) + noise * random


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise", [0.2, 0.4, 0.6])
def test_noise_that_leaves_the_band_for_a_moment_does_not_count(noise, seed):
    measured, naive, _ = settled(rising(noise, seed))
    assert measured == pytest.approx(193, abs=70)
    assert naive > measured


def test_without_noise_it_is_the_last_entry_into_the_band():
    measured, naive, title = settled(rising(0.0))
    assert measured == naive == 193.0
    assert title == "settling time of T (±3 %)"


@pytest.mark.parametrize("period", [5, 10, 40])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_an_oscillation_that_goes_on_never_settles(period, noise):
    y = rising(noise) + 3 * np.cos(2 * np.pi * T / period)
    assert settled(y)[0] == np.inf


def test_a_drift_out_of_the_band_never_settles():
    assert settled(rising(0.3) + np.maximum(T - 400, 0) * 0.02)[0] == np.inf


def test_a_few_rows_are_taken_as_they_are():
    t = np.linspace(0, 500, 11)
    measured, naive, _ = settled(rising(0.6, t=t), t)
    assert measured == naive
