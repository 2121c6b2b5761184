"""A suite as a whole: the same digest however it is run, and nothing run twice."""

from dataclasses import replace
from pathlib import Path

import pytest

from prefcal_bench import Processes, Store, Suite, run_suite

OWN = Path(__file__).parents[1] / "bench_support" / "agents.py"
LOOP = OWN.with_name("loop.py")
LOOPS = (f"{LOOP}:SCENARIO",)
TASTES = ("weights", "hidden-noisy20", "rising", "priorities")
SICK = """

from dataclasses import replace

def sick(theta, seed=0):
    if theta[0] > 0.9:
        raise OSError("the pump does not answer")
    return run(theta, seed)

SICK = replace(SCENARIO, run=sick, kpis=KPIS[:2])
"""
SMALL = Suite(
    ("GLISp", "GLIS", "RandomSearch"),
    ("hartman3", "overtake"),
    ("perfect", "lexicographic", "noisy20"),
    seeds=1,
    n_init=2,
    n_max=4,
)


class Seen:
    """A watcher that writes everything down."""

    def __init__(self):
        self.begun, self.words, self.count = [], [], 0

    def begin(self, what, total, done):
        self.begun.append((what, total, done))

    def landed(self, what):
        self.count += 1

    def say(self, words):
        self.words.append(words)


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


def test_closed_loops_give_the_same_on_one_process_and_two_and_after_a_stop(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    agents = ("GLISp", f"{OWN}:Own", f"{OWN}:Sees")
    loops = Suite(agents, LOOPS, TASTES, seeds=1, n_init=2, n_max=4)
    (one, seen), (two, later) = (run(loops, tmp_path / str(jobs), jobs) for jobs in (1, 2))
    assert not one.failures
    assert all(len(result.worth) == 4 for result in one.results)
    assert one.digest == two.digest
    assert one.duels == two.duels == ()
    # Random experiments are computed once; neither they nor any cell a second time.
    assert seen.begun == [("random experiments", 1, 0), ("cells", 9, 0)]
    assert later.begun == [("cells", 9, 0)]

    for cell in loops.cells[2:7]:
        Store(tmp_path / "1").path(cell).unlink()
    again, seen = run(loops, tmp_path / "1", jobs=2)
    assert seen.begun == [("cells", 9, 4)]
    assert seen.count == 5
    assert again.digest == one.digest


def test_a_pool_that_cannot_be_computed_fails_its_cells_and_no_others(tmp_path):
    own = tmp_path / "own.py"
    own.write_text(LOOP.read_text() + SICK)
    suite = Suite(
        (f"{OWN}:Own",), (f"{own}:SICK", f"{own}:SCENARIO"), ("weights",), seeds=1, n_init=2, n_max=3
    )
    finished, seen = run(suite, tmp_path / "out")
    (failed,) = finished.failures
    assert failed.cell.problem == f"{own}:SICK"
    assert "the pump does not answer" in failed.failure
    assert len(finished.results) == 2
    assert any(words.startswith(f"random experiments of {own}:SICK") for words in seen.words)


@pytest.mark.parametrize("poison", ["Dies", "Raises"])
def test_only_the_guilty_cell_is_reported(tmp_path, poison):
    finished, seen = run(own(poison, "Own", seeds=3), tmp_path)
    (failed,) = finished.failures
    assert (failed.cell.agent, failed.cell.seed) == (f"{OWN}:{poison}", 1)
    words = {"Dies": "the task crashed", "Raises": "OSError: the pump does not answer"}[poison]
    assert words in failed.failure
    assert [line for line in seen.words if words in line] == seen.words
    assert len(finished.results) == 6

    # It runs again when asked again, and what has landed does not.
    again, seen = run(own(poison, "Own", seeds=3), tmp_path)
    assert seen.begun == [("cells", 6, 5)]
    assert again.digest == finished.digest


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
