import pytest

from prefcal_bench.replay import Replay
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube


def history(*values):
    grown = History()
    for k, value in enumerate(values):
        grown = grown.with_pending(in_cube([k / 10])).with_answer(Answer(None, value=value), None)
    return grown


@pytest.fixture
def replay():
    started = []

    def start():
        started.append([])
        return started[-1]

    replay = Replay(start, lambda session, seen: session.append(seen.comparisons[-1].value))
    replay.started = started
    return replay


def test_a_session_is_kept_while_the_history_grows_and_sees_each_answer_once(replay):
    assert replay.at(history()) == []
    assert replay.at(history(1.0)) == [1.0]
    assert replay.at(history(1.0)) == [1.0]
    assert replay.at(history(1.0, 2.0, 3.0).with_pending(in_cube([0.7]))) == [1.0, 2.0, 3.0]
    assert len(replay.started) == 1


def test_after_an_undo_a_retraction_or_another_answer_it_lives_through_all_anew(replay):
    replay.at(history(1.0, 2.0, 3.0))
    assert replay.at(history(1.0, 2.0)) == [1.0, 2.0]
    assert replay.at(history(1.0, 5.0)) == [1.0, 5.0]
    assert replay.at(history(1.0, 5.0, 6.0).retracted(0)) == [None, 5.0, 6.0]
    moved = History((in_cube([0.9]),), history(1.0).comparisons)
    assert replay.at(moved) == [1.0]
    assert len(replay.started) == 5


def test_a_session_that_failed_is_not_used_again():
    sessions = []

    def feed(session, seen):
        session.append(seen.answered)
        if len(sessions) == 1 and seen.answered == 2:
            raise RuntimeError("lost")

    def start():
        sessions.append([])
        return sessions[-1]

    replay = Replay(start, feed)
    with pytest.raises(RuntimeError):
        replay.at(history(1.0, 2.0, 3.0))
    assert replay.at(history(1.0, 2.0, 3.0)) == [1, 2, 3]
