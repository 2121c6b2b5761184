"""What goes wrong beside the answers costs neither a verdict, an experiment nor the thread."""

import itertools
from dataclasses import replace

import pytest

from prefcal_agents import GLISp
from prefcal_app.session import Choice, Interview, Phase, actions
from prefcal_app.session.runs import due
from prefcal_app.session.study import ExperimentStore
from prefcal_env.errors import ScenarioError, StaleError, StudyError
from prefcal_env.study import Shown, StudyFile
from support.interviews import begin, clock, proceed, worked

LEFT = Choice.LEFT


def test_an_experiment_is_not_counted_as_failed_because_the_disk_was_full(toy, monkeypatch):
    interview = begin(toy)
    interview.do(actions.Answer(proceed(interview).question.id, LEFT))
    append = StudyFile.append

    def full(self, *events):
        if isinstance(events[0], Shown):
            raise StudyError("the disk is full")
        return append(self, *events)

    monkeypatch.setattr(StudyFile, "append", full)
    assert proceed(interview).phase is Phase.FAILED
    with pytest.raises(StaleError, match="experiment 3 is saved"):
        interview.do(actions.Fail(2, "slip"))
    monkeypatch.undo()
    interview.do(actions.Retry())
    assert not proceed(interview).question.challenger.experiment.end.interrupted


def test_trouble_while_looking_ahead_leaves_the_question_open(toy, monkeypatch):
    interview = begin(toy, ahead=True)
    question = proceed(interview).question

    def broken(self, query, answer):
        raise FloatingPointError("an unlikely answer")

    with monkeypatch.context() as patched:
        patched.setattr(GLISp, "tell", broken)
        worked(interview)
    assert interview.now().question == question
    interview.do(actions.Answer(question.id, LEFT))
    assert proceed(interview).question.challenger.index == 2


def exits(theta, seed=0):
    raise SystemExit("no such port")


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (lambda theta, seed=0: None, "must return an Experiment, got NoneType"),
        (lambda theta, seed=0: 3.0, "must return an Experiment, got float"),
        (exits, "called exit: no such port"),
    ],
)
def test_a_plant_that_gives_no_experiment_has_failed_in_words(toy, run, words):
    interview = begin(replace(toy, run=run))
    now = proceed(interview)
    assert now.phase is Phase.FAILED
    assert words in now.problem
    with pytest.raises(ScenarioError, match=words):
        interview.raise_problem()


def test_whatever_fails_after_an_answer_is_a_problem_and_no_error_of_who_answered(toy, monkeypatch):
    interview = begin(toy, ahead=True)
    question = worked(interview).question

    def broken(self, index):
        raise MemoryError("no room for the curves")

    with monkeypatch.context() as patched:
        patched.setattr(ExperimentStore, "experiment", broken)
        now = interview.do(actions.Answer(question.id, LEFT))
    assert (now.phase, now.problem) == (Phase.FAILED, "MemoryError: no room for the curves")
    interview.do(actions.Retry())
    assert proceed(interview).question.challenger.index == 2


@pytest.mark.parametrize("kpis", [{"smooth": "fairly"}, {1: 2.0}, {"late": [1.0]}, {"late": None}])
def test_an_experiment_that_no_file_could_hold_is_a_failed_run(toy, kpis):
    runs = itertools.count()

    def run(theta, seed=0):
        made = toy.run(theta, seed)
        return made if next(runs) != 2 else replace(made, kpis=kpis)

    interview = begin(replace(toy, run=run), ahead=True)
    question = worked(interview).question
    interview.do(actions.Answer(question.id, LEFT))
    assert proceed(interview).phase is not Phase.FAILED  # the fourth run of the same θ


def test_an_error_that_names_a_strange_file_is_told(toy):
    def run(theta, seed=0):
        raise FileNotFoundError("no file b\udce4r")

    now = proceed(begin(replace(toy, run=run)))
    assert "no file b\\udce4r" in now.problem
    assert now.problem == now.state.failures[0]


def counted(toy, change=lambda made: made):
    """The toy, and the list of θ that it has run."""
    ran = []

    def run(theta, seed=0):
        ran.append(tuple(theta))
        return change(toy.run(theta, seed))

    return replace(toy, run=run), ran


def test_nothing_is_run_after_the_interview_was_closed(toy):
    same, ran = counted(toy)
    interview = begin(same, ahead=True)
    proceed(interview)
    before = len(ran)
    interview.close()
    assert not interview.work()
    assert len(ran) == before


def test_an_undo_after_a_proposal_is_not_asked_twice(toy):
    interview = begin(toy)
    interview.do(actions.Answer(proceed(interview).question.id, LEFT))
    job = [due(interview._driver, ahead=False) for _ in range(2)][1]  # the next sample is proposed, and runs
    question = interview.do(actions.Undo(interview.now().version)).question
    job.finish(interview._driver, job.run())
    assert interview.now().question.id == question.id


def test_a_plant_that_rounds_its_parameters_is_not_run_twice(toy):
    rounding, ran = counted(toy, lambda made: replace(made, theta=made.theta.round(3)))
    interview = begin(rounding, ahead=True)
    question = worked(interview).question
    interview.do(actions.Answer(question.id, LEFT))
    proceed(interview)
    assert len(ran) == len(set(ran))


def test_what_the_study_holds_is_not_run_ahead_again(toy, tmp_path):
    path = tmp_path / "mine.prefcal"
    interview = begin(toy, path=path)
    interview.do(actions.Answer(proceed(interview).question.id, LEFT))
    proceed(interview)
    interview.file.close()

    same, ran = counted(toy)
    resumed = Interview(same, StudyFile.open(path, clock=clock()))
    resumed.do(actions.Undo(resumed.now().version))
    worked(resumed)
    assert ran == []  # the start is space-filling: every answer leads to the θ that was run
