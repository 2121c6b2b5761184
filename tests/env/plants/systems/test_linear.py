"""Plants of linear systems against python-control, SciPy and answers by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal

from prefcal_env import Channel, FunctionPlant, LTILoop, Move, Plant
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.plants.systems import motion, of_fractions, system_of
from support.held import A, B, C, D, Held, driven


@pytest.mark.parametrize("system", [(A, B, C, D), signal.StateSpace(A, B, C, D)])
def test_a_mimo_plant_steps_as_scipy_says(system):
    run = driven(Plant.of(system), Held([1.0, -2.0], 0.3))
    inputs = np.tile([1.0, -2.0], (4001, 1))
    t, y, _ = signal.lsim(signal.StateSpace(A, B, C, D), inputs, np.linspace(0, 4, 4001))
    at = np.isin(np.round(t, 6), np.round(run.t, 6))
    there = np.isin(np.round(run.t, 6), np.round(t, 6))
    assert at.sum() > 400
    assert run.y[there] == pytest.approx(y[at], abs=1e-9)


@pytest.mark.parametrize("dt", [(), (0.1,)], ids=["continuous", "discrete"])
def test_a_plant_with_a_rest_moves_as_without_it_but_in_absolute_values(dt):
    matrices, u, y = ([[0.5]], [[2.0]], [[3.0]], [[0.7]], *dt), np.array([40.0]), np.array([52.0])
    own, absolute = Plant.of(matrices), Plant.of(matrices, rest=(u, y))
    x, du, none, times = np.array([0.3]), np.array([1.5]), np.zeros(0), np.array([0.1, 0.2])
    assert absolute.u0 == 40
    assert absolute.f(x, u + du, none) == pytest.approx(own.f(x, du, none))
    assert absolute.g(x, u + du, none) == pytest.approx(own.g(x, du, none) + y)
    assert absolute.hold(x, u + du, none, times) == pytest.approx(own.hold(x, du, none, times))
    assert absolute.entries(x, u + du, none).sum(axis=1) == pytest.approx(absolute.g(x, u + du, none))
    for by_own, by_absolute in zip(motion(own, x, du, none), motion(absolute, x, u + du, none), strict=True):
        assert by_absolute == pytest.approx(by_own)


def test_a_loop_of_a_plant_with_a_rest_settles_where_absolute_values_say():
    plant = Plant.of(([2.0], [3.0, 1.0]), rest=(40.0, 52.0))
    run = LTILoop(plant, lambda _: 1.0, horizon=50.0, reference=52.0)(np.ones(1))
    # y = 52 + 2 (u - 40) with u = 52 - y
    assert run.y[0] == 52
    assert run.y[-1] == pytest.approx(76 / 3)


def test_each_input_has_its_own_dead_time_even_if_it_changes_every_step():
    class Ramp:
        T_s = 0.1

        def move(self, m):
            return Move(np.array([round(m.t / 0.1), -round(m.t / 0.1)], float))

    # Two integrators: the state is the area below the delayed staircase.
    plant = Plant.of((np.zeros((2, 2)), np.eye(2), np.eye(2), np.zeros((2, 2))), delay=[0.25, 0.03])
    run = driven(plant, Ramp(), horizon=2.0)

    def area(t):
        k = np.floor(np.maximum(t, 0) / 0.1 + 1e-9)
        return 0.1 * k * (k - 1) / 2 + k * (np.maximum(t, 0) - 0.1 * k)

    assert run.x[:, 0] == pytest.approx(area(run.t - 0.25), abs=1e-9)
    assert run.x[:, 1] == pytest.approx(-area(run.t - 0.03), abs=1e-9)


GAIN, LAG = np.array([[12.8, -18.9], [6.6, -19.4]]), np.array([[16.7, 21.0], [10.9, 14.4]])
LATE = np.array([[1.0, 3.0], [7.0, 3.0]])  # Wood and Berry's distillation column
COLUMN = [[([GAIN[i, j]], [LAG[i, j], 1]) for j in range(2)] for i in range(2)]


def superposed(t, steps):
    """Return the outputs by hand, for steps (instant, input, size)."""
    y = np.zeros((len(t), 2))
    for at, j, size in steps:
        for i in range(2):
            since = np.maximum(t - at - LATE[i, j], 0.0)
            y[:, i] += size * GAIN[i, j] * (1 - np.exp(-since / LAG[i, j]))
    return y


class Steps:
    T_s = 0.7

    def move(self, m):
        return Move(np.array([1.0, 0.5 if m.t > 4 * 0.7 - 1e-9 else 0.0]))


def test_each_entry_of_a_matrix_has_its_own_dead_time():
    run = driven(Plant.of(COLUMN, delay=LATE), Steps(), horizon=40.0)
    assert run.y == pytest.approx(superposed(run.t, [(0, 0, 1.0), (4 * 0.7, 1, 0.5)]), abs=1e-9)


def test_entries_that_share_states_are_delayed_as_those_that_do_not():
    entries = LATE + np.array([[0.0, 0.3], [0.2, 0.0]])
    A, B = -np.diag([0.5, 0.2]), np.array([[1.0, 0.4], [0.3, 1.0]])
    C, D = np.array([[1.0, 0.5], [0.2, 1.0]]), np.array([[0.0, 0.1], [0.0, 0.0]])
    shared = driven(Plant.of((A, B, C, D), delay=entries), Steps(), horizon=20.0)
    parts = [[signal.StateSpace(A, B[:, [j]], C[[i]], D[[i]][:, [j]]) for j in range(2)] for i in range(2)]
    alone = driven(Plant.of(parts, delay=entries), Steps(), horizon=20.0)
    assert shared.y == pytest.approx(alone.y, abs=1e-9)


def test_a_matrix_of_equal_rows_is_the_dead_time_of_the_inputs():
    plant = Plant.of(COLUMN, delay=[[1.0, 3.0], [1.0, 3.0]])
    assert plant.input_delay == (1.0, 3.0)
    assert plant.entry_delay == ()


def test_a_number_as_the_start_is_refused_where_the_delay_matrix_copies_states():
    how = {"delay": [[1.0, 2.0], [3.0, 0.0]]}
    with pytest.raises(PlantError, match=r"x0 .*4 .*got 1\.0"):
        Plant.of((A, B, C, D), x0=1.0, **how)
    assert Plant.of((A, B, C, D), x0=0.0, **how).x0 == pytest.approx(np.zeros(4))
    given = [1.0, 0.0, 0.0, 2.0]
    assert Plant.of((A, B, C, D), x0=given, **how).x0 == pytest.approx(given)
    # Nothing is copied where each state has one input already, or all entries are equally late.
    assert Plant.of(COLUMN, x0=1.0, **how).x0 == pytest.approx(np.ones(4))
    assert Plant.of((A, B, C, D), x0=1.0, delay=[1.0, 2.0]).x0 == pytest.approx(np.ones(2))


def test_a_delay_matrix_of_a_discrete_plant_shifts_by_samples():
    entries = [[signal.dlti([0.1], [1, -0.9], dt=0.5), 0], [0, signal.dlti([0.2], [1, 0], dt=0.5)]]
    run = driven(Plant.of(entries, delay=[[1.0, 0.0], [0.0, 2.5]]), Held([1.0, 1.0], 0.5))
    samples = np.floor(run.t / 0.5 + 1e-6)
    first = 1 - 0.9 ** np.maximum(samples - 2, 0)
    assert run.y[:, 0] == pytest.approx(first, abs=1e-9)
    assert run.y[:, 1] == pytest.approx(np.where(samples >= 6, 0.2, 0.0), abs=1e-9)


def test_disturbances_and_measurements_keep_their_own_times():
    row = [*COLUMN[0], ([2.0], [1, 1])]
    plant = Plant.of([row, [*COLUMN[1], 0]], delay=LATE, output_delay=0.5, disturbances="w")
    run = driven(plant, Held([1.0, 0.0], 1.0), d=np.ones(1), horizon=20.0)
    late = np.maximum(run.t - 0.5, 0.0)
    expected = superposed(late, [(0, 0, 1.0)])
    expected[:, 0] += 2 * (1 - np.exp(-late))
    assert run.y == pytest.approx(expected, abs=1e-9)


def test_the_measured_output_is_late_and_noisy_and_follows_from_the_seed():
    plant = Plant.of(([1.0], [1.0, 1.0]))
    exact, noisy, again = (Held(1.0, 0.1) for _ in range(3))
    driven(plant, exact, measurement_delay=0.25)
    for seen in (noisy, again):
        driven(plant, seen, measurement_delay=0.25, noise=np.array([0.1]))
    t, y = np.array([t for t, _ in exact.seen]), np.array([y[0] for _, y in exact.seen])
    assert y == pytest.approx(1 - np.exp(-np.maximum(t - 0.25, 0)), abs=1e-9)
    difference = np.array([v[0] for _, v in noisy.seen]) - y
    assert 0.05 < difference.std() < 0.15
    assert all(np.array_equal(a[1], b[1]) for a, b in zip(noisy.seen, again.seen, strict=True))


def test_a_discrete_plant_is_held_between_its_samples():
    plant = Plant.of(signal.dlti([0.5], [1.0, -0.5], dt=0.2))
    run = driven(plant, Held(1.0, 0.4), horizon=2.0)
    k = np.floor(run.t / 0.2 + 1e-6)
    assert run.y[:, 0] == pytest.approx(1 - 0.5**k, abs=1e-12)
    with pytest.raises(SettingsError, match=r"multiple of the sample time 0\.2"):
        driven(plant, Held(1.0, 0.3))


def test_the_mpc_of_a_discrete_plant_sees_a_continuous_one_with_the_same_samples():
    plant, none = Plant.of(([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.2)), np.zeros(0)
    J = plant.jacobians(np.zeros(1), np.zeros(1), none)
    same = Plant.of((J.A, J.B, J.C, J.D))
    x, u, t = np.array([2.0]), np.array([3.0]), np.array([0.2])
    assert same.hold(x, u, none, t) == pytest.approx(plant.hold(x, u, none, t), abs=1e-12)
    shifted = Plant.of(([[0.0]], [[1.0]], [[1.0]], [[0.0]], 0.2))
    with pytest.raises(PlantError, match="no continuous model"):
        shifted.jacobians(x, u, none)


@pytest.mark.parametrize(
    ("system", "how", "reason"),
    [
        (([1.0, 0.0], [1.0]), {}, "must be proper"),
        ((A, np.ones((3, 1)), C, D), {}, "B must have shape"),
        ((A, B, C, D, True), {}, "must state its sample time"),
        ("ss", {}, "a linear system must be"),
        ((A, B, C, D), {"inputs": ["a"]}, "expected 2 names"),
        ((A, B, C, D), {"inputs": ["a", "a"]}, "different names"),
        ((A, B, C, D), {"delay": -1.0}, "delay must be 0 s or more"),
        ((A, B, C, D), {"delay": [1.0]}, "a finite number or 2"),
        ((A, B, C, D), {"delay": [[1.0, 2.0]]}, r"a row for each of 2 outputs.*got shape \(1, 2\)"),
        ((A, B, C, D), {"delay": [[0.0, -1.0], [0.0, 0.0]]}, "delay must be 0 s or more"),
        ([[([1], [1, 1]), 0], [0]], {}, "rows of transfer functions must have the same length"),
        # Numerators and denominators as elsewhere; as rows, the gain of the first entry would be 1 / 0.8.
        (
            ([[[1.0], [0.8]], [[0.5], [0.4]]], [[[20, 1], [15, 1]], [[30, 1], [10, 1]]]),
            {},
            "can be read in two ways: give rows of transfer functions as",
        ),
        ((A, B, C, D, 0.1), {"delay": 0.25}, "multiple of its sample time"),
        ((A * np.nan, B, C, D), {}, "A must be finite"),
    ],
)
def test_what_is_no_plant_is_refused(system, how, reason):
    with pytest.raises(PlantError, match=reason):
        Plant.of(system, **how)


def test_a_continuous_loop_is_exact_and_a_sampled_one_converges_to_it():
    # 1/(s + 1) under K: y = K/(1 + K) (1 - exp(-(1 + K) t))
    def exact(t, K=3.0):
        return K / (1 + K) * (1 - np.exp(-(1 + K) * t))

    run = LTILoop(([1.0], [1.0, 1.0]), lambda theta: theta[0], horizon=3.0)([3.0])
    assert run.y[:, 0] == pytest.approx(exact(run.t), abs=1e-12)
    assert run.x.shape == (501, 0)
    errors = []
    for T_s in (0.02, 0.01):
        loop = LTILoop(([1.0], [1.0, 1.0]), lambda theta: theta[0], horizon=3.0, T_s=T_s)
        sampled = loop([3.0])
        errors.append(np.abs(sampled.y[:, 0] - exact(sampled.t)).max())
    assert errors[1] < 0.6 * errors[0] < 0.05


def test_a_loop_starts_at_the_state_and_input_of_a_function_plant():
    plant = FunctionPlant(
        lambda x, u, d: [u[0] - x[0]],
        states=[Channel("level")],
        inputs=[Channel("flow")],
        x0=3.0,
        u0=[1.5],
        delay=0.5,
    )
    run = LTILoop(plant, lambda _: 0.0, horizon=2.0, T_s=0.1)(np.zeros(1))
    # The last input acts for the dead time, then the controller's 0 does.
    early = run.t <= 0.5
    assert run.y[early, 0] == pytest.approx(1.5 + 1.5 * np.exp(-run.t[early]), abs=1e-6)
    assert run.y[-1, 0] == pytest.approx((1.5 + 1.5 * np.exp(-0.5)) * np.exp(-1.5), abs=1e-6)
    same = LTILoop(Plant.of(([1.0], [1, 1]), x0=3.0, u0=1.5, delay=0.5), lambda _: 0.0, horizon=2)
    assert run.y[-1, 0] == pytest.approx(same(np.zeros(1)).y[-1, 0], abs=1e-6)


@pytest.mark.parametrize("start", [{"x0": [1.0, 2.0]}, {"u0": [np.nan]}])
def test_a_start_that_does_not_fit_the_plant_is_refused(start):
    with pytest.raises(PlantError, match="must be a finite number or 1 of them"):
        FunctionPlant(lambda x, u, d: -x, states=[Channel("x")], inputs=[Channel("u")], **start)


def test_two_degrees_of_freedom_get_references_then_outputs():
    law = (np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.array([[4.0, -3.0]]))
    run = LTILoop(([1.0], [1.0, 1.0]), lambda theta: law, horizon=5.0)([1.0])
    assert run.y[-1, 0] == pytest.approx(1.0, abs=1e-8)  # 4/(1 + 3)


def test_limits_saturate_and_instability_is_data():
    plant = Plant.of(([1.0], [1.0, 1.0]), inputs=Channel("u", "", -0.5, 0.5))
    assert LTILoop(plant, lambda theta: theta[0], horizon=3.0)([50.0]).u.max() == 0.5
    wild = LTILoop(([1.0], [1.0, -1.0]), lambda theta: theta[0], horizon=500.0)([0.5])
    assert wild.end.interrupted
    assert np.isfinite(wild.y).all()


@pytest.mark.parametrize(
    ("controller", "error", "reason"),
    [
        (([1.0, 0.0], [1.0]), PlantError, "must be proper"),
        (np.ones((2, 1)), SettingsError, "needs 1 outputs"),
        (-1.0, SettingsError, "algebraic"),
        ("PI", PlantError, "a linear system must be"),
    ],
)
def test_a_controller_that_does_not_fit_is_refused(controller, error, reason):
    loop = LTILoop(([1.0, 0.0], [1.0, 1.0]), lambda theta: controller, horizon=1.0)
    with pytest.raises(error, match=reason):
        loop([1.0])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"d": [1, 2]}, "d must be a finite number or 0 of them"),
        ({"noise": [1, 2]}, "noise must be a finite number or 1 of them"),
        ({"T_s": "x"}, "T_s must be above 0 s, got 'x'"),
        ({"T_s": -1.0}, r"T_s must be above 0 s, got -1\.0"),
    ],
)
def test_settings_that_do_not_fit_a_loop_are_refused(change, words):
    with pytest.raises(SettingsError, match=words):
        LTILoop(([1.0], [1.0, 1.0]), lambda theta: 2.0, horizon=10.0, **change)


seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 4)


def stable(seed, n_x, n_u=2, n_y=2):
    """Random matrices with all poles left of -0.1, and a state and an input to start with."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n_x, n_x))
    A -= (np.linalg.eigvals(A).real.max() + 0.1 + rng.exponential()) * np.eye(n_x)
    B, C = rng.normal(size=(n_x, n_u)), rng.normal(size=(n_y, n_x))
    return (A, B, C, rng.normal(size=(n_y, n_u))), rng.normal(size=n_x), rng.normal(size=n_u)


