"""What a person may want: scales of KPIs, orders and trade-offs."""

from dataclasses import fields

import numpy as np
import pytest

from prefcal_agents.people import REAL, SURE, Scale, Utilities, notice_chance
from support.simulated import bank_of, random_bank


def scale_of(bank, limits=None):
    return Scale.of(bank, np.arange(len(bank)), limits or {})


def drawn(scale, count=300, seed=1, ordered=None):
    mask = None if ordered is None else np.full(count, ordered)
    return Utilities.draw(scale, count, np.random.default_rng(seed), mask)


def by_hand(k=1, **known):
    """One draw of k KPIs, in which everything is 1 that is not known; no limit is stated."""
    rows = dict.fromkeys(("scales", "exponents", "steps", "limits", "normals"), np.ones((1, k)))
    rows |= {"limits": np.full((1, k), np.inf), "noticed": np.ones(1), "spreads": np.ones(1)}
    rows |= {"ordered": np.zeros(1, dtype=int), "errors": np.zeros(1)}
    return Utilities(**rows | {name: np.array([value]) for name, value in known.items()})


def in_order(steps, limits=None, count=None):
    """One order of KPIs, the first of them first; `limits` in which all values are good."""
    k = len(steps)
    limits = np.array([-np.inf] * k if limits is None else limits, dtype=float)
    scales = np.where(limits > 0, np.log(np.maximum(limits, 1e-9)), -np.inf)
    return by_hand(
        k,
        scales=scales,
        steps=np.array(steps, dtype=float),
        normals=-np.arange(k, dtype=float),
        ordered=k if count is None else count,
    )


def gain(utilities, worse, better):
    """How much better an experiment is than another, by what each of them costs in each part."""
    logs = np.log(np.array([worse, better], dtype=float))
    return utilities.gains(utilities.levels(logs), np.array([1]), np.array([0])).sum(axis=0)[0, 0]


@pytest.mark.parametrize("kpi", [0, 1, 2])
@pytest.mark.parametrize("limits", [{}, {"a": 0.5, "b": 0.2}], ids=["free", "limits"])
def test_a_cost_never_falls_when_one_kpi_grows(kpi, limits):
    bank = random_bank()
    scale = scale_of(bank, limits)
    kpis = np.tile(bank.kpis[7], (40, 1))
    kpis[:, kpi] = np.append(np.geomspace(1e-3, 1e3, 39), np.inf)
    logs = scale(bank_of(kpis))
    costs = drawn(scale).costs(logs)
    assert np.all(np.diff(costs, axis=1) >= -1e-12 * costs[:, 1:])
    trade_offs = drawn(scale, ordered=False).costs(logs)
    assert np.all(trade_offs[:, -1] > trade_offs[:, 0])


def test_an_infinite_kpi_loses_all_of_its_weight_in_a_trade_off():
    bank = random_bank()
    scale = scale_of(bank)
    utilities = drawn(scale, ordered=False)
    kpis = np.array([[0.5, 0.5, 1e99], [0.5, 0.5, np.inf], [np.inf, np.inf, np.inf]])
    logs = scale(bank_of(kpis))
    assert np.isposinf(logs[1, 2])
    assert np.all(utilities.level(logs, 2)[:, 1:] == 1.0)
    costs = utilities.costs(logs)
    assert np.all(costs[:, 1] >= costs[:, 0])
    assert costs[:, 2] * utilities.noticed == pytest.approx(1.0)


def test_half_of_the_weight_is_lost_at_the_scale():
    utilities = by_hand(scales=np.log([2.0]), exponents=[2.0], noticed=0.5)
    logs = np.log([[1.0], [2.0], [4.0]])
    assert utilities.costs(logs)[0] == pytest.approx([0.4, 1.0, 1.6])  # 2 / (1 + (2 / d)^2)


def test_half_of_the_draws_are_orders_of_at_most_five_kpis():
    utilities = drawn(scale_of(random_bank(k=7)), 2000)
    assert np.all(utilities.ordered[:1000] >= 1)
    assert np.all(utilities.ordered[1000:] == 0)
    shares = np.bincount(utilities.ordered[:1000], minlength=6)[1:] / 1000
    assert shares == pytest.approx(np.full(5, 0.2), abs=0.05)


def test_the_first_kpi_of_an_order_that_differs_noticeably_decides():
    order = in_order([0.5, 0.5, 0.5])
    assert gain(order, [2.0, 1.0, 1.0], [1.4, 9.0, 9.0]) > 1
    assert gain(order, [1.4, 9.0, 9.0], [2.0, 1.0, 1.0]) < -1
    assert gain(order, [2.0, 5.0, 1.0], [1.6, 4.0, 9.0]) > 1  # the first is alike
    assert gain(order, [2.0, 5.0, 3.0], [1.6, 4.6, 2.6]) == 0  # all are: a tie
    assert gain(in_order([0.5, 0.5], count=1), [2.0, 1.0], [1.8, 9.0]) == 0  # no second one


