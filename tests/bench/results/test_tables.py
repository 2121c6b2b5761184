"""The tables of worth on the page."""

from prefcal_bench.results.campaign import campaign_of
from prefcal_bench.results.rows import worth_rows
from prefcal_bench.results.tables import worth_numbers
from support.worths import study, walks


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
