import random

import numpy as np
import pytest

from prefcal_bench.global_random import seeded


def draws():
    return np.random.rand(), random.random()  # noqa: NPY002


def test_the_key_alone_decides_what_is_drawn_inside():
    with seeded(3, 1) as seed:
        first, first_seed = draws(), seed
    draws()
    with seeded(3, 1) as seed:
        assert (draws(), seed) == (first, first_seed)
    for key in ((3, 2), (4, 1), (3,)):
        with seeded(*key):
            assert draws() != first


def _draw_and_fail():
    with seeded(2**40, 7):
        draws()
        _ = 1 / 0


def test_the_caller_draws_as_if_nothing_had_happened():
    with seeded(0):
        undisturbed = [draws(), draws()]
    with seeded(0):
        disturbed = [draws()]
        with pytest.raises(ZeroDivisionError):
            _draw_and_fail()
        disturbed.append(draws())
    assert disturbed == undisturbed
