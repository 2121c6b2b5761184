"""Squared distances."""

import numpy as np
import pytest

from prefcal_agents.space.distance import squared_distances


def test_squared_distances_by_hand():
    d = squared_distances(np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([[3.0, 4.0]]))
    assert d.tolist() == [[25.0], [8.0]]


def test_squared_distances_of_close_points_keep_their_digits():
    a = np.array([[0.7, 0.3]])
    assert squared_distances(a, a + 1e-9)[0, 0] == pytest.approx(2e-18, rel=1e-6)
