import numpy as np
import pytest

from bench_support.people import runs
from prefcal_bench.people import random_search_worth, worth
from prefcal_bench.people.judgements import Noticed, Order
from prefcal_bench.people.rule import Noticing
from prefcal_env.errors import SettingsError


def by_error(noticed, *, ties_count):
    return Noticing(Order((Noticed("error", noticed),)), ties_count)


STRICT = by_error(0.0, ties_count=True)
POOL = runs(*[[float(k)] for k in range(9)])


@pytest.mark.parametrize(
    ("value", "expected"), [(-1.0, 10 / 1), (0.0, 10 / 2), (2.5, 10 / 4), (8.0, 10 / 10), (99.0, 10 / 10)]
)
def test_worth_by_hand(value, expected):
    assert worth(STRICT, POOL, runs([value])) == expected  # (N + 1) / (k + 1)


def test_ties_are_at_least_as_good():
    blunt = by_error(2.0, ties_count=True)
    assert worth(blunt, POOL, runs([0.0])) == 10 / 4


def test_to_people_with_eyes_only_what_is_noticeably_better_counts():
    eyes = by_error(2.0, ties_count=False)
    assert worth(eyes, POOL, runs([0.0])) == worth(eyes, POOL, runs([2.0])) == 10 / 1
    assert worth(eyes, POOL, runs([5.0])) == 10 / 4  # 0, 1 and 2 are noticeably better


def test_an_interrupted_run_is_worth_least():
    assert worth(STRICT, POOL, runs([0.0], survived=[5.0])) == 1.0


@pytest.mark.parametrize(("count", "expected"), [(1, np.e), (20, 36.5), (50, 89.9)])
def test_random_search_of_a_strict_order_is_worth_the_exponential_of_a_harmonic_number(count, expected):
    assert expected == pytest.approx(np.exp(np.sum(1 / np.arange(1, count + 1))), rel=1e-3)
    rng = np.random.default_rng(0)
    many = runs(*rng.random((8192, 1)))
    found = random_search_worth(STRICT, many, experiments=count, replays=2000, rng=rng)
    assert found == pytest.approx(expected, rel=0.08)


def test_where_all_are_alike_random_search_is_worth_nothing():
    alike, rng = runs(*[[1.0]] * 64), np.random.default_rng(0)
    assert random_search_worth(STRICT, alike, experiments=50, replays=9, rng=rng) == 1.0


def test_random_search_follows_from_its_generator():
    found = [
        random_search_worth(STRICT, POOL, experiments=5, replays=9, rng=np.random.default_rng(seed))
        for seed in (0, 0, 1)
    ]
    assert found[0] == found[1] != found[2]


NOTHING = POOL.take(np.array([], dtype=int))


@pytest.mark.parametrize(("pool", "one"), [(NOTHING, runs([1.0])), (POOL, POOL), (POOL, NOTHING)])
def test_worth_needs_a_pool_and_one_experiment(pool, one):
    with pytest.raises(SettingsError, match="a pool and one experiment"):
        worth(STRICT, pool, one)


@pytest.mark.parametrize("change", [{"runs": NOTHING}, {"experiments": 0}, {"replays": 0}], ids=str)
def test_random_search_needs_something_to_search(change):
    sound = {"runs": POOL, "experiments": 5, "replays": 3, "rng": np.random.default_rng(0)}
    with pytest.raises(SettingsError, match="1 or more"):
        random_search_worth(STRICT, **sound | change)
