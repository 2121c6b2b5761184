"""The campaign that checks the certificate: its figures by hand, and that it resumes."""

import importlib
import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit

from prefcal_agents.glisp.agent import Foresight
from prefcal_agents.screening.agent import Evidence

ROOT = Path(__file__).parents[3]


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("certificate")


def row(script, true=0.0, better=False, family="trade", **changes):
    """A study of which a few percent are stated, and 50 % of the most promising θ."""
    found = {"answers": 10, "better": 0.01, "wide": 0.0, "held": 2.0, "predicted": -0.4, "chance": 0.5}
    known = Evidence(**found | changes, explained=True, promising=(1.0,), spread=1000)
    return script.Row("lag", family, 0, 0, known, true, better)


def test_a_study_is_exceeded_if_more_is_better_than_was_stated(script):
    stated = row(script).said.share
    assert not row(script, true=stated).exceeded
    assert row(script, true=stated + 1e-6).exceeded
    assert not row(script, true=1.0, predicted=-2.0).exceeded  # nothing was stated


def test_the_number_of_random_experiments_is_that_which_finds_something_better_half_of_the_time(script):
    low, _, high = row(script).said.experiments
    assert 1 < low < 1000 == high  # 1000 stands for more, too
    for number, held in ((low - 1, False), (low + 1, True), (1e6, True)):
        assert row(script, true=1 - 0.5 ** (1 / number)).in_interval is held
    assert row(script, true=0.0).in_interval
    assert not row(script, true=1.0).in_interval
    text = "\n".join(script.tables([row(script, true) for true in (0.0, 0.0, 0.0, 1.0)]))
    assert f"| 3 (75.0%) | {low:.0f} |" in text


def test_the_tables_count_each_family_by_itself(script):
    rows = [row(script, true) for true in (0.0, 0.0, 0.5, 0.0)]
    rows += [row(script, 1.0, family="curves", predicted=-2.0), row(script, family="curves")]
    text = "\n".join(script.tables(rows))
    assert "| trade | 4 | 0 | 1 (25.0%) | 0.6% to 80.6% |" in text  # Clopper-Pearson, of 1 in 4
    assert "| curves | 2 | 1 | 0 (0.0%) | 0.0% to 97.5% |" in text
    assert "| all | 6 | 1 | 1 (20.0%) |" in text
    assert "After 5 answers" not in text


def test_the_chance_is_compared_with_what_was_true_in_bins(script):
    rows = [row(script, better=better) for better in (True, True, False, False)]
    rows += [row(script, chance=0.0)]
    text = "\n".join(script.tables(rows))
    assert "| 40% to 60% | 4 | 55% | 50% |" in text
    assert "| 0% to 20% | 1 | 3% | 0% |" in text


def test_a_study_ends_with_its_first_answer_after_which_it_is_enough(script):
    def study(seed, shares, chances):
        rows = [
            row(script, share, answers=n, wide=0.0, chance=c)
            for n, share, c in zip((5, 8, 10), shares, chances, strict=True)
        ]
        return [replace(each, seed=seed) for each in rows]

    one = study(0, (0.1, 3 / 8192, 1 / 8192), (0.2, 0.2, 0.2))  # ends after 8, at half the worth
    two = study(1, (0.1, 1 / 8192, 1 / 8192), (0.2, 0.9, 0.9))  # its most promising θ remains likely
    text = "\n".join(script.tables([*one, *two]))
    assert "| trade | 2 | 9.0 | 0.71 |" in text  # the geometric mean of 1/2 and 1
    assert "| all | 2 | 9.00 | 0.707 |" in text
    assert "Studies that end when it is enough" in text


def test_the_fit_finds_the_coefficients_by_which_shares_were_drawn(script):
    rng = np.random.default_rng(0)
    terms = np.column_stack([np.ones(4000), rng.standard_normal((4000, 2))])
    chance = rng.random(4000)
    logs = terms @ [-1.5, 0.4, -0.2] + np.log(chance / (1 - chance)) / 4.0
    found, step = script.fitted_share(terms, 10.0**logs, np.full(4000, 1 / 4000))
    assert step == pytest.approx(1 / 4.0, abs=0.02)
    at = -1.5 + np.log(0.99 / 0.01) / 4.0  # 1 % of the shares are larger
    assert found == pytest.approx([at, 0.4, -0.2], abs=0.06)
    assert np.mean(logs > terms @ found) == pytest.approx(0.01, abs=0.006)
    assert expit(np.log(0.01 / 0.99)) == pytest.approx(script._FIT_AT)


def test_of_a_rig_each_bin_of_ten_is_compared_with_what_was_true(script):
    rows = [
        script.Row("lag", "trade", 0, 0, Foresight(0.5, 1), 0.0, better) for better in (True, False, False)
    ]
    rows += [script.Row("lag", "curves", 0, 0, Foresight(None, 1), 0.0, True)]  # no number
    rows = [script._row(json.loads(json.dumps(asdict(row)))) for row in rows]
    text = "\n".join(script.rig_tables(rows))
    stated = Foresight(0.5, 1).chance
    low = int(10 * stated) * 10
    counts = f"| 3 | 0 | {stated:.1%} | 33.3% | 0.8% to 90.6% |"  # Clopper-Pearson, of 1 in 3
    assert f"| {low}% to {low + 10}% {counts}" in text
    assert f"| trade {counts}" in text
    assert "| curves | 1 | 1 |  |  |  |" in text
    assert "| all | 4 | 1 |" in text


def test_the_fit_of_the_next_finds_the_coefficients_by_which_runs_were_better(script):
    rng = np.random.default_rng(1)
    found = [
        Foresight(share, int(lost))
        for share, lost in zip(rng.random(4000), rng.integers(0, 9, 4000), strict=True)
    ]
    chances = [expit(np.dot([-0.5, 0.6, -0.4], (1.0, *each.terms))) for each in found]
    rows = [
        script.Row("lag", "trade", 0, 0, each, 0.0, rng.random() < p)
        for each, p in zip(found, chances, strict=True)
    ]
    [line] = script.fitted(rows)
    assert json.loads(line.removeprefix("Chance of the next: ")) == pytest.approx([-0.5, 0.6, -0.4], abs=0.15)


def test_studies_that_are_there_do_not_run_again_and_all_are_reported(script, tmp_path, capsys):
    words = ["--quick", "--out", str(tmp_path)]
    script.main(words)
    file = tmp_path / "studies.jsonl"
    before = file.read_text()
    lines = [json.loads(line) for line in before.splitlines()]
    assert [line["evidence"]["answers"] for line in lines] == [2, 3, 5]
    assert all(0 <= line["exceeded_by"] <= 1 for line in lines)
    script.main(words)
    assert file.read_text() == before
    assert [asdict(r) for r in script.stored(tmp_path)] == [asdict(script._row(line)) for line in lines]
    frame = pd.read_parquet(tmp_path / "certificate.parquet")
    assert len(frame) == 3
    assert {"loop", "family", "evidence.held", "exceeded_by", "said"} <= set(frame.columns)
    assert "| trade | 1 | 0 |" in capsys.readouterr().out
