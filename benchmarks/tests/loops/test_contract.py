"""Random closed loops keep the contract of the named ones."""

import pytest

from contracts.loops import *  # noqa: F403
from prefcal_bench.loops import family

SEEDS = (1, 2, 8, 13, 21)
"""Random loops, an MPC and an LQR among them."""


@pytest.fixture(params=SEEDS)
def seed(request):
    return request.param


@pytest.fixture
def name(seed):
    return f"loop-{seed}"


@pytest.fixture
def make(seed):
    return lambda: family._accepted(seed)[0]
