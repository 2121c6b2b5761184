"""The contract of tastes: rules that hold for every taste on every closed loop."""

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest

from prefcal_bench.people import TASTES, USUAL, Runs, has_cost, runs_of, taste
from prefcal_bench.people.named import WRONG, _usable
from prefcal_bench.people.sample import _run, thetas
from prefcal_scenarios.catalog import load
from support.people import EYES, kinds, only

LOOPS = ("servo", "building", "loop-6")
every = pytest.mark.parametrize("name", kinds(TASTES))
everywhere = pytest.mark.parametrize("loop", LOOPS)
COUNT = 24
"""Number of experiments that are compared with each other."""


@cache
def usual(loop):
    scenario = load(loop)
    return _run(scenario, thetas(scenario, USUAL, 512))


@cache
def experiments(loop):
    scenario = load(loop)
    return [scenario.run(theta) for theta in thetas(scenario, "contract", COUNT)]


rule_of = cache(lambda kind, loop, seed: _usable(kind, usual(loop), seed))


@cache
def made(loop, name, seed=0):
    """The taste; the rules of sure and noisy ones are drawn once, see below."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "prefcal_bench.people.named._usable", lambda kind, runs, number: rule_of(kind, loop, number)
        )
        return taste(name, load(loop).kpis, usual(loop), seed)


def stopped(runs: Runs, after: float) -> Runs:
    return replace(runs, survived=np.full(len(runs), after))


def matrix(compare, runs):
    """Verdicts on all pairs, shape (K, K)."""
    return np.array([compare(runs, only(runs, row)) for row in range(len(runs))])


@everywhere
@every
def test_the_referee_s_verdicts_are_opposite_and_the_same_side_by_side(loop, name):
    rule, runs = made(loop, name).rule, usual(loop).take(np.arange(COUNT))
    verdicts = matrix(rule.compare, runs)
    assert np.array_equal(verdicts, -verdicts.T)
    assert not np.diag(verdicts).any()
    assert verdicts.any()
    one_by_one = [[rule.compare(only(runs, b), only(runs, a))[0] for b in range(COUNT)] for a in range(COUNT)]
    assert np.array_equal(verdicts, one_by_one)
    a, b = np.random.default_rng(0).integers(COUNT, size=(2, 99))
    assert np.array_equal(rule.compare(runs.take(a), runs.take(b)), verdicts[b, a])


@everywhere
@every
def test_an_interrupted_run_loses_and_of_two_the_longer_wins(loop, name):
    rule, runs = made(loop, name).rule, usual(loop)
    whole = runs.take(np.flatnonzero(np.isinf(runs.survived))[:COUNT])
    early, late = (stopped(whole, after) for after in (0.5, 0.75))
    assert (rule.compare(early, whole) == 1).all()
    assert (rule.compare(early, late) == 1).all()
    assert (rule.compare(early, early.take(np.arange(len(early))[::-1])) == 0).all()


@everywhere
@every
def test_the_order_of_a_cost_is_that_of_the_comparisons(loop, name):
    rule, runs = made(loop, name).rule, usual(loop).take(np.arange(COUNT))
    cost = rule.cost(runs)
    assert (cost is None) == (name.partition("-")[0] in ("priorities", *EYES))
    assert has_cost(name) == (name in ("weights", "limits", "narrow", "hidden"))
    if cost is not None:
        assert np.isfinite(cost).all()
        differences = np.sign(cost[None] - cost[:, None])
        assert np.array_equal(matrix(rule.compare, runs), differences)


def answers(person, them, pairs):
    return [int(person.prefer(them[a], them[b])) for a, b in pairs]


@everywhere
@every
def test_the_same_person_answers_the_same_in_every_study(loop, name):
    them, one = experiments(loop), made(loop, name)
    pairs = list(combinations(range(8), 2))
    first = answers(one.calibrator(), them, pairs)
    assert answers(one.calibrator(), them, pairs) == first
    assert set(first) <= {-1, 0, 1}


@pytest.mark.parametrize("kind", kinds(name for name in TASTES if "-" not in name))
def test_noisy_people_flip_the_stated_share_of_answers_and_never_the_referee(kind):
    them, pairs = experiments("servo"), list(combinations(range(COUNT), 2))
    sure = np.array(answers(made("servo", kind).calibrator(), them, pairs))
    for end, share in WRONG.items():
        person = made("servo", f"{kind}{end}")
        said = np.array(answers(person.calibrator(), them, pairs))
        decided = sure != 0
        assert set((said * sure)[decided]) <= {-1, 1}
        assert (said[~decided] == 0).all()
        flipped = np.mean((said != sure)[decided])
        assert flipped == pytest.approx(share, abs=0.06 if share else 0)  # 276 pairs
        assert person.rule == made("servo", kind).rule
        runs = runs_of(person.kpis, them)
        assert np.array_equal(
            person.rule.compare(runs, only(runs, 0)), made("servo", kind).rule.compare(runs, only(runs, 0))
        )


def test_two_people_make_different_mistakes_and_have_different_rules():
    one, other = (made("servo", "weights-noisy20", seed) for seed in (0, 1))
    assert one.rule != other.rule
    twin = replace(other, rule=one.rule)
    them, pairs = experiments("servo"), list(combinations(range(COUNT), 2))
    assert answers(one.calibrator(), them, pairs) != answers(twin.calibrator(), them, pairs)
