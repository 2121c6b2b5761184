"""θ reads as in best.json, and each rule that people know stands once."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_app.report.export import best_as_json
from prefcal_app.report.pictures import curves_of
from prefcal_app.report.record import result_columns, result_rows
from prefcal_app.report.write import page, sheet_of
from toy_study import toy_record


@pytest.fixture
def precise():
    """A study whose best gain has more digits than people read."""
    record = toy_record()
    best = replace(record.best.experiment, theta=np.array([0.4, 20, 2.7164]))
    trials = tuple(replace(t, experiment=best) if t.index == record.best.index else t for t in record.trials)
    changed = replace(record)
    changed.__dict__["trials"] = trials
    return changed


def test_theta_of_the_result_has_the_digits_of_best_json_wherever_it_is_read(precise):
    rows = {row["name"]: row["cells"] for row in result_rows(precise, result_columns(precise).values())}
    assert rows["gain"][0]["text"] == "2.7164"
    assert [r["cells"][1]["text"] for r in sheet_of(precise)["knobs"]["rows"] if r["name"] == "gain"] == [
        "2.7164"
    ]
    assert "2.7164 <small>m/%" in page(precise, [])
    assert '"gain": 2.7164' in best_as_json(precise)


def test_rules_with_the_same_parameters_stand_once_under_both_names():
    record = toy_record()
    paper = record.references["paper"]
    record = replace(
        record, references={"a": paper, "b": record.references["automated"], "c": replace(paper)}
    )
    assert list(result_columns(record)) == ["best", "first experiment", "a and c", "b"]
    assert [curve.label for curve in curves_of(record)][1:-1] == ["a and c", "b"]


def test_a_rule_with_the_parameters_of_the_baseline_has_no_column_of_its_own():
    record = toy_record()
    record = replace(record, references={"rule": record.before.experiment})
    assert list(result_columns(record)) == ["best", "first experiment and rule"]


def test_each_rule_has_its_own_look():
    record = toy_record()
    paper = record.references["paper"]
    rules = {f"rule {i}": replace(paper, theta=paper.theta + i) for i in range(9)}
    looks = [(c.color, c.dashes) for c in curves_of(replace(record, references=rules))]
    assert len(set(looks)) == 11
