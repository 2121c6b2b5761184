"""Workers that die, hang and are ended: who is to blame, and who gets a result."""

import os
import pickle
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from prefcal_env.errors import RunError
from prefcal_env.workers import GRACE, Pool, Terms, Worker, in_time, run_all, usable_cores
from prefcal_env.workers import worker as worker_module
from support import worker_tasks as tasks
from support.processes import is_running, wait_until

WORK = pickle.dumps((tasks.work, ()))
ONCE = Terms(again=False, grace=GRACE)


@pytest.fixture
def pool():
    """Make a pool that is closed in the end."""
    pools = []

    def make(jobs=2, limit=np.inf, terms=Terms(), work=WORK):  # noqa: B008
        pools.append(Pool(lambda: work, jobs, limit, terms))
        return pools[-1]

    yield make
    for made in pools:
        made.close()


@pytest.fixture
def worker():
    """Make a worker that is closed in the end."""
    workers = []

    def make(limit=np.inf, terms=ONCE):
        workers.append(Worker(lambda: WORK, limit, terms))
        return workers[-1]

    yield make
    for made in workers:
        made.close()


def run(pool, *requests):
    """Results in order, from a pool that stays open."""
    pool.give(requests)
    found = []
    while len(found) < len(requests):
        found += pool.collect(patient=True)
    return [result for _, _, result in sorted(found, key=lambda arrived: arrived[0])]


TWICE = r"the run crashed, and again when it ran alone: its "
FATES = {
    "die": ("died", TWICE + "process was ended by SIGKILL"),
    "crash": ("died", TWICE + "process was ended by SIGSEGV"),
    "abort": ("died", TWICE + "process was ended by SIGABRT"),
    "vanish": ("died", TWICE + "process ended with exit code 0"),
    "orphan": ("died", TWICE + "process ended with exit code 3"),
    "write_everywhere": ("died", TWICE + "code used a file that it had not opened"),
    "hang": ("late", r"the run took longer than 2 s and was ended$"),
    "spin": ("late", r"the run took longer than 2 s and was ended$"),
    "fail": ("raised", r"^OSError: the pump does not answer \(in worker_tasks.py:\d+: raise"),
    "fail_oddly": ("raised", r"^OddError: the pump, 3 bar \(in "),
    "interrupt": ("raised", r"^run raised KeyboardInterrupt: the pump is stopped \(in "),
    "stop_generator": ("raised", r"^run raised GeneratorExit: the pump is stopped \(in "),
    "leave": ("raised", r"^run called exit: bye"),
    "stutter": ("raised", r"no file b\\udce4r"),  # half a character is spelled out
    "lock": ("raised", r"cannot pickle"),
}


@pytest.mark.parametrize("what", FATES)
def test_only_the_request_that_does_it_fails_and_says_how(pool, what):
    why, words = FATES[what]
    first, wild, last = run(pool(limit=2.0), ("double", 1), what, ("double", 2))
    assert (first, last) == (2, 4)
    assert isinstance(wild, RunError)
    assert wild.why == why
    with pytest.raises(RunError, match=words):
        raise wild
    assert ("Traceback" in wild.trace) == (why == "raised")


def test_crashes_among_many_short_requests_cost_nobody_else_a_result(pool):
    requests = [("double", number) for number in range(300)]
    requests[100] = requests[200] = "die"
    found = run(pool(), *requests)
    assert [k for k, r in enumerate(found) if isinstance(r, RunError)] == [100, 200]


@pytest.mark.parametrize("limit", [60.0, np.inf])
def test_a_request_whose_process_died_once_runs_again(pool, tmp_path, limit):
    requests = [("double", 1), ("die", str(tmp_path / "once")), ("double", 2)]
    assert run(pool(limit=limit), *requests) == [2, "alive", 4]


