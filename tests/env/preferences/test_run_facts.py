"""What comes with every answer unasked: marks of interrupted runs, and outcomes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents import RandomSearch
from prefcal_agents.lessons import Marks
from prefcal_env.experiments.experiment import End
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark, Preference, calibrate, completed, counts_as_unsafe
from support.studies import experiment

NEW, OLD = Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE
SAFE, UNSAFE = experiment(0.1), experiment(0.2, end=End.UNSAFE)


@pytest.mark.parametrize("end", End)
def test_only_a_run_that_became_unsafe_counts(end):
    assert counts_as_unsafe(experiment(0.1, end=end)) == (end is End.UNSAFE)


@pytest.mark.parametrize("worst", [End.UNSAFE, End.FAILED])
def test_of_several_runs_one_is_enough_even_if_another_one_failed(worst):
    assert counts_as_unsafe(replace(SAFE, end=worst, runs=(SAFE, UNSAFE)))
    assert not counts_as_unsafe(replace(SAFE, runs=(SAFE, SAFE)))


@pytest.mark.parametrize(
    ("pair", "marks"),
    [
        ((SAFE, SAFE), ()),
        ((UNSAFE, SAFE), (NEW,)),
        ((SAFE, UNSAFE), (OLD,)),
        ((UNSAFE, UNSAFE), (NEW, OLD)),
        ((UNSAFE, None), (NEW,)),
        ((SAFE, None), ()),
    ],
)
def test_each_side_has_the_mark_of_its_own_run(pair, marks):
    answer = completed(Answer(1), *pair)
    assert answer == Answer(1, marks=marks, automatic=marks)


@given(
    st.lists(st.sampled_from(Mark), unique=True),
    st.sampled_from([SAFE, UNSAFE]),
    st.sampled_from([SAFE, UNSAFE, None]),
)
def test_twice_is_as_good_as_once(marks, new, old):
    once = completed(Answer(0, marks=tuple(marks)), new, old, ({"late": 1.0}, None))
    assert completed(once, new, old, ({"late": 2.0}, None)) == once


def test_outcomes_that_came_along_are_kept():
    own = Answer(1, outcomes=({"late": 1.0}, None))
    assert completed(own, SAFE, SAFE, ({"late": 2.0}, None)) == own
    assert completed(Answer(1), SAFE, SAFE, ({"late": 2.0}, None)).outcomes[0] == {"late": 2.0}
    assert completed(Answer(1), SAFE, SAFE).outcomes is None


class Silent:
    """Prefers the smaller θ and marks nothing."""

    def prefer(self, challenger, incumbent):
        return int(np.sign(challenger.theta[0] - incumbent.theta[0]))


def test_the_loop_in_memory_tells_the_agent():
    def run(theta):
        return experiment(float(theta[0]), end=End.UNSAFE if theta[0] > 0.5 else End.TIME_UP)

    agent = RandomSearch(KnobSpace([Knob("gain", 0.0, 1.0)]), n_max=12, seed=0)
    steps = list(calibrate(agent, run, Silent()))
    ends = [step.challenger.end for step in steps]
    assert {End.UNSAFE, End.TIME_UP} == set(ends)
    for step, told in zip(steps, agent.state.history.comparisons, strict=True):
        assert told.answer == step.answer
        assert (NEW in told.answer.automatic) == (step.challenger.end is End.UNSAFE)
    marks = Marks.of(agent.state.history)
    assert marks.unsafe.tolist() == [end is End.UNSAFE for end in ends]


def test_what_is_unsafe_is_not_good_enough():
    both = (Mark.CHALLENGER_UNSAFE, Mark.CHALLENGER_GOOD_ENOUGH, Mark.INCUMBENT_GOOD_ENOUGH)
    kept = completed(Answer(None, marks=both), SAFE, SAFE).marks
    assert kept == (Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_GOOD_ENOUGH)
    said = Answer(None, marks=(Mark.INCUMBENT_GOOD_ENOUGH,))
    assert completed(said, SAFE, UNSAFE).marks == (OLD,)


def test_a_run_cut_short_loses_without_a_question_and_its_kpis_are_bounds():
    def run(theta):
        return experiment(float(theta[0]), end=End.CUT_SHORT if theta[0] > 0.5 else End.TIME_UP)

    agent, asked = RandomSearch(KnobSpace([Knob("a", 0, 1)]), n_init=3, n_max=9, seed=1), []

    class Person:
        def prefer(self, challenger, incumbent):
            asked.append(challenger)
            return Preference.INCUMBENT

    steps = list(calibrate(agent, run, Person()))
    short = [s for s in steps[1:] if s.challenger.end is End.CUT_SHORT]
    assert short
    assert all(s.answer.preference is Preference.INCUMBENT for s in short)
    assert all(s.answer.automatic == (Mark.CHALLENGER_CUT_SHORT,) for s in short)
    assert all(e.end is End.TIME_UP for e in asked)
    assert len(asked) + len(short) == 8
    assert agent.history.cut_short == {
        s.query.challenger.index for s in steps if s.challenger.end is End.CUT_SHORT
    }
