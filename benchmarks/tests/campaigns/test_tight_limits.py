"""The campaign of studies with tight limits: its limits, its table by hand, and that it resumes."""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def campaign(monkeypatch):
    for folder in ("campaigns", "checks"):
        monkeypatch.syspath_prepend(ROOT / "benchmarks" / folder)
    return importlib.import_module("tight_limits")


def test_some_random_tuning_just_keeps_the_limits(campaign):
    plain = campaign.scenario_of(campaign.PROCESSES["lag"])
    scenario = campaign.limited(plain, 1.0)
    most = {kpi.name: kpi.at_most for kpi in scenario.kpis if np.isfinite(kpi.at_most) and not kpi.margin}
    assert most["overshoot"] == 10.0
    looser = {kpi.name: kpi.at_most for kpi in campaign.limited(plain, 1.3).kpis}
    assert looser["settling_time"] == pytest.approx(1.3 * most["settling_time"])


def test_shares_are_averaged_and_times_are_ratios(campaign):
    rows = [
        {"plant": "a", "slack": 1.05, "runs": [20] * 4, "held": [5, 10, 20, 20], "settles": [2, 2, 4, 2]},
        {"plant": "b", "slack": 1.3, "runs": [10] * 4, "held": [5, 10, 10, 5], "settles": [1, 1, 8, 1]},
    ]
    text = "\n".join(campaign.table(rows))
    assert "| a | 1.05 | 5 of 20 | 10 of 20 | 20 of 20 | 20 of 20 |" in text
    assert "| all |  | 38 % | 75 % | 100 % | 75 % |" in text
    assert "| settling time, beside the first |  | 1.00 | 1.00 | 4.00 | 1.00 |" in text


def test_rows_that_are_there_do_not_run_again(campaign, tmp_path, capsys, monkeypatch):
    made = []

    def row_of(name, slack, runs):
        made.append((name, slack, runs))
        return {"plant": name, "slack": slack, "runs": [2] * 4, "held": [1] * 4, "settles": [1.0] * 4}

    monkeypatch.setattr(campaign, "row_of", row_of)
    for _ in range(2):
        campaign.main(["--quick", "--out", str(tmp_path / "rows.jsonl")])
        assert "| lag | 1.3 | 1 of 2 |" in capsys.readouterr().out
    assert made == [("lag", 1.3, 20)]
    assert len((tmp_path / "rows.jsonl").read_text().splitlines()) == 1
    assert json.loads((tmp_path / "rows.jsonl").read_text())["plant"] == "lag"
