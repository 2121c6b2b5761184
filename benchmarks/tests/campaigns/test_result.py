"""The campaign that measures what is said of a result: its figures by hand, and that it resumes."""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from prefcal_bench.people import Runs

ROOT = Path(__file__).parents[3]


@pytest.fixture
def result(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("result")


def row(taste, found, good, better, wanted=()):
    return {
        "loop": "rough-0",
        "taste": taste,
        "seed": 0,
        "stakes": [(0.1, False), (0.12, True)],
        "answer": {"predicted": 3, "found": found, "now": 4, "sure": True},
        "good": good,
        "better": better,
        "wanted": list(wanted),
    }


def test_the_figures_are_shares_of_the_studies_that_have_them(result):
    rows = [
        row("order", 3, [False, True, False], [0.3, 0.001, 0.3], [(0.85, True), (0.89, False)]),
        row("order", 4, [True, False], [0.0, 0.2]),
        row("curves", 2, [False], [0.3], [(0.85, True)]) | {"answer": None},
    ]
    text = "\n".join(result.tables(rows))
    assert "| order | 2 | 100 % | 50 % | 50 % | 100 % | 50 % | 100 % |" in text
    assert "| all | 3 | 67 % | 50 % | 33 % | 67 % | 33 % | 67 % |" in text
    assert "| 11 % | 6 | 50 % |" in text
    assert "| 87 % | 2 | 50 % |" in text  # nobody decides by KPIs in curves


def test_the_smaller_change_is_counted_where_it_is_offered(result):
    backs = [(0, None), (2, True), (4, False), (4, True)]
    rows = [{"taste": "order", "smaller": {"changed": 5, "back": back, "good": good}} for back, good in backs]
    text = "\n".join(result.tables(rows))
    assert "| order | 4 | 75 % | 67 % | 5 | 4 |" in text
    assert "| order | 1 | 0 % | – | – | – |" in "\n".join(result.tables(rows[:1]))


def test_one_kpi_is_changed_and_the_others_stay(result):
    runs = Runs(("a", "b"), np.array([[1.0, 2.0], [3.0, 4.0]]), np.full(2, np.inf))
    changed = result._with(runs, "b", np.array([7.0, 8.0]))
    assert changed.values.tolist() == [[1.0, 7.0], [3.0, 8.0]]
    assert runs.values[0, 1] == 2.0


def test_a_study_is_stored_and_does_not_run_again(result, tmp_path, capsys, monkeypatch):
    file = tmp_path / "found.jsonl"
    words = ["--out", str(file), "--loops", "rough-0", "--tastes", "order", "--simulated", "80"]
    result.main(words)
    (found,) = map(json.loads, file.read_text().splitlines())
    assert len(found["stakes"]) == 5
    assert 1 <= len(found["good"]) <= 3
    assert all(0 <= share <= 1 for share in found["better"])
    first = capsys.readouterr().out
    result.main([*words[:1], str(tmp_path / "smaller.jsonl"), *words[2:], "--start"])
    (found,) = map(json.loads, (tmp_path / "smaller.jsonl").read_text().splitlines())
    smaller = found["smaller"]
    assert 0 <= smaller["back"] <= smaller["changed"] <= 7
    assert "| family | studies | offered |" in capsys.readouterr().out
    monkeypatch.setattr(result, "ToldStudy", None)
    result.main(words)
    assert capsys.readouterr().out == first
