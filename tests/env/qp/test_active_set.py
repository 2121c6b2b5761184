"""The compiled active-set method finds the nearest point, or says why it does not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.qp import QP, PIQPSolver
from prefcal_env.qp._active_set import INFEASIBLE, ITERATION_LIMIT, SOLVED, nearest

INF = np.inf


def solve(G, low, high, most=250):
    arrays = (np.array(v, dtype=float) for v in (G, low, high))
    return nearest(*arrays, 1e-10, 1e-12, most)


def test_an_origin_within_the_limits_takes_no_iteration():
    how, z, y, iterations = solve(np.eye(2), [-1, 0], [INF, 0])
    assert (how, iterations) == (SOLVED, 0)
    assert not z.any()
    assert not y.any()


def test_the_nearest_point_of_a_corner_and_its_multipliers():
    how, z, y, iterations = solve([[1, 0], [0, 1], [1, 1]], [2, -INF, -INF], [INF, -3, 9])
    assert (how, iterations) == (SOLVED, 2)
    np.testing.assert_allclose(z, [2, -3])
    np.testing.assert_allclose(y, [-2, 3, 0])


def test_a_limit_that_another_one_makes_superfluous_becomes_inactive_again():
    # x >= 1 is violated less than x + y >= 4 per length, and both end up where x = y = 2.
    how, z, y, _ = solve([[1, 0], [1, 1]], [1, 4], [INF, INF])
    assert how == SOLVED
    np.testing.assert_allclose(z, [2, 2])
    np.testing.assert_allclose(y, [0, -2], atol=1e-14)


@pytest.mark.parametrize(
    ("G", "low", "high"),
    [
        ([[1.0], [1.0]], [1, -INF], [INF, 0]),
        ([[1, 1], [1, 1]], [1, -INF], [INF, 0.5]),
        ([[0, 0]], [1], [INF]),
    ],
)
def test_limits_that_leave_nothing_are_infeasible(G, low, high):
    assert solve(G, low, high)[0] == INFEASIBLE


def test_too_few_iterations_are_told():
    assert solve(np.eye(3), [1, 1, 1], [2, 2, 2], most=2)[0] == ITERATION_LIMIT
    assert solve(np.eye(3), [1, 1, 1], [2, 2, 2], most=3)[0] == SOLVED


@settings(max_examples=150, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 12), m=st.integers(1, 30))
def test_it_agrees_with_an_interior_point_method_also_with_rows_that_repeat(seed, n, m):
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(m, n)) * 10.0 ** rng.uniform(-3, 3, size=(m, 1))
    G[m // 2 :] = G[: m - m // 2] * (1 if seed % 2 else -1)
    around = G @ rng.normal(size=n)
    room = np.abs(G).sum(axis=1)
    low, high = around - room * rng.random(m), around + room * rng.random(m)
    low[rng.random(m) < 0.3] = -INF
    high[rng.random(m) < 0.3] = INF
    how, z, y, _ = solve(G, low, high)
    assert how == SOLVED
    np.testing.assert_allclose(z + G.T @ y, 0, atol=1e-9 * (1 + np.abs(G).max()))
    solution = PIQPSolver().solve(QP(np.eye(n), np.zeros(n), G, low, high))
    if solution.solved:
        assert z @ z <= solution.z @ solution.z + 1e-5 * (1 + z @ z)
    scale = 1e-9 * (1 + np.abs(G) @ np.abs(z))
    assert np.all(G @ z <= high + scale)
    assert np.all(G @ z >= low - scale)
    assert np.all(y[low == -INF] >= 0)
    assert np.all(y[high == INF] <= 0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 8))
def test_equalities_are_met(seed, n):
    rng = np.random.default_rng(seed)
    G = rng.normal(size=(n, n))
    inside = rng.normal(size=n)
    how, z, _, _ = solve(G, G @ inside, G @ inside)
    assert how == SOLVED
    np.testing.assert_allclose(G @ z, G @ inside, atol=1e-8)
