"""The table of worth, as data and on the page."""

import json

import pytest

from prefcal_bench.results.campaign import Setting, campaign_of
from prefcal_bench.results.rows import checkpoints, worth_rows, worth_table
from prefcal_bench.results.tables import worth_numbers
from support.worths import study, walks


def table(results, baseline="GLISp"):
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
    found = row(table(results))
    assert (found["loops"], found["studies"]) == (2, 3)
    assert found["worth"] == pytest.approx((2 * 32) ** 0.5)
    assert found["worth_low"] < found["worth"] < found["worth_high"]
    assert found["drift"] == pytest.approx((8 * 2 * 1) ** (1 / 3))
    assert found["answers"] == 1
    assert found["improvement"] is None


def test_after_answers_an_agent_that_asks_more_has_run_less():
    held = (2, 4, 8, 16)
    results = [study("GLISp", worth=held), study("Own", worth=held, questions=(0, 3, 6, 9))]
    rows = table(results)
    assert row(rows, "Own", "experiments", 4)["worth"] == pytest.approx(16)
    assert row(rows, "Own", "answers", 3)["worth"] == pytest.approx(4)
    assert row(rows, "GLISp", "answers", 3)["worth"] == pytest.approx(16)
    assert row(rows, "Own", "answers", 3)["answers"] == 3


def test_an_agent_that_is_told_values_has_no_row_after_answers():
    rows = table([study("GLIS", questions=(0, 0))])
    assert {r["unit"] for r in rows} == {"experiments"}


def test_only_loops_that_both_have_are_compared():
    results = [study("GLISp", worth=(1, 4)), study("Own", worth=(1, 5))]
    results.append(study("Own", "boost", worth=(1, 2)))
    assert row(table(results), "Own")["improvement"] == 1
    apart = [study("GLISp"), study("Own", "boost")]
    assert row(table(apart), "Own")["improvement"] is None


def test_rows_do_not_depend_on_which_others_there_are():
    results = walks({"GLISp": 1.3, "GLIS": 1.6, "RandomSearch": 1.0}, n_max=5)
    alone = [r for r in results if r.cell.agent == "GLISp"]
    assert row(table(results), after=5) == row(table(alone), after=5)
    assert row(table(results[::-1]), "GLIS", after=5) == row(table(results), "GLIS", after=5)


def test_the_table_is_strict_json():
    json.dumps(table([study()]), allow_nan=False)
    assert table([]) == []


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