def test_a_death_does_not_disturb_what_runs_beside_it(pool, tmp_path):
    log = tmp_path / "runs"
    assert run(pool(limit=60.0), ("count_runs", str(log)), "die")[0] == "counted"
    assert log.read_text() == "run\n"


def test_a_time_limit_is_that_of_one_request(pool):
    assert run(pool(jobs=1, limit=0.8), *[("rest", 0.3)] * 4) == ["rested"] * 4


def test_code_that_raises_or_forks_keeps_its_process(pool):
    made = pool(jobs=1)
    run(made, ("double", 1))
    pids = [worker.pid for worker in made._workers]
    run(made, "interrupt", "fork", "fail", ("double", 1))
    assert [worker.pid for worker in made._workers] == pids
    assert run(made, "fork", ("double", 1), "fork", ("double", 2)) == ["once", 2, "once", 4]


def test_a_thread_that_a_request_leaves_behind_keeps_nobody(tmp_path):
    over = tmp_path / "over"
    made = Pool(lambda: WORK, 1, np.inf, Terms())
    found = run_all(made, [("leave_a_thread", str(over)), ("double", 1)])
    assert dict(pair for arrived in found for pair in arrived) == {0: None, 1: 2}
    assert not over.exists()


def test_what_requests_print_is_not_our_standard_output(pool, capfd):
    run(pool(jobs=1), "shout")
    printed = capfd.readouterr()
    assert (printed.out, printed.err) == ("", "from a worker\n")


def test_workers_keep_one_thread_of_linear_algebra(pool):
    assert run(pool(jobs=1), "threads") == ["1"]


def test_no_worker_takes_notice_of_ctrl_c(pool):
    made = pool(jobs=1)
    run(made, ("double", 1))
    os.kill(made._workers[0].pid, signal.SIGINT)
    assert run(made, ("double", 1)) == [2]


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("raises", "the pump does not answer"),
        ("dies", "crashed while it was loaded: its process ended with exit code 4"),
        ("hangs", "loading takes too long"),
    ],
)
def test_work_that_cannot_be_loaded_is_an_error(pool, monkeypatch, how, words):
    monkeypatch.setattr("prefcal_env.workers.worker._LOADING", 5.0 if how == "hangs" else 60.0)
    work = pickle.dumps((tasks.unloadable, (how,)))
    with pytest.raises(RunError, match=words):
        run(pool(limit=1.0, work=work), ("double", 1))


def test_the_time_limit_of_a_gentle_pool_follows_the_usual_time(pool, monkeypatch):
    made = pool(jobs=1, terms=Terms(gentle=True))
    assert made.limit == worker_module._UNKNOWN
    for _ in range(5):  # one by one: results that arrive together are timed together
        run(made, ("double", 1))
    assert made.limit == worker_module._SHORTEST
    monkeypatch.setattr(worker_module, "_SHORTEST", 0.0)
    assert made.limit < 1.0
    assert pool(limit=2.0, terms=Terms(gentle=True)).limit == 2.0


def test_what_is_taken_back_or_dropped_does_not_run(pool):
    made = pool(jobs=1)
    made.give(["hang", "die"])
    assert made.take_back() == "die"
    made.drop()
    assert made.take_back() is None
    made.give([("double", 1)])
    assert made.collect(patient=False) == []
    assert run(made, ("double", 2))


def test_requests_are_read_no_further_than_needed_and_closing_ends_what_runs(tmp_path):
    read, log = [], tmp_path / "pid"

    def requests():
        yield ("log_pid", str(log))
        while True:
            read.append(None)
            yield ("double", 1)

    found = run_all(Pool(lambda: WORK, 2, np.inf, Terms()), requests(), ahead=100)
    next(found)
    wait_until(lambda: log.exists() and log.read_text())
    found.close()
    assert len(read) <= 100
    assert not is_running(int(log.read_text()))


def test_a_closed_pool_starts_nothing(pool):
    made = pool()
    made.close()
    made.give([("double", 1)])
    assert made.collect(patient=True) == []


