"""The compiled pieces against scipy and against extended precision."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from prefcal_env.mpc import control_horizon
from prefcal_env.mpc.kernels import discretize, triangularize


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), size=st.floats(0.01, 30), T=st.floats(0.01, 2))
def test_discretize_is_the_matrix_exponential(seed, size, T):
    rng = np.random.default_rng(seed)
    A, B, c = size * rng.normal(size=(3, 3)), rng.normal(size=(3, 2)), rng.normal(size=3)
    M = np.zeros((6, 6))
    M[:3] = np.hstack([A, B, c[:, None]])
    E = expm(M * T)[:3]
    ours = np.hstack([discretize(A, B, c, T)[0], discretize(A, B, c, T)[1]])
    np.testing.assert_allclose(ours, E[:, :5], rtol=1e-9, atol=1e-9 * np.abs(E).max())
    np.testing.assert_allclose(discretize(A, B, c, T)[2], E[:, 5], rtol=1e-9, atol=1e-9 * np.abs(E).max())


def test_an_integrator_of_a_constant_drifts_linearly():
    A_d, B_d, c_d = discretize(np.zeros((1, 1)), np.ones((1, 1)), np.array([3.0]), 0.5)
    assert (A_d[0, 0], B_d[0, 0], c_d[0]) == pytest.approx((1.0, 0.5, 1.5))


@given(seed=st.integers(0, 10**6), rows=st.integers(1, 7), columns=st.integers(1, 6))
def test_triangularize_keeps_the_inner_products(seed, rows, columns):
    M = np.random.default_rng(seed).normal(size=(rows, columns))
    R = M.copy()
    triangularize(R, rows, columns, 0)
    np.testing.assert_allclose(R.T @ R, M.T @ M, atol=1e-10)
    np.testing.assert_array_equal(np.tril(R, -1), 0)


def test_rows_of_very_different_size_keep_their_own_accuracy():
    """Two rows of size 1 beside one of 1e40: plain QR leaves only rounding of the large one."""
    big, a, b = np.array([2e40, 1e40, 3e40]), np.array([1.0, 2, 3]), np.array([0.0, 1.0, 5.0])
    R = np.array([a, big, b])
    triangularize(R, 3, 2, 0)
    # Exactly: with x_1 + x_2 / 2 + 3 / 2 = 0 enforced, rows a and b are 1.5 x_2 + 1.5, x_2 + 5.
    assert np.hypot(1.5, 1.0) == pytest.approx(abs(R[1, 1]), rel=1e-12)
    assert (1.5 * 1.5 + 1.0 * 5.0) / np.hypot(1.5, 1.0) == pytest.approx(
        R[1, 2] * np.sign(R[1, 1]), rel=1e-12
    )
    plain = np.linalg.qr(np.array([a, big, b]), mode="r")
    assert not np.isclose(abs(plain[1, 1]), np.hypot(1.5, 1.0), rtol=1e-3)


@pytest.mark.parametrize(
    ("share", "N_p", "N_u"), [(1 / 3, 4, 1), (1 / 3, 26, 9), (1 / 3, 40, 13), (0.1, 3, 1), (0.5, 5, 3)]
)
def test_control_horizon_rounds_half_up_and_is_at_least_one(share, N_p, N_u):
    assert control_horizon(share, N_p) == N_u
