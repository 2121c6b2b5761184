"""Workers that die, tasks that raise: who is to blame, and who gets a result."""

import multiprocessing
import os
import signal
import time
from functools import partial

import numpy as np
import pytest

from prefcal_bench.cells.engine import Lost, each
from prefcal_bench.cells.executors import Processes
from prefcal_env.errors import BenchmarkError, SettingsError
from support import bench_tasks as tasks


def run(todo, jobs=2, limit=np.inf):
    found = dict(each(todo, Processes(jobs, limit=limit)))
    assert not multiprocessing.active_children()
    return [found[number] for number in range(len(todo))]


@pytest.mark.parametrize("jobs", [1, 2])
def test_only_the_task_that_kills_its_worker_is_lost(jobs):
    todo = [partial(tasks.double, k) for k in range(6)]
    todo[2] = tasks.die
    results = run(todo, jobs)
    assert isinstance(results[2], Lost)
    assert "its worker died, and again when it ran alone" in results[2].why
    assert [r for k, r in enumerate(results) if k != 2] == [0, 2, 6, 8, 10]


def test_a_worker_that_was_killed_from_outside_costs_nobody_his_result(tmp_path):
    todo = [partial(tasks.double, k) for k in range(5)]
    todo[1] = partial(tasks.die, str(tmp_path / "once"))
    assert run(todo) == [0, "alive", 4, 6, 8]


def test_a_task_that_raises_is_lost_with_its_words_and_the_others_are_not():
    raising = [
        (tasks.fail, "OSError: the pump does not answer"),
        (tasks.leave, "SystemExit: 3"),
        *(
            (partial(tasks.interrupt, error), f"{error.__name__}: the pump is stopped")
            for error in (KeyboardInterrupt, GeneratorExit, BaseException)  # which end programs
        ),
        (tasks.fail_oddly, "OddError: the pump, 3 bar"),  # it cannot be unpickled
        (tasks.stutter, "OSError: no file b\\udce4r"),  # half a character is spelled out
    ]
    *lost, two = run([*(task for task, _ in raising), partial(tasks.double, 1)])
    assert lost == [Lost(words) for _, words in raising]
    assert two == 2


def test_a_task_that_takes_too_long_is_lost_and_what_ran_beside_it_is_not():
    todo = [partial(tasks.double, k) for k in range(6)]
    todo[1] = tasks.spin
    todo[2] = partial(tasks.sleep, 0.5)
    results = run(todo, limit=4.0)
    assert results[1] == Lost("it took longer than 4 s and was ended (--cell-timeout)")
    assert [results[k] for k in (0, 3, 4, 5)] == [0, 6, 8, 10]
    assert not isinstance(results[2], Lost)


def test_a_process_that_ends_as_if_all_were_well_is_noticed():
    todo = [partial(tasks.double, 1), tasks.vanish, partial(tasks.double, 2)]
    two, gone, four = run(todo)
    assert (two, four) == (2, 4)
    assert isinstance(gone, Lost)
    assert "its worker died" in gone.why


def test_a_death_does_not_disturb_what_runs_beside_it(tmp_path):
    log = tmp_path / "runs"
    todo = [partial(tasks.count_runs, str(log)), tasks.die]
    found = run(todo)
    assert found[0] == "counted"
    assert log.read_text() == "run\n"


def test_workers_that_die_at_once_end_the_run(monkeypatch):
    monkeypatch.setattr("prefcal_bench.cells.executors._begin", tasks.refuse)
    with pytest.raises(BenchmarkError, match="workers die as soon as they are started"):
        run([partial(tasks.double, k) for k in range(9)], jobs=1)


def test_a_thread_that_a_task_leaves_behind_keeps_nobody(tmp_path):
    over = tmp_path / "over"
    leave = partial(tasks.leave_a_thread, str(over))
    assert run([leave, partial(tasks.double, 1)], jobs=1) == [None, 2]
    assert not over.exists()


def test_nothing_to_do_opens_nothing():
    assert run([]) == []


def test_closing_early_kills_what_is_running(tmp_path):
    log = tmp_path / "pid"
    running = each([partial(tasks.sleep, 0), partial(tasks.sleep, 60, str(log))], Processes(2))
    next(running)
    while not log.exists() or not log.read_text():
        time.sleep(0.01)
    running.close()
    assert not multiprocessing.active_children()
    with pytest.raises(ProcessLookupError):
        os.kill(int(log.read_text()), 0)  # no number is left if it has slept to the end


def test_standard_output_of_a_worker_is_not_ours(capfd):
    run([tasks.shout], jobs=1)
    seen = capfd.readouterr()
    assert seen.out == ""
    assert "from a worker" in seen.err


def test_no_worker_takes_notice_of_ctrl_c_however_young():
    workers = Processes(2)
    workers.open(2)
    futures = [workers.submit(partial(tasks.double, k)) for k in range(2)]
    young = multiprocessing.active_children()
    assert len(young) == 2
    for process in young:
        os.kill(process.pid, signal.SIGINT)
    assert [future.result(timeout=60) for future in futures] == [0, 2]
    workers.close(at_once=False)


@pytest.fixture
def _ctrl_c_raises():
    """As at a terminal: whatever runs the tests in the background has it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_ctrl_c_raises")
def test_ctrl_c_while_a_worker_is_started_comes_after_it(monkeypatch):
    workers = Processes(1)
    start = multiprocessing.process.BaseProcess.start

    def pressed(process):
        signal.raise_signal(signal.SIGINT)
        start(process)

    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", pressed)
    with pytest.raises(KeyboardInterrupt):
        workers.open(1)
    assert len(multiprocessing.active_children()) == 1
    workers.close(at_once=True)
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("jobs", [0, -1, True, 1.5])
def test_an_impossible_number_of_processes_is_refused(jobs):
    with pytest.raises(SettingsError, match="jobs"):
        Processes(jobs)


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_an_impossible_time_limit_is_refused(limit):
    with pytest.raises(SettingsError, match="time limit"):
        Processes(1, limit=limit)
