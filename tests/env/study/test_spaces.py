"""A Respaced event: what it does to samples, and what of it is refused."""

import numpy as np
import pytest

from prefcal_env.errors import StudyError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.study import (
    Answered,
    Created,
    Finished,
    Respaced,
    Suggested,
    Undone,
    knobs_as_dicts,
    space_of,
    within_as_dict,
)
from prefcal_env.study.fold import begin, step

OLD = KnobSpace([Knob("a", 0.0, 2.0, "h")])
NEW = KnobSpace([Knob("b", 1.0, 5.0), Knob("a", 0.0, 4.0, "h")], within={"a": (1.0, 3.0)})


def content(space=NEW, **changed):
    plain = {"knobs": knobs_as_dicts(space), "within": within_as_dict(space),
             "scenario_knobs": knobs_as_dicts(space)}  # fmt: skip
    return {**plain, **changed}


def state(*events):
    """Of a study of one answered sample and one open, and then these events."""
    configuration = {
        "n_max": 5,
        "knobs": knobs_as_dicts(OLD),
        "agent": {"seed": 4, "start": [[0.25]]},
    }
    now = begin(1, "now", Created(configuration))
    first = (Suggested(0, (0.5,), (1.0,)), Finished(0), Answered(None, 0, None, Answer(None)),
             Suggested(1, (1.0,), (2.0,)))  # fmt: skip
    for seq, event in enumerate((*first, *events), start=2):
        now = step(now, seq, "now", event)
    return now


def test_samples_are_carried_into_the_new_space():
    now = state(Finished(1), Respaced(content(), {"b": 3.0}, {"start": [[0.5, 0.125]]}))
    assert [s.theta for s in now.history.samples] == [(3.0, 1.0), (3.0, 2.0)]
    assert [s.z for s in now.history.samples] == [(0.5, 0.25), (0.5, 0.5)]
    assert now.configuration["agent"] == {"seed": 4, "start": [[0.5, 0.125]]}
    assert space_of(now.configuration) == NEW
    assert step(now, 9, "now", Undone()).history.samples[0].theta == (3.0, 1.0)


def test_a_sample_that_has_not_run_is_dropped():
    now = state(Respaced(content(), {"b": 3.0}))
    assert len(now.history.samples) == 1
    later = step(now, 9, "now", Suggested(1, (0.0, 0.5), (1.0, 2.0)))
    assert later.history.samples[1].theta == (1.0, 2.0)


@pytest.mark.parametrize(
    ("space", "added"),
    [
        (content(), {}),
        (content(), {"b": 9.0}),
        (content(), {"b": "high"}),
        (content(), {"b": float("nan")}),
        (content(knobs=[]), {"b": 3.0}),
        (content(knobs=[{"name": "a"}]), {"b": 3.0}),
        (content(within={"c": [0, 1]}), {"b": 3.0}),
        (content(within={"a": 3}), {"b": 3.0}),
        (content(within=3), {"b": 3.0}),
        (content(scenario_knobs=None), {"b": 3.0}),
        (content(agent={}), {"b": 3.0}),
        (content(KnobSpace([Knob("b", 1.0, 5.0), Knob("a", 0.0, 0.5, "h")])), {"b": 3.0}),
    ],
)
def test_an_impossible_change_is_refused(space, added):
    with pytest.raises(StudyError):
        state(Respaced(space, added))


def test_theta_that_ran_stays_to_the_last_digit():
    theta = float(np.nextafter(1.1, 2))
    now = state(Undone(), Answered(None, 0, None, Answer(None)), Suggested(1, (0.5,), (theta,)),
                Finished(1), Respaced(content(), {"b": 3.0}))  # fmt: skip
    assert now.history.samples[1].theta == (3.0, theta)
