"""Rankings and what agents have in common."""

import numpy as np
import pytest
from scipy.stats import friedmanchisquare

from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.standing import Ranking, critical_difference, rank
from support.campaigns import ends, failed, grid


def ranked(results):
    campaign = campaign_of(results)
    return rank(campaign, campaign.settings[0])


@pytest.mark.parametrize(("agents", "q"), [(2, 1.960), (3, 2.343), (5, 2.728), (10, 3.164)])
def test_the_critical_difference_is_that_of_the_published_table(agents, q):
    expected = q * np.sqrt(agents * (agents + 1) / (6 * 14))  # Demšar (2006), table 5 (a)
    assert critical_difference(agents, 14) == pytest.approx(expected, rel=5e-4)


def test_the_worked_example_of_four_agents_on_fourteen_problems():
    assert critical_difference(4, 14) == pytest.approx(1.25, abs=0.005)  # Demšar, section 3.2.4


def test_an_agent_that_is_nearest_everywhere_has_rank_one():
    found = ranked(grid({"GLISp": 1.0, "RandomSearch": 100.0, "Own": 10.0}))
    assert found.agents == ("GLISp", "Own", "RandomSearch")
    assert found.average.tolist() == [1.0, 2.0, 3.0]
    assert found.problems == ("bowl", "valley", "waves")
    assert found.p == pytest.approx(friedmanchisquare([1] * 3, [2] * 3, [3] * 3).pvalue)


def test_equal_medians_share_their_ranks():
    results = [*ends("A", "p", [0.0]), *ends("B", "p", [1e-12]), *ends("A", "q", [0.1])]
    found = ranked([*results, *ends("B", "q", [0.2])])
    assert found.ranks.tolist() == [[1.5, 1.5], [1.0, 2.0]]
    assert found.p is None


def test_agents_that_are_alike_everywhere_are_not_told_apart():
    found = ranked(grid(dict.fromkeys("ABC", 1.0)))
    assert found.average.tolist() == [2.0, 2.0, 2.0]
    assert found.p == 1.0


def test_only_seeds_that_all_agents_have_decide():
    results = [
        *ends("A", "p", [0.1, 0.9, 0.9]),  # by all its seeds it would be the second
        *ends("B", "p", [0.2]),
        *ends("A", "q", [0.1]),
        *ends("B", "q", [0.2]),
    ]
    assert ranked(results).ranks[0].tolist() == [1.0, 2.0]


def test_a_problem_that_an_agent_lacks_is_left_out_and_named():
    results = grid({"A": 1.0, "B": 2.0})
    results = [r for r in results if (r.cell.agent, r.cell.problem) != ("B", "waves")]
    found = ranked(results)
    assert found.problems == ("bowl", "valley")
    assert found.left_out == ("waves: no results of B",)


def test_an_agent_that_lacks_more_than_half_of_the_problems_is_left_out_and_named():
    found = ranked([*grid({"A": 1.0, "B": 2.0}), *ends("C", "bowl", [0.1], n_max=3)])
    assert found.agents == ("A", "B")
    assert found.left_out == ("C: it has results on 1 of 3 problems only",)


@pytest.mark.parametrize(
    "results",
    [
        grid({"A": 1.0}),
        grid({"A": 1.0, "B": 2.0}, problems=("bowl",)),
        [failed()],
        [*ends("A", "p", [0.1]), *ends("B", "q", [0.1]), *ends("C", "r", [0.1])],
    ],
)
def test_too_little_for_a_ranking_is_said_in_words(results):
    assert "needs two agents and two problems" in ranked(results)


def test_no_seed_in_common_is_said():
    results = grid({"A": 1.0, "B": 2.0})
    odd = {"A": 1, "B": 0}
    apart = [
        r for r in results if r.cell.problem != "waves" or r.cell.seed % 2 == odd[r.cell.agent]
    ]
    assert ranked(apart).left_out == ("waves: no seed that all agents have",)


def test_an_unfinished_agent_does_not_become_the_best_by_missing_problems():
    results = grid({"A": 1.0, "B": 2.0})
    found = ranked(results)
    fewer = ranked([r for r in results if r.cell.agent == "A" or r.cell.seed == 0])
    assert isinstance(fewer, Ranking)
    assert fewer.average.tolist() == found.average.tolist()
