"""Several runs of one θ as one experiment."""

import numpy as np
import pytest

from prefcal_env.calibrators import Criterion, Lexicographic
from prefcal_env.errors import ExperimentError
from prefcal_env.experiments.experiment import End
from prefcal_env.experiments.worst_case import worst_of
from prefcal_env.preferences.answer import Preference
from support.short_runs import final_level, short_run


def run(error=0.0, distance=3.0, theta=1.0, **changes):
    return short_run([theta], kpis={"error": error, "distance": distance}, **changes)


def test_arrays_are_those_of_the_first_run_and_kpis_the_worst_of_all():
    runs = [run(1.0, 3.0, value=5.0), run(2.0, 4.0), run(0.0, 2.0)]
    worst = worst_of(runs, ["distance"])
    np.testing.assert_array_equal(worst.x, runs[0].x)
    assert dict(worst.kpis) == {"error": 2.0, "distance": 2.0}
    assert worst.runs == tuple(runs)


@pytest.mark.parametrize(
    ("ends", "worst"),
    [
        ((End.SETTLED, End.TIME_UP), End.TIME_UP),
        ((End.TIME_UP, End.UNSAFE, End.SETTLED), End.UNSAFE),
        ((End.FAILED, End.UNSAFE), End.FAILED),
        ((End.SETTLED,), End.SETTLED),
    ],
)
def test_it_ended_as_the_worst_run_did(ends, worst):
    assert worst_of([run(end=end) for end in ends]).end is worst


def test_a_kpi_that_is_nan_in_one_run_is_nan():
    assert np.isnan(worst_of([run(1.0), run(np.nan), run(2.0)]).kpis["error"])


def test_infinite_kpis_are_compared():
    worst = worst_of([run(np.inf, np.inf), run(1.0, 3.0)], ["distance"])
    assert dict(worst.kpis) == {"error": np.inf, "distance": 3.0}


def test_a_calibrator_with_priorities_asks_how_long_all_runs_survived():
    calibrator = Lexicographic([Criterion("level", final_level)])
    early, late = (
        worst_of([run(), run(end=End.UNSAFE, duration=duration)]) for duration in (0.3, 0.6)
    )
    whole = worst_of([run(), run()])
    assert calibrator.prefer(late, early) is Preference.CHALLENGER
    assert calibrator.prefer(late, whole) is Preference.INCUMBENT


@pytest.mark.parametrize(
    ("runs", "better", "match"),
    [
        ([], (), "got none"),
        ([run(), run(theta=2.0)], (), "same θ"),
        ([run(), short_run([1.0])], (), "same KPIs"),
        ([run(), worst_of([run()])], (), "single runs"),
        ([run()], ["speed"], r"no KPI is called \['speed'\]"),
    ],
)
def test_runs_that_do_not_belong_together_are_refused(runs, better, match):
    with pytest.raises(ExperimentError, match=match):
        worst_of(runs, better)
