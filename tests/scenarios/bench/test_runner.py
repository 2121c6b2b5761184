"""A suite as a whole: the same digest however it is run, and nothing run twice."""

from dataclasses import replace
from pathlib import Path

import pytest

from prefcal_scenarios.bench import Processes, Store, Suite, run_suite
from support.bench_watcher import Seen

OWN = Path(__file__).parents[2] / "support" / "bench_agents.py"
SMALL = Suite(
    ("GLISp", "GLIS", "RandomSearch"), ("hartman3", "overtake"),
    ("perfect", "lexicographic", "noisy20"), seeds=1, n_init=2, n_max=4,
)  # fmt: skip


def own(*names, **changes):
    agents = tuple(f"{OWN}:{name}" for name in names)
    return replace(SMALL, agents=agents, problems=("camel",), calibrators=("perfect",), **changes)


def run(suite, folder, jobs=2):
    seen = Seen()
    return run_suite(suite, Store(folder), Processes(jobs), seen), seen


def test_one_process_and_two_give_the_same_and_nothing_runs_again(tmp_path):
    (one, _), (two, seen) = (run(SMALL, tmp_path / str(jobs), jobs) for jobs in (1, 2))
    assert one.digest == two.digest
    assert one.duels == two.duels
    assert {(d.agent, d.rival) for d in one.duels} >= {("GLISp", "RandomSearch")}
    assert not one.failures
    assert not two.trouble
    assert seen.begun == [("cells", 9, 0), ("duels", 2, 0)]
    assert seen.count == 11
    # Times come from serial runs only.
    assert all(result.seconds is not None for result in one.results)
    assert all(result.seconds is None for result in two.results)

    again, seen = run(SMALL, tmp_path / "2")
    assert again == two
    assert seen.begun == [("cells", 9, 9)]
    assert seen.count == 0


def test_results_of_a_smaller_suite_are_used_by_a_larger_one(tmp_path):
    run(own("Own", seeds=1), tmp_path)
    _, seen = run(own("Own", "Sees", seeds=2), tmp_path)
    assert seen.begun == [("cells", 4, 1)]


@pytest.mark.parametrize("poison", ["Dies", "Raises"])
def test_only_the_guilty_cell_is_reported(tmp_path, poison):
    finished, seen = run(own(poison, "Own", seeds=3), tmp_path)
    (failed,) = finished.failures
    assert (failed.cell.agent, failed.cell.seed) == (f"{OWN}:{poison}", 1)
    words = {"Dies": "its worker died", "Raises": "OSError: the pump does not answer"}[poison]
    assert words in failed.failure
    assert [line for line in seen.words if words in line] == seen.words
    assert len(finished.results) == 6

    # It runs again when asked again, and what has landed does not.
    again, seen = run(own(poison, "Own", seeds=3), tmp_path)
    assert seen.begun == [("cells", 6, 5)]
    assert again.digest == finished.digest


def test_a_process_that_dies_once_costs_no_cell(tmp_path, monkeypatch):
    monkeypatch.setenv("PREFCAL_TEST_FLAG", str(tmp_path / "died"))
    finished, _ = run(own("Unlucky", seeds=3), tmp_path / "out")
    assert (tmp_path / "died").exists()
    assert not finished.failures
    undisturbed, _ = run(own("Unlucky", seeds=3), tmp_path / "other")
    assert finished.digest == undisturbed.digest


def test_a_damaged_result_runs_again_with_a_word(tmp_path):
    suite = own("Own", seeds=2)
    before, _ = run(suite, tmp_path, jobs=1)
    path = Store(tmp_path).path(suite.cells[0])
    path.write_text(path.read_text()[:100])
    after, seen = run(suite, tmp_path, jobs=1)
    assert len(seen.words) == 1
    assert seen.words[0].endswith("it runs again")
    assert seen.begun == [("cells", 2, 1)]
    assert after.digest == before.digest
