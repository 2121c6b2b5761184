from dataclasses import replace

import pytest

from bench_support.worths import study
from prefcal_bench.cells.cell import Cell, Result
from prefcal_bench.cells.duels import PAPER, Duel, Round, play, rounds
from prefcal_bench.problems import problem
from prefcal_env.errors import SettingsError

OPTIMUM = (0.085, 0.31, 16.0, 0.261, 0.918)
SLOW = (0.4, 1.0, 30.0, 2.0, 2.0)


def result(agent, seed=0, best=OPTIMUM, calibrator="noisy10", where="overtake", n_max=2):
    gaps = None if where == "overtake" else (1.0, 1.0)
    return Result(Cell(agent, where, calibrator, seed, 1, n_max), (SLOW, best), gaps, gaps, (0, 1), best)


@pytest.mark.unchecked  # twice as fast
def test_each_meets_each_and_the_paper_s_optimum_before_the_referee():
    round_ = Round("overtake", "noisy10", 3, (("A", OPTIMUM), ("B", SLOW)))
    assert play(round_) == (
        Duel("overtake", "noisy10", "A", "B", 3, -1),
        Duel("overtake", "noisy10", "A", PAPER, 3, 0),
        Duel("overtake", "noisy10", "B", PAPER, 3, 1),
    )


def test_what_has_a_worth_is_not_duelled():
    assert rounds([study("A"), study("B")]) == ()


def test_rounds_are_made_of_what_has_no_cost_and_has_not_failed_in_canonical_order():
    lost = Result.failed(replace(result("C").cell), "no")
    results = [
        result("B", seed=1),
        result("B"),
        result("A"),
        lost,
        result("A", where="camel"),
        result("A", calibrator="lexicographic"),
    ]
    found = rounds(results)
    assert [(r.calibrator, r.seed, [name for name, _ in r.thetas]) for r in found] == [
        ("lexicographic", 0, ["A"]),
        ("noisy10", 0, ["A", "B"]),
        ("noisy10", 1, ["B"]),
    ]
    assert rounds(results[::-1]) == found
    assert len({r.key for r in found}) == 3


def test_studies_of_different_budgets_do_not_meet():
    with pytest.raises(SettingsError, match="one budget"):
        rounds([result("A"), result("A", n_max=3)])


def test_a_round_s_key_knows_the_version_of_the_problem(monkeypatch):
    round_ = Round("overtake", "noisy10", 3, (("A", OPTIMUM),))
    before = round_.key
    now = problem("overtake")
    newer = replace(now, version=f"{now.version}, newer")
    monkeypatch.setattr("prefcal_bench.cells.duels.problem", lambda name: newer)
    assert round_.key != before


def test_an_impossible_outcome_says_so():
    with pytest.raises(SettingsError, match="outcome"):
        Duel("overtake", "noisy10", "A", "B", 0, 2)
