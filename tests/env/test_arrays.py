"""What is compared of runs."""

import numpy as np
import pytest

from prefcal_env.arrays import holds_more


@pytest.mark.parametrize(
    ("gained", "lost", "more"),
    [(4, 0, False), (5, 0, True), (7, 1, True), (6, 1, False), (0, 0, False), (0, 9, False)],
)
def test_one_tuning_holds_in_more_runs_than_another_only_beyond_chance(gained, lost, more):
    both = [True] * 20 + [False] * 3  # says nothing
    these = np.array([*both, *[True] * gained, *[False] * lost])
    those = np.array([*both, *[False] * gained, *[True] * lost])
    assert holds_more(these, those) is more
