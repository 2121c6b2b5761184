"""What models of KPIs learn from runs that were cut short."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.history.lessons import judged
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import History
from support.histories import in_cube

CUT = Mark.CHALLENGER_CUT_SHORT


def history(*, cut=True):
    marks = (CUT,) if cut else ()
    made = History(tuple(in_cube([z]) for z in (0.0, 1.0, 0.9)))
    made = made.with_answer(Answer(None, outcomes=({"a": 1.0, "b": 5.0}, None)), None)
    made = made.with_answer(Answer(1, outcomes=({"a": 4.0, "b": 6.0}, None)), 0)
    return made.with_answer(
        Answer(1, outcomes=({"a": 9.0}, {"a": 1.0, "b": 5.0}), marks=marks, automatic=marks), 0
    )


def test_a_history_without_runs_cut_short_stays_the_same_object():
    whole = history(cut=False)
    assert judged(whole) is whole


def test_kpis_become_those_of_the_nearest_whole_run_or_their_bounds():
    taught = judged(history()).comparisons[2]
    assert dict(taught.answer.outcomes[0]) == {"a": 9.0, "b": 6.0}
    assert dict(taught.answer.outcomes[1]) == {"a": 1.0, "b": 5.0}


def test_an_answer_about_a_run_cut_short_teaches_nothing_about_kpis_but_all_about_theta():
    made = history()
    assert [c.challenger for c in made.lessons()] == [1, 2]
    assert [c.challenger for c in judged(made).lessons()] == [1]


def test_a_later_experiment_does_not_change_what_an_earlier_cut_taught():
    made = history()
    later = replace(made, samples=(*made.samples, in_cube([0.89]))).with_answer(
        Answer(1, outcomes=({"a": 2.0, "b": 99.0}, None)), 0
    )
    assert judged(later).comparisons[:3] == judged(made).comparisons
    assert judged(later).until(3) == judged(later.until(3))


@pytest.mark.parametrize(
    ("kpis", "marks"),
    [
        ({"a": np.inf, "b": np.inf, "interrupted": 1.0}, ()),
        ({"a": 40.0, "b": 60.0}, (Mark.CHALLENGER_UNSAFE,)),
    ],
)
def test_a_run_that_was_not_completed_says_nothing_about_one_cut_short_nearby(kpis, marks):
    made = History(tuple(in_cube([z]) for z in (0.0, 0.95, 0.9)))
    made = made.with_answer(Answer(None, outcomes=({"a": 1.0, "b": 5.0}, None)), None)
    made = made.with_answer(Answer(1, outcomes=(kpis, None), marks=marks), 0)
    bounds = {"a": 2.0, "interrupted": 0.0}
    made = made.with_answer(Answer(1, outcomes=(bounds, None), marks=(CUT,)), 0)
    taught = judged(made).comparisons[2].answer.outcomes[0]
    assert dict(taught) == {"a": 2.0, "b": 5.0, "interrupted": 0.0}
