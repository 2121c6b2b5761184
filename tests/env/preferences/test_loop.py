"""One loop serves every kind of agent: what is run, compared and told is the caller's."""

import os
import threading
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest

from prefcal_agents import GLIS, GLISp, GLISpSettings, RandomSearch
from prefcal_env.errors import RunError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import ask_and_tell

SPACE = KnobSpace([Knob("gain", 0.0, 1.0)])


def cost(theta):
    return float((theta[0] - 0.3) ** 2)


def better(new, old):
    return None if old is None else int(np.sign(new - old))


def test_results_need_not_be_experiments():
    agent = RandomSearch(SPACE, n_init=2, n_max=6, seed=0)
    steps = list(ask_and_tell(agent, cost, better))
    assert [step.challenger for step in steps] == [cost(theta) for theta in agent.samples]
    assert cost(agent.best) == min(step.challenger for step in steps)
    assert (steps[0].incumbent, steps[0].answer) == (None, None)


def test_an_agent_that_learns_from_scores_is_told_them():
    agent = GLIS(SPACE, n_init=3, n_max=5, seed=0)
    steps = list(ask_and_tell(agent, cost, lambda new, _: new))
    assert [step.answer for step in steps] == [cost(theta) for theta in agent.samples]
    assert all(step.incumbent is None for step in steps)


def test_every_experiment_runs_once_even_if_it_is_asked_about_again():
    ran = []

    def run(theta):
        ran.append(float(theta[0]))
        return cost(theta)

    settings = GLISpSettings(questions_per_experiment=3)
    agent = GLISp(SPACE, n_init=3, n_max=6, seed=0, settings=settings)
    assert len(list(ask_and_tell(agent, run, better))) > len(ran) == 6


class Bench:
    """An executor whose runs end when and how the test says."""

    def __init__(self):
        self.given = []

    def submit(self, run, theta):
        self.given.append((theta, Future()))
        threading.Timer(0.0, self.settle, (run,)).start()
        return self.given[-1][1]

    def settle(self, run):
        """End the latest of the runs that are in progress."""
        for theta, future in reversed(self.given):
            if not future.done():
                future.set_result(run(theta))
                break


class Mortal(Bench):
    """One of its workers dies: the one that runs experiment `fatal` for the first `times` times."""

    def __init__(self, fatal, times):
        super().__init__()
        self.fatal, self.times = fatal, times

    def submit(self, run, theta):
        future = Future()
        self.given.append((theta, future))
        if self.fatal is None and len(self.given) == 3:
            self.fatal = tuple(theta)
        if tuple(theta) == self.fatal and self.times:
            self.times -= 1
            future.set_exception(CancelledError("killed"))
        else:
            future.set_result(run(theta))
        return future


def test_several_experiments_run_at_the_same_time_and_each_of_them_once():
    most, running, lock, ran = 0, 0, threading.Lock(), []
    meet = threading.Barrier(3)

    def run(theta):
        nonlocal most, running
        with lock:
            running += 1
            most = max(most, running)
            ran.append(float(theta[0]))
        if len(ran) <= 3:
            meet.wait(20)
        with lock:
            running -= 1
        return cost(theta)

    agent = GLISp(SPACE, n_init=3, n_max=9, seed=0)
    steps = list(ask_and_tell(agent, run, better, at_once=3))
    assert (most, len(ran), len(set(ran))) == (3, 9, 9)
    assert [s.challenger for s in steps if not s.query.further] == [cost(t) for t in agent.samples]


def test_results_out_of_order_are_asked_about_as_they_come():
    asked = []
    agent, bench = RandomSearch(SPACE, n_init=2, n_max=12, seed=0), Bench()
    for step in ask_and_tell(agent, cost, better, at_once=4, executor=bench):
        asked.append(float(step.query.challenger.theta[0]))
    assert sorted(asked) == sorted(float(theta[0]) for theta, _ in bench.given)
    assert len(asked) == 12
    assert cost(agent.best) == min(map(cost, agent.samples))


def test_an_experiment_whose_worker_died_runs_again():
    agent, executor = RandomSearch(SPACE, n_init=2, n_max=8, seed=0), Mortal(None, 1)
    assert len(list(ask_and_tell(agent, cost, better, at_once=3, executor=executor))) == 8
    assert len(executor.given) == 9


def dies(theta):
    os._exit(1)


def test_a_pool_of_processes_that_broke_is_reported_and_another_pool_continues():
    agent = RandomSearch(SPACE, n_init=2, n_max=4, seed=0)
    with ProcessPoolExecutor(2) as pool, pytest.raises(RunError, match=r"died.*: \w"):
        list(ask_and_tell(agent, dies, better, at_once=2, executor=pool))
    pending = [query.challenger.theta for query in agent.ask(2)]
    steps = list(ask_and_tell(agent, cost, better, at_once=2))
    assert len(steps) == 4
    assert set(map(tuple, pending)) <= set(map(tuple, agent.samples))


def test_after_two_dead_workers_the_error_is_raised_and_another_loop_continues():
    agent, twin = (RandomSearch(SPACE, n_init=2, n_max=8, seed=0) for _ in range(2))
    with pytest.raises(RunError, match="died 2 times"):
        list(ask_and_tell(agent, cost, better, at_once=3, executor=Mortal(None, 2)))
    pending = agent.ask(3)
    assert len(pending) == 3
    list(ask_and_tell(agent, cost, better, at_once=3))
    list(ask_and_tell(twin, cost, better))
    assert sorted(map(tuple, agent.samples)) == sorted(map(tuple, twin.samples))


def test_an_error_of_a_run_is_raised_and_the_agent_keeps_what_is_pending():
    def run(theta):
        raise ValueError("no licence")

    agent = RandomSearch(SPACE, n_init=2, n_max=8, seed=0)
    with ThreadPoolExecutor(2) as pool, pytest.raises(ValueError, match="no licence"):
        list(ask_and_tell(agent, run, better, at_once=2, executor=pool))
    assert len(agent.history.samples) == 2


@pytest.mark.parametrize("at_once", [0, 1.5, True, "4"])
def test_an_impossible_number_at_once_is_refused(at_once):
    agent = RandomSearch(SPACE, n_init=2, n_max=8, seed=0)
    with pytest.raises(SettingsError, match="at_once"):
        list(ask_and_tell(agent, cost, better, at_once=at_once))
