"""The table as data, of whole and of partial campaigns."""

import csv
import io
import json
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_support.campaigns import duel, ends, failed, grid, result
from bench_support.worths import study, walks
from prefcal_bench.cells.duels import PAPER
from prefcal_bench.results import as_csv, duel_table, table
from prefcal_bench.results.campaign import Setting, campaign_of
from prefcal_bench.results.missing import beaten, failures, in_holes, missing, not_run
from prefcal_bench.results.rows import checkpoints, duel_rows, gap_rows, worth_rows, worth_table
from prefcal_bench.results.statistics import FLOOR
from prefcal_bench.results.tables import overview, worth_numbers
from prefcal_env.errors import SettingsError

KINDS = st.sampled_from(["there", "missing", "failed"])


def by_agent(rows):
    return {row["agent"]: row for row in rows}


def test_a_row_by_hand():
    results = ends("GLISp", "p", [1e-3, 2e-3, 3e-3]) + ends("Own", "p", [1e-1, 2e-1, 3e-3])
    rows = by_agent(table(results))
    own = rows["Own"]
    assert (own["problem"], own["knobs"], own["calibrator"]) == ("p", 2, "perfect")
    assert (own["n_init"], own["n_max"], own["seeds"], own["failed"]) == (1, 2, 3, 0)
    assert own["gap_median"] == pytest.approx(0.1)
    assert (own["gap_lower_quartile"], own["gap_upper_quartile"]) == (
        pytest.approx(0.0515),
        pytest.approx(0.15),
    )
    assert own["log10_ratio"] == pytest.approx(2)
    assert (own["wins"], own["ties"], own["losses"]) == (0, 1, 2)
    assert own["floor"] == FLOOR
    assert own["questions_median"] == 1
    assert rows["GLISp"]["log10_ratio"] is None
    assert rows["GLISp"]["p_holm"] is None


def test_p_values_are_corrected_for_the_agents_on_one_problem():
    rows = by_agent(table(grid({"GLISp": 1.0, "A": 3.0, "B": 9.0}, problems=("p",), seeds=6)))
    assert rows["A"]["p"] == rows["B"]["p"] == pytest.approx(2 / 2**6)
    assert rows["A"]["p_holm"] == pytest.approx(2 * 2 / 2**6)


def test_no_row_depends_on_which_other_agents_there_are():
    results = grid({"GLISp": 1.0, "A": 3.0, "B": 9.0})
    alone = [r for r in results if r.cell.agent != "B"]
    kept = [row for row in table(results) if row["agent"] == "A"]
    few = [row for row in table(alone) if row["agent"] == "A"]
    for row, other in zip(kept, few, strict=True):
        assert {**row, "p_holm": None} == {**other, "p_holm": None}


@settings(max_examples=10)
@given(st.randoms())
def test_the_order_of_results_changes_nothing(random):
    results = [*grid({"GLISp": 1.0, "A": 3.0}), failed("A", "bowl", 9, n_max=3)]
    shuffled = results * 2
    random.shuffle(shuffled)
    assert table(results) == table(shuffled)


@settings(max_examples=25)
@given(st.lists(KINDS, min_size=12, max_size=12), st.lists(KINDS, min_size=4, max_size=4))
def test_any_part_of_a_campaign_has_a_table_and_says_what_is_missing(kinds, roads):
    cells = [(a, p, s) for a in ("GLISp", "B") for p in ("p", "q") for s in range(3)]
    cells += [(a, "road", s) for a in ("GLISp", "B") for s in range(2)]
    results = []
    for (a, p, s), kind in zip(cells, [*kinds, *roads], strict=True):
        if kind == "failed":
            results.append(failed(a, p, s))
        elif kind == "there":
            results.append(result(a, p, s, None if p == "road" else (1.0, 0.1 * (s + 1))))
    rows = table(results)
    json.dumps(rows, allow_nan=False)
    campaign = campaign_of(results)
    assert sum(row["seeds"] for row in rows) == [*kinds, *roads].count("there")
    assert sum(row["failed"] for row in rows) == len(failures(campaign))
    assert bool(missing(campaign) + not_run(campaign)) == _is_uneven(cells, [*kinds, *roads])