@given(seed=seeds, n_x=sizes, cuts=st.lists(st.floats(0.01, 3.0), min_size=1, max_size=8))
def test_one_long_hold_is_the_same_as_many_short_ones(seed, n_x, cuts):
    system, x0, u = stable(seed, n_x)
    plant, none, times = Plant.of(system), np.zeros(0), np.cumsum(cuts)
    once, x = plant.hold(x0, u, none, times), x0
    for i, dt in enumerate(cuts):
        x = plant.hold(x, u, none, np.array([dt]))[0]
        assert x == pytest.approx(once[i], rel=1e-9, abs=1e-9)


@given(seed=seeds, n_x=sizes)
def test_a_held_input_leads_to_the_steady_state_of_the_matrices(seed, n_x):
    (A, B, C, D), x0, u = stable(seed, n_x)
    plant, none = Plant.of((A, B, C, D)), np.zeros(0)
    rest = -np.linalg.solve(A, B @ u)
    assert plant.f(rest, u, none) == pytest.approx(np.zeros(n_x), abs=1e-8)
    assert plant.hold(x0, u, none, np.array([1000.0]))[0] == pytest.approx(rest, rel=1e-6, abs=1e-6)


@settings(max_examples=25)
@given(seed=seeds, n_x=sizes, dead=st.floats(0.01, 1.5), late=st.floats(0.0, 0.4))
def test_dead_time_of_input_and_output_add_up_for_any_length(seed, n_x, dead, late):
    system, _, _ = stable(seed, n_x)
    u = np.random.default_rng(seed).normal(size=2)
    split = Plant.of(system, delay=dead, output_delay=late)
    run = driven(split, Held(u, 0.2), horizon=2.0, dense_step=0.025)
    plain = Plant.of(system)
    for i in np.flatnonzero(run.t > dead + late + 1e-6):
        x = plain.hold(np.zeros(n_x), u, np.zeros(0), np.array([run.t[i] - dead - late]))[0]
        assert run.y[i] == pytest.approx(plain.g(x, u, np.zeros(0)), rel=1e-8, abs=1e-8)


