"""Data profiles, by hand."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.standing import profiles
from support.campaigns import ends, failed, result


def made(results):
    campaign = campaign_of(results)
    return profiles(campaign, campaign.settings[0])


def test_shares_by_hand():
    found = made(
        [
            result("A", "p", 0, (2.0, 0.3, 0.01)),  # the median first gap is 2
            result("A", "p", 1, (2.0, 0.1, 0.1)),
            result("A", "q", 0, (4.0, 4.0, 0.0)),  # and 4
            result("A", "q", 1, (4.0, 4.0, 4.0)),
        ]
    )
    assert found.instances == 4
    assert found.problems == 2
    assert found.shares[1e-1]["A"].tolist() == [0.0, 0.25, 0.75]
    assert found.shares[1e-2]["A"].tolist() == [0.0, 0.0, 0.5]
    assert found.shares[1e-3]["A"].tolist() == [0.0, 0.0, 0.25]


def test_the_initial_gap_is_one_number_for_all_agents():
    lucky = result("A", "p", 0, (0.01, 0.01))  # 1 % of what the others begin with
    found = made([lucky, result("B", "p", 0, (1.0, 1.0)), result("C", "p", 0, (1.0, 1.0))])
    assert found.shares[1e-2]["A"].tolist() == [1.0, 1.0]


def test_a_failed_study_is_not_solved():
    found = made([*ends("A", "p", [0.001, 0.001]), *ends("B", "p", [0.001]), failed("B", "p", 1)])
    assert found.instances == 2
    assert found.shares[1e-1]["A"][-1] == 1
    assert found.shares[1e-1]["B"][-1] == 0.5


def test_what_was_reached_can_be_lost_again_under_noise():
    assert made([result("A", "p", 0, (1.0, 0.0, 0.5))]).shares[1e-1]["A"].tolist() == [0, 1, 0]


def test_without_a_cost_there_is_no_profile():
    assert "a problem with a cost" in made([result("A", "road", 0, None)])
    assert "a problem with a cost" in made([failed()])


@settings(max_examples=30)
@given(st.lists(st.lists(st.floats(0, 10), min_size=3, max_size=3), min_size=1, max_size=5))
def test_shares_lie_between_none_and_all_and_a_wider_tolerance_solves_more(gaps):
    found = made([result("A", "p", s, tuple(g)) for s, g in enumerate(gaps)])
    shares = np.array([found.shares[t]["A"] for t in (1e-1, 1e-2, 1e-3)])
    assert ((shares >= 0) & (shares <= 1)).all()
    assert (np.diff(shares, axis=0) <= 0).all()


def test_a_start_at_the_optimum_is_solved_at_once():
    assert made([result("A", "p", 0, (0.0, 0.0))]).shares[1e-3]["A"].tolist() == [1, 1]
