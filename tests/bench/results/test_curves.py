"""Worth along studies, from results and published frames."""

import numpy as np
import pytest

from prefcal_bench.results.curves import (
    COLUMNS,
    Setting,
    after_answers,
    curves_of,
    frame_of,
    joined,
)
from prefcal_env.errors import SettingsError
from support.campaigns import failed, result
from support.worths import study, walks


def test_a_frame_has_a_row_for_each_experiment_of_each_study_with_a_worth():
    results = [study(worth=(1, 4, 2)), study(seed=1), result(), failed()]
    frame = frame_of(results)
    assert tuple(frame.columns) == COLUMNS
    assert frame["experiment"].tolist() == [0, 1, 2, 0, 1]
    assert frame["answers"].tolist() == [0, 1, 2, 0, 1]
    assert frame["worth"].tolist() == [1, 4, 2, 1, 4]
    assert set(frame["loop"]) == {"servo"}


def test_curves_come_back_from_a_frame_in_any_order_of_its_rows():
    frame = frame_of(walks({"GLISp": 1.2, "RandomSearch": 1.0}, n_max=6))
    mixed = frame.sample(frac=1, random_state=0)
    first, second = curves_of(frame).studies, curves_of(mixed).studies
    assert first[["setting", "loop", "agent", "seed"]].equals(
        second[["setting", "loop", "agent", "seed"]]
    )
    assert all(map(np.array_equal, first["worth"], second["worth"]))


def test_a_study_that_ended_early_keeps_its_last_worth():
    (row,) = curves_of(frame_of([study(worth=(1, 3), n_max=4)])).studies.itertuples()
    assert row.worth.tolist() == [1, 3, 3, 3]
    assert row.asked.tolist() == [0, 1, 1, 1]


def test_sure_tastes_come_first_and_generated_loops_are_sorted_by_number():
    tastes = ("weights-noisy10", "weights", "limits")
    curves = curves_of(
        frame_of([study(taste=t, loop=x) for t in tastes for x in ("loop-17", "loop-2", "servo")])
    )
    assert [s.calibrator for s in curves.settings][-1] == "weights-noisy10"
    assert [s.noisy for s in curves.settings] == [False, False, True]
    loops = curves.loops(curves.settings[0])
    assert loops.index("loop-2") < loops.index("loop-17")


def test_settings_are_named_by_taste_and_by_budget_only_if_that_differs():
    one, other = Setting("weights", 10, 50), Setting("weights", 10, 20)
    assert one.name([one]) == "weights"
    assert one.name([one, other]) == "weights, 50 experiments (10 initial)"
    assert one.name([one], " calibrator") == "weights calibrator"
    assert (
        other.name([one, other], " calibrator") == "weights calibrator, 20 experiments (10 initial)"
    )


def test_worth_after_answers_is_that_of_the_last_experiment_by_then():
    worth, asked = np.array([2.0, 4.0, 8.0]), np.array([0, 2, 3])
    assert after_answers(worth, asked, 5).tolist() == [2, 2, 4, 8, 8, 8]


@pytest.mark.parametrize(
    ("results", "word"),
    [
        ([study(worth=(0.5, 2))], "1 or more"),
        ([study(), study(worth=(1, 5))], "two studies of GLISp on servo, weights"),
    ],
)
def test_impossible_worths_are_refused(results, word):
    with pytest.raises(SettingsError, match=word):
        curves_of(frame_of(results))


def test_a_worth_that_is_no_number_is_named():
    frame = frame_of([study(worth=(1, 4, 2))])
    frame.loc[1, "worth"] = np.nan
    with pytest.raises(SettingsError, match="got nan"):
        curves_of(frame)


@pytest.mark.parametrize("lost", [0, 1])
def test_a_study_without_all_its_experiments_is_refused(lost):
    frame = frame_of([study(seed=0), study(worth=(1, 4, 2), seed=1)])
    with pytest.raises(SettingsError, match=r"GLISp on servo, weights, seed 1: .* not all before"):
        curves_of(frame.drop(index=2 + lost))


def test_our_worth_is_rounded_as_the_published_one_so_that_equal_ones_tie():
    ours = frame_of([study("Mine", worth=(1, 8193 / 7))])
    published = frame_of([study(worth=(1, 8193 / 7))]).astype({"worth": "float32"})
    mine, other = curves_of(joined(ours, published)).studies["worth"]
    assert mine[-1] == other[-1]


def test_there_can_be_nothing_at_all():
    curves = curves_of(frame_of([]))
    assert curves.settings == curves.agents == ()
    ours = frame_of([study()])
    assert joined(ours, None) is ours
    assert len(joined(frame_of([]), ours)) == 2
    assert len(joined(frame_of([study("Mine")]), ours)) == 4
