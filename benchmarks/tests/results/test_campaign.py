"""Worth along studies, from results and published frames."""

import numpy as np
import pytest

from bench_support.worths import published, study, walks
from prefcal_bench.results.campaign import Setting, after_answers, campaign_of, problems_of
from prefcal_env.errors import SettingsError


def test_published_studies_are_those_of_the_results_in_any_order_of_their_rows():
    results = walks({"GLISp": 1.2, "RandomSearch": 1.0}, n_max=6)
    mixed = published(results).sample(frac=1, random_state=0)
    first, second = campaign_of(results).studies, campaign_of((), mixed).studies
    keys = ["setting", "problem", "agent", "seed"]
    assert first[keys].equals(second[keys])
    assert all(map(np.allclose, first["worth"], second["worth"]))
    assert all(map(np.array_equal, first["asked"], second["asked"]))
    assert second["published"].all()
    assert not first["published"].any()


def test_a_study_that_ended_early_keeps_its_last_worth():
    (row,) = campaign_of([study(worth=(1, 3), n_max=4)]).studies.itertuples()
    assert row.worth.tolist() == [1, 3, 3, 3]
    assert row.asked.tolist() == [0, 1, 1, 1]


def test_sure_tastes_come_first_and_generated_loops_are_sorted_by_number():
    tastes = ("weights-noisy10", "weights", "limits")
    loops = ("loop-17", "loop-2", "servo")
    campaign = campaign_of([study(taste=t, loop=x) for t in tastes for x in loops])
    assert [s.calibrator for s in campaign.settings][-1] == "weights-noisy10"
    assert [s.noisy for s in campaign.settings] == [False, False, True]
    shown = problems_of(campaign.of(campaign.settings[0], "worth"))
    assert shown.index("loop-2") < shown.index("loop-17")


def test_settings_are_named_by_taste_and_by_budget_only_if_that_differs():
    one, other = Setting("weights", 10, 50), Setting("weights", 10, 20)
    assert one.name([one]) == "weights"
    assert one.name([one, other]) == "weights, 50 experiments (10 initial)"
    assert one.name([one], " calibrator") == "weights calibrator"
    assert other.name([one, other], " calibrator") == "weights calibrator, 20 experiments (10 initial)"


def test_worth_after_answers_is_that_of_the_last_experiment_by_then():
    worth, asked = np.array([2.0, 4.0, 8.0]), np.array([0, 2, 3])
    assert after_answers(worth, asked, 5).tolist() == [2, 2, 4, 8, 8, 8]


def test_impossible_worths_are_refused():
    with pytest.raises(SettingsError, match="1 or more"):
        campaign_of([study(worth=(0.5, 2))])


def test_a_study_has_one_course():
    with pytest.raises(SettingsError, match="two studies of GLISp on servo, weights"):
        campaign_of([study()], published([study()]))
    frame = published([study(worth=(1, 5))])
    with pytest.raises(SettingsError, match="two studies of GLISp on servo, weights"):
        campaign_of((), frame.loc[[0, 1, 1]])


def test_a_worth_that_is_no_number_is_named():
    frame = published([study(worth=(1, 4, 2))])
    frame.loc[1, "worth"] = np.nan
    with pytest.raises(SettingsError, match="got nan"):
        campaign_of((), frame)


@pytest.mark.parametrize("lost", [0, 1])
def test_a_study_without_all_its_experiments_is_refused(lost):
    frame = published([study(seed=0), study(worth=(1, 4, 2), seed=1)])
    with pytest.raises(SettingsError, match=r"GLISp on servo, weights, seed 1: .* not all before"):
        campaign_of((), frame.drop(index=2 + lost))


def test_our_worth_is_rounded_as_the_published_one_so_that_equal_ones_tie():
    worth = (1, 8193 / 7)
    campaign = campaign_of([study("Mine", worth=worth)], published([study(worth=worth)]))
    mine, other = campaign.studies["worth"]
    assert mine[-1] == other[-1] != worth[-1]
