import numpy as np
import pytest

from prefcal_bench.problems.functions import FUNCTIONS

EACH = pytest.mark.parametrize("function", FUNCTIONS.values(), ids=list(FUNCTIONS))


@EACH
def test_every_minimizer_lies_in_the_box_and_has_the_optimal_value(function):
    for minimizer in function.minimizers:
        theta = function.space.check(np.array(minimizer))
        assert function(theta) == pytest.approx(function.optimum, abs=1e-8)


@EACH
def test_nothing_is_below_the_optimum(function):
    rng = np.random.default_rng(0)
    points = list(rng.random((300, len(function.space))))
    for minimizer in function.minimizers:
        center = function.space.encode(np.array(minimizer))
        near = center + 1e-3 * rng.standard_normal((100, len(center)))
        points += list(np.clip(near, 0, 1))
    assert min(function.gap(function.space.decode(z)) for z in points) > -1e-8


@EACH
def test_the_lower_value_is_preferred(function):
    best = np.array(function.minimizers[0])
    other = function.space.decode(np.full(len(best), 0.9))
    assert function.prefer(best, other) == -1
    assert function.prefer(other, best) == 1
    assert function.prefer(other, other) == 0