def _is_uneven(cells, kinds):
    """Whether an agent that was run at all lacks a seed that another one has there."""
    tried = {cell for cell, kind in zip(cells, kinds, strict=True) if kind != "missing"}
    agents = {agent for agent, _, _ in tried}
    return any((agent, p, s) not in tried for agent in agents for _, p, s in tried)


def test_what_is_missing_is_named():
    results = [*ends("A", "p", [1.0] * 4), *ends("B", "p", [1.0] * 2), *ends("A", "q", [1.0])]
    campaign = campaign_of(results)
    assert missing(campaign) == ["p, perfect calibrator: no seeds 2, 3 of B"]
    assert not_run(campaign) == ["q, perfect calibrator: not run with B"]


def test_an_agent_that_is_nowhere_with_a_calibrator_is_told_once():
    results = [*grid({"A": 1.0, "GLIS": 1.0}), *ends("A", "p", [0.1], calibrator="noisy")]
    results += ends("A", "q", [0.1], calibrator="noisy")
    words = not_run(campaign_of(results))
    assert words == ["noisy calibrator, 2 experiments (1 initial): not run with GLIS"]


def test_a_baseline_without_results_leaves_the_differences_out():
    rows = table(grid({"A": 1.0, "B": 3.0}), baseline="nobody")
    assert {row["log10_ratio"] for row in rows} == {None}
    assert all(row["gap_median"] is not None for row in rows)


def test_different_budgets_are_never_compared():
    rows = table([*ends("GLISp", "p", [0.1]), result("A", "p", 0, (1.0, 0.5, 0.1))])
    assert [row["log10_ratio"] for row in rows] == [None, None]
    assert [row["n_max"] for row in rows] == [2, 3]


def test_a_problem_without_a_cost_has_rows_without_gaps():
    (row,) = table([result("A", "road", 0, None)])
    assert row["seeds"] == 1
    assert row["gap_median"] is None
    assert row["questions_median"] == 1


def test_infinite_gaps_are_no_crash_and_null():
    inf = float("inf")
    results = ends("GLISp", "p", [0.1, 0.2]) + [
        result("A", "p", s, (inf, inf), visited=None) for s in range(2)
    ]
    row = by_agent(table(results))["A"]
    assert row["gap_median"] is None
    assert row["losses"] == 2
    json.dumps(row, allow_nan=False)


def test_what_was_visited_and_what_is_returned_are_two_things():
    (row,) = table([result("A", "p", 0, (1.0, 0.01, 0.3))])
    assert row["gap_median"] == 0.3
    assert row["visited_median"] == 0.01


def test_beating_the_best_known_value_is_told():
    assert beaten(campaign_of(ends("A", "p", [-0.02]))) == [
        "p, 2 knobs: 0.02 below the best known value, which is therefore not "
        "the optimum; such gaps count as the floor"
    ]
    assert beaten(campaign_of(ends("A", "p", [-1e-12]))) == []


def test_the_hole_of_the_reactor_s_index_is_counted_apart_from_what_nobody_knew():
    campaign = campaign_of(ends("GLIS", "cstr", [-0.27, 0.01, -0.2]) + ends("A", "cstr", [0.02] * 3))
    assert beaten(campaign) == []
    (words,) = in_holes(campaign)
    assert "cstr, perfect calibrator: found the hole of the cost" in words
    assert "GLIS in 2 of 3 seeds" in words
    assert " A in" not in words


def test_a_gap_below_the_bottom_of_the_hole_is_news_all_the_same():
    campaign = campaign_of(ends("A", "cstr", [-0.4]))
    assert in_holes(campaign) == []
    assert "0.4 below the best known value" in beaten(campaign)[0]


def test_where_no_hole_is_known_none_is_counted():
    assert in_holes(campaign_of(ends("A", "p", [-0.02]))) == []


def test_seconds_are_there_only_where_they_were_measured():
    results = [result("A", "p", s, seconds=0.25 if s else None) for s in range(2)]
    assert table(results)[0]["seconds_per_proposal"] == 0.25
    assert table([results[0]])[0]["seconds_per_proposal"] is None


