"""The campaign that counts which tunings hold: its rows, its figures by hand, and that it resumes."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def campaign(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("verification")


def row(failed, who="weights, seed 0", unsafe=0, noise=0, loop="rough-0"):
    return {"loop": loop, "who": who, "runs": 200, "failed": failed, "unsafe": unsafe, "by noise": noise}


def test_tunings_are_counted_by_their_share_of_failed_runs(campaign):
    rows = [row(0), row(2), row(3, unsafe=1), row(40, noise=10), row(150, unsafe=150), row(20, "random 0")]
    text = "\n".join(campaign.table(rows))
    assert "| tuned | 5 | 1 | 3 | 2 | 1 | 2 | 20 % | 15 % | 1 % |" in text
    assert "| random | 1 | 0 | 1 | 0 | 0 | 0 | 10 % | 0 % | 0 % |" in text


def test_it_runs_and_resumes(campaign, tmp_path, capsys):
    campaign.main(["--quick", "--out", str(tmp_path)])
    first, rows = capsys.readouterr().out, (tmp_path / "verification.jsonl").read_text()
    assert len(rows.splitlines()) == 1 + campaign.RANDOM
    campaign.main(["--quick", "--out", str(tmp_path)])
    assert capsys.readouterr().out == first
    assert (tmp_path / "verification.jsonl").read_text() == rows


def test_robust_studies_are_measured_like_others(campaign, tmp_path, capsys):
    campaign.main(["--quick", "--robust", "--out", str(tmp_path)])
    assert "| tuned | 1 | 1 | 0 |" in capsys.readouterr().out
    assert len((tmp_path / "verification.jsonl").read_text().splitlines()) == 1