def test_all_values_within_the_limit_of_an_order_are_equally_good():
    order = in_order([0.5, 0.1], limits=[3.0, 0.0])
    assert gain(order, [2.9, 1.0], [0.1, 2.0]) < -1  # the second decides
    assert gain(order, [3.6, 1.0], [3.0, 2.0]) > 1  # beyond the limit the first one does
    assert gain(order, [3.4, 1.0], [0.1, 2.0]) < -1  # not noticeably beyond


def test_costs_of_an_order_sort_what_it_compares():
    rng, steps = np.random.default_rng(0), np.array([0.4, 0.2, 0.1])
    order = in_order(steps)
    kpis = (0.25 + 1.01 * rng.integers(0, 6, (40, 3))) * steps  # a step apart, or equal
    costs = order.costs(np.log(kpis))[0]
    for first, second in rng.permutation(40).reshape(-1, 2):
        expected = gain(order, kpis[second], kpis[first])
        assert np.sign(costs[second] - costs[first]) == np.sign(expected)


@pytest.mark.parametrize("ordered", [0, 2])
def test_a_stated_limit_comes_before_everything_else(ordered):
    wanted = by_hand(
        2,
        scales=np.zeros(2),
        steps=np.array([0.1, 0.1]),
        limits=np.array([np.inf, 1.0]),
        normals=np.array([1.0, -1.0]),
        ordered=ordered,
    )
    assert wanted.parts == (0, 1, 3)
    assert gain(wanted, [0.01, 1.05], [90.0, 1.0]) > 1
    assert gain(wanted, [0.01, 1.5], [90.0, 1.3]) > 1  # nearer to the limit
    costs = wanted.costs(np.log([[90.0, 1.0], [0.01, 1.05], [0.01, np.inf]]))[0]
    assert costs[0] + 1 < costs[1] < costs[2] - 1


def test_a_value_at_the_stated_limit_meets_it_and_distances_are_those_from_the_best_value():
    bank = bank_of([[-4.0], [-1.3], [-1.2], [0.0], [2.0]])
    scale = scale_of(bank, {"a": -1.3})
    assert scale.limits == pytest.approx([2.7])
    utilities = drawn(scale, 400)
    beyond = utilities.level(scale(bank), 1)
    assert np.all(beyond[:, :2] == 0)
    assert np.mean(beyond[:, 2] > 0) == pytest.approx(0.97, abs=0.03)  # the rest ignores limits
    assert np.all(np.diff(beyond, axis=1) >= 0)


def test_just_noticeable_differences_are_shares_of_the_range_of_a_kpi():
    rows = np.column_stack([np.linspace(0, 100, 1001), np.linspace(1, 2, 1001)])
    scale = scale_of(bank_of(rows))
    assert scale.ranges == pytest.approx([78.0, 0.78])  # quantiles 0.02 to 0.8
    steps = drawn(scale, 4000).steps / scale.ranges
    assert steps.min() == pytest.approx(10**-2.5, rel=0.05)
    assert steps.max() == pytest.approx(10**-0.3, rel=0.05)
    assert np.median(steps) == pytest.approx(10**-1.4, rel=0.1)


def test_a_kpi_is_measured_from_0_or_from_its_best_value_below():
    bank = bank_of([[1.0, -4.0], [2.0, -3.0], [4.0, 4.0]])
    scale = scale_of(bank)
    assert scale.good.tolist() == [0.0, -4.0]
    logs = scale(bank)
    assert np.exp(logs[:, 0]) == pytest.approx([1.0, 2.0, 4.0])
    assert np.exp(logs[:, 1]) == pytest.approx([0.002 * 4.5, 1.0, 8.0])  # the median of 1 and 8


def test_constant_and_infinite_kpis_are_left_out():
    bank = bank_of([[1.0, 3.0, np.inf, 7.0], [1.0, 5.0, np.inf, np.inf], [1.0, 4.0, np.inf, 7.0]])
    scale = scale_of(bank, {"a": 2.0, "b": 4.5})
    assert scale.names == ("b",)
    assert scale(bank).shape == (3, 1)
    assert scale.limits.tolist() == [4.5]
    assert drawn(scale).weights.shape == (300, 2)


def test_a_kpi_that_is_nearly_always_the_same_has_a_range():
    bank = bank_of([[1.0]] * 99 + [[3.0]])
    assert scale_of(bank).ranges.tolist() == [2.0]


def test_scales_lie_within_the_values_of_their_kpi_but_not_among_the_worst():
    bank = random_bank(400)
    scale = scale_of(bank)
    scales, logs = drawn(scale, 1000, ordered=False).scales, scale(bank)
    assert np.all(scales >= logs.min(axis=0))
    assert np.all(scales <= np.quantile(logs, 0.8, axis=0) + 1e-2)
    share = np.mean(scales < np.quantile(logs, 0.1, axis=0))
    assert 0.35 < share < 0.5  # by hand: half of log10(0.1 / 0.8) / -2.5 + 1, and 1/16


def test_the_distance_of_a_share_of_random_theta_lies_between_those_around_it():
    scale = scale_of(bank_of([[1.0], [2.0], [4.0]]))
    assert np.exp(scale.at(np.array([[0.0], [0.25], [0.5]]))[:, 0]) == pytest.approx(
        [1.0, np.sqrt(2.0), 2.0], rel=1e-3
    )


