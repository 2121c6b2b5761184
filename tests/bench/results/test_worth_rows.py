"""The table of worth."""

import json

import pytest

from prefcal_bench.results.campaign import Setting, campaign_of
from prefcal_bench.results.rows import checkpoints, worth_table
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