def test_csv_reads_back():
    rows = table(grid({"GLISp": 1.0, "A": 3.0}))
    back = list(csv.DictReader(io.StringIO(as_csv(rows))))
    assert len(back) == len(rows)
    assert float(back[1]["log10_ratio"]) == rows[1]["log10_ratio"]
    assert back[0]["log10_ratio"] == ""
    assert as_csv([]) == ""
    assert table([]) == []


@pytest.mark.parametrize(
    ("results", "words"),
    [
        (lambda: [result(), result(gaps=(1.0, 0.2))], "two different results"),
        (lambda: [replace(result(), best=())], "must have numbers"),
        (lambda: [replace(result(), questions=())], "must have"),
        (lambda: [result(gaps=(1.0, float("nan")))], "numbers"),
        (lambda: [result(gaps=(1.0, -float("inf")))], "gaps must be numbers"),
        (lambda: [replace(result(), visited=(1.0,))], "visited"),
        (lambda: [result(seed=0), result(seed=1, gaps=None)], "other results of 'bowl' have gaps"),
    ],
)
def test_results_that_contradict_themselves_are_refused(results, words):
    with pytest.raises(SettingsError, match=words):
        table(results())


def test_worth_has_no_row_though_the_problem_has_gaps_with_other_calibrators():
    rows = table([result("GLISp", "cstr"), study("GLISp", "cstr"), study("GLISp", "servo")])
    assert [(row["problem"], row["calibrator"]) for row in rows] == [("cstr", "perfect")]


def last_row(results):
    campaign = campaign_of(results)
    table = overview(campaign, gap_rows(campaign), campaign.settings[0], "GLISp")
    return dict(zip(table.columns, (cell.text for cell in table.rows[-1]), strict=True))


def test_equal_medians_share_their_ranks_and_gaps_below_the_floor_are_equal():
    results = [*ends("A", "p", [0.0]), *ends("B", "p", [1e-12]), *ends("A", "q", [0.1])]
    found = last_row([*results, *ends("B", "q", [0.2])])
    assert (found["problem"], found["A"], found["B"]) == ("average rank", "1.25", "1.75")


def test_an_agent_that_lacks_a_problem_has_no_average_rank():
    found = last_row([*grid({"A": 1.0, "B": 2.0}), *ends("C", "bowl", [1e-6], n_max=3)])
    assert (found["A"], found["B"], found["C"]) == ("1.00", "2.00", "–")


# Worth.


def worths(results, baseline="GLISp"):
    return worth_table(campaign_of(results), baseline)


def row(rows, agent="GLISp", unit="experiments", after=2):
    (found,) = [r for r in rows if (r["agent"], r["unit"], r["after"]) == (agent, unit, after)]
    return found


def test_the_tables_look_after_two_fifths_and_all_of_the_experiments():
    assert checkpoints(Setting("weights", 10, 50)) == (20, 50)
    assert checkpoints(Setting("weights", 1, 2)) == (1, 2)


def test_a_row_is_made_of_all_loops_and_seeds():
    results = [study(loop="servo", seed=s, worth=(8, w)) for s, w in enumerate((1, 4))]
    results.append(study(loop="boost", worth=(2, 32)))
    found = row(worths(results))
    assert (found["loops"], found["studies"]) == (2, 3)
    assert found["worth"] == pytest.approx((2 * 32) ** 0.5)
    assert found["worth_low"] < found["worth"] < found["worth_high"]
    assert found["drift"] == pytest.approx((8 * 2 * 1) ** (1 / 3))
    assert found["answers"] == 1
    assert found["improvement"] is None


def test_after_answers_an_agent_that_asks_more_has_run_less():
    held = (2, 4, 8, 16)
    results = [study("GLISp", worth=held), study("Own", worth=held, questions=(0, 3, 6, 9))]
    rows = worths(results)
    assert row(rows, "Own", "experiments", 4)["worth"] == pytest.approx(16)
    assert row(rows, "Own", "answers", 3)["worth"] == pytest.approx(4)
    assert row(rows, "GLISp", "answers", 3)["worth"] == pytest.approx(16)
    assert row(rows, "Own", "answers", 3)["answers"] == 3


def test_an_agent_that_is_told_values_has_no_row_after_answers():
    rows = worths([study("GLIS", questions=(0, 0))])
    assert {r["unit"] for r in rows} == {"experiments"}


