"""What a person may want: scales of KPIs and draws of trade-offs."""

import numpy as np
import pytest

from prefcal_agents.utility.utilities import ERRORS, Scale, Utilities
from support.simulated import bank_of, random_bank


def scale_of(bank):
    return Scale.of(bank, np.arange(len(bank)))


def drawn(scale, count=300, seed=1):
    return Utilities.drawn(scale, count, np.random.default_rng(seed))


@pytest.mark.parametrize("kpi", [0, 1, 2])
def test_a_cost_never_falls_when_one_kpi_grows(kpi):
    bank = random_bank()
    scale = scale_of(bank)
    kpis = np.tile(bank.kpis[7], (40, 1))
    kpis[:, kpi] = np.append(np.geomspace(1e-3, 1e3, 39), np.inf)
    costs = drawn(scale).costs(scale(bank_of(kpis)))
    assert np.all(np.diff(costs, axis=1) >= -1e-12)
    assert np.all(costs[:, -1] > costs[:, 0])


def test_an_infinite_kpi_loses_all_of_its_weight():
    bank = random_bank()
    scale = scale_of(bank)
    utilities = drawn(scale)
    kpis = np.array([[0.5, 0.5, 1e99], [0.5, 0.5, np.inf], [np.inf, np.inf, np.inf]])
    logs = scale(bank_of(kpis))
    assert np.isposinf(logs[1, 2])
    assert np.all(utilities.losses(logs, 2)[:, 1:] == 1.0)
    costs = utilities.costs(logs)
    assert np.all(costs[:, 1] >= costs[:, 0])
    assert costs[:, 2] == pytest.approx(1.0)


@pytest.mark.parametrize("k", [1, 2, 7])
def test_weights_are_positive_and_add_up_to_1(k):
    weights = drawn(scale_of(random_bank(k=k))).weights
    assert weights.shape == (300, k)
    assert np.all(weights > 0)
    assert weights.sum(axis=1) == pytest.approx(1.0)


def test_weights_range_from_all_alike_to_one_before_all_others():
    largest = drawn(scale_of(random_bank(k=4)), 2000).weights.max(axis=1)
    assert np.quantile(largest, 0.05) < 0.4
    assert np.quantile(largest, 0.95) > 0.95


def test_half_of_the_weight_is_lost_at_the_scale():
    utilities = Utilities(
        scales=np.log([[2.0]]), exponents=np.array([[2.0]]), normals=np.zeros((1, 1)),
        spreads=np.ones(1), errors=np.zeros(1),
    )  # fmt: skip
    logs = np.log([[1.0], [2.0], [4.0]])
    assert utilities.costs(logs)[0] == pytest.approx([0.2, 0.5, 0.8])  # 1 / (1 + (2 / d)^2)


def test_a_kpi_is_measured_from_0_or_from_its_best_value_below():
    bank = bank_of([[1.0, -4.0], [2.0, -3.0], [4.0, 4.0]])
    scale = scale_of(bank)
    assert scale.good.tolist() == [0.0, -4.0]
    logs = scale(bank)
    assert np.exp(logs[:, 0]) == pytest.approx([1.0, 2.0, 4.0])
    assert np.exp(logs[:, 1]) == pytest.approx([0.002 * 4.5, 1.0, 8.0])  # the median of 1 and 8


def test_the_best_value_below_0_counts_even_if_it_was_found_later():
    bank = bank_of([[1.0], [2.0], [-3.0]])
    assert Scale.of(bank, np.arange(2)).good.tolist() == [-3.0]


def test_constant_and_infinite_kpis_are_left_out():
    bank = bank_of([[1.0, 3.0, np.inf, 7.0], [1.0, 5.0, np.inf, np.inf], [1.0, 4.0, np.inf, 7.0]])
    scale = scale_of(bank)
    assert scale.names == ("b",)
    assert scale(bank).shape == (3, 1)
    assert drawn(scale).weights == pytest.approx(np.ones((300, 1)))


def test_without_a_kpi_that_differs_all_costs_are_0():
    bank = bank_of([[1.0], [1.0], [1.0]])
    scale = scale_of(bank)
    assert scale.names == ()
    assert np.all(drawn(scale).costs(scale(bank)) == 0.0)


def test_the_log_distances_of_some_rows_are_those_of_all():
    bank = random_bank()
    scale = scale_of(bank)
    assert np.array_equal(scale(bank, [5, 2]), scale(bank)[[5, 2]])


def test_scales_lie_within_the_values_of_their_kpi_but_not_among_the_worst():
    bank = random_bank(400)
    scale = scale_of(bank)
    scales, logs = drawn(scale, 1000).scales, scale(bank)
    assert np.all(scales >= logs.min(axis=0))
    assert np.all(scales <= np.quantile(logs, 0.8, axis=0) + 1e-2)
    share = np.mean(scales < np.quantile(logs, 0.1, axis=0))
    assert 0.35 < share < 0.5  # by hand: half of log10(0.1 / 0.8) / -2.5 + 1, and 1/16


def test_many_mutations_without_lessons_keep_the_distribution():
    scale, rng = scale_of(random_bank()), np.random.default_rng(2)
    first = utilities = Utilities.drawn(scale, 4000, rng)
    for _ in range(40):
        utilities = utilities.mutated(Utilities.drawn(scale, 4000, rng), rng)
    assert utilities.normals.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.06)
    assert utilities.normals.std(axis=0) == pytest.approx(np.ones(3), abs=0.05)
    assert np.corrcoef(utilities.normals.T)[np.triu_indices(3, 1)] == pytest.approx(0, abs=0.08)
    for name in ("scales", "exponents", "spreads"):
        now, before = (getattr(u, name).mean(axis=0) for u in (utilities, first))
        assert now == pytest.approx(before, rel=0.06)
    for rate, odds in ERRORS:
        assert np.mean(utilities.errors == rate) == pytest.approx(odds, abs=0.03)
    moved = np.corrcoef(first.normals[:, 0], utilities.normals[:, 0])[0, 1]
    assert abs(moved) < 0.1  # or nothing was tried


def test_a_mutation_changes_one_kpi_or_what_all_have_in_common():
    scale, rng = scale_of(random_bank()), np.random.default_rng(3)
    before = Utilities.drawn(scale, 500, rng)
    after = before.mutated(Utilities.drawn(scale, 500, rng), rng)
    weight, shape = after.normals != before.normals, after.scales != before.scales
    common = (after.spreads != before.spreads) | (after.errors != before.errors)
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
    for name in ("scales", "exponents", "normals", "spreads", "errors"):
        a, b = getattr(one, name), getattr(other, name)
        assert np.array_equal(getattr(mixed, name), np.array([a[0], b[1], a[2], b[3]]))
        assert np.array_equal(getattr(part, name), a[[3, 3, 0]])
