"""Learn what a person wants from answers."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents.utility.posterior import DRAWS, NOTICED, Lessons, noticeable, typical, updated
from prefcal_agents.utility.utilities import Scale, Utilities
from prefcal_env.preferences.answer import Answer, Mark, Strength
from prefcal_env.preferences.history import History
from support.histories import in_cube
from support.simulated import bank_of, of_pairs, random_bank

BANK = random_bank()
SCALE = Scale.of(BANK, np.arange(len(BANK)))
WANTED = np.log(BANK.kpis) @ [10.0, 1.0, 0.1]
"""Cost of a person who cares most about the first KPI and least about the last one."""


def pairs_of(count, seed=0, start=0):
    rows = np.random.default_rng(seed).permutation(len(BANK))[start : start + 2 * count]
    return rows.reshape(-1, 2).tolist()


def sure(pairs, wanted=WANTED):
    """The answers of someone who makes no mistake."""
    return [int(np.sign(wanted[challenger] - wanted[incumbent])) for incumbent, challenger in pairs]


def prior(seed=0):
    return Utilities.drawn(SCALE, DRAWS, np.random.default_rng(seed))


def learned(*records, seed=0):
    """Draws after each of the records, one after the other."""
    rng, utilities, old = np.random.default_rng(seed + 100), prior(seed), lessons(History())
    for record in records:
        new = lessons(record)
        utilities, old = updated(utilities, old, new, SCALE, rng), new
    return utilities


def lessons(record, bank=BANK):
    return Lessons.of(bank, SCALE, record)


def agreement(utilities, pairs, wanted=WANTED):
    """How often a draw orders a pair as the person does."""
    costs = utilities.costs(SCALE(BANK))
    signs = [np.sign(costs[:, b] - costs[:, a]) == s
             for (a, b), s in zip(pairs, sure(pairs, wanted), strict=True)]  # fmt: skip
    return float(np.mean(signs))


def test_draws_order_what_was_shown_as_answered_and_more_besides():
    pairs, unseen = pairs_of(12), pairs_of(40, start=24)
    after = learned(of_pairs(BANK, pairs, sure(pairs)))
    assert agreement(prior(), pairs) < 0.75
    assert agreement(after, pairs) > 0.93
    assert agreement(after, unseen) > 0.85 > agreement(prior(), unseen)
    weights = after.weights.mean(axis=0)
    assert weights[0] > 0.6
    assert prior().weights.mean(axis=0) == pytest.approx(np.full(3, 1 / 3), abs=0.04)


def test_an_answer_at_a_time_teaches_what_all_at_once_teach():
    pairs = pairs_of(8)
    records = [of_pairs(BANK, pairs[:k], sure(pairs[:k])) for k in range(1, 9)]
    step, once = learned(*records).weights, learned(records[-1]).weights
    assert step.mean(axis=0) == pytest.approx(once.mean(axis=0), abs=0.08)


def test_answers_that_no_trade_off_explains_are_taken_for_mistakes():
    pairs = pairs_of(12)
    against = learned(of_pairs(BANK, pairs, [-a for a in sure(pairs)]))
    assert agreement(against, pairs) < agreement(prior(), pairs) - 0.1
    assert against.errors.mean() > 0.15


def test_a_tie_pulls_costs_together():
    pairs = [(a, b) for a, b in pairs_of(60) if abs(WANTED[a] - WANTED[b]) > 8][:4]
    after = learned(of_pairs(BANK, pairs, [0] * 4))

    def apart(utilities):
        costs = utilities.costs(SCALE(BANK))
        steps = np.abs(np.diff(costs[:, np.array(pairs)], axis=2)[:, :, 0])
        return np.median(steps / noticeable(costs)[:, None])

    assert apart(after) < 0.5 * apart(prior())


@pytest.mark.parametrize("strength", [Strength.MUCH_BETTER, 0.5])
def test_the_strength_is_the_weight_of_an_answer(strength):
    pair = pairs_of(1)
    answer = Answer(sure(pair)[0], strength=strength)
    plain, weighed = (lessons(of_pairs(BANK, pair, given)) for given in (sure(pair), [answer]))
    one = plain.log_likelihood(prior())
    assert weighed.log_likelihood(prior()) == pytest.approx(float(strength) * one)
    assert one.std() > 0.1


def test_of_two_answers_that_contradict_each_other_the_stronger_one_counts():
    (a, b), = pairs_of(1)  # fmt: skip
    strong, weak = Answer(1, strength=Strength.MUCH_BETTER), Answer(-1)
    chain = of_pairs(BANK, [(a, b)], [strong])
    both = chain.with_follow_up(weak, 1, 0)
    costs = learned(both).costs(SCALE(BANK))
    before = prior().costs(SCALE(BANK))
    assert np.mean(costs[:, a] < costs[:, b]) > np.mean(before[:, a] < before[:, b]) + 0.1


def test_the_preferred_experiment_of_each_answer_is_the_better_one():
    record = of_pairs(BANK, [(3, 5), (7, 9), (11, 13), (2, 4)], [-1, 1, 0, None])
    found = lessons(record)
    assert len(found) == 3  # can't tell teaches nothing
    assert found.better[:2].tolist() == [1, 2]  # the challenger, then the incumbent
    assert found.worse[:2].tolist() == [0, 3]
    assert found.tie.tolist() == [False, False, True]
    assert found.shown == 8
    assert np.array_equal(found.logs[:8], SCALE(BANK)[[3, 5, 7, 9, 11, 13, 2, 4]])


def test_a_retracted_answer_teaches_nothing():
    record = of_pairs(BANK, [(3, 5), (7, 9)], [-1, 1])
    assert len(lessons(record.retracted(1))) == 1
    assert len(lessons(record.retracted(1).retracted(3))) == 0


def test_an_unsafe_experiment_comes_last_even_if_it_was_preferred():
    odd = [[0.1, 0.1, 1.0], [0.5, 0.5, 0.2], [0.6, 0.4, 0.3], [0.3, 0.6, 0.2]]  # a trade-off
    bank = bank_of([*odd, *BANK.kpis[:60]])
    rng, scale = np.random.default_rng(0), Scale.of(bank, np.arange(len(bank)))
    safe = of_pairs(bank, [(1, 0), (2, 3)], [-1, 0])
    unsafe = of_pairs(bank, [(1, 0), (2, 3)], [Answer(-1, marks=(Mark.CHALLENGER_UNSAFE,)), 0])
    found = lessons(unsafe, bank)
    # In the order shown: 1, 0, 2, 3. The preference, a tie, and three that the mark adds.
    assert list(zip(found.better, found.worse, strict=True))[2:] == [(0, 1), (2, 1), (3, 1)]
    before, last = Utilities.drawn(scale, DRAWS, rng), []
    for record in (safe, History(), unsafe):
        old, new = lessons(History(), bank), lessons(record, bank)
        costs = updated(before, old, new, scale, rng).costs(scale(bank))
        last.append(np.mean(np.argmax(costs[:, :4], axis=1) == 0))
    assert last[0] < last[1] - 0.1
    assert last[2] > 0.7 > last[1]


def test_wrong_answers_raise_the_error_rate_of_the_draws():
    pairs = pairs_of(24)
    answers = sure(pairs)
    wrong = [-a if k % 10 in (0, 3, 7) else a for k, a in enumerate(answers)]  # 30 %
    surely, mistaken = (learned(of_pairs(BANK, pairs, a)).errors.mean() for a in (answers, wrong))
    expected = prior().errors.mean()
    assert surely < expected
    assert mistaken > 2 * expected


def test_mistakes_do_not_hide_what_is_wanted():
    pairs = pairs_of(24)
    wrong = [-a if k % 10 == 3 else a for k, a in enumerate(sure(pairs))]
    assert agreement(learned(of_pairs(BANK, pairs, wrong)), pairs_of(30, start=48)) > 0.8


def test_without_lessons_the_distribution_stays():
    before, after = prior(), learned(History())
    quantiles = [0.1, 0.5, 0.9]
    for name in ("scales", "exponents", "normals", "weights"):
        was, now = (np.quantile(getattr(u, name), quantiles, axis=0) for u in (before, after))
        assert now == pytest.approx(was, abs=0.2)
    assert not np.array_equal(before.normals, after.normals)  # or it was not tried
    assert after.errors.mean() == pytest.approx(before.errors.mean(), abs=0.01)


def test_the_same_seed_gives_the_same_draws():
    record = of_pairs(BANK, pairs_of(3), sure(pairs_of(3)))
    one, same, other = (learned(record, seed=seed).normals for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_the_probability_of_a_clear_win_is_that_of_no_mistake():
    clear = bank_of([[1e-3, 1e-3, 1e-3], [1e3, 1e3, 1e3], *BANK.kpis[:40]])
    utilities = replace(prior(), errors=np.full(DRAWS, 0.1))
    for answer, chance in ((1, 0.9), (-1, 0.1)):
        found = lessons(of_pairs(clear, [(0, 1)], [answer]), clear).log_probabilities(utilities)
        assert np.exp(np.median(found)) == pytest.approx(chance, rel=1e-3)


def test_equal_experiments_win_by_chance_and_are_called_alike():
    same = bank_of([[0.3, 0.3, 0.3], [0.3, 0.3, 0.3], *BANK.kpis[:40]])
    found = lessons(of_pairs(same, [(0, 1), (3, 4)], [-1, None]), same)
    assert np.exp(found.log_probabilities(prior())) == pytest.approx(0.5)
    tie = lessons(of_pairs(same, [(0, 1)], [0]), same)
    assert np.exp(tie.log_probabilities(prior())) == pytest.approx(1.0)


def test_the_noticed_difference_is_a_share_of_the_spread_of_typical_experiments():
    costs = np.array([[0.0, 1.0, 0.0, 1.0], [0.2, 0.2, 0.2, 0.2]])
    assert noticeable(costs) == pytest.approx([NOTICED * 0.5, 0.0], abs=1e-8)
    assert np.all(noticeable(costs) > 0)
    assert noticeable(np.zeros((2, 0))).tolist() == [NOTICED, NOTICED]


def test_typical_experiments_are_the_first_ones_that_were_not_interrupted():
    logs = np.zeros((50, 2))
    logs[[0, 4], 1] = np.inf
    assert typical(logs).tolist() == [k for k in range(34) if k not in (0, 4)]
    assert len(typical(np.full((3, 1), np.inf))) == 0


def test_an_experiment_that_nobody_looked_at_is_not_called_better_than_an_unsafe_one():
    unsafe = of_pairs(BANK, [(1, 0), (2, 3)], [Answer(-1, marks=(Mark.CHALLENGER_UNSAFE,)), 0])
    pending = unsafe.with_pending(in_cube(BANK.thetas[5])).with_answer(Answer(None), None)
    assert pending.answered == unsafe.answered + 1
    assert len(lessons(pending)) == len(lessons(unsafe))
