"""How many worker processes there may be."""

import os

from prefcal_env.workers import usable_cores


def test_the_cores_that_may_be_used_are_counted():
    assert 1 <= usable_cores() <= (os.cpu_count() or 1)
