"""Known constraints on θ: what is refused at birth, and what they allow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env import Constraint, Knob, KnobSpace, LinearConstraint
from prefcal_env.errors import KnobError

KNOBS = (Knob("gain", 0.01, 10.0, scale="log10"), Knob("horizon", 2, 9, integer=True))
SUM = LinearConstraint("sum", {"gain": 2.0, "horizon": 1.0}, at_most=10.0)
PRODUCT = Constraint("product", lambda knobs: knobs["gain"] * knobs["horizon"] - 20.0)
SPACE = KnobSpace(KNOBS, constraints=(SUM, PRODUCT))
inside = st.tuples(st.floats(0.01, 10.0), st.integers(2, 9)).map(lambda t: np.array(t, float))


@given(inside)
def test_theta_is_allowed_where_every_constraint_is_0_or_less(theta):
    allowed = 2 * theta[0] + theta[1] <= 10 * (1 + 1e-12) and theta[0] * theta[1] <= 20
    assert SPACE.allows(theta) is bool(allowed)
    assert SPACE.allows(theta[None]).tolist() == [allowed]


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
    assert KnobSpace(KNOBS, (again, PRODUCT)) == SPACE
    assert hash(SPACE) == hash(KnobSpace(KNOBS, (again, PRODUCT)))
    assert KnobSpace(KNOBS) != SPACE
    assert KnobSpace(KNOBS, (SUM, Constraint("product", lambda knobs: 0.0))) != SPACE
    with pytest.raises(AttributeError):
        SPACE.constraints = ()


def test_decoding_and_encoding_work_for_theta_that_are_not_allowed():
    theta = SPACE.decode(np.array([1.0, 1.0]))
    assert theta.tolist() == [10.0, 9.0]
    assert SPACE.encode(theta).tolist() == [1.0, 1.0]
    assert SPACE.snap(np.ones(2)).tolist() == [1.0, 1.0]


def test_theta_that_is_not_allowed_is_refused_with_name_value_and_what_was_expected():
    assert SPACE.check_allowed([0.5, 3]).tolist() == [0.5, 3.0]
    with pytest.raises(KnobError, match=r"'sum' must be 0 or less, got 19 at .*'gain': 10.0"):
        SPACE.check_allowed([10.0, 9])
    with pytest.raises(KnobError, match="must be in"):
        SPACE.check_allowed([11.0, 9])


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
            SPACE.allows(thetas)