def test_only_loops_that_both_have_are_compared():
    results = [study("GLISp", worth=(1, 4)), study("Own", worth=(1, 5))]
    results.append(study("Own", "boost", worth=(1, 2)))
    assert row(worths(results), "Own")["improvement"] == 1
    apart = [study("GLISp"), study("Own", "boost")]
    assert row(worths(apart), "Own")["improvement"] is None


def test_rows_do_not_depend_on_which_others_there_are():
    results = walks({"GLISp": 1.3, "GLIS": 1.6, "RandomSearch": 1.0}, n_max=5)
    alone = [r for r in results if r.cell.agent == "GLISp"]
    assert row(worths(results), after=5) == row(worths(alone), after=5)
    assert row(worths(results[::-1]), "GLIS", after=5) == row(worths(results), "GLIS", after=5)


def test_the_table_is_strict_json():
    json.dumps(worths([study()]), allow_nan=False)
    assert worths([]) == []


def tables(results):
    campaign = campaign_of(results)
    rows = worth_rows(campaign)
    return [worth_numbers(campaign, rows, setting, "GLISp") for setting in campaign.settings]


def cells(table, agent):
    (row,) = [row for row in table.rows if row[0].text == agent]
    return dict(zip(table.columns, row, strict=True))


def test_each_taste_has_a_table_with_the_highest_worth_on_top():
    results = [
        study(a, seed=s, worth=(2, 2, 2, w), taste=t)
        for a, w in (("GLISp", 8), ("Own", 90))
        for s in range(2)
        for t in ("weights", "limits")
    ]
    found = tables(results)
    assert [t.label for t in found] == ["Worth: weights", "Worth: limits"]
    assert [row[0].text for row in found[0].rows] == ["Own", "GLISp"]
    own, glisp = cells(found[0], "Own"), cells(found[0], "GLISp")
    assert own["worth [95 %] (4)"].text == "90 [90, 90]"
    assert own["worth [95 %] (4)"].kind == "best"
    assert glisp["worth [95 %] (4)"].kind == ""
    assert own["worth [95 %] (2)"].text == "2.0 [2.0, 2.0]"
    assert own["beats GLISp [95 %] (4)"].text == "100 % [100, 100]"
    assert glisp["beats GLISp [95 %] (4)"].text == "–"
    assert (own["answers (4)"].text, own["studies"].text) == ("3", "2")
    assert own["worth after 3 answers [95 %]"].text == "90 [90, 90]"


def test_agents_that_are_told_values_are_not_tinted_if_others_ask():
    (table,) = tables([study(worth=(1, 4)), study("GLIS", worth=(1, 9), questions=(0, 0))])
    assert cells(table, "GLIS")["worth [95 %] (2)"].kind == ""
    assert cells(table, "GLISp")["worth [95 %] (2)"].kind == "best"
    assert cells(table, "GLIS")["worth after 1 answers [95 %]"].text == "–"
    (table,) = tables([study("GLIS", worth=(1, 9), questions=(0, 0))])
    assert cells(table, "GLIS")["worth [95 %] (2)"].kind == "best"


def test_a_full_budget_is_looked_at_after_20_and_50():
    (table,) = tables(walks({"GLISp": 1.2, "Own": 1.1}, seeds=2))
    assert "worth [95 %] (20)" in table.columns
    assert "drift (50)" in table.columns
    assert "worth after 49 answers [95 %]" in table.columns


def test_an_agent_that_is_told_values_is_not_tinted_if_its_worth_equals_the_best():
    (table,) = tables([study(worth=(1, 9)), study("GLIS", worth=(1, 9), questions=(0, 0))])
    assert cells(table, "GLIS")["worth [95 %] (2)"].kind == ""
    assert cells(table, "GLISp")["worth [95 %] (2)"].kind == "best"


def test_an_agent_that_lacks_a_loop_is_marked():
    (table,) = tables([study(), study(loop="tank"), study("Own")])
    assert cells(table, "GLISp")["studies"].text == "2"
    assert cells(table, "Own")["studies"].text == "1 (on 1 of 2)"


# Duels.


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
