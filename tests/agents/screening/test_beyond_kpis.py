"""When KPIs are left: a person may judge by what no KPI measures."""

import numpy as np

from prefcal_agents.screening.agent import BeyondKPIs, without_kpis
from prefcal_agents.screening.bank import Growth, Simulations
from prefcal_env.preferences.history import History
from support.simulated import SQUARE, in_chain


def unrelated(theta):
    """KPIs that θ does not explain, so that a person judges by either."""
    noise = np.random.default_rng(list(theta.tobytes())).uniform(-1, 1, 3)
    return dict(zip("abc", 10.0**noise, strict=True))


def by_theta(theta):
    return float(np.sum((theta - [0.3, 0.8]) ** 2))


def by_kpis(theta):
    kpis = unrelated(theta)
    return float(np.log(kpis["a"]) + 0.2 * np.log(kpis["b"]))


def studied(cost, count, seed=0):
    """The record of someone with this cost and `count` answers, and its stage."""
    grown = Growth(Simulations(unrelated), SQUARE, 60, seed)
    bank = grown.stage(History()).bank
    costs = [cost(theta) for theta in bank.thetas[: count + 1]]
    record = in_chain(bank, range(count + 1), np.sign(np.diff(costs)).astype(int).tolist())
    return record, grown.stage(record)


def proposed(record, stage, seed=0):
    return BeyondKPIs(Simulations(unrelated), SQUARE, seed).propose(record, stage)


def test_who_judges_by_theta_is_shown_proposals_without_kpis_after_ten_answers():
    found = [without_kpis(*studied(by_theta, 10, s)) for s in range(3)]
    assert all(found)


def test_who_judges_by_the_kpis_is_not():
    found = [without_kpis(*studied(by_kpis, 10, s)) for s in range(3)]
    assert not any(found)


def test_what_is_proposed_is_a_point_of_the_cube_and_the_same_for_the_same_seed():
    record, stage = studied(by_theta, 12)
    one, again = (proposed(record, stage, 4) for _ in range(2))
    assert one.shape == (2,)
    assert np.all((one >= 0) & (one <= 1))
    assert np.array_equal(one, again)


def test_every_fourth_proposal_fills_the_space():
    record, stage = studied(by_theta, 11)
    point = proposed(record, stage)
    assert np.array_equal(point, stage.bank.z[stage.spread[11]])
    record, stage = studied(by_theta, 12)
    assert not np.any(np.all(stage.bank.z == proposed(record, stage), axis=1))
