"""What duels say."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_bench.cells.duels import PAPER
from prefcal_bench.results import duel_table
from prefcal_bench.results.rows import duel_rows
from prefcal_env.errors import SettingsError
from support.campaigns import duel


def tallies(duels):
    return list(duel_rows(duels).itertuples())


def test_outcomes_are_counted_from_both_sides():
    one, two = tallies([duel("A", "B", 0, -1), duel("A", "B", 1, 0), duel("B", "A", 2, 1)])
    assert (one.agent, one.rival, one.wins, one.ties, one.losses) == ("A", "B", 2, 1, 0)
    assert (two.agent, two.rival, two.wins, two.ties, two.losses) == ("B", "A", 0, 1, 2)


def test_the_paper_is_a_rival_and_no_agent():
    assert [(t.agent, t.rival) for t in tallies([duel("A", PAPER, 0, -1)])] == [("A", PAPER)]


def test_the_interval_is_the_exact_one():
    (t,) = tallies([duel("A", PAPER, seed, -1) for seed in range(10)])
    assert t.share == 1
    assert t.low == pytest.approx(0.025 ** (1 / 10))  # the closed form when all are won
    assert t.high == 1
    assert t.p == pytest.approx(2 / 2**10)


def test_ties_alone_decide_nothing():
    (t,) = tallies([duel("A", PAPER, seed, 0) for seed in range(4)])
    assert (t.share, t.p, t.ties) == (0, 1, 4)


def test_the_baseline_comes_first_and_the_paper_before_all_rivals():
    found = tallies([duel("Own", "GLISp", 0, 0), duel("Own", PAPER, 0, 0), duel("GLISp", PAPER, 0, 0)])
    pairs = [(t.agent, t.rival) for t in found]
    assert pairs == [("GLISp", PAPER), ("GLISp", "Own"), ("Own", PAPER), ("Own", "GLISp")]


@settings(max_examples=30)
@given(
    st.lists(
        st.tuples(st.sampled_from("AB"), st.sampled_from(["C", PAPER]), st.integers(0, 3)),
        unique=True,
        max_size=12,
    ),
    st.randoms(),
)
def test_neither_order_nor_repetition_changes_anything(keys, random):
    duels = [duel(a, r, seed, (seed % 3) - 1) for a, r, seed in keys]
    again = duels * 2
    random.shuffle(again)
    assert duel_table(duels) == duel_table(again)


def test_the_table_is_plain_data():
    (row,) = json.loads(json.dumps(duel_table([duel("A", PAPER, 0, 1)]), allow_nan=False))
    assert row["losses"] == 1
    assert row["rival"] == PAPER


@pytest.mark.parametrize(
    ("duels", "words"),
    [
        (lambda: [duel("A", "B", 0, 2)], "-1, 0 or 1"),
        (lambda: [duel("A", "A", 0, 1)], "a different rival"),
        (lambda: [duel(PAPER, "A", 0, 1)], "a different rival"),
        (lambda: [duel("A", "B", 0, 1), duel("A", "B", 0, -1)], "two different outcomes"),
        (lambda: [duel("A", "B", 0, 1), duel("B", "A", 0, 1)], "two different outcomes"),
    ],
)
def test_impossible_duels_are_refused(duels, words):
    with pytest.raises(SettingsError, match=words):
        duel_rows(duels())
