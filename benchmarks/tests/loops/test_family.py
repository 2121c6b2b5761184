"""Random closed loops, and models of them that know them only roughly."""

import numpy as np
import pytest

from prefcal_bench.loops import loop, rough_model
from prefcal_env.errors import ScenarioError


def test_a_seed_gives_one_random_loop_and_seeds_differ():
    first, again, other = loop(3), loop(3), loop(4)
    theta = first.space.decode(np.full(len(first.space), 0.5))
    assert first.name == again.name != other.name
    assert first.run(theta) == again.run(theta)


def test_a_rough_model_without_an_error_is_the_loop_itself():
    for seed in (300, 301):
        ours, model = loop(seed), rough_model(seed, 0.0)
        theta = ours.space.decode(np.full(len(ours.space), 0.5))
        assert model.run(theta).kpis == ours.run(theta).kpis


def test_a_rough_model_is_the_more_off_the_larger_its_error():
    ours, theta = loop(300), loop(300).space.decode(np.full(6, 0.5))
    error = ours.run(theta).kpis["error"]
    off = [abs(rough_model(300, e).run(theta).kpis["error"] - error) for e in (0.01, 0.03, 0.1)]
    assert 0 < off[0] < off[1] < off[2] < 0.3 * error
    with pytest.raises(ScenarioError, match="error of a model must be 0 or more, got -1"):
        rough_model(300, -1)
