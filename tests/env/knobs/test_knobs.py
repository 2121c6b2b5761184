"""Knobs, spaces and constraints: what is refused at birth, and the way between the cube and physics."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Constraint, Knob, KnobSpace, LinearConstraint
from prefcal_env.errors import KnobError

SPACE = KnobSpace(
    [
        Knob("T_s", 0.25, 1.5, "h", step=0),
        Knob("N_p", 4, 40, integer=True),
        Knob("gain", 1e-3, 1e3, scale="log10", step=0),
    ]
)
cube = st.lists(st.floats(0, 1), min_size=3, max_size=3).map(np.array)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"low": 2.0, "high": 1.0, "unit": "h"}, r"low must be below high, got \[2.0, 1.0\] h"),
        ({"low": 1.0, "high": 1.0}, "low must be below high"),
        ({"low": -np.inf, "high": 1.0}, "must be finite"),
        ({"low": 0.0, "high": np.nan}, "must be finite"),
        ({"low": "0", "high": 1.0}, "must be numbers"),
        ({"low": None, "high": 1.0}, "must be numbers"),
        ({"low": -1.7e308, "high": 1.7e308}, "high minus low must be below"),
        ({"low": -1e308, "high": 1e308}, "high minus low must be below 1.8e308, got"),
        ({"low": 0.0, "high": 5e-324}, "too close"),
        ({"low": 1.0, "high": 1 + 2.5e-16}, "too close"),
        ({"low": 1.0, "high": 1 + 8 * math.ulp(1.0)}, "too close"),
        ({"low": 2.0**60, "high": 2.0**60 + 2**10, "integer": True}, "too close"),
        ({"low": 1.0, "high": 1 + 8 * math.ulp(1.0), "scale": "log10"}, "too close"),
        ({"low": 0.0, "high": 1.0, "scale": "log10"}, "log10 scale needs low above 0"),
        ({"low": -1.0, "high": 0.0, "scale": "log10"}, "log10 scale needs .* or high below 0"),
        ({"low": -1.0, "high": 1.0, "scale": "log10"}, "log10 scale needs .* or high below 0"),
        ({"low": 0.0, "high": 1.0, "scale": "log"}, "scale must be one of"),
        ({"low": 0.5, "high": 3.0, "integer": True}, "integer bounds"),
        ({"low": 0, "high": 3, "integer": "yes"}, "integer must be True or False, got 'yes'"),
        ({"low": 0, "high": 3, "unit": 3}, "unit must be text, got 3"),
    ],
)
def test_an_impossible_knob_is_refused_with_name_value_and_unit(arguments, message):
    with pytest.raises(KnobError, match=message) as caught:
        Knob("T_s", **arguments)
    assert "'T_s'" in str(caught.value)


@pytest.mark.parametrize(
    "knob",
    [
        Knob("k", 0, 5e-319),
        Knob("k", 1, 1 + 2e-12),
        Knob("k", 1e12, 1e12 + 5, integer=True),
        Knob("k", 0, 2**60, integer=True),
        Knob("k", -8e307, 8e307),
        Knob("k", 1.0, 1 + 2e-12, scale="log10"),
    ],
    ids=str,
)
def test_the_narrowest_and_the_widest_ranges_hold_enough_numbers(knob):
    space = KnobSpace([knob])
    values = {space.decode(np.array([z]))[0] for z in np.linspace(0, 1, 501)}
    assert len(values) > (5 if knob.integer else 90)


def test_a_part_of_a_range_that_holds_hardly_a_number_is_refused():
    with pytest.raises(KnobError, match=r"knob 'k': .* too narrow"):
        KnobSpace([Knob("k", 1, 1 + 1e-11)], within={"k": (1.0, 1 + 4e-16)})


def test_a_knob_without_a_name_is_refused():
    with pytest.raises(KnobError, match="needs a name"):
        Knob("  ", 0, 1)


@pytest.mark.parametrize("knobs", [[], 5, Knob("a", 0, 1), ["T_s"], [Knob("a", 0, 1), Knob("a", 0, 2)]])
def test_an_impossible_space_is_refused(knobs):
    with pytest.raises(KnobError):
        KnobSpace(knobs)


def test_corners_decode_to_the_bounds_exactly():
    np.testing.assert_array_equal(SPACE.decode(np.zeros(3)), [0.25, 4, 1e-3])
    np.testing.assert_array_equal(SPACE.decode(np.ones(3)), [1.5, 40, 1e3])


def test_a_log_knob_is_even_in_decades():
    assert SPACE.decode(np.array([0, 0, 0.5]))[2] == pytest.approx(1.0)


def test_a_log_knob_of_negative_values_mirrors_the_positive_one():
    below, above = (Knob("K", *ends, scale="log10") for ends in ((-50, -0.5), (0.5, 50)))
    z = np.linspace(0, 1, 41)
    values = np.array([below.decode(each) for each in z])
    np.testing.assert_allclose(values, [-above.decode(1 - each) for each in z], rtol=1e-12)
    np.testing.assert_allclose(below.decode_all(z), values, rtol=1e-12)
    np.testing.assert_allclose(below.encode_all(values), z, atol=1e-12)
    np.testing.assert_allclose([below.encode(value) for value in values], z, atol=1e-12)
    assert below.resolution == above.resolution
    choices = below.choices(-50, -0.5)
    assert np.all(np.diff(choices) > 0)
    assert len(choices) > 100
    assert [below.round(value) for value in choices] == list(choices)
    np.testing.assert_allclose(below.round_all(choices), choices, rtol=0.01)


def test_integers_round_half_up():
    two = KnobSpace([Knob("n", 0, 3, integer=True)])
    assert [two.decode(np.array([z]))[0] for z in (0.5 / 3, 1.5 / 3, 2.4999 / 3)] == [1, 2, 2]


@given(z=cube)
def test_decode_stays_in_the_box_and_encode_leads_back(z):
    theta = SPACE.decode(z)
    np.testing.assert_array_equal(SPACE.check(theta), theta)
    np.testing.assert_allclose(SPACE.decode(SPACE.encode(theta)), theta, rtol=1e-12)


@given(z=cube)
def test_snap_is_idempotent_and_names_the_experiment(z):
    snapped = SPACE.snap(z)
    np.testing.assert_allclose(SPACE.snap(snapped), snapped, atol=1e-12)
    np.testing.assert_allclose(SPACE.decode(snapped), SPACE.decode(z), rtol=1e-12)


@pytest.mark.parametrize(
    ("theta", "message"),
    [
        ([0.2, 10, 1], r"'T_s' must be in \[0.25, 1.5\] h, got 0.2"),
        ([0.5, 41, 1], "'N_p' must be in"),
        ([0.5, 10.5, 1], "'N_p' must be an integer, got 10.5"),
        ([0.5, 10, np.nan], "must be finite"),
        ([0.5, 10], r"shape \(3,\).*got shape \(2,\)"),
        ([[0.5, 10, 1]], r"got shape \(1, 3\)"),
        ("abc", "must be numbers"),
    ],
)
def test_theta_that_does_not_fit_is_refused(theta, message):
    with pytest.raises(KnobError, match=message):
        SPACE.check(theta)


@pytest.mark.parametrize("z", [[-0.1, 0, 0], [0, 1.1, 0], [0, 0, np.nan], [0, 0]])
def test_a_point_outside_the_cube_is_refused(z):
    with pytest.raises(KnobError):
        SPACE.decode(np.array(z))


def test_named_gives_integers_as_integers_in_order():
    named = SPACE.named(np.array([0.25, 26.0, 1.0]))
    assert list(named) == ["T_s", "N_p", "gain"]
    assert isinstance(named["N_p"], int)


@pytest.mark.parametrize(
    ("knob", "step"),
    [
        (Knob("T_s", 0.1, 1.0, "h"), 0.005),
        (Knob("log Q", -5.0, 3.0), 0.05),
        (Knob("angle", -180, 180, "°"), 2.0),
        (Knob("K", 0.01, 10.0, scale="log10"), 0.05),  # 5 %
        (Knob("K", 1, 2, scale="log10"), 0.005),
        (Knob("N", 3, 60, integer=True), 1.0),
        (Knob("N", 1, 1000, scale="log10", integer=True), 1.0),
        (Knob("x", 0, 1, step=0.25), 0.25),
        (Knob("x", 0, 1, step=0), 0.0),
        (Knob("narrow", 1, 1 + 5e-12), 0.0),
    ],
)
def test_the_step_is_given_or_a_round_share_of_the_range(knob, step):
    assert knob.resolution == step


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.floats(0, 1), st.sampled_from(["linear", "log10"]))
def test_the_default_is_between_a_250th_and_a_100th_of_the_range(low, width, share, scale):
    if scale == "log10":
        low = abs(low) + 1e-3
    knob = Knob("x", low, low + width, scale=scale)
    if knob.resolution == 0:
        assert width < 1e-10 * abs(low)
        return
    first, last = knob.steps(np.array([knob.low, knob.high]))
    assert 99.9 <= last - first <= 251 * (1.1 if scale == "log10" else 1)
    value = knob.decode(share)
    assert knob.round(knob.round(value)) == knob.round(value)
    away = np.diff(knob.steps(np.array([value, knob.round(value)])))
    assert abs(away[0]) <= 0.56  # the digits of a round number add up to a twentieth of a step


def test_what_is_proposed_comes_back_as_the_round_number_that_it_is():
    space = KnobSpace([Knob("T_s", 0.1, 1.0, "h"), Knob("K", 0.01, 10.0, scale="log10")])
    theta = space.decode(space.snap(np.array([0.2284, 0.481])))
    assert theta.tolist() == [0.305, 0.276]
    assert space.decode(space.snap(space.encode(theta))).tolist() == theta.tolist()
    assert space.decode(space.snap(np.zeros(2))).tolist() == [0.1, 0.01]
    assert space.decode(space.snap(np.ones(2))).tolist() == [1.0, 10.0]


def test_a_given_value_need_not_be_a_round_number():
    space = KnobSpace([Knob("log Q", -5.0, 3.0)])
    assert space.decode(space.encode(np.array([-1.79]))) == pytest.approx([-1.79], abs=1e-14)


def test_close_means_less_than_a_step_away_in_every_knob():
    space = KnobSpace([Knob("x", 0, 10, step=0.5), Knob("N", 1, 9, integer=True)])
    tried = np.array([[2.0, 4.0], [2.3, 4.0], [2.0, 5.0], [9.5, 9.0]])
    assert space.close(np.array([2.5, 4.0]), tried).tolist() == [False, True, False, False]
    assert space.close(np.array([9.5, 9.0]), tried).tolist() == [False, False, False, True]
    fine = KnobSpace([Knob("x", 0, 10, step=0)])
    assert fine.close(np.array([2.0]), np.array([[2.0], [2.0 + 1e-12]])).tolist() == [True, False]
    with pytest.raises(KnobError, match="has no step"):
        fine.knobs[0].steps(np.zeros(1))


def test_rounding_does_not_leave_what_is_searched_or_allowed():
    knob = Knob("x", 0.0, 10.0, step=1.0)
    narrowed = KnobSpace([knob], within={"x": (2.3, 4.6)})
    inside = [narrowed.decode(narrowed.snap(z)) for z in np.linspace(0.23, 0.46, 12)[:, None]]
    assert {float(x[0]) for x in inside} == {2.3, 3.0, 4.0, 4.6}
    bounded = KnobSpace([knob], [LinearConstraint("bound", {"x": 1}, 7.6)])
    assert bounded.decode(bounded.snap(np.array([0.757]))) == pytest.approx([7.57])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": -0.1}, "step must be a number, 0 or more"),
        ({"step": np.nan}, "step must be a number, 0 or more"),
        ({"step": "fine"}, "step must be a number, 0 or more"),
        ({"step": True}, "step must be a number, 0 or more"),
        ({"step": 20.0}, "step must be at most 9, the range"),
        ({"step": 9.5, "scale": "log10"}, "step must be at most 9, the range"),
        ({"step": 0.5, "integer": True}, "an integer knob needs an integer step"),
        ({"step": 0, "integer": True}, "an integer knob needs an integer step"),
    ],
)
def test_an_impossible_step_is_refused(options, message):
    with pytest.raises(KnobError, match=f"knob 'x': {message}"):
        Knob("x", 1.0, 10.0, "V", **options)


def test_an_integer_knob_may_go_in_larger_steps():
    space = KnobSpace([Knob("N", 3, 60, integer=True, step=5)])
    proposed = {float(space.decode(space.snap(np.array([z])))[0]) for z in np.linspace(0, 1, 400)}
    assert proposed == {3.0, *np.arange(5.0, 61.0, 5.0)}


EVERY_KIND = KnobSpace(
    [
        Knob("real", 2.0, 5.0, step=0),
        Knob("count", 3, 17, integer=True),
        Knob("decades", 1, 5000, scale="log10", integer=True),
    ]
)
coordinate = st.floats(0, 1)


@given(st.tuples(coordinate, coordinate, coordinate))
def test_snapping_many_agrees_with_snapping_one(z):
    snapped, one = EVERY_KIND.snap_all(np.array([z]))[0], EVERY_KIND.snap(np.array(z))
    assert snapped[0] == z[0]
    assert EVERY_KIND.check(EVERY_KIND.decode(snapped))[1:] == pytest.approx(
        EVERY_KIND.decode(one)[1:], abs=1
    )
    half_way = [(3 + 14 * z[1]) % 1, 5000 ** z[2] % 1]
    for k, part in enumerate(half_way, start=1):
        # Just between two integers, rounding may take either.
        assert abs(part - 0.5) < 1e-9 or snapped[k] == pytest.approx(one[k], abs=1e-12)


@given(st.lists(st.tuples(coordinate, coordinate, coordinate), max_size=5))
def test_encoding_many_agrees_with_encoding_one(points):
    thetas = np.array([EVERY_KIND.decode(np.array(z)) for z in points]).reshape(-1, 3)
    z = EVERY_KIND.encode_all(thetas)
    assert z.shape == thetas.shape
    for theta, found in zip(thetas, z, strict=True):
        assert found == pytest.approx(EVERY_KIND.encode(theta), abs=1e-14)


@pytest.mark.parametrize(
    ("theta", "words"),
    [
        ((1.9, 3, 1), "'real' must be in"),
        ((2.0, 3.5, 1), "'count' must be an integer"),
        ((2.0, 3, np.nan), "must be finite"),
        ((2.0, 3, np.inf), "must be finite"),
        ((2.0, 3, 0), "'decades' must be in"),
        ((2.0, 3), "must have shape"),
    ],
)
def test_of_many_the_first_that_cannot_be_is_refused(theta, words):
    fine = (2.0, 3.0, 1.0)[: len(theta)]
    with pytest.raises(KnobError, match=words):
        EVERY_KIND.encode_all(np.array([fine, theta, np.full(len(theta), 9e9)], dtype=float))


@given(st.tuples(coordinate, coordinate, coordinate))
def test_decoding_many_agrees_with_decoding_one(z):
    z = EVERY_KIND.snap_all(np.array([z]))
    assert EVERY_KIND.decode_all(z)[0] == pytest.approx(EVERY_KIND.decode(z[0]), rel=1e-12, abs=1e-12)


def test_a_part_that_rounding_leaves_no_room_in_is_refused():
    with pytest.raises(KnobError, match="too narrow to search"):
        EVERY_KIND.narrowed({"real": (3.0, 3.0 + 1e-12)})
    with pytest.raises(KnobError, match=r"expected a part of \[2.0, 5.0\], got 1 to 3"):
        EVERY_KIND.narrowed({"real": (1, 3)})
    with pytest.raises(KnobError, match=r"existing knobs, got \['speed'\]"):
        EVERY_KIND.narrowed({"speed": (0, 1)})


KNOBS = (Knob("gain", 0.01, 10.0, scale="log10"), Knob("horizon", 2, 9, integer=True))
SUM = LinearConstraint("sum", {"gain": 2.0, "horizon": 1.0}, at_most=10.0)
PRODUCT = Constraint("product", lambda knobs: knobs["gain"] * knobs["horizon"] - 20.0)
CONSTRAINED = KnobSpace(KNOBS, constraints=(SUM, PRODUCT))
inside = st.tuples(st.floats(0.01, 10.0), st.integers(2, 9)).map(lambda t: np.array(t, float))


@given(inside)
def test_theta_is_allowed_where_every_constraint_is_0_or_less(theta):
    allowed = 2 * theta[0] + theta[1] <= 10 * (1 + 1e-12) and theta[0] * theta[1] <= 20
    assert CONSTRAINED.allows(theta) is bool(allowed)
    assert CONSTRAINED.allows(theta[None]).tolist() == [allowed]


@given(st.lists(inside, max_size=8))
def test_a_vectorized_constraint_says_the_same_as_one_that_is_called_for_each_theta(thetas):
    vectorized = KnobSpace(KNOBS, [Constraint("product", PRODUCT.g, vectorized=True)])
    rows = np.array(thetas).reshape(-1, 2)
    assert np.array_equal(vectorized.allows(rows), KnobSpace(KNOBS, [PRODUCT]).allows(rows))


def test_a_space_without_constraints_allows_everything_and_equals_the_one_of_before():
    free = KnobSpace(KNOBS)
    assert free.constraints == ()
    assert free.allows(np.array([5.0, 9.0])) is True
    assert free.allows(np.zeros((3, 2))).tolist() == [True] * 3
    assert free == KnobSpace(KNOBS, ())
    assert hash(free) == hash(KnobSpace(KNOBS, ()))


def test_spaces_are_equal_if_knobs_and_constraints_are():
    again = LinearConstraint("sum", {"gain": 2, "horizon": 1}, 10)
    assert KnobSpace(KNOBS, (again, PRODUCT)) == CONSTRAINED
    assert hash(CONSTRAINED) == hash(KnobSpace(KNOBS, (again, PRODUCT)))
    assert KnobSpace(KNOBS) != CONSTRAINED
    assert KnobSpace(KNOBS, (SUM, Constraint("product", lambda knobs: 0.0))) != CONSTRAINED
    with pytest.raises(AttributeError):
        CONSTRAINED.constraints = ()


def test_decoding_and_encoding_work_for_theta_that_are_not_allowed():
    theta = CONSTRAINED.decode(np.array([1.0, 1.0]))
    assert theta.tolist() == [10.0, 9.0]
    assert CONSTRAINED.encode(theta).tolist() == [1.0, 1.0]
    assert CONSTRAINED.snap(np.ones(2)).tolist() == [1.0, 1.0]


def test_theta_that_is_not_allowed_is_refused_with_name_value_and_what_was_expected():
    assert CONSTRAINED.check_allowed([0.5, 3]).tolist() == [0.5, 3.0]
    with pytest.raises(KnobError, match=r"'sum' must be 0 or less, got 19 at .*'gain': 10.0"):
        CONSTRAINED.check_allowed([10.0, 9])
    with pytest.raises(KnobError, match="must be in"):
        CONSTRAINED.check_allowed([11.0, 9])


def test_rounding_does_not_refuse_theta_on_the_edge_of_a_linear_constraint():
    knobs = [Knob("a", 0, 1), Knob("b", 0, 1)]
    space = KnobSpace(knobs, [LinearConstraint("sum", {"a": 1, "b": 1}, 0.3)])
    assert 0.1 + 0.2 > 0.3
    assert space.allows(np.array([0.1, 0.2]))
    assert not space.allows(np.array([0.1, 0.2 + 1e-9]))


def test_what_is_not_a_number_is_not_allowed():
    space = KnobSpace(KNOBS, [Constraint("nan", lambda knobs: np.nan)])
    assert space.allows(np.array([1.0, 3.0])) is False
    with pytest.raises(KnobError, match="'nan' must be 0 or less, got nan"):
        space.check_allowed([1.0, 3])


@pytest.mark.parametrize(
    ("g", "message"),
    [
        (lambda knobs: knobs["Gain"], "'odd' cannot be computed at .*KeyError"),
        (lambda knobs: "low", "'odd' cannot be computed at .*ValueError"),
        (lambda knobs: [1.0, 2.0], r"'odd' must return one number for each θ"),
        (lambda knobs: None, "'odd' .*must|'odd' cannot"),
    ],
)
def test_a_constraint_that_gives_no_number_is_refused_by_name(g, message):
    space = KnobSpace(KNOBS, [Constraint("odd", g)])
    if g({"Gain": 1}) is None:  # None is NaN to numpy, which is not allowed
        assert not space.allows(np.array([1.0, 3.0]))
        return
    with pytest.raises(KnobError, match=message):
        space.allows(np.array([1.0, 3.0]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Constraint("", abs), "needs a name"),
        (lambda: Constraint("a", 3), "'a': g must be a function"),
        (lambda: LinearConstraint(" ", {"gain": 1}, 0), "needs a name"),
        (lambda: LinearConstraint("a", {}, 0), "'a': coefficients must map"),
        (lambda: LinearConstraint("a", [1.0], 0), "'a': coefficients must map"),
        (lambda: LinearConstraint("a", {"gain": np.nan}, 0), "'a': gain must be a finite"),
        (lambda: LinearConstraint("a", {"gain": 1}, np.inf), "'a': at_most must be a finite"),
        (lambda: LinearConstraint("a", {"gain": 1}, "0"), "'a': at_most must be a finite"),
        (lambda: KnobSpace(KNOBS, SUM), "sequence"),
        (lambda: KnobSpace(KNOBS, "sum"), "sequence"),
        (lambda: KnobSpace(KNOBS, [abs]), "expected a Constraint"),
        (lambda: KnobSpace(KNOBS, [SUM, SUM]), r"\['sum'\] more than once"),
        (lambda: KnobSpace(KNOBS[:1], [SUM]), r"'sum' names \['horizon'\]"),
    ],
)
def test_impossible_constraints_are_refused_at_birth(make, message):
    with pytest.raises(KnobError, match=message):
        make()


def test_thetas_of_another_shape_are_refused():
    for thetas in (np.zeros(3), np.zeros((2, 3)), np.zeros((1, 1, 2))):
        with pytest.raises(KnobError, match="shape"):
            CONSTRAINED.allows(thetas)
