"""Who is the best, by the whole record."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Verdict, best_of, contradictory, find_undominated, reigns


def record(*answers, follow_up=False):
    """Verdicts of (challenger, incumbent, -1 or 0 or 1)."""
    return [Verdict(a, b, Preference(p), follow_up) for a, b, p in answers]


def dominators(verdicts, index):
    """Who is better than `index` by a chain, as a walk through the answers finds it."""
    better = {(v.winner, v.loser) for v in verdicts if v.winner is not None}
    ties = {(v.challenger, v.incumbent) for v in verdicts if v.winner is None}
    steps = better | ties | {(b, a) for a, b in ties}
    return reached(index, {(b, a) for a, b in steps}) - reached(index, steps)


def reached(start, steps):
    """Everything that a chain of `steps` leads to."""
    found, fringe = {start}, [start]
    while fringe:
        here = fringe.pop()
        new = {b for a, b in steps if a == here} - found
        found |= new
        fringe += new
    return found


def test_before_any_answer_the_first_experiment_is_the_best():
    assert best_of([]) == 0
    assert find_undominated([]) == ()


def test_each_new_best_has_beaten_the_one_before():
    verdicts = record((1, 0, -1), (2, 1, 1), (3, 1, -1))
    assert best_of(verdicts) == 3
    assert reigns(verdicts) == (0, 1, 3)


def test_winning_against_another_rival_crowns_nobody():
    """The README's second command once called experiment 2 the best this way."""
    verdicts = record((1, 0, -1), (2, 1, -1)) + record((3, 0, -1), follow_up=True)
    assert best_of(verdicts) == 2
    assert find_undominated(verdicts) == (frozenset({2}), frozenset({3}))


def test_a_tie_keeps_the_one_that_was_there():
    assert best_of(record((1, 0, 0), (2, 0, 0))) == 0
    assert find_undominated(record((1, 0, 0))) == (frozenset({0, 1}),)


def test_in_a_circle_the_latest_winner_is_the_best():
    circle = record((1, 0, -1), (2, 1, -1)) + record((2, 0, 1), follow_up=True)
    assert contradictory(circle)
    assert best_of(circle) == 0
    assert best_of([*circle, *record((3, 0, -1))]) == 3


def test_ties_alone_contradict_nothing():
    assert not contradictory([])
    assert not contradictory(record((1, 0, 0), (2, 1, 0), (2, 0, 0)))
    assert contradictory(record((1, 0, 0), (2, 1, 0), (2, 0, -1)))


def test_the_best_is_safe_wherever_anything_safe_was_compared():
    verdicts = record((1, 0, -1), (2, 1, -1))
    assert best_of(verdicts, frozenset({2})) == 1
    assert best_of(verdicts, frozenset({1, 2})) == 2  # nothing safe was compared with 0
    assert best_of(verdicts, frozenset({0, 1, 2})) == 2


def test_after_a_retraction_the_last_winner_along_the_remaining_answers_is_the_best():
    verdicts = record((2, 1, -1), (3, 2, -1))  # "1 beats 0" was taken back
    assert best_of(verdicts) == 3
    assert best_of([*verdicts, *record((3, 0, 1), follow_up=True)]) == 0


answers = st.lists(
    st.tuples(st.integers(0, 7), st.integers(0, 7), st.sampled_from([-1, 0, 1])).filter(
        lambda t: t[0] != t[1]
    ),
    max_size=20,
)


@given(answers)
def test_nobody_standing_has_beaten_the_best(raw):
    verdicts = record(*raw)
    assert not dominators(verdicts, best_of(verdicts))


@given(answers)
def test_the_groups_are_those_that_nobody_outside_beats(raw):
    verdicts = record(*raw)
    compared = {i for a, b, _ in raw for i in (a, b)}
    found = {index for group in find_undominated(verdicts) for index in group}
    assert found == {i for i in compared if not dominators(verdicts, i)}


@given(st.lists(st.integers(0, 5), min_size=1, max_size=30), st.randoms(use_true_random=False))
def test_with_sure_answers_the_best_is_the_best_of_all_that_were_shown(costs, random):
    """Whatever further questions are asked between any two."""
    verdicts = []
    for new in range(1, len(costs)):
        pairs = [(new, best_of(verdicts))]
        pairs += [tuple(random.sample(range(new + 1), 2)) for _ in range(random.randrange(3))]
        for k, (a, b) in enumerate(pairs):
            verdicts += record((a, b, int(np.sign(costs[a] - costs[b]))), follow_up=k > 0)
    assert costs[best_of(verdicts)] == min(costs)
    assert not contradictory(verdicts)


def test_a_long_chain_of_reigns_is_followed_to_its_end():
    assert best_of(record(*((k, k - 1, -1) for k in range(1, 401)))) == 400
