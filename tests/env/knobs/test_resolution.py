"""Knobs have a resolution: the round numbers among which values are proposed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.errors import KnobError
from prefcal_env.knobs.constraints import LinearConstraint
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace


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


@given(
    st.floats(-1e6, 1e6),
    st.floats(1e-6, 1e6),
    st.floats(0, 1),
    st.sampled_from(["linear", "log10"]),
)
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
