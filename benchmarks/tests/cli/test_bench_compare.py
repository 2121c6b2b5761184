"""`prefcal bench compare`: anybody's agent beside published runs."""

import json
from pathlib import Path

import pandas as pd
import pytest

from bench_support.worths import walk, walks
from prefcal_bench import SuiteResults
from prefcal_bench.cli import run as run_module
from prefcal_bench.cli.options import BenchOptions, CompareOptions
from prefcal_bench.published.plan import publish
from prefcal_bench.published.raw import write_raw

OWN = Path(__file__).parents[1] / "bench_support" / "agents.py"


@pytest.fixture
def published(tmp_path):
    results = walks({"GLISp": 1.3, "RandomSearch": 1.0}, ("camel",), ("perfect",), 3, n_max=4)
    publish([write_raw(results, tmp_path / "raw.parquet")], tmp_path / "worth.parquet")
    return tmp_path / "worth.parquet"


def test_only_the_agent_runs_and_what_has_run_is_kept(prefcal, done, published):
    words = ["bench", "compare", f"{OWN}:Own", "--published", published, "--seeds", "2"]
    out = done(*map(str, words), "--jobs", "1", "--json")
    content = json.loads(out)
    assert content["cells"] == 2
    assert content["failures"] == []
    assert {row["agent"] for row in content["worth"]} == {"GLISp", "RandomSearch"}
    raw = pd.read_parquet("prefcal-compare/raw.parquet")
    assert set(raw["agent"]) == {f"{OWN}:Own"}
    code, out, err = prefcal(*map(str, words), "--jobs", "1")
    assert code == 0
    assert "2 of 2 results are there already" in err
    assert "Worth: perfect" in out


def test_the_page_compares_everybody_with_the_agent(published, tmp_path, monkeypatch, capsys):
    def run_suite(suite, *_):
        made = (walk(c.agent, c.problem, c.seed, 1.4, taste=c.calibrator, n_max=c.n_max) for c in suite.cells)
        return SuiteResults(tuple(made), ())

    monkeypatch.setattr(run_module, "run_suite", run_suite)
    mine = f"{OWN}:Own"
    options = CompareOptions(mine, published, out=tmp_path / "made", json=True)
    assert run_module.compare(options) == 0
    rows = json.loads(capsys.readouterr().out)["worth"]
    assert {row["baseline"] for row in rows} == {mine}
    assert {row["agent"]: row["studies"] for row in rows} == {"GLISp": 3, "RandomSearch": 3, mine: 3}
    assert all((row["improvement"] is None) == (row["agent"] == mine) for row in rows)
    page = (tmp_path / "made" / "index.html").read_text(encoding="utf-8")
    assert "Beside them, 2 published agents" in page
    assert f"prefcal bench compare {mine} --published {published}" in page


def test_the_benchmark_writes_worth_and_raw_results_of_closed_loops(tmp_path, monkeypatch):
    found = SuiteResults(tuple(walks({"GLISp": 1.3, "RandomSearch": 1.0}, seeds=2, n_max=4)), ())
    monkeypatch.setattr(run_module, "run_suite", lambda *_: found)
    options = BenchOptions(agents="GLISp", problems="camel", out=tmp_path / "made")
    assert run_module.run(options) == 0
    assert "GLISp" in (tmp_path / "made" / "worth.csv").read_text()
    assert set(pd.read_parquet(tmp_path / "made" / "raw.parquet")["taste"]) == {"weights"}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["compare"], "name an agent"),
        (["compare", "Glisp"], "no agent is called 'Glisp'. Did you mean 'GLISp'?"),
        (["compare", "GLISp", "--problems", "camle"], "Did you mean 'camel'?"),
        (["compare", "GLISp", "--calibrators", "weights"], "no taste 'weights' is published"),
        (["compare", "GLISp", "--seeds", "0"], "seeds"),
        (["--quick", "compare", "GLISp"], "options come after compare"),
    ],
)
def test_impossible_wishes_are_refused_before_anything_runs(prefcal, published, words, said):
    more = ["--published", str(published)] if len(words) > 1 else []
    code, out, err = prefcal("bench", *words, *more)
    assert code == 2
    assert said in err
    assert out == ""
