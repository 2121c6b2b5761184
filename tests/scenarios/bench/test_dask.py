"""The same suite on a real Dask cluster of several worker processes, one of which is killed."""

import os
import signal
from pathlib import Path

import pytest

from prefcal_env.errors import BenchmarkError, MissingExtraError
from prefcal_scenarios.bench import DaskCluster, Processes, Store, Suite, run_suite
from support.bench_watcher import Seen

distributed = pytest.importorskip("distributed")
OWN = Path(__file__).parents[2] / "support" / "bench_agents.py"
LOOP = OWN.with_name("bench_loop.py")
SLOW = Suite(
    ("GLISp", f"{OWN}:Own", f"{OWN}:Slow"), ("camel",), ("perfect", "noisy10"), seeds=2,
    n_init=2, n_max=4,
)  # fmt: skip


@pytest.fixture(scope="module")
def cluster():
    """A scheduler, and two worker processes that a nanny starts again when they die."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as cluster:
        yield cluster


class Killer(Seen):
    """Kills a worker when the third result lands; Dask must still have most of its work to do."""

    def __init__(self, address):
        super().__init__()
        self.address, self.killed = address, None

    def landed(self, what):
        super().landed(what)
        if self.count == 3:
            with distributed.Client(self.address, set_as_default=False) as client:
                self.killed = sorted(client.run(os.getpid).values())[0]
            os.kill(self.killed, signal.SIGKILL)


def test_a_killed_worker_changes_nothing(cluster, tmp_path):
    killer = Killer(cluster.scheduler_address)
    workers = DaskCluster(cluster.scheduler_address)
    on_dask = run_suite(SLOW, Store(tmp_path / "dask"), workers, killer)
    assert killer.killed
    here = run_suite(SLOW, Store(tmp_path / "here"), Processes(2), Seen())
    assert not on_dask.failures
    assert on_dask.digest == here.digest


def test_closed_loops_give_the_same_on_dask(cluster, tmp_path):
    suite = Suite(
        (f"{OWN}:Own", f"{OWN}:Sees"), (f"{LOOP}:SCENARIO",), ("weights", "hidden-noisy10"),
        seeds=1, n_init=2, n_max=4,
    )  # fmt: skip
    workers = DaskCluster(cluster.scheduler_address)
    on_dask = run_suite(suite, Store(tmp_path / "dask"), workers, Seen())
    here = run_suite(suite, Store(tmp_path / "here"), Processes(1), Seen())
    assert not on_dask.failures
    assert on_dask.digest == here.digest


def test_a_cell_that_kills_every_worker_is_the_only_one_reported(cluster, tmp_path):
    suite = Suite(
        ("RandomSearch", f"{OWN}:Dies"), ("camel",), ("perfect",), seeds=3, n_init=2, n_max=3
    )
    finished = run_suite(suite, Store(tmp_path), DaskCluster(cluster.scheduler_address), Seen())
    (failed,) = finished.failures
    assert (failed.cell.agent, failed.cell.seed) == (f"{OWN}:Dies", 1)
    assert "its worker died" in failed.failure
    assert len(finished.results) == 6


def test_a_cluster_without_workers_and_no_cluster_say_so(tmp_path):
    suite = Suite(("RandomSearch",), ("camel",), ("perfect",), seeds=1, n_init=2, n_max=3)
    with distributed.LocalCluster(
        n_workers=0, processes=False, dashboard_address=":0", silence_logs=50
    ) as empty:
        nobody = DaskCluster(empty.scheduler_address, patience=0.5)
        with pytest.raises(BenchmarkError, match=r"has had no worker for 0\.5 s"):
            run_suite(suite, Store(tmp_path), nobody, Seen())
    with pytest.raises(BenchmarkError, match="no Dask scheduler at 'nonsense://x'"):
        run_suite(suite, Store(tmp_path), DaskCluster("nonsense://x"), Seen())


def test_without_distributed_it_says_what_to_install(monkeypatch):
    monkeypatch.setattr("prefcal_scenarios.bench.dask_cluster.is_installed", lambda _: False)
    with pytest.raises(MissingExtraError, match=r"prefcal\[dask\]"):
        DaskCluster("tcp://127.0.0.1:1")