def test_without_a_second_attempt_a_death_is_told_at_once_and_the_next_request_runs(worker):
    one = worker()
    with pytest.raises(RunError, match="the run crashed: its process was ended by SIGKILL") as died:
        one.run("die")
    assert died.value.why == "died"
    assert one.run(("double", 1)) == 2


def test_a_late_request_says_where_it_was_and_whether_the_next_one_may_hang(worker, monkeypatch):
    monkeypatch.setattr("prefcal_env.workers.worker._LONG", 0.5)
    one = worker(1.0, Terms("the simulation", "--more", grace=GRACE))
    words = r"simulation took longer than 1 s .*\(--more allows more\). It was in worker_tasks.py:"
    with pytest.raises(RunError, match=words):
        one.run("spin")
    assert one.hangs
    assert one.run(("double", 1)) == 2
    assert not one.hangs


def test_a_request_is_stopped_from_another_thread_and_tidies_up(worker, tmp_path):
    flag, one = tmp_path / "flag", worker()

    def stop():
        wait_until(lambda: flag.exists() and flag.read_text() == "running")
        assert one.busy_with("tidy")
        one.stop("stopped")

    thread = threading.Thread(target=stop)
    thread.start()
    with pytest.raises(RunError, match=r"you stopped the run after 1 s\. It was in ") as stopped:
        one.run(("spin_tidily", str(flag)), "tidy")
    thread.join()
    assert stopped.value.why == "stopped"
    assert flag.read_text() == "at rest"
    assert one.busy_with("tidy") is None


def test_what_is_in_the_way_ends_a_little_later(worker):
    one = worker()
    one.reserve("spins")
    one.stop("given up", within=0.1)
    with pytest.raises(RunError, match="no longer needed") as given_up:
        one.run("spin", "spins")
    assert given_up.value.why == "given up"


def test_a_quiet_process_that_crashes_is_quoted(worker, capfd):
    one = worker(terms=Terms(quiet=True, again=False))
    with pytest.raises(RunError, match=r"SIGKILL \(from a worker\)$"):
        one.run("die_loudly")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("gently", [True, False])
def test_a_closed_worker_runs_nothing_and_leaves_no_process(worker, gently):
    one = worker()
    one.run(("double", 1))
    pid = one.pid
    one.close(gently=gently)
    assert not is_running(pid)
    with pytest.raises(RunError, match="closing"):
        one.run(("double", 1))


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs the list of open files")
@pytest.mark.parametrize("how", ["closed", "closed gently", "late", "died"])
def test_however_a_process_ends_none_of_its_pipes_stays_open(worker, how):
    def pipes():
        return {one for one in Path("/proc/self/fd").iterdir() if one.is_fifo()}

    before = pipes()
    one = worker(limit=1.0)
    one.run(("double", 1))
    assert pipes() > before
    if how.startswith("closed"):
        one.close(gently=how == "closed gently")
    else:
        with pytest.raises(RunError):
            one.run("hang" if how == "late" else "die")
    wait_until(lambda: pipes() <= before)


def test_ctrl_c_ends_what_runs_at_once(worker, tmp_path):
    log, one = tmp_path / "pid", worker(terms=Terms())
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def press():
        wait_until(lambda: log.exists() and log.read_text())
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=press).start()
    begun = time.monotonic()
    try:
        with pytest.raises(KeyboardInterrupt):
            one.run(("log_pid", str(log)))
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - begun < 20
    assert not is_running(int(log.read_text()))


def test_the_cores_that_may_be_used_are_counted():
    assert 1 <= usable_cores() <= (os.cpu_count() or 1)


@pytest.mark.parametrize(("seconds", "words"), [(0.5, "0.5 s"), (90, "90 s"), (600, "10 min"), (3600, "1 h")])
def test_a_time_in_words(seconds, words):
    assert in_time(seconds) == words
