"""Spaces that change in a running study, and a warm start from an earlier one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contracts.proposals import MIXED, judge, latent, run
from prefcal_agents import GLISp, RandomSearch
from prefcal_agents.baselines import LatinHypercube
from prefcal_agents.transfer import Earlier, respaced
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace, LinearConstraint
from support.agents import agents_without_extra

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


AGENTS = agents_without_extra()


@pytest.fixture(params=AGENTS.values(), ids=AGENTS)
def make_agent(request):
    return request.param


def half_way(make, count=5, space=MIXED):
    agent = make(space, n_init=3, n_max=12)
    run(agent, [judge] * count)
    return agent


def test_a_narrowed_range_is_all_that_is_searched(make_agent):
    agent = half_way(make_agent)
    new = MIXED.narrowed({"gain": (0.1, 1.0), "horizon": (4, 6)})
    after = respaced(agent, new, keep_open=False)
    assert after.space == new
    run(after)
    assert after.samples[:5].tolist() == agent.samples.tolist()
    later = after.samples[5:]
    assert len(later) == 7
    assert np.all((later[:, 0] >= 0.1) & (later[:, 0] <= 1.0))
    assert np.all((later[:, 1] >= 4) & (later[:, 1] <= 6))
    assert len(np.unique(after.samples, axis=0)) == 12


def test_a_widened_range_keeps_every_theta(make_agent):
    agent = half_way(make_agent)
    wider = KnobSpace([MIXED.knobs[0], MIXED.knobs[1], Knob("weight", -9.0, 9.0)])
    after = respaced(agent, wider)
    assert after.samples == pytest.approx(agent.samples)
    assert after.ask().challenger.theta == pytest.approx(agent.ask().challenger.theta)
    assert after.ask().incumbent.index == agent.ask().incumbent.index
    run(after)
    assert len(after.samples) == 12


def test_an_added_knob_has_its_old_value_in_the_experiments_before(make_agent):
    agent = half_way(make_agent)
    more = KnobSpace([Knob("filter", 1.0, 5.0, "s"), *MIXED])
    simulate = getattr(agent, "simulate", None)  # `quick` can be asked about any number of knobs
    after = respaced(agent, more, added={"filter": 0.5}, keep_open=False, simulate=simulate)
    assert after.samples[:, 1:] == pytest.approx(agent.samples)
    assert after.samples[:, 0] == pytest.approx(0.5)
    run(after)
    assert np.all(after.samples[5:, 0] >= 1.0)


def test_what_simulates_goes_on_with_the_same_knobs_and_must_be_given_anew_for_others():
    agent = half_way(AGENTS["Screening"])
    assert respaced(agent, MIXED.narrowed({"gain": (0.1, 1.0)})).simulate is agent.simulate
    more = KnobSpace([Knob("filter", 1.0, 5.0, "s"), *MIXED])
    after = respaced(agent, more, added={"filter": 0.5}, keep_open=False)
    assert after.simulate is None  # it would take the filter for the gain
    with pytest.raises(SettingsError, match="needs simulate"):
        after.ask()
    with pytest.raises(SettingsError, match="RandomSearch takes no simulate"):
        respaced(half_way(RandomSearch), MIXED, simulate=agent.simulate)


def test_the_verdicts_outside_still_teach():
    agent = half_way(GLISp, 8)
    after = respaced(agent, MIXED.narrowed({"gain": (0.1, 1.0)}))
    assert after.surrogate(agent.samples) == pytest.approx(agent.surrogate(agent.samples))


def test_an_integer_space_ends_when_what_is_searched_has_run():
    space = KnobSpace([Knob("a", 0, 9, integer=True), Knob("b", 0.0, 1.0)])
    agent = half_way(RandomSearch, 4, space)
    after = respaced(agent, space.narrowed({"a": (3, 5), "b": (0.5, 0.5)}), keep_open=False)
    run(after)
    assert sorted(after.samples[4:, 0].tolist()) == [3.0, 4.0, 5.0]
    assert after.n_max == 7


@pytest.mark.parametrize(
    ("new", "added", "words"),
    [
        (KnobSpace(MIXED.knobs[:2]), {}, r"knobs \['weight'\] are missing"),
        (KnobSpace([*MIXED, Knob("filter", 0, 1)]), {}, r"added knobs \['filter'\]"),
        (MIXED, {"gain": 1.0}, "got \\['gain'\\]"),
        (KnobSpace([*MIXED.knobs[:2], Knob("weight", -5, 3, "s")]), {}, "must keep its unit"),
    ],
)
def test_an_impossible_change_is_refused(new, added, words):
    with pytest.raises(KnobError, match=words):
        respaced(half_way(RandomSearch), new, added=added)


@settings(max_examples=15)
@given(st.data())
def test_no_proposal_leaves_what_is_searched(data):
    part = {}
    for knob in MIXED:
        number = (
            st.integers(int(knob.low), int(knob.high)) if knob.integer else st.floats(knob.low, knob.high)
        )
        low, high = sorted((data.draw(number), data.draw(number)))
        narrow = knob.encode(high) - knob.encode(low) < 1e-9
        part[knob.name] = (low, low) if narrow else (low, high)
    kind = data.draw(st.sampled_from([GLISp, RandomSearch, LatinHypercube]))
    new = MIXED.narrowed(part)
    before = half_way(kind, 4)
    after = respaced(before, new, keep_open=False)
    run(after, [judge] * 3)
    assert after.samples[:4].tolist() == before.samples.tolist()
    assert all(new.searches(theta) for theta in after.samples[4:])


@pytest.mark.parametrize("value", [1.999999999999, 2.000000000001, 0.1 + 0.2, 1e-5])
def test_a_frozen_value_is_met_exactly(value):
    new = MIXED.narrowed({"weight": (value, value)})
    after = respaced(half_way(RandomSearch, 4), new, keep_open=False)
    run(after, [judge] * 2)
    assert set(after.samples[4:, 2]) == {value}