G = [3.0, 1.5], [9.0, 6.0, 4.0, 1.5]
H = [0.05, 0.04], [1.0, -1.6, 0.7]  # in z, with T_s = 0.2


def times(fraction, *factors):
    """A fraction whose numerator and denominator have more factors."""
    num, den = fraction
    for factor in factors:
        num, den = np.polymul(num, factor), np.polymul(den, factor)
    return num, den


@pytest.mark.parametrize(
    ("given", "right", "dt", "words"),
    [
        (times(G, [1, 0]), G, 0.0, "s = 0 cancel"),
        (times(G, [1, 0], [1, 0]), G, 0.0, "s = 0 cancel"),
        (times(G, [1, 0, 4]), G, 0.0, "s = 0+2j cancel"),
        ((np.append(times(G)[0], 1e-17), np.append(G[1], 0.0)), G, 0.0, "s = 0 cancel"),
        (([1e-16, 2e-16, 0, *G[0]], G[1]), G, 0.0, "rounding"),
        (([1e-16, *G[0]], G[1]), G, 0.0, "rounding"),
        ((G[0], [1e-17, *G[1]]), G, 0.0, "rounding"),
        (([1.0], [2.0, 1.0, 1e-14]), ([1.0], [2.0, 1.0, 0.0]), 0.0, "rounding"),
        (([-2e-16, 0.5], [1.0, 0.5, -8e-16]), ([0.5], [1.0, 0.5, 0.0]), 0.0, "rounding"),
        (([1.0], [1.0, 1e-16, -1e-17]), ([1.0], [1.0, 0.0, 0.0]), 0.0, "rounding"),
        (times(H, [1, -1]), H, 0.2, "z = 1 cancel"),
        (times(H, [1, 1]), H, 0.2, "z = -1 cancel"),
        ((np.concatenate([[1e-16, 1e-16], H[0]]), H[1]), H, 0.2, "rounding"),
        (times(([0.05], [1, 0]), [1, 0]), ([0.05], [1, 0]), 0.0, "s = 0 cancel"),
    ],
)
def test_rounding_and_common_factors_that_do_not_decay_are_left_out_and_said(given, right, dt, words):
    made = of_fractions([[given[0]]], [[given[1]]], dt)
    omega = np.geomspace(0.01, 3.0, 9)
    z = np.exp(1j * omega * dt) if dt else 1j * omega
    exact = np.polyval(right[0], z) / np.polyval(right[1], z)
    np.testing.assert_allclose(made.at(1j * omega)[:, 0, 0], exact, rtol=1e-6)
    assert len(made.A) == len(right[1]) - 1
    assert words in " ".join(made.cleaned)