def test_many_mutations_without_lessons_keep_the_distribution():
    scale, rng = scale_of(random_bank(), {"a": 1.0}), np.random.default_rng(2)
    first = utilities = Utilities.draw(scale, 4000, rng)
    for _ in range(40):
        new = Utilities.draw(scale, 4000, rng, utilities.ordered > 0)
        utilities = utilities.mutate(new, rng)
    assert utilities.normals.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.06)
    assert utilities.normals.std(axis=0) == pytest.approx(np.ones(3), abs=0.05)
    assert np.corrcoef(utilities.normals.T)[np.triu_indices(3, 1)] == pytest.approx(0, abs=0.08)
    assert np.array_equal(utilities.ordered > 0, first.ordered > 0)
    for name in ("exponents", "steps", "spreads", "noticed", "ordered"):
        now, before = (getattr(u, name).mean(axis=0) for u in (utilities, first))
        assert now == pytest.approx(before, rel=0.1)
    for rate, odds in REAL:
        assert np.mean(utilities.errors == rate) == pytest.approx(odds, abs=0.03)
    moved = np.corrcoef(first.normals[:, 0], utilities.normals[:, 0])[0, 1]
    assert abs(moved) < 0.1  # or nothing was tried


def test_sure_people_rarely_answer_against_their_kpis():
    draws = Utilities.draw(scale_of(random_bank()), 2000, np.random.default_rng(0), mistakes=SURE)
    assert draws.errors.mean() == pytest.approx(0.7 * 0.02 + 0.2 * 0.1 + 0.1 * 0.25, abs=0.005)


def test_a_mutation_changes_one_kpi_or_what_all_have_in_common():
    scale, rng = scale_of(random_bank()), np.random.default_rng(3)
    before = Utilities.draw(scale, 500, rng)
    after = before.mutate(Utilities.draw(scale, 500, rng), rng)
    weight, shape = after.normals != before.normals, after.steps != before.steps
    common = (after.noticed != before.noticed) | (after.errors != before.errors)
    assert np.all(np.isin(weight.sum(axis=1), [0, 1, 3]))
    assert np.all(shape.sum(axis=1) <= 1)
    assert not np.any(common & (weight | shape).any(axis=1))
    both = (weight.sum(axis=1) == 1) & shape.any(axis=1)
    assert both.any()
    assert np.array_equal(weight[both], shape[both])  # of the same KPI
    assert np.array_equal(shape, after.exponents != before.exponents)
    for kind in (weight.all(axis=1), common, weight.any(axis=1), shape.any(axis=1)):
        assert kind.any()


def test_draws_are_taken_and_mixed_row_by_row():
    scale = scale_of(random_bank())
    one, other = drawn(scale, 4, seed=1), drawn(scale, 4, seed=2)
    mask = np.array([False, True, False, True])
    mixed, part = one.where(mask, other), one.take(np.array([3, 3, 0]))
    for field in fields(Utilities):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert np.array_equal(getattr(mixed, field.name), np.array([a[0], b[1], a[2], b[3]]))
        assert np.array_equal(getattr(part, field.name), a[[3, 3, 0]])


def test_a_difference_is_noticed_from_1_on():
    assert notice_chance(np.array([-5.0, 0.0, 1.0, 2.0, 1e30])) == pytest.approx([0, 0, 0.5, 1, 1], abs=0.002)


def test_what_some_draws_say_of_answers_is_to_the_bit_what_all_say():
    bank = random_bank()
    some, rows = drawn(scale_of(bank)), np.array([3, 299, 7, 3])
    rng = np.random.default_rng(4)
    better, worse = rng.integers(len(bank), size=(2, 90))
    apart = some.differences(some.levels(scale_of(bank)(bank)), better, worse)
    tie = rng.random(90) < 0.2
    whole = some.gain(apart)
    assert np.array_equal(some.gain(apart, some.weights, rows), whole[rows])
    assert np.array_equal(some.log_answers(whole[rows], tie, rows), some.log_answers(whole, tie)[rows])
    assert np.ptp(whole[rows], axis=0).min() > 0, "draws differ, so that a mix-up would show"


def test_an_answer_is_as_probable_as_its_difference_is_noticed():
    gains = np.array([-5.0, 1.0, 3.9, 4.1, 50.0, 0.0, 50.0])
    tie = np.array([False] * 5 + [True] * 2)
    (found,) = by_hand(errors=0.1).log_answers(gains.reshape(1, -1), tie)
    # One of ten answers is any of the three; one threshold is noticed every other time.
    noticed = [0.1 / 3, 0.9 * 0.5 + 0.1 / 3, *[0.9 + 0.1 / 3] * 3]
    assert np.exp(found[:5]) == pytest.approx(noticed, abs=1e-12)
    # Without a difference, each side is noticed with 0.00135, three standard deviations away.
    assert np.exp(found[5:]) == pytest.approx([0.9 * (1 - 2 * 0.00135) + 0.1 / 3, 0.1 / 3], abs=1e-5)
    assert found[2] == found[4]  # to the last bit: most answers of a long study are not computed one by one
