"""Learn what a person wants from answers."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import people
from prefcal_agents.people import DRAWS, Lessons, Posterior, Scale, Utilities
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import History
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
    return Utilities.draw(SCALE, DRAWS, np.random.default_rng(seed))


def learned(*records, seed=0):
    """Draws after each of the records, one after the other."""
    rng, given = np.random.default_rng(seed + 100), Posterior.of(prior(seed), lessons(History()))
    for record in records:
        given = given.update(lessons(record), SCALE, rng)
    return given.utilities


def update(before, old, new, scale, rng):
    """Draws given new answers, from those given old ones."""
    return Posterior.of(before, old).update(new, scale, rng).utilities


def lessons(record, bank=BANK):
    return Lessons.of(bank, SCALE, record)


def agreement(utilities, pairs, wanted=WANTED):
    """How often a draw orders a pair as the person does."""
    costs = utilities.costs(SCALE(BANK))
    signs = [
        np.sign(costs[:, b] - costs[:, a]) == s for (a, b), s in zip(pairs, sure(pairs, wanted), strict=True)
    ]
    return float(np.mean(signs))


def first(utilities):
    """How often each KPI comes first: in the order, or by its weight."""
    return np.bincount(np.argmax(utilities.normals, axis=1), minlength=3) / len(utilities)


def noticing(utilities, pairs):
    """How often the experiments of a pair differ noticeably."""
    costs = utilities.costs(SCALE(BANK))
    return float(np.mean([np.abs(costs[:, b] - costs[:, a]) > 1 for a, b in pairs]))


def test_draws_order_what_was_shown_as_answered_and_more_besides():
    pairs, unseen = pairs_of(12), pairs_of(40, start=24)
    after = learned(of_pairs(BANK, pairs, sure(pairs)))
    assert agreement(prior(), pairs) < 0.75
    assert agreement(after, pairs) > 0.93
    assert agreement(after, unseen) > 0.85 > agreement(prior(), unseen)
    assert first(after)[0] > 0.6
    assert first(prior()) == pytest.approx(np.full(3, 1 / 3), abs=0.05)


def test_ties_teach_what_cannot_be_told_apart():
    pairs = [(a, b) for a, b in pairs_of(60) if 1 < abs(WANTED[a] - WANTED[b]) < 4][:8]
    alike, apart = (learned(of_pairs(BANK, pairs, [0] * 8)), learned(of_pairs(BANK, pairs, sure(pairs))))
    assert noticing(alike, pairs) < 0.2 < 0.8 < noticing(apart, pairs)
    unseen = pairs_of(30, seed=1)
    assert noticing(alike, unseen) < noticing(prior(), unseen) - 0.1


def test_someone_with_an_order_is_taken_for_one():
    """The second KPI decides unless it is alike; then the first one does."""
    rng, kpis = np.random.default_rng(3), BANK.kpis
    pairs = rng.integers(0, len(BANK), (60, 2)).tolist()
    steps = (kpis[:, 1] / 0.25, kpis[:, 0] / 0.1)
    answers = []
    for incumbent, challenger in pairs:
        gaps = [np.trunc(step[challenger] - step[incumbent]) for step in steps]
        answers.append(int(np.sign(next((gap for gap in gaps if gap), 0))))
    some = [k for k, (a, b) in enumerate(pairs) if a != b][:40]
    record = of_pairs(BANK, [pairs[k] for k in some], [answers[k] for k in some])
    after = learned(record)
    assert np.mean(after.ordered > 0) > 0.9 > 0.6 > np.mean(prior().ordered > 0)
    assert first(after)[1] > 0.9


def test_stated_limits_come_first_unless_answers_say_otherwise():
    scale = Scale.of(BANK, np.arange(len(BANK)), {"a": 0.3})
    below, above = np.flatnonzero(BANK.kpis[:, 0] <= 0.25), np.flatnonzero(BANK.kpis[:, 0] > 0.4)
    pairs = [(int(a), int(b)) for a, b in zip(below, above, strict=False)]
    before = Utilities.draw(scale, DRAWS, np.random.default_rng(0))
    rng, none = np.random.default_rng(1), Lessons.of(BANK, scale, History())

    def respected(utilities):
        costs = utilities.costs(scale(BANK))
        return np.mean([costs[:, a] < costs[:, b] for a, b in pairs])

    ignored = Lessons.of(BANK, scale, of_pairs(BANK, pairs[:10], [-1] * 10))
    assert respected(before) > 0.95
    assert respected(update(before, none, ignored, scale, rng)) < 0.5


def weighed(strength, times):
    """Draws after an answer of this strength that is given so many times."""
    pair = pairs_of(1)
    one = lessons(of_pairs(BANK, pair, [Answer(sure(pair)[0], strength=strength)]))
    rows = np.zeros(times, dtype=np.int64)
    given = Lessons(one.logs, one.better[rows], one.worse[rows], one.tie[rows], one.strength[rows])
    return update(prior(), lessons(History()), given, SCALE, np.random.default_rng(1)).normals


def test_an_answer_of_strength_3_counts_as_three_and_two_of_strength_half_as_one():
    assert np.array_equal(weighed(3, 1), weighed(1, 3))
    assert np.array_equal(weighed(0.5, 2), weighed(1, 1))
    assert not np.array_equal(weighed(3, 1), weighed(1, 1))


def test_the_preferred_experiment_of_each_answer_is_the_better_one():
    record = of_pairs(BANK, [(3, 5), (7, 9), (11, 13), (2, 4)], [-1, 1, 0, None])
    found = lessons(record)
    assert len(found) == 3  # can't tell teaches nothing
    assert found.better[:2].tolist() == [1, 2]  # the challenger, then the incumbent
    assert found.worse[:2].tolist() == [0, 3]
    assert found.tie.tolist() == [False, False, True]
    assert np.array_equal(found.logs, SCALE(BANK)[[3, 5, 7, 9, 11, 13, 2, 4]])


def test_an_unsafe_experiment_comes_last_even_if_it_was_preferred():
    odd = [[0.1, 0.1, 1.0], [0.5, 0.5, 0.2], [0.6, 0.4, 0.3], [0.3, 0.6, 0.2]]  # a trade-off
    bank = bank_of([*odd, *BANK.kpis[:60]])
    rng, scale = np.random.default_rng(0), Scale.of(bank, np.arange(len(bank)))
    safe = of_pairs(bank, [(1, 0), (2, 3)], [-1, 0])
    unsafe = of_pairs(bank, [(1, 0), (2, 3)], [Answer(-1, marks=(Mark.CHALLENGER_UNSAFE,)), 0])
    found = lessons(unsafe, bank)
    # In the order shown: 1, 0, 2, 3. The preference, a tie, and three that the mark adds.
    assert list(zip(found.better, found.worse, strict=True))[2:] == [(0, 1), (2, 1), (3, 1)]
    before, last = Utilities.draw(scale, DRAWS, rng), []
    for record in (safe, History(), unsafe):
        old, new = lessons(History(), bank), lessons(record, bank)
        costs = update(before, old, new, scale, rng).costs(scale(bank))
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
    assert mistaken > 1.9 * expected


def test_without_lessons_the_distribution_stays():
    before, after = prior(), learned(History())
    quantiles = [0.1, 0.5, 0.9]
    for name in ("exponents", "normals", "spreads", "noticed"):
        was, now = (np.quantile(getattr(u, name), quantiles, axis=0) for u in (before, after))
        assert now == pytest.approx(was, abs=0.2, rel=0.07)
    assert not np.array_equal(before.normals, after.normals)  # or it was not tried
    assert after.errors.mean() == pytest.approx(before.errors.mean(), abs=0.02)


def test_a_mistake_is_each_of_the_three_answers_alike():
    clear = bank_of([[1e-3, 1e-3, 1e-3], [1e3, 1e3, 1e3], *BANK.kpis[:40]])
    utilities = replace(prior(), errors=np.full(DRAWS, 0.1))
    for answer, chance in ((1, 0.9 + 0.1 / 3), (0, 0.1 / 3), (-1, 0.1 / 3)):
        found = Posterior.of(utilities, lessons(of_pairs(clear, [(0, 1)], [answer]), clear)).logs
        assert np.exp(np.median(found)) == pytest.approx(chance, rel=1e-3)


def test_equal_experiments_are_called_alike_but_for_mistakes():
    same = bank_of([[0.3, 0.3, 0.3], [0.3, 0.3, 0.3], *BANK.kpis[:40]])
    utilities = replace(prior(), errors=np.full(DRAWS, 0.12))
    for answer, chance in ((0, 0.92), (-1, 0.04), (1, 0.04)):
        record = of_pairs(same, [(0, 1), (3, 4)], [answer, None])
        found = Posterior.of(utilities, lessons(record, same)).logs
        assert np.exp(found) == pytest.approx(chance, rel=0.05)


@pytest.mark.parametrize("undone", [(), (3,), (9, 3)], ids=["more", "one retracted", "two retracted"])
def test_what_is_carried_on_says_of_each_answer_what_is_worked_out_anew(undone):
    pairs = pairs_of(8)
    record = of_pairs(BANK, pairs, [*sure(pairs)[:6], 0, 0])
    rng, given = np.random.default_rng(5), Posterior.of(prior(), lessons(History()))
    given = given.update(lessons(of_pairs(BANK, pairs[:5], sure(pairs)[:5])), SCALE, rng)
    for number in undone:
        record = record.retracted(number)
    again, after = Posterior.of(given.utilities, given.lessons), given.update(lessons(record), SCALE, rng)
    anew = Posterior.of(after.utilities, lessons(record))
    for carried, worked_out in ((given, again), (after, anew)):
        assert np.array_equal(carried.logs, worked_out.logs)
        assert carried.logs.shape == (DRAWS, len(carried.lessons))
    assert len(after.lessons) == 8 - len(undone)


def test_an_update_works_out_old_answers_of_the_draws_it_moves_and_new_ones_of_those_before(monkeypatch):
    pairs, counted = pairs_of(8), []
    given = Posterior.of(prior(), lessons(of_pairs(BANK, pairs[:6], sure(pairs)[:6])))
    of = Lessons.differences
    monkeypatch.setattr(Lessons, "differences", lambda t, u: (counted.append(len(t) * len(u)), of(t, u))[1])
    given.update(lessons(of_pairs(BANK, pairs, sure(pairs))), SCALE, np.random.default_rng(5))
    assert sum(counted) == (2 + 8) * DRAWS


def test_answers_are_shared_up_to_the_first_that_is_another_one():
    pairs = pairs_of(6)
    record = of_pairs(BANK, pairs, sure(pairs))
    every = lessons(record)
    assert every.shared(every) == every.shared(every.take(np.arange(6))) == 6
    assert every.shared(every.first(4)) == every.first(4).shared(every) == 4
    assert every.shared(lessons(record.retracted(5))) == 2
    assert every.shared(lessons(of_pairs(BANK, pairs, [*sure(pairs)[:3], 0, *sure(pairs)[4:]]))) == 3


def test_what_few_answers_refuse_all_answers_refuse(monkeypatch):
    pairs = np.random.default_rng(3).integers(0, len(BANK), (150, 2))
    signs, ties = np.array(sure(pairs)), np.arange(len(pairs)) % 7 == 0
    signs[::10] *= -1  # mistakes, which no draw explains
    better, worse = np.where(signs > 0, pairs.T, pairs.T[::-1])
    all_of_them = Lessons(SCALE(BANK), better, worse, ties, np.ones(len(pairs)))
    found = [update(prior(), all_of_them.first(0), all_of_them, SCALE, np.random.default_rng(1))]
    monkeypatch.setattr(people, "_TELLING", len(pairs))  # so that no answer comes before the others
    found += [update(prior(), all_of_them.first(0), all_of_them, SCALE, np.random.default_rng(1))]
    assert found[0].to_bytes() == found[1].to_bytes()
    assert found[0].to_bytes() != prior().to_bytes()
