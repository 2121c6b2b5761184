import numpy as np
import pytest

from prefcal_bench.problems.functions import FUNCTIONS

EACH = pytest.mark.parametrize("function", FUNCTIONS.values(), ids=list(FUNCTIONS))
MINIMIZERS = {
    "camel": [(0.0898420131, -0.7126564030), (-0.0898420131, 0.7126564030)],
    "hartman3": [(0.11458888111058596, 0.5556488965584945, 0.8525469846916554)],
    "hartman6": [
        (
            0.2016895106414348,
            0.15001069461424155,
            0.4768739765861194,
            0.2753324285232711,
            0.31165161724300744,
            0.6573005330010271,
        )
    ],
    "branin": [(-np.pi, 12.275), (np.pi, 2.275), (3 * np.pi, 2.475)],
    "adjiman": [(2.0, 0.1057834735)],
    "rosenbrock2": [(1.0,) * 2],
    "rosenbrock4": [(1.0,) * 4],
    "rosenbrock8": [(1.0,) * 8],
    "ackley2": [(0.0,) * 2],
    "ackley5": [(0.0,) * 5],
    "levy4": [(1.0,) * 4],
    "levy8": [(1.0,) * 8],
    "styblinski3": [(-2.9035340277,) * 3],
    "terraces3": [(0.3, 25.0, -1.0)],
}


@EACH
def test_every_minimizer_lies_in_the_box_and_has_the_optimal_value(function):
    for minimizer in MINIMIZERS[function.name]:
        theta = function.space.check(np.array(minimizer))
        assert function(theta) == pytest.approx(function.optimum, abs=1e-8)


@EACH
def test_nothing_is_below_the_optimum(function):
    rng = np.random.default_rng(0)
    points = list(rng.random((300, len(function.space))))
    for minimizer in MINIMIZERS[function.name]:
        center = function.space.encode(np.array(minimizer))
        near = center + 1e-3 * rng.standard_normal((100, len(center)))
        points += list(np.clip(near, 0, 1))
    assert min(function.gap(function.space.decode(z)) for z in points) > -1e-8


@EACH
def test_the_lower_value_is_preferred(function):
    best = np.array(MINIMIZERS[function.name][0])
    other = function.space.decode(np.full(len(best), 0.9))
    assert function.prefer(best, other) == -1
    assert function.prefer(other, best) == 1
    assert function.prefer(other, other) == 0
