"""A long study: trajectories are read when they are shown, and only the last ones stay."""

import gc

import pytest

from prefcal_app.session import Choice, Interview, actions, study
from prefcal_app.view import Seen
from prefcal_app.view import question as seen_module
from prefcal_env.errors import StudyError
from prefcal_env.study import StudyFile
from support.interviews import answer_all, begin, clock, proceed
from toy_study import toy_scenario


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A study of twelve experiments, one of them failed."""
    path = tmp_path_factory.mktemp("studies") / "long.prefcal"
    interview = begin(toy_scenario(), n_max=12, path=path)
    answer_all(interview, lambda number: None)
    interview.do(actions.GoOn(1))
    interview.do(actions.Answer(proceed(interview).question.id, Choice.LEFT))
    interview.file.close()
    return path


@pytest.fixture
def reading(path, monkeypatch):
    """The study, opened again, and the events whose trajectories were read since."""
    read = []
    experiment = StudyFile.experiment

    def noted(self, seq):
        read.append(seq)
        return experiment(self, seq)

    monkeypatch.setattr(StudyFile, "experiment", noted)
    file = StudyFile.open(path, clock=clock())
    yield Interview(toy_scenario(), file, asks=False), read
    file.close()


def test_opening_reads_no_trajectory_and_how_runs_ended_is_known_without(reading):
    interview, read = reading
    ends = [interview.past.end(index) for index in range(13)]
    assert read == []
    assert ends == [interview.past.experiment(index).end for index in range(13)]
    with pytest.raises(StudyError, match="no experiment 14"):
        interview.past.end(13)


def test_only_the_last_trajectories_stay_and_what_is_held_is_not_read_twice(reading, monkeypatch):
    interview, read = reading
    monkeypatch.setattr(study, "_KEPT", 3)
    held = interview.past.experiment(0)
    for index in range(1, 13):
        interview.past.experiment(index)
    assert len(read) == 13
    assert interview.past.experiment(0) is held
    interview.past.experiment(12)
    assert len(read) == 13
    gc.collect()
    assert len(interview._driver.store._held) == 3
    interview.past.experiment(1)
    assert len(read) == 14


def test_axes_take_in_a_long_study_bit_by_bit_the_latest_first(reading, monkeypatch):
    interview, read = reading
    monkeypatch.setattr(seen_module, "_AT_ONCE", 5)
    finished = interview.now().state.finished
    seen = Seen().look(interview)
    assert set(seen._reach) == {finished[index] for index in range(8, 13)}
    assert len(read) == 5
    for _ in range(4):
        seen.look(interview)
    assert set(seen._reach) == set(finished.values())
    whole = Seen()
    monkeypatch.setattr(seen_module, "_AT_ONCE", 200)
    assert whole.look(interview)._reach == seen._reach
