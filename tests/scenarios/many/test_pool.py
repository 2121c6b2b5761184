"""Workers that stay between batches: one that dies or hangs costs nobody else a result."""

import numpy as np
import pytest

from prefcal_env.errors import ScenarioError
from prefcal_env.workers import Terms
from prefcal_env.workers import pool as pool_module
from prefcal_scenarios import FailedRun, Simulated
from prefcal_scenarios.many.task import Task
from support.many_runs import DIES, DIES_ONCE, FORKS, HANGS, INTERRUPTS, RUNS, WRITES, run


@pytest.fixture
def opened():
    """Make a pool of one worker, or more, that is closed in the end."""
    pools = []

    def make(jobs=1, longest=np.inf, run=run):
        pools.append(Task(run, 0, trajectories=False).pool(jobs, longest, Terms(gentle=True)))
        return pools[-1]

    yield make
    for pool in pools:
        pool.close()


def results(pool, *whats):
    """Run θ that do these; return what came of each, in order."""
    pool.give([np.array([what, k / 100]) for k, what in enumerate(whats)])
    found = {}
    while len(found) < len(whats):
        found |= {round(100 * theta[1]): result for _, theta, result in pool.collect(patient=True)}
    return [found[k] for k in range(len(whats))]


def test_the_same_workers_run_one_batch_after_the_other(opened):
    pool = opened(jobs=2)
    assert all(isinstance(r, Simulated) for r in results(pool, *[RUNS] * 5))
    workers = [worker.pid for worker in pool._workers]
    assert all(isinstance(r, Simulated) for r in results(pool, *[RUNS] * 5))
    assert [worker.pid for worker in pool._workers] == workers


def test_a_run_that_kills_its_process_twice_has_failed_and_the_others_have_not(opened):
    first, crashed, last = results(opened(), RUNS, DIES, RUNS)
    assert isinstance(first, Simulated)
    assert isinstance(last, Simulated)
    assert isinstance(crashed, FailedRun)
    assert crashed.why == "died"
    assert "the run crashed, and again when it ran alone" in crashed.words


def test_a_run_whose_process_died_once_runs_again(opened, tmp_path, monkeypatch):
    monkeypatch.setenv("PREFCAL_TEST_FLAG", str(tmp_path / "died"))
    assert isinstance(results(opened(), DIES_ONCE)[0], Simulated)
    assert (tmp_path / "died").exists()


def test_own_code_that_raises_keyboard_interrupt_keeps_its_worker(opened, capfd):
    pool = opened()
    assert isinstance(results(pool, RUNS)[0], Simulated)
    workers = [worker.pid for worker in pool._workers]
    interrupted, after = results(pool, INTERRUPTS, RUNS)
    assert isinstance(interrupted, FailedRun)
    assert interrupted.why == "raised"
    assert "run raised KeyboardInterrupt (in many_runs.py:" in interrupted.words
    assert isinstance(after, Simulated)
    assert [worker.pid for worker in pool._workers] == workers
    assert capfd.readouterr().err == ""


def test_a_run_that_writes_to_every_open_file_has_failed(opened):
    wrote, after = results(opened(), WRITES, RUNS)
    assert isinstance(wrote, FailedRun)
    assert "used a file that it had not opened" in wrote.words
    assert isinstance(after, Simulated)


def test_a_run_that_forks_and_forgets_it_has_one_result(opened):
    found = results(opened(), FORKS, RUNS, FORKS, RUNS)
    assert [r.kpis["mean"] for r in found] == sorted(r.kpis["mean"] for r in found)


def test_a_run_that_hangs_is_ended_after_its_time(opened):
    before, hung, after = results(opened(longest=0.5), RUNS, HANGS, RUNS)
    assert isinstance(before, Simulated)
    assert isinstance(after, Simulated)
    assert isinstance(hung, FailedRun)
    assert hung.why == "late"


def test_the_time_limit_follows_the_usual_time(opened, monkeypatch):
    pool = opened()
    assert pool.limit == pool_module._UNKNOWN
    for _ in range(5):  # one by one: results that arrive together are timed together
        results(pool, RUNS)
    assert pool.limit == pool_module._SHORTEST
    monkeypatch.setattr(pool_module, "_SHORTEST", 0.0)
    assert pool.limit < 1.0
    assert opened(longest=2.0).limit == 2.0


def test_what_is_taken_back_or_dropped_does_not_run(opened):
    pool = opened()
    pool.give([np.array([RUNS, 0.0]), np.array([DIES, 0.1])])
    assert pool.take_back()[0] == DIES
    pool.drop()
    assert pool.take_back() is None
    assert isinstance(results(pool, RUNS)[0], Simulated)


class Unloadable:
    """A run that no other process can load."""

    def __call__(self, theta, seed=0):
        raise AssertionError

    def __reduce__(self):
        return _explode, ()


def _explode():
    raise OSError("no such model")


def test_a_scenario_that_cannot_be_loaded_is_an_error(opened):
    with pytest.raises(ScenarioError, match="no such model"):
        results(opened(run=Unloadable()), RUNS)


def test_a_closed_pool_starts_nothing(opened):
    pool = opened()
    pool.close()
    pool.give([np.array([RUNS, 0.0])])
    assert pool.collect(patient=True) == []
