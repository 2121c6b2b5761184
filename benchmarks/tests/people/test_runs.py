import numpy as np
import pytest

from bench_support.people import runs
from prefcal_bench.people import runs_of
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.scenario import KPI
from support.short_runs import short_run

KPIS = (
    KPI("error", "error", better="lower"),
    KPI("margin", "margin", better="higher"),
    KPI("level", "level", at_least=1.0, at_most=3.0),
    KPI("score", "score"),
)


def values(**kpis):
    return runs_of(KPIS, [short_run([0.0], kpis=kpis)]).values[0].tolist()


def test_lower_is_better_in_every_column_and_kpis_without_a_direction_are_left_out():
    assert runs_of(KPIS, []).names == ("error", "margin", "level")
    assert values(error=2.0, margin=5.0, level=2.5, score=7.0) == [2.0, -5.0, 0.5]


def test_what_was_not_measured_is_the_worst():
    assert values(error=np.nan, margin=np.inf) == [np.inf] * 3


def test_an_interrupted_run_has_survived_its_duration_and_another_for_ever():
    done, late, failed = (
        short_run([0.0], duration=2.0, end=end) for end in (End.SETTLED, End.UNSAFE, End.FAILED)
    )
    assert runs_of(KPIS, [done, late, failed]).survived.tolist() == [np.inf, 2.0, 2.0]


def test_of_several_variants_the_first_one_to_be_stopped_counts():
    variants = tuple(
        short_run([0.0], duration=duration, end=end)
        for duration, end in ((1.0, End.TIME_UP), (4.0, End.UNSAFE), (3.0, End.UNSAFE))
    )
    whole = short_run([0.0], duration=9.0, runs=variants)
    assert runs_of(KPIS, [whole]).survived.tolist() == [3.0]


def test_no_experiments_are_no_runs():
    nothing = runs_of(KPIS, [])
    assert len(nothing) == 0
    assert nothing.values.shape == (0, 3)


def test_columns_and_rows_are_taken():
    these = runs([1.0, 2.0], [3.0, 4.0], survived=[np.inf, 5.0])
    assert these.column("effort").tolist() == [2.0, 4.0]
    swapped = these.take(np.array([1, 0, 1]))
    assert swapped.column("error").tolist() == [3.0, 1.0, 3.0]
    assert swapped.survived.tolist() == [5.0, np.inf, 5.0]
    with pytest.raises(ValueError, match="not in tuple"):
        these.column("absent")
