"""The CSTR is the paper's: its steady states, its derivatives, its simulation."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from prefcal_env.errors import PlantError
from prefcal_env.plants.cstr import CSTR, FEED, CSTRParams

PLANT = CSTR()
states = st.tuples(st.floats(290, 400), st.floats(0.05, 9.95)).map(np.array)
inputs = st.floats(284, 310).map(lambda v: np.array([v]))


def test_three_steady_states_at_298_kelvin_the_papers_start_among_them():
    found = PLANT.steady_states_at_input(298.0)
    assert len(found) == 3
    assert found[0] == pytest.approx([311.5, 8.54], rel=1e-3)  # design, section 4
    assert found[0, 1] == pytest.approx(8.56, rel=0.005)  # paper, section IV-A
    assert np.all(np.diff(found[:, 0]) > 0)


def test_paper_start_and_target_by_concentration():
    x, u = PLANT.steady_state_at_concentration(8.56)
    assert (x[0], u[0]) == pytest.approx((311.23, 297.62), abs=0.01)
    _, u = PLANT.steady_state_at_concentration(2.0)
    assert u[0] == pytest.approx(304.4, abs=0.05)


@given(C_A=st.floats(0.2, 9.8))
def test_a_steady_state_stands_still(C_A):
    x, u = PLANT.steady_state_at_concentration(C_A)
    np.testing.assert_allclose(PLANT.f(x, u, FEED), 0, atol=1e-9)


@settings(max_examples=15)
@given(T_c=st.floats(270, 330))
def test_steady_states_at_an_input_stand_still(T_c):
    found = PLANT.steady_states_at_input(T_c)
    assert len(found) in (1, 3)
    for x in found:
        np.testing.assert_allclose(PLANT.f(x, np.array([T_c]), FEED), 0, atol=1e-6)


def test_with_the_printed_sign_c_a_is_95():
    """Deviation in `CSTR`: the paper's minus, by hand, leaves one steady state near 9.5."""
    p = CSTRParams()

    def imbalance(T):
        k = p.k_0 * np.exp(-p.E / (p.R * T))
        C_A = 10 / (1 + k)
        return 298.15 - T - p.H / p.rho_Cp * k * C_A - p.US_V / p.rho_Cp * (T - 298), C_A

    grid = np.linspace(250, 400, 20001)
    values = [imbalance(T) for T in grid]
    crossings = np.flatnonzero(np.diff(np.sign([v[0] for v in values])))
    assert len(crossings) == 1
    assert values[crossings[0]][1] == pytest.approx(9.5, abs=0.1)


@given(x=states, u=inputs)
def test_jacobians_agree_with_differences(x, u):
    J = PLANT.jacobians(x, u, FEED)
    for i, h in enumerate((1e-4, 1e-6)):
        e = np.zeros(2)
        e[i] = h
        slope = (PLANT.f(x + e, u, FEED) - PLANT.f(x - e, u, FEED)) / (2 * h)
        np.testing.assert_allclose(J.A[:, i], slope, rtol=1e-5, atol=1e-5)
    slope = (PLANT.f(x, u + 1e-3, FEED) - PLANT.f(x, u - 1e-3, FEED)) / 2e-3
    np.testing.assert_allclose(J.B[:, 0], slope, rtol=1e-6)
    np.testing.assert_array_equal(J.C, np.eye(2))
    np.testing.assert_array_equal(J.D, 0)


@settings(max_examples=30, deadline=None)
@given(x=states, u=inputs, T_s=st.floats(0.25, 1.5))
def test_every_interval_agrees_with_dop853(x, u, T_s):
    precise = solve_ivp(
        lambda t, y: PLANT.f(y, u, FEED), (0, T_s), x, method="DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    ours = PLANT.hold(x, u, FEED, np.array([T_s]))[0]
    np.testing.assert_allclose(ours[1], precise[1], atol=1e-6)
    np.testing.assert_allclose(ours[0], precise[0], rtol=1e-6)  # K, also in an explosion


@pytest.mark.parametrize("C_A", [0.0, 10.0, -1.0, np.nan, 1e-9])
def test_an_impossible_concentration_is_refused(C_A):
    with pytest.raises(PlantError, match="kgmol/m³"):
        PLANT.steady_state_at_concentration(C_A)


@pytest.mark.parametrize("T_c", [0.0, -3.0, np.inf, np.nan])
def test_an_impossible_coolant_is_refused(T_c):
    with pytest.raises(PlantError, match="T_c must be positive"):
        PLANT.steady_states_at_input(T_c)


def test_impossible_parameters_are_refused():
    with pytest.raises(PlantError, match="k_0 must be positive"):
        CSTRParams(k_0=-1)


def test_parameters_may_be_integers():
    whole = CSTRParams(**{f.name: int(getattr(CSTRParams(), f.name)) for f in fields(CSTRParams)})
    real = CSTRParams(**{f.name: float(getattr(whole, f.name)) for f in fields(CSTRParams)})
    x, u, times = np.array([311.0, 8.5]), np.array([298.0]), np.array([0.1])
    states = [CSTR(params).hold(x, u, FEED, times) for params in (whole, real)]
    assert np.isfinite(states[0]).all()
    np.testing.assert_array_equal(*states)


def test_there_are_derivatives_where_the_reaction_is_frozen():
    J = CSTR().jacobians(np.zeros(2), np.array([298.0]), FEED)
    assert J.A.tolist() == [[-1.3, 0.0], [0.0, -1.0]]  # flow and cooling alone
