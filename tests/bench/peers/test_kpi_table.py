"""The table of KPIs that BOPE learns from."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_bench.peers.utility import KPITable
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import Comparison, History
from support.histories import in_cube


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
