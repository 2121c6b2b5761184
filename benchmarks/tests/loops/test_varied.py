"""Rough loops are varied and drawn like the named ones."""

import pytest

from prefcal_app.report.write import resting
from prefcal_scenarios import load
from support.varied_loops import (
    assert_it_starts_at_rest_where_the_study_does,
    assert_without_a_variation_the_run_is_that_of_the_study,
)

rough = pytest.mark.parametrize("name", ["rough-900", "rough-903"])


@rough
def test_a_varied_loop_starts_at_rest_where_the_study_does(name):
    assert_it_starts_at_rest_where_the_study_does(name)


@rough
def test_without_a_variation_the_run_is_that_of_the_study(name):
    assert_without_a_variation_the_run_is_that_of_the_study(name)


def test_a_rough_loop_says_where_its_inputs_rest():
    loop = load("rough-900")
    assert resting(loop) == pytest.approx(loop.run.function.__self__.task.u0)
