from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.view import Seen, question_view
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.wording import comparable
from support.looks import asked, toy

SCENARIO = replace(
    toy,
    kpis=(
        KPI("time", "time", "h", at_most=20.0),
        KPI("peak", "peak", "m", better="lower"),
        KPI("count", "count"),
    ),
)


def rows(left, right, seen=None, scenario=SCENARIO):
    """The comparison of two runs with these KPIs."""
    _, now = asked()
    question = now.question
    both = [
        replace(side, experiment=replace(side.experiment, kpis=kpis))
        for side, kpis in ((question.left, left), (question.right, right))
    ]
    asked_now = replace(question, left=both[0], right=both[1])
    return question_view(asked_now, scenario, blind=False, seen=seen)["comparison"]


def seen_of(*kpis):
    """As if these experiments had been finished."""
    seen = Seen()
    seen._kpis.update(dict(enumerate(kpis)))
    return seen


def test_what_differs_most_beside_the_spread_of_all_experiments_comes_first():
    # time spreads over hours and differs by one; peak hardly ever differs, and does here.
    spread = ({"time": float(t), "peak": 1.0 + t / 1e3} for t in range(0, 40, 4))
    seen = seen_of(*(kpis | {"count": 0.0} for kpis in spread))
    left = {"time": 10.0, "peak": 1.0, "count": 0.0}
    found = rows(left, {"time": 11.0, "peak": 1.1, "count": 0.0}, seen)
    assert [row["title"] for row in found] == ["peak", "time", "count"]
    assert found[0]["size"] == 1.0
    assert found[1]["size"] == pytest.approx(1 / 18, abs=0.001)  # the middle half spans 18 h
    assert found[2] | {"objective": ""} == {
        "group": "",
        "title": "count",
        "about": "",
        "unit": "",
        "objective": "",
        "difference": "",
        "left": {"text": "0", "met": None},
        "right": {"text": "0", "met": None},
        "better": None,
        "size": 0.0,
        "change": 0.0,
    }


def test_an_objective_that_only_one_side_misses_comes_first():
    seen = seen_of(*({"time": float(t), "peak": 1.0} for t in range(0, 40, 4)))
    found = rows({"time": 19.5, "peak": 1.0}, {"time": 20.5, "peak": 9.0}, seen)
    assert [row["title"] for row in found][:2] == ["time", "peak"]


def test_a_difference_that_nobody_would_notice_is_small_though_no_experiment_differs_more():
    seen = seen_of(*({"peak": 1.2 + k * 1e-4} for k in range(6)))
    (row,) = rows({"peak": 1.2}, {"peak": 1.2014}, seen)
    assert row["size"] < 0.1


def test_the_difference_is_right_minus_left_and_the_better_side_follows_the_goal():
    found = {r["title"]: r for r in rows({"time": 25.5, "peak": 2.0}, {"time": 15.0, "peak": 2.5})}
    assert found["time"]["difference"] == "−10.5 h"
    assert found["time"]["better"] == "right"
    assert found["time"]["left"] == {"text": "25.5", "met": False}
    assert found["time"]["right"] == {"text": "15", "met": True}
    assert found["time"]["objective"] == "≤ 20 h"
    assert (found["peak"]["difference"], found["peak"]["better"]) == ("+0.5 m", "left")


def test_never_against_a_number_comes_first_and_has_no_difference():
    found = rows({"time": np.inf, "peak": 9.0}, {"time": 15.0, "peak": 1.0})
    assert found[0]["title"] == "time"
    assert (found[0]["left"]["text"], found[0]["difference"]) == ("never", "")
    assert (found[0]["better"], found[0]["size"]) == ("right", 1.0)


def test_what_reads_the_same_does_not_differ():
    (row,) = rows({"peak": 1.00001}, {"peak": 1.00002})
    assert (row["size"], row["difference"], row["better"]) == (0.0, "", None)


def test_a_kpi_that_one_side_lacks_is_told_all_the_same():
    (row,) = rows({"peak": 1.0}, {})
    assert (row["left"]["text"], row["right"]["text"], row["better"]) == ("1", "–", None)


@pytest.mark.parametrize(
    ("left", "right", "texts", "difference"),
    [
        (0.007353, 0.04471, ("0.0074", "0.0447"), "+0.0373 m"),  # 7 mm against 45 mm
        (12.85, 3.412, ("12.8", "3.4"), "−9.4 m"),
        (311.2, 311.4, ("311.2", "311.4"), "+0.2 m"),  # three digits would not tell them apart
        (0.001, 427.3, ("0.001", "427.3"), "+427 m"),  # the smaller one is not 0
        (np.inf, 12.345, ("∞", "12.3"), ""),
    ],
)
def test_two_values_have_the_digits_that_tell_them_apart_and_what_is_shown_adds_up(
    left, right, texts, difference
):
    (row,) = rows({"peak": left}, {"peak": right})
    assert (row["left"]["text"], row["right"]["text"], row["difference"]) == (*texts, difference)


def test_the_difference_of_two_percentages_is_not_read_as_a_share():
    scenario = replace(toy, kpis=(KPI("overshoot", "overshoot", "%", better="lower", resolution=0.1),))
    (row,) = rows({"overshoot": 37.2}, {"overshoot": 61.6}, scenario=scenario)
    assert (row["difference"], row["left"]["text"], row["right"]["text"]) == (
        "+24.4 % points",
        "37.2",
        "61.6",
    )


def test_a_tick_says_what_the_printed_number_says():
    # As 20 h, the limit, 20.04 h would be missed by nothing that is seen.
    (row,) = rows({"time": 20.04}, {"time": 12.3456})
    assert (row["left"], row["right"]) == ({"text": "20.04", "met": False}, {"text": "12.35", "met": True})


def test_the_head_of_a_side_has_the_numbers_of_the_table():
    _, now = asked()
    view = question_view(now.question, toy, blind=False)
    for side in ("left", "right"):
        head = {row["title"]: row["text"] for row in view[side]["kpis"]}
        assert head == {row["title"]: row[side]["text"] for row in view["comparison"]}


def test_a_resolution_that_the_scenario_states_is_kept():
    coarse = KPI("peak", "peak", "m", better="lower", resolution=0.25)
    assert comparable(coarse, (12.3, 2.61)) == [12.25, 2.5]