def test_zeros_poles_and_gain_that_share_an_integrator_are_cleaned():
    made = system_of(signal.lti([0.0, -1.0], [0.0, -2.0, -3.0], 4.0))
    assert len(made.A) == 2
    assert made.at(np.array([2j]))[0, 0, 0] == pytest.approx(4 * (2j + 1) / (2j + 2) / (2j + 3))


@pytest.mark.parametrize(("fraction", "factor", "dt"), [(G, [1, -2], 0.0), (H, [1, -1.1], 0.2)])
def test_an_unstable_pole_that_cancels_is_refused(fraction, factor, dt):
    num, den = times(fraction, factor)
    with pytest.raises(PlantError, match=r"unstable pole at [sz] = [\d.]+ that a zero cancels"):
        of_fractions([[num]], [[den]], dt)


@pytest.mark.parametrize(
    "fraction",
    [
        times(G, [1, 2]),  # a stable factor does no harm
        ([1.0, 1e-7], [1.0, 1.0, 0.0]),  # a slow zero is none at 0
        ([1.0, 0.0], [1.0, 1.0, 1e-7]),  # and a slow pole no integrator
        (np.poly([-1.0] * 6), np.poly([-0.9] * 7)),
        ([1.0], [1e-15, 1e-7, 1.0]),  # fast, in s
        ([1e-6, 1.0], [1.0, 1.0, 0.0]),
        ([1e-15], [1.0, 3e-5, 3e-10, 1e-15]),
    ],
)
def test_what_is_no_rounding_stays(fraction):
    made = system_of(fraction)
    assert made.cleaned == ()
    assert len(made.A) == len(fraction[1]) - 1


def test_a_lag_before_the_inputs_multiplies_the_transfer_function():
    system = Plant.of(([2.0, 1.0], [5, 1, 1])).system
    s = 1j * np.array([0.01, 0.3, 2.0])
    expected = system.at(s)[:, 0, 0] / (1 + 4 * s)
    assert system.behind(4.0).at(s)[:, 0, 0] == pytest.approx(expected, rel=1e-12)
    assert system.behind(0.0) is system
