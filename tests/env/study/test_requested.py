"""A θ that the person asks for: it replaces the sample that has no answer yet, on the record."""

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.preferences.answer import Answer
from prefcal_env.study import (
    Answered,
    Ended,
    Failed,
    Finished,
    Marked,
    Requested,
    Respaced,
    Shown,
    Suggested,
    Undone,
)
from support.studies import CONFIGURATION, experiment, small_study

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
