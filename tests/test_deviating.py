"""The scripts that measure deviations vary what they say, and nothing else."""

import importlib
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

from prefcal_agents.acquisition import exploration as acquisition
from prefcal_agents.space.design import latin_hypercube
from prefcal_env import Knob, KnobSpace
from prefcal_env.mpc import LinearMPC

ROOT = Path(__file__).parents[1]
CUBE = KnobSpace([Knob(f"z{k}", 0, 1, step=0) for k in range(3)])


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "checks")
    return importlib.import_module


def test_z_of_the_wider_box_is_that_of_points_twice_as_far_apart(script):
    agents = script("deviating.agents")
    rng = np.random.default_rng(0)
    samples, z = rng.random((6, 3)), rng.random((4, 3))
    wide = [((2 * z[:, None] - 2 * samples) ** 2).sum(axis=2)]
    narrow = ((z[:, None] - samples) ** 2).sum(axis=2)
    np.testing.assert_allclose(agents.z_printed(narrow), acquisition.exploration(wide[0]))
    np.testing.assert_allclose(agents.z_authors(narrow), np.arctan(1 / np.sum(1 / wide[0], axis=1)))
    assert agents.z_authors(np.array([[0.0, 1.0]])) == 0


def test_the_best_of_five_plans_is_never_nearer_than_the_first_which_is_ours(script):
    agents = script("deviating.agents")
    for seed in range(5):
        ours, best = latin_hypercube(CUBE, 10, seed), agents.maximin(CUBE, 10, seed)
        assert agents.smallest_distance(best) >= agents.smallest_distance(ours)


def test_a_variant_is_undone_after_its_study(script):
    agents = script("deviating.agents")
    before = acquisition.exploration
    agents.gap.__wrapped__("camel", "box [-1, 1], z as printed", 300)
    assert acquisition.exploration is before


def test_printed_horizons_are_one_shorter_and_one_freer(script):
    control, tuning = script("deviating.control"), script("prefcal_scenarios.cases.cstr.controller")
    ours = tuning.mpc_settings(np.array([0.25, 26.0, -1.0]))
    shorter, freer = control.up_to_last_but_one(ours), control.one_more(ours)
    assert (shorter.N_p, shorter.N_u) == (25, ours.N_u)
    assert (freer.N_p, freer.N_u) == (26, ours.N_u + 1)


def test_without_limits_on_the_first_input_moves_become_larger_than_allowed(script):
    control = script("deviating.control")
    theta = (0.31, 26.0, -1.79)
    limited = control.react(theta).kpis["largest_move"]
    with mock.patch.object(LinearMPC, "move", control.first_unlimited):
        unlimited = control.react(theta).kpis["largest_move"]
    assert limited <= 10 + 1e-9 < unlimited
