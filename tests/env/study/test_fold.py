"""The fold: a state for every possible sequence of events, and a clear refusal of all others."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_env.errors import StudyError
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_env.study import (
    Adjusted,
    Answered,
    Concluded,
    Created,
    Ended,
    Event,
    Extended,
    Failed,
    Finished,
    Kept,
    Led,
    Marked,
    Noted,
    Reopened,
    Requested,
    Retracted,
    Shown,
    StudyFile,
    Suggested,
    Undone,
)
from prefcal_env.study.fold import begin, step
from support.interviews import clock
from support.studies import CONFIGURATION, experiment, small_study

CANDIDATES = (
    "answer",
    "undo",
    "retract",
    "mark",
    "note",
    "end",
    "conclude",
    "reopen",
    "extend",
    "repeat",
    "adjust",
    "request",
)


def possible(state, dice):
    """Some events, each possible in `state` or refused."""
    due = state.history.answered
    kind = dice.choice(CANDIDATES)
    if kind == "answer":
        if len(state.history.samples) == due:
            return Suggested(due, (dice.random(),), (dice.random(),))
        if due not in state.finished:
            return Finished(due)
        if due == 0:
            return Answered(None, 0, None, Answer(None))
        if state.open is None:
            return Shown(due, dice.randrange(due), dice.random() < 0.5)
        shown = state.open[1]
        answer = Answer(dice.choice((-1, 0, 1, None)))
        return Answered(state.open[0], shown.challenger, shown.incumbent, answer)
    index = dice.randrange(max(due, 1))
    return {
        "undo": Undone(),
        "retract": Retracted(index),
        "note": Noted("so"),
        "end": Ended("stopped"),
        "mark": Marked(index, dice.choice(("unsafe", "good enough")), dice.random() < 0.7),
        "adjust": Adjusted({"questions": dice.randrange(4)}),
        "conclude": Concluded({"share": dice.random(), "names": ["b", "a"]}),
        "reopen": Reopened(),
        "request": Requested(due, (dice.random(),), (dice.random(),)),
        "extend": Extended(dice.randrange(5, 40)),
        "repeat": Shown(max(due - 1, 0), 0, True, dice.randrange(30)),
    }[kind]


@given(st.integers(0, 10**6))
@settings(max_examples=40)
def test_the_kept_state_is_the_fold_of_all_events(tmp_path_factory, seed):
    path = tmp_path_factory.mktemp("fold") / "a.prefcal"
    dice = random.Random(seed)
    adjustable = {**CONFIGURATION, "agent": {"settings": {}}}
    with StudyFile.create(path, adjustable, clock=clock()) as file:
        for _ in range(60):
            event = possible(file.state, dice)
            before = file.state
            try:
                if isinstance(event, Finished):
                    file.append((event, experiment(0.5)))
                else:
                    file.append(event)
            except StudyError:
                assert file.state == before
        state = file.state
    with StudyFile.open(path, clock=clock()) as again:
        assert again.state == state
    assert [c.challenger for c in state.history.comparisons] == list(range(state.history.answered))
    assert state.history.answered <= len(state.history.samples) <= state.history.answered + 1
    assert all(i < len(state.history.samples) for i in state.finished)
    assert all(c.challenger in state.finished for c in state.history.comparisons)


def test_undo_reopens_the_query_and_drops_what_came_after():
    with small_study(":memory:", answers=3) as file:
        file.append(Suggested(4, (0.9,), (0.9,)), (Finished(4), experiment(0.9)), Marked(4, "unsafe", True))
        file.append(Undone())
        state = file.state
    assert state.history.answered == 3
    assert len(state.history.samples) == 4
    assert set(state.finished) == {0, 1, 2, 3}
    assert state.marks == {}


def test_a_repeat_teaches_nothing_and_closes_nothing():
    with small_study(":memory:", answers=3) as file:
        first = file.state.history.comparisons[1]
        (shown,) = file.append(Shown(1, first.incumbent, not first.challenger_left, first.question))
        file.append(Answered(shown, 1, first.incumbent, Answer(1)))
        state = file.state
    assert state.history.answered == 4
    assert state.history.repeats[0].repeats == first.question
    assert state.history.repeats[0].answer.preference is Preference.INCUMBENT


@pytest.mark.parametrize(("number", "retracted"), [(2, ([2], [])), (-1, ([], [0]))])
def test_answers_are_retracted_by_their_numbers_and_follow_ups_by_negative_ones(number, retracted):
    with small_study(":memory:", answers=3) as file:
        (shown,) = file.append(Shown(3, 0, True))
        file.append(Answered(shown, 3, 0, Answer(1)), Retracted(number))
        history = file.state.history
    answers, further = history.comparisons, history.follow_ups
    assert [k for k, c in enumerate(answers) if c.retracted] == retracted[0]
    assert [k for k, c in enumerate(further) if c.retracted] == retracted[1]


def test_an_end_is_taken_back_by_reopening_or_by_undoing_the_last_answer():
    with small_study(":memory:", answers=2) as file:
        file.append(Ended("stopped"))
        assert file.state.ended == "stopped"
        file.append(Reopened())
        assert (file.state.ended, file.state.reopened) == (None, True)
        file.append(Ended("good enough"), Undone())
        assert (file.state.ended, file.state.history.answered) == (None, 2)


@pytest.mark.parametrize(
    ("then", "counts"),
    [
        (Noted("so"), True),
        (Retracted(1), False),
        (Undone(), False),
        (Reopened(), False),
        (Ended("good enough"), False),
    ],
)
def test_what_was_said_of_a_result_counts_until_the_record_is_another_one(then, counts):
    with small_study(":memory:", answers=2) as file:
        with pytest.raises(StudyError, match="the study is not over"):
            file.append(Concluded({}))
        file.append(Ended("stopped"), Concluded({"share": 0.1}))
        assert file.state.concluded == {"share": 0.1}
        file.append(then)
        assert (file.state.concluded is not None) == counts


def test_what_is_kept_on_a_plant_is_what_was_confirmed_last_until_the_study_goes_on():
    with small_study(":memory:", answers=2) as file:
        with pytest.raises(StudyError, match="the study is not over"):
            file.append(Kept(1, False))
        file.append(Ended("stopped"), Kept(1, False))
        with pytest.raises(StudyError, match="no experiment of sample 9"):
            file.append(Kept(9, False))
        file.append(Kept(0, True), Noted("so"), Concluded({}))
        assert file.state.kept is not None
        assert file.state.kept[2] == Kept(0, True)
        file.append(Reopened())
        assert file.state.kept is None
        file.append(Ended("stopped"), Kept(1, False), Retracted(1))
        assert file.state.kept is None, "it may have been the best by the answer that is retracted"


def test_a_failed_run_is_forgotten_once_it_has_run():
    with small_study(":memory:", answers=1) as file:
        file.append(Suggested(2, (0.9,), (0.9,)), Failed(2, "pump"))
        assert file.state.failures == {2: "pump"}
        file.append((Finished(2), experiment(0.9)))
        assert file.state.failures == {}


@pytest.mark.parametrize(
    "event",
    [
        Created({"n_max": 3}),
        Suggested(3, (0.5,), (0.5,)),
        Suggested(2, (0.5,), (0.5, 0.6)),
        Finished(7),
        Failed(-1, "pump"),
        Shown(2, 0, True),
        Shown(1, 1, True),
        Answered(3, 1, 0, Answer(0)),
        Answered(None, 0, None, Answer(None)),
        Marked(5, "unsafe", True),
        Retracted(2),
        Retracted(-1),
        Led(2),
        Led(-1),
        Extended(1),
        Adjusted({}),
    ],
    ids=repr,
)
def test_an_impossible_event_is_refused_by_its_number(event):
    with small_study(":memory:", answers=1) as file:
        state = file.state
    with pytest.raises(StudyError, match=r"event \d+"):
        step(state, 99, "now", event)


@pytest.mark.parametrize("event", [Noted("x"), Created({}), Created({"n_max": "many"})])
def test_a_study_begins_with_its_configuration_or_is_refused(event):
    with pytest.raises(StudyError, match="begins with its configuration"):
        begin(1, "now", event)


def test_an_event_without_a_rule_is_refused():
    class Surprised(Event, frozen=True):
        pass

    with small_study(":memory:", answers=1) as file, pytest.raises(StudyError, match="no rule for"):
        file.append(Surprised())
