"""Interviews that run several experiments at once: any order, failures, undo and resume."""

import os
import signal
import threading
from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import RandomSearch
from prefcal_app.session import Background, Choice, Phase, actions, runs, unattended
from prefcal_app.view import now_view
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import End
from prefcal_env.sources.rig import Rig
from prefcal_env.study import Taken
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import isolation
from support.interviews import begin, judge, reopened, until
from toy_scenario_tools import CHANNELS
from toy_study import TOY, toy_scenario


class Simulator:
    """A plant whose runs end when the test says: `end` the run of a θ."""

    def __init__(self):
        self.toy = toy_scenario()
        self.ends, self.lock, self.most, self.running = {}, threading.Lock(), 0, 0
        self.fails = set()

    @property
    def scenario(self):
        return replace(self.toy, run=self.run)

    def run(self, theta, seed=0):
        with self.lock:
            ended = self.ends.setdefault(tuple(theta), threading.Event())
            self.running += 1
            self.most = max(self.most, self.running)
        assert ended.wait(20)
        with self.lock:
            self.running -= 1
            if tuple(theta) in self.fails:
                self.fails.discard(tuple(theta))
                raise ValueError("no licence")
        return self.toy.run(theta, seed)

    def end(self, theta):
        with self.lock:
            self.ends.setdefault(tuple(theta), threading.Event()).set()

    def end_all(self):
        for ended in self.ends.values():
            ended.set()


def asks(now):
    return now.phase is Phase.QUESTION


def waiting(interview):
    """The θ that have no answer yet, in the order of the study file."""
    history = interview.file.state.history
    return [sample.theta for sample in history.samples[history.answered :]]


@pytest.fixture
def plant():
    plant = Simulator()
    yield plant
    plant.end_all()


def test_what_ends_while_a_question_is_open_is_saved_and_asked_about_next(plant):
    interview = begin(plant.scenario, n_max=8, at_once=3)
    with Background(interview):
        until(interview, lambda now: now.running == 3)
        first, second, third = waiting(interview)
        plant.end(first)
        plant.end(third)
        question = until(interview, asks).question
        plant.end(second)
        until(interview, lambda now: len(now.state.finished) == 3)
        assert interview.now().question is question
        interview.do(actions.Answer(question.id, Choice.LEFT))
        now = until(interview, asks)
        assert tuple(now.question.challenger.experiment.theta) == second
        plant.end_all()
        until(interview, lambda now: plant.end_all() or asks(now))


def test_a_study_resumes_with_the_same_pending_experiments(plant, tmp_path):
    path = tmp_path / "a.prefcal"
    interview = begin(plant.scenario, n_max=9, at_once=4, path=path)
    with Background(interview):
        until(interview, lambda now: now.running == 4)
        assert now_view(interview)["progress"]["running"] == 4
        for theta in waiting(interview)[2:]:
            plant.end(theta)
        now = until(interview, asks)
        interview.do(actions.Answer(now.question.id, Choice.RIGHT))
        until(interview, lambda now: len(waiting(interview)) == 4)
        plant.end_all()
    before, state = waiting(interview), interview.file.state
    interview.file.close()
    again = reopened(plant.scenario, path, at_once=4)
    assert {s.theta for s in state.history.samples} <= {s.theta for s in again.file.state.history.samples}
    assert set(waiting(again)) >= set(before)
    assert any(isinstance(recorded.event, Taken) for recorded in again.file.events())
    with Background(again):
        while (now := until(again, lambda now: plant.end_all() or settled(now))).question:
            again.do(actions.Answer(now.question.id, judge(now.question, again.scenario.cost)))
    assert set(before) <= {s.theta for s in again.file.state.history.samples}
    assert again.file.state.history.answered == 9
    again.file.close()


def settled(now):
    return now.phase in (Phase.QUESTION, Phase.OVER)


def test_an_undo_leaves_what_runs_alone_and_drops_what_was_proposed_since(plant):
    interview = begin(plant.scenario, n_max=9, at_once=3)
    with Background(interview):
        until(interview, lambda now: now.running == 3)
        first, second, third = waiting(interview)
        plant.end(first)
        plant.end(second)
        now = until(interview, asks)
        challenger = tuple(now.question.challenger.experiment.theta)
        interview.do(actions.Answer(now.question.id, Choice.LEFT))
        now = until(interview, lambda now: len(waiting(interview)) == 3)
        interview.do(actions.Undo(now.version))
        assert waiting(interview)[:2] == [challenger, third]
        now = until(interview, asks)
        assert tuple(now.question.challenger.experiment.theta) == challenger
        plant.end_all()


def test_a_failed_run_beside_an_open_question_is_shown_when_it_is_due_and_may_run_again(plant):
    interview = begin(plant.scenario, n_max=5, at_once=3)
    with Background(interview):
        until(interview, lambda now: now.running == 3)
        first, second, third = waiting(interview)
        plant.fails.add(third)
        plant.end(first)
        plant.end(second)
        question = until(interview, asks).question
        plant.end(third)
        until(interview, lambda now: third not in plant.fails)
        assert interview.now().question is question
        interview.do(actions.Answer(question.id, Choice.LEFT))
        now = until(interview, lambda now: now.phase is Phase.FAILED)
        assert "no licence" in now.problem
        assert now.pending.theta == third
        interview.do(actions.Retry())
        while (now := until(interview, lambda now: plant.end_all() or settled(now))).question:
            interview.do(actions.Answer(now.question.id, Choice.LEFT))
    assert third in {s.theta for s in now.state.history.samples}
    assert not now.state.failures


def test_a_known_failure_is_taken_by_one_thread_though_another_looks_for_work_at_once():
    toy, tried = toy_scenario(), []

    def run(theta, seed=0):
        tried.append(tuple(theta))
        if len(tried) == 3:
            raise ValueError("no licence")
        return toy.run(theta, seed)

    interview = begin(replace(toy, run=run), n_max=5, at_once=3)
    while len(tried) < 3:
        assert interview.work()
    question = interview.now().question
    interview.do(actions.Answer(question.id, Choice.LEFT))
    assert interview.work()  # it proposes what can run
    jobs = [runs.due(interview._driver, ahead=False) for _ in range(2)]  # before either is done
    assert interview.now().phase is Phase.FAILED
    for job in filter(None, jobs):
        job.finish(interview._driver, job.run())
    assert tried.count(tried[2]) == 1
    assert interview.now().phase is Phase.FAILED


def test_the_experiments_of_a_killed_worker_run_again():
    with isolation(TOY, 60.0, at_once=2) as isolated:
        scenario = isolated(load(TOY))
        victim = scenario.run._workers[0].pid
        interview = begin(scenario, n_max=6, at_once=2, agent=RandomSearch)
        os.kill(victim, signal.SIGKILL)
        told = []
        calibrator = scenario.calibrators["synthetic"](0)
        found = list(unattended(interview, calibrator, failed=told.append))
    assert not told
    assert len(found) == 6
    assert all(comparison.challenger.end is not End.FAILED for comparison in found)
    thetas = [tuple(comparison.challenger.theta) for comparison in found]
    alone = RandomSearch(scenario.space, n_init=3, n_max=6, seed=0)
    assert set(thetas) == {tuple(query.challenger.theta) for query in alone.ask(6)}
    assert np.isfinite(thetas).all()


def test_a_rig_runs_one_experiment_at_a_time():
    with pytest.raises(SettingsError, match="leave --at-once out"):
        begin(replace(toy_scenario(), run=Rig(CHANNELS, (2.0,)), kpis=()), at_once=2)
