"""Warm start from an earlier study: its best θ, as θ of another space."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contracts.agents import MIXED, latent, run
from prefcal_agents import GLISp, RandomSearch
from prefcal_agents.transfer import Earlier
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace, LinearConstraint

LINE = KnobSpace([Knob("x", 0.0, 10.0, "m")])
AREA = KnobSpace([Knob("y", 0.0, 4.0, "s"), Knob("x", 0.0, 10.0, "m")])


def record(best, knobs=LINE.knobs):
    return Earlier(knobs, (float(best),))


def found(agent):
    run(agent)
    return Earlier.of(agent)


def test_the_best_of_an_earlier_study_is_the_first_experiment_of_the_next():
    before = GLISp(MIXED, n_init=3, n_max=8, seed=1)
    earlier = found(before)
    start = earlier.start(MIXED)
    assert start == pytest.approx(before.best)
    agent = GLISp(MIXED, n_init=4, n_max=8, start=start)
    assert agent.ask().challenger.theta == pytest.approx(before.best)
    run(agent)
    assert latent(agent.best) <= latent(before.best)


def test_nothing_found_is_refused():
    with pytest.raises(SettingsError, match="no answered experiment"):
        Earlier.of(GLISp(LINE))
    with pytest.raises(SettingsError, match="1 values"):
        Earlier(LINE.knobs, (1.0, 2.0))


def test_knobs_are_matched_by_name():
    earlier = Earlier(AREA.knobs, (1.0, 7.0))
    swapped = KnobSpace([AREA.knobs[1], AREA.knobs[0]])
    assert earlier.start(swapped) == (7.0, 1.0)
    assert earlier.start(LINE) == (7.0,)  # y is no knob any more


def test_a_new_knob_needs_a_value():
    with pytest.raises(KnobError, match=r"no knobs \['y'\]"):
        record(7).start(AREA)
    assert record(7).start(AREA, added={"y": 3}) == (3.0, 7.0)
    assert record(7).start(AREA, added={"x": 1, "y": 9}) == (4.0, 7.0)


@pytest.mark.unchecked
@pytest.mark.parametrize("value", ["fast", None, np.nan])
def test_a_value_of_it_that_is_none_is_refused(value):
    with pytest.raises(KnobError, match=r"numbers|finite"):
        record(7).start(AREA, added={"y": value})


def test_another_unit_is_refused():
    with pytest.raises(KnobError, match="'x' was in 'm' in the earlier study, and is in 'km'"):
        record(7).start(KnobSpace([Knob("x", 0, 10, "km")]))


def test_what_lies_outside_becomes_the_nearest_inside():
    assert record(9).start(KnobSpace([Knob("x", 1, 5, "m")])) == (5.0,)
    assert record(9).start(LINE.narrowed({"x": (2, 3)})) == (3.0,)
    assert record(9).start(LINE.narrowed({"x": (2, 2)})) == (2.0,)
    logarithmic = KnobSpace([Knob("x", 0.1, 100, "m", scale="log10")])
    assert record(0).start(logarithmic) == (0.1,)


def test_a_fraction_becomes_the_nearest_integer():
    assert record(6.5).start(KnobSpace([Knob("x", 1, 9, "m", integer=True)])) == (7.0,)


def test_constraints_are_respected():
    below = KnobSpace(LINE.knobs, [LinearConstraint("low", {"x": 1}, 4)])
    assert record(3).start(below) == (3.0,)
    assert record(9).start(below) is None
    assert GLISp(below, start=record(9).start(below)).ask()  # begins as without it


@settings(max_examples=40)
@given(st.tuples(*[st.floats(-1e6, 1e6)] * 3))
def test_whatever_was_found_an_agent_can_begin_with(best):
    knobs = (Knob("weight", -2e6, 2e6), Knob("gain", -2e6, 2e6), Knob("horizon", -2e6, 2e6))
    start = Earlier((*knobs, Knob("gone", 0, 2)), (*best, 1.0)).start(MIXED)
    agent = RandomSearch(MIXED, n_init=3, n_max=5, start=start)
    run(agent)
    # The way through the unit cube rounds to 1e-16 of a range, which is up to 2e6 here.
    assert agent.samples[0] == pytest.approx(np.array(start), rel=1e-9, abs=1e-9)
