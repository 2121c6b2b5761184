"""Quadratic programs: what can be solved is, and where nothing can be it is said."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.errors import QPError, SettingsError
from prefcal_env.qp import QP, PIQPSolver, Tolerances
from prefcal_env.qp._active_set import INFEASIBLE, ITERATION_LIMIT, SOLVED, nearest
from support.daqp_backend import DAQPBackend

INF = np.inf


@pytest.fixture(params=[PIQPSolver, DAQPBackend])
def backend(request):
    return request.param()


def qp(P, q, G=None, lower=None, upper=None):
    n = len(q)
    G = np.zeros((0, n)) if G is None else np.array(G, float)
    m = len(G)
    return QP(
        np.array(P, float),
        np.array(q, float),
        G,
        np.full(m, -INF) if lower is None else np.array(lower, float),
        np.full(m, INF) if upper is None else np.array(upper, float),
    )


@pytest.mark.parametrize(
    ("problem", "z", "multipliers", "atol"),
    [
        (([[2, 0], [0, 4]], [-2, -4]), [1, 1], None, 1e-7),
        ((np.eye(2), [-1, -1], np.eye(2), [-INF, -INF], [0.3, 5]), [0.3, 1], [0.7, 0], 1e-6),
        (([[1.0]], [0], [[1.0]], [2], [INF]), None, [-2], 1e-6),
        ((np.eye(2), [0, 0], [[1, 1]], [1], [1]), [0.5, 0.5], None, 1e-6),
        ((np.zeros((2, 2)), [-1, -2], np.eye(2), [0, 0], [1, 1]), [1, 1], None, 1e-6),
    ],
    ids=["free", "bound above", "bound below", "equality", "linear program"],
)
def test_minima_and_multipliers_are_those_by_hand(backend, problem, z, multipliers, atol):
    solution = backend.solve(qp(*problem))
    assert solution.solved
    for found, expected in ((solution.z, z), (solution.multipliers, multipliers)):
        if expected is not None:
            np.testing.assert_allclose(found, expected, atol=atol)


def test_a_row_without_any_bound_is_no_row(backend, capfd):
    solution = backend.solve(qp(np.eye(2), [-1, -1], np.eye(2), [-INF, -INF], [0.3, INF]))
    np.testing.assert_allclose(solution.z, [0.3, 1], atol=1e-6)
    assert solution.multipliers[1] == 0
    assert capfd.readouterr().out == ""


def test_infeasible_is_data_and_no_exception(backend):
    solution = backend.solve(qp([[1.0]], [0], [[1.0], [1.0]], [1, -INF], [INF, 0]))
    assert not solution.solved
    assert np.isnan(solution.z).all()


@pytest.mark.parametrize("G", [[[np.nan]], [[np.inf]]])
def test_numbers_that_are_not_finite_are_not_solved(G):
    assert not PIQPSolver().solve(qp([[1.0]], [0], G, [0], [1])).solved
    assert not PIQPSolver().solve(qp([[1.0]], [0], [[1.0]], [-INF], [np.nan])).solved


def test_unbounded_is_data(backend):
    assert not backend.solve(qp([[0.0]], [-1], [[1.0]], [0], [INF])).solved


def test_a_later_solve_leaves_an_earlier_solution_alone(backend):
    first = backend.solve(qp([[1.0]], [-1]))
    kept = first.z.copy()
    backend.solve(qp([[1.0]], [-7]))
    np.testing.assert_array_equal(first.z, kept)


def test_iteration_limit_is_reported():
    box = qp(np.eye(3), [-1, 2, -3], np.eye(3), [-0.1] * 3, [0.1] * 3)
    solution = PIQPSolver(Tolerances(max_iterations=1)).solve(box)
    assert (solution.solved, solution.iterations) == (False, 1)


def test_an_iteration_limit_of_numpy_is_kept_as_a_plain_number():
    kept = Tolerances(max_iterations=np.arange(5)[3])
    assert (kept.max_iterations, type(kept.max_iterations)) == (3, int)
    with pytest.raises(SettingsError, match="max_iterations must be an integer, 1 or more, got True"):
        Tolerances(max_iterations=True)


def test_looser_tolerances_take_fewer_iterations():
    rng = np.random.default_rng(0)
    L = rng.normal(size=(8, 8))
    problem = qp(L @ L.T, rng.normal(size=8), np.eye(8), [-0.1] * 8, [0.1] * 8)
    loose = PIQPSolver(Tolerances(absolute=1e-3, relative=1e-3)).solve(problem)
    tight = PIQPSolver(Tolerances(absolute=1e-10, relative=1e-10)).solve(problem)
    assert loose.iterations < tight.iterations


def test_impossible_tolerances_are_refused():
    with pytest.raises(SettingsError, match="absolute QP tolerance"):
        Tolerances(absolute=-1)
    with pytest.raises(SettingsError, match="max_iterations"):
        Tolerances(max_iterations=0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 8), m=st.integers(0, 8))
def test_what_is_called_solved_is_optimal(seed, n, m):
    rng = np.random.default_rng(seed)
    L = rng.normal(size=(n, n))
    inside, G = rng.normal(size=n), rng.normal(size=(m, n))
    around = G @ inside
    problem = QP(
        L @ L.T + 0.1 * np.eye(n), rng.normal(size=n), G, around - rng.random(m), around + rng.random(m)
    )
    results = [made().solve(problem) for made in (PIQPSolver, DAQPBackend)]
    assert all(r.solved for r in results)
    np.testing.assert_allclose(results[0].z, results[1].z, atol=1e-5)
    z, y = results[0].z, results[0].multipliers
    np.testing.assert_allclose(problem.P @ z + problem.q + G.T @ y, 0, atol=1e-5)
    assert np.all(G @ z <= problem.upper + 1e-6)
    assert np.all(G @ z >= problem.lower - 1e-6)


def test_boxes_are_solved_like_the_same_problems_in_full():
    backend, rng = PIQPSolver(), np.random.default_rng(2)
    for n in (1, 2, 7, 20):
        root = rng.standard_normal((n, n))
        P, q, upper = root @ root.T + np.eye(n), rng.standard_normal(n), rng.random(n)
        full = backend.solve(QP(P, q, np.eye(n), np.zeros(n), upper))
        assert backend.solve_box(P, q, upper) == pytest.approx(full.z, abs=1e-6)


def test_a_box_without_a_solution_is_none_and_data_that_is_not_finite_is_refused():
    hasty = PIQPSolver(Tolerances(max_iterations=1))
    assert hasty.solve_box(np.eye(2), np.array([-1.0, 2.0]), np.array([0.3, 5.0])) is None
    with pytest.raises(QPError, match="finite"):
        PIQPSolver().solve_box(np.eye(2), np.array([np.nan, 0.0]), np.array([0.3, 5.0]))


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
