"""Single events: settings, θ that a person asks for, and another space; what of them is refused."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_env.errors import StudyError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.study import (
    Adjusted,
    Answered,
    Created,
    Ended,
    Failed,
    Finished,
    Marked,
    Requested,
    Respaced,
    Shown,
    StudyFile,
    Suggested,
    Undone,
    knobs_as_dicts,
    space_of,
    within_as_dict,
)
from prefcal_env.study.fold import begin, step
from support.interviews import clock
from support.studies import CONFIGURATION, compared, experiment, small_study

AGENT = {"agent": "any", "seed": 3, "settings": {"delta": 0.3, "questions": 3}}


@pytest.fixture
def study():
    """Experiments 0 to 2, all compared."""
    with StudyFile.create(":memory:", {**CONFIGURATION, "agent": AGENT}, clock=clock()) as file:
        for index, preference in enumerate((None, 1, 1)):
            compared(file, index, preference)
        yield file


def test_it_changes_the_named_settings_of_the_agent_and_nothing_else(study):
    before = study.state
    study.append(Shown(2, 1, True))
    shown = study.state
    study.append(Adjusted({"questions": 5, "scales": [0.0, 1.0]}))
    after = study.state
    assert after.configuration["agent"] == {
        **AGENT,
        "settings": {"delta": 0.3, "questions": 5, "scales": [0.0, 1.0]},
    }
    assert replace(after, configuration=before.configuration) == shown
    assert before.configuration["agent"] == AGENT


def test_a_question_that_the_agent_no_longer_asks_goes_with_the_next_sample(study):
    study.append(Shown(2, 1, True), Adjusted({"questions": 1}))
    assert study.state.open is not None
    study.append(Suggested(3, (0.5,), (0.5,)))
    assert study.state.open is None


@pytest.mark.parametrize("agent", [None, [], {}, {"settings": 3}])
def test_a_study_whose_agent_has_no_settings_refuses_it(study, agent):
    state = replace(study.state, configuration={**CONFIGURATION, "agent": agent})
    with pytest.raises(StudyError, match="event 9 is impossible: the agent of the study has no"):
        step(state, 9, "now", Adjusted({"questions": 2}))


WANTED = Requested(3, (0.7,), (0.7,))


@pytest.fixture
def file(tmp_path):
    """A study with two answers and an open question about sample 3, which is marked."""
    with small_study(tmp_path / "a.prefcal", answers=2) as file:
        file.append(Suggested(3, (0.9,), (0.9,)), (Finished(3), experiment(0.9)))
        file.append(Marked(3, "unsafe", True))
        file.append(Shown(3, 1, True))
        yield file


def test_all_that_was_known_of_the_replaced_sample_goes_and_nothing_else(file):
    before = file.state
    file.append(WANTED)
    state = file.state
    assert state.history.pending.theta == (0.7,)
    assert state.history.samples[:3] == before.history.samples[:3]
    assert state.history.comparisons == before.history.comparisons
    assert (state.open, state.requested) == (None, {3})
    assert sorted(state.finished) == [0, 1, 2]
    assert 3 not in state.marks
    assert file.find_experiment([0.9]) == before.finished[3]  # if it is proposed again


def test_it_needs_no_proposal_and_can_be_replaced_in_turn(tmp_path):
    with small_study(tmp_path / "a.prefcal", answers=2) as file:
        file.append(WANTED, Failed(3, "no license"))
        assert file.state.failures == {3: "no license"}
        file.append(Requested(3, (0.8,), (0.8,)))
        assert file.state.failures == {}
        assert file.state.history.pending.theta == (0.8,)
        assert file.state.requested == {3}


def test_it_is_run_answered_and_undone_as_any_sample(file):
    file.append(WANTED, (Finished(3), experiment(0.7)))
    (shown,) = file.append(Shown(3, 1, False))
    file.append(Answered(shown, 3, 1, Answer(-1)))
    assert file.state.history.incumbent == 3
    file.append(Undone())
    assert file.state.requested == {3}
    assert file.state.history.pending.theta == (0.7,)
    file.append(Undone())
    assert file.state.requested == set()


def test_a_changed_space_drops_it_if_it_has_not_run(file):
    file.append(WANTED)
    knobs = CONFIGURATION["knobs"]
    space = {"knobs": knobs, "within": {}, "scenario_knobs": knobs}
    file.append(Respaced(space, {}))
    assert file.state.requested == set()
    assert file.state.history.pending is None


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (Requested(2, (0.7,), (0.7,)), "sample 3 is due, not 2"),
        (Requested(4, (0.7,), (0.7,)), "sample 3 is due, not 4"),
        (Requested(3, (0.7, 0.1), (0.7,)), "differ in length"),
        (Requested(3, (0.7, 0.1), (0.7, 0.1)), "differ in length"),
        (Requested(3, (), ()), "differ in length"),
    ],
)
def test_an_impossible_request_is_refused_and_changes_nothing(file, event, words):
    before = file.state
    with pytest.raises(StudyError, match=words):
        file.append(event)
    assert file.state == before


def test_nothing_can_be_asked_for_when_the_study_is_over_or_full(file, tmp_path):
    file.append(Ended("stopped"))
    with pytest.raises(StudyError, match="nothing is left to be tried"):
        file.append(WANTED)
    with (
        small_study(tmp_path / "b.prefcal", answers=8) as full,
        pytest.raises(StudyError, match="nothing is left to be tried"),
    ):
        full.append(Requested(9, (0.7,), (0.7,)))


OLD = KnobSpace([Knob("a", 0.0, 2.0, "h")])
NEW = KnobSpace([Knob("b", 1.0, 5.0), Knob("a", 0.0, 4.0, "h")], within={"a": (1.0, 3.0)})


def content(space=NEW, **changed):
    plain = {
        "knobs": knobs_as_dicts(space),
        "within": within_as_dict(space),
        "scenario_knobs": knobs_as_dicts(space),
    }
    return {**plain, **changed}


def state(*events):
    """Of a study of one answered sample and one open, and then these events."""
    configuration = {"n_max": 5, "knobs": knobs_as_dicts(OLD), "agent": {"seed": 4, "start": [[0.25]]}}
    now = begin(1, "now", Created(configuration))
    first = (
        Suggested(0, (0.5,), (1.0,)),
        Finished(0),
        Answered(None, 0, None, Answer(None)),
        Suggested(1, (1.0,), (2.0,)),
    )
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
    now = state(
        Undone(),
        Answered(None, 0, None, Answer(None)),
        Suggested(1, (0.5,), (theta,)),
        Finished(1),
        Respaced(content(), {"b": 3.0}),
    )
    assert now.history.samples[1].theta == (3.0, theta)
