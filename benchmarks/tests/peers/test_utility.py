"""What BOPE and EUBO learn from: the utility of comparisons, and the table of KPIs."""

from dataclasses import replace

import numpy as np
import pytest

from bench_support.extras import need
from prefcal_bench.peers.peer import torch_seeded
from prefcal_bench.peers.utility import KPITable, Utility, strict_pairs
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import Comparison, History
from support.histories import in_cube

POINTS = np.linspace(0.0, 1.0, 6)[:, None]
PAIRS = np.array([[3, k] for k in (0, 1, 5)] + [[4, 1], [2, 0], [4, 5]])
"""The best is near 0.65."""


@pytest.fixture
def utility():
    need("peers")
    with torch_seeded(0):
        yield Utility.of(POINTS, PAIRS)


def test_only_strict_answers_count_and_the_winner_comes_first():
    answers = [None, Answer(-1), Answer(1), Answer(0), Answer(None), Answer(1)]
    samples = tuple(in_cube([k / 10]) for k in range(6))
    comparisons = tuple(
        Comparison(k, 0 if k else None, answer or Answer(None), retracted=k == 5)
        for k, answer in enumerate(answers)
    )
    assert strict_pairs(History(samples, comparisons)).tolist() == [[1, 0], [0, 2]]


def test_what_won_is_worth_more(utility):
    means = utility.means()
    assert means[3] > means[1] > means[0] - 0.5
    assert means[[3, 4]].min() > means[[0, 1, 5]].max()


def test_the_challenger_is_not_where_experiments_lost(utility):
    assert 0.4 < utility.challengers(3)[0, 0] < 0.9


def test_the_best_pair_is_that_of_the_package(utility):
    import torch
    from botorch.acquisition.preference import AnalyticExpectedUtilityOfBestOption

    first, second = np.triu_indices(6, 1)
    pairs = torch.tensor(np.stack([POINTS[first], POINTS[second]], axis=1))
    with torch.no_grad():
        k = int(AnalyticExpectedUtilityOfBestOption(utility.model)(pairs).argmax())
    assert utility.best_pair(np.ones((6, 6), dtype=bool)) == (first[k], second[k])
    allowed = np.ones((6, 6), dtype=bool)
    allowed[first[k], second[k]] = False
    assert utility.best_pair(allowed) not in (None, (first[k], second[k]))
    assert utility.best_pair(np.zeros((6, 6), dtype=bool)) is None


def history(*kpis):
    samples = tuple(in_cube([k / 10, 0.5]) for k in range(len(kpis)))
    comparisons = tuple(
        Comparison(k, None if k == 0 else 0, Answer(None, outcomes=(kpi, None))) for k, kpi in enumerate(kpis)
    )
    return History(samples, comparisons)


def test_the_best_is_0_the_worst_1_and_never_a_bit_worse():
    table = KPITable.of(history({"t": 2.0}, {"t": np.inf}, {"t": 4.0}, {"t": 3.0}))
    assert table.rows.tolist() == [0, 1, 2, 3]
    assert table.shares == pytest.approx(np.array([[0.0], [1.1], [1.0], [0.5]]))


def test_a_missing_value_counts_as_the_mean_and_what_never_differs_is_left_out():
    table = KPITable.of(history({"t": 0.0, "same": 5.0}, {"t": 1.0}, {"u": 1.0}, {"u": 0.0}))
    assert table.shares[:, 0] == pytest.approx([0, 1, 0.5, 0.5])
    assert table.shares[:, 1] == pytest.approx([0.5, 0.5, 1, 0])


@pytest.mark.parametrize(
    "kpis", [[None] * 5, [{"t": 1.0}, {"t": 2.0}], [{"t": 1.0}] * 5, [{"t": np.inf}] * 4]
)
def test_with_nothing_to_learn_from_there_is_none(kpis):
    assert KPITable.of(history(*kpis)) is None


def test_experiments_without_kpis_are_left_out_and_so_are_pairs_with_them():
    table = KPITable.of(history({"t": 1.0}, None, {"t": 2.0}, {"t": 3.0}))
    assert table.rows.tolist() == [0, 2, 3]
    assert table.pairs(np.array([[2, 0], [1, 0], [3, 2]])).tolist() == [[1, 0], [2, 1]]


def test_runs_cut_short_are_left_out_since_their_kpis_are_bounds():
    made = history({"t": 1.0}, {"t": 0.0, "u": 1.0}, {"t": 2.0}, {"t": 3.0})
    marks = (Mark.CHALLENGER_CUT_SHORT,)
    cut = replace(made.comparisons[1], answer=replace(made.comparisons[1].answer, marks=marks))
    made = replace(made, comparisons=(made.comparisons[0], cut, *made.comparisons[2:]))
    table = KPITable.of(made)
    assert table.rows.tolist() == [0, 2, 3]
    assert table.shares == pytest.approx(np.array([[0.0], [0.5], [1.0]]))
