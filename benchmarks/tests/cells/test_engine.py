"""Tasks of the benchmark in workers: what is lost says why, and all else has its result."""

from functools import partial

import pytest

from prefcal_bench.cells.engine import Processes, each
from prefcal_env.errors import BenchmarkError, RunError, SettingsError
from support import worker_tasks as tasks


def test_a_lost_task_says_why_and_the_others_have_their_results():
    todo = [tasks.fail, tasks.die, tasks.spin, partial(tasks.double, 1), lambda: 5]
    found = dict(each(dict(enumerate(todo)), Processes(2, limit=4.0)))
    assert (found[3], found[4]) == (2, 5)
    assert all(isinstance(found[k], RunError) for k in range(3))
    assert str(found[0]).startswith("OSError: the pump does not answer (in worker_tasks.py:")
    assert str(found[1]).startswith("the task crashed, and again when it ran alone: ")
    late = "the task took longer than 4 s and was ended (--cell-timeout allows more)"
    assert str(found[2]) == late


def test_without_workers_it_keeps_what_a_failing_task_says():
    found = dict(each({"good": partial(tasks.double, 1), "bad": tasks.fail, "also": lambda: 5}, None))
    assert (found["good"], found["also"]) == (2, 5)
    assert str(found["bad"]).startswith("OSError: the pump does not answer (in worker_tasks.py:")


def test_last_words_are_only_of_workers_whose_benchmark_was_killed(capfd):
    for _ in range(5):
        assert dict(each({"a": partial(tasks.double, 1)}, Processes(1, last_words="killed"))) == {"a": 2}
    assert capfd.readouterr().err == ""


def test_workers_that_die_at_once_end_the_run(monkeypatch):
    monkeypatch.setattr("prefcal_bench.cells.engine._Tasks", partial(tasks.unloadable))
    with pytest.raises(BenchmarkError, match="workers die as soon as they are started"):
        list(each({0: partial(tasks.double, 1)}, Processes(1, last_words="dies")))


@pytest.mark.parametrize("workers", [None, Processes(2)])
def test_nothing_to_do_opens_nothing(workers):
    assert list(each({}, workers)) == []


@pytest.mark.parametrize("jobs", [0, -1, True, 1.5])
def test_an_impossible_number_of_processes_is_refused(jobs):
    with pytest.raises(SettingsError, match="jobs"):
        Processes(jobs)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_an_impossible_time_limit_is_refused(limit):
    with pytest.raises(SettingsError, match="time limit"):
        Processes(1, limit=limit)
