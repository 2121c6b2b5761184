"""Torch alone: seeded by a key, and restored."""

import pytest

from prefcal_bench.peers.peer import torch_seeded
from support.extras import need


@pytest.fixture(autouse=True)
def _peers():
    need("peers")


def test_draws_follow_from_the_key_and_leave_the_callers_alone():
    import torch

    before, draws = torch.get_rng_state(), []
    for key in ((1, 2), (1, 2), (1, 3)):
        with torch_seeded(*key):
            draws.append(float(torch.rand(1)))
    assert draws[0] == draws[1] != draws[2]
    assert torch.equal(torch.get_rng_state(), before)
