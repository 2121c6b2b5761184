"""A menu that satisfies as many of the drawn people as it can."""

import numpy as np
import pytest

from prefcal_agents.result import find_unbeaten, others, rows_between

USABLE = np.ones(6, dtype=bool)
LOGS = np.array([[0.0, 5.0], [1.0, 4.0], [2.0, 3.0], [3.0, 2.0], [4.0, 1.0], [5.0, 0.0]])


def costs_of(*favourites, noticed=3.0):
    """Costs of people who each notice everything but their favourite rows as worse."""
    costs = np.full((len(favourites), 6), noticed)
    for person, rows in enumerate(favourites):
        costs[person, list(rows)] = 0.0
    costs[:, 0] = 2.0  # the result: nothing else is noticeably worse, the favourites are better
    return costs


@pytest.mark.parametrize(
    ("favourites", "found"),
    [
        ([(2,), (2,), (2,), (4,), (4,), (5,)], (2, 4)),
        ([(3,), (3,), (3,)], (3,)),  # what is better for all comes once
        ([(1, 2, 3), (1, 2, 3), (4,), (4,)], (4, 2)),  # 4 differs most, then 1 and 2 from both
        ([(1, 2, 5), (1, 2, 5)], (5,)),
    ],
)
def test_it_satisfies_those_whom_the_result_does_not_by_what_differs_most(favourites, found):
    assert others(costs_of(*favourites), LOGS, USABLE, 0) == found


def test_nothing_is_left_to_offer_where_the_result_satisfies_all():
    costs = costs_of((1,), (2,))
    costs[:, 0] = 0.5
    assert others(costs, LOGS, USABLE, 0) == ()


def test_no_candidate_that_is_refused_and_none_that_most_would_find_worse_than_the_result():
    costs = costs_of((2,), (2,), (4,))
    usable = USABLE.copy()
    usable[2] = False
    assert 2 not in others(costs, LOGS, usable, 0)
    costs = np.vstack([np.tile(costs_of((4,))[0], (9, 1)), costs_of((5,))])
    costs[:9, 5] = 4.0
    assert others(costs, LOGS, USABLE, 0) == (4,)  # one in ten would take 5


def test_what_lies_between_is_in_order_and_none_of_it_is_beaten():
    line = np.array([[k, 10.0 - k] for k in range(11)])
    kpis = np.vstack([line, [[5.0, 9.0], [20.0, 0.0]]])  # row 11 is beaten by row 5, 12 lies beyond
    usable = np.ones(13, dtype=bool)
    assert rows_between(kpis, find_unbeaten(kpis, usable), 0, 10) == tuple(range(11))
    assert rows_between(kpis, find_unbeaten(kpis, usable), 7, 3) == (7, 6, 5, 4, 3)
    usable[5] = False
    assert rows_between(kpis, find_unbeaten(kpis, usable), 7, 3) == (7, 6, 4, 3)


def test_what_is_beaten_by_a_usable_row_is_no_stop_and_equals_stay():
    kpis = np.array([[1.0, 2.0], [1.0, 2.0], [1.0, 3.0], [0.0, 0.0], [np.inf, 1.0], [np.inf, np.inf]])
    usable = np.array([True, True, True, False, True, True])
    assert find_unbeaten(kpis, usable).tolist() == [True, True, False, False, True, False]


def test_there_may_be_nothing_between_two():
    kpis = np.array([[0.0, 1.0], [1.0, 0.0], [np.inf, np.inf]])
    assert rows_between(kpis, np.array([True, True, False]), 1, 0) == (1, 0)
