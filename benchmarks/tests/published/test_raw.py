"""Raw results as Parquet."""

import json
import sys

import numpy as np
import pandas as pd
import pytest

from bench_support.campaigns import failed, result
from bench_support.worths import study, walks
from prefcal_bench.cells.roster import entry
from prefcal_bench.published.raw import raw_file, read_curves, write_raw
from prefcal_bench.results.campaign import campaign_of
from prefcal_env.errors import MissingExtraError, SettingsError


def raw(tmp_path, *results):
    return pd.read_parquet(write_raw(results, tmp_path / "raw.parquet"))


def test_there_is_a_row_for_each_comparison_and_for_the_first_experiment(tmp_path):
    asked = ((1, 0, -1), (2, 1, 0), (2, 0, 1))
    found = raw(tmp_path, study(worth=(1, 2, 4), questions=(0, 1, 3), comparisons=asked))
    assert found["experiment"].tolist() == [0, 1, 2, 2]
    assert found["incumbent"].fillna(-9).tolist() == [-9, 0, 1, 0]
    assert found["answer"].fillna(-9).tolist() == [-9, -1, 0, 1]
    assert found["answers"].tolist() == [0, 1, 2, 3]
    assert found["after"].tolist() == [1, 2, 3, 3]
    assert found["worth"].tolist() == [1, 2, 4, 4]
    assert [theta.tolist() for theta in found["theta"]] == [[0, 0.5], [1, 0.5], [2, 0.5], [2, 0.5]]


def test_a_follow_up_about_old_experiments_has_the_row_of_its_challenger(tmp_path):
    asked = ((1, 0, -1), (2, 1, 0), (0, 1, 1))
    found = raw(tmp_path, study(worth=(1, 2, 4), questions=(0, 1, 3), comparisons=asked))
    assert found["experiment"].tolist() == [0, 1, 2, 0]
    assert found["after"].tolist() == [1, 2, 3, 3]
    assert found["theta"].iloc[-1].tolist() == [0, 0.5]


def test_an_agent_that_is_told_values_has_a_row_for_each_experiment(tmp_path):
    found = raw(tmp_path, study("GLIS", questions=(0, 0), comparisons=()))
    assert found["experiment"].tolist() == [0, 1]
    assert found["answer"].isna().all()


def test_kpis_stand_beside_their_names_and_may_be_infinite(tmp_path):
    one = study(kpi_names=("overshoot", "settling"), kpis=((0.1, np.inf), (0.2, 3.0)))
    found = raw(tmp_path, one)
    named = [
        dict(zip(names, kpis, strict=True))
        for names, kpis in zip(found["kpi_names"], found["kpis"], strict=True)
    ]
    assert named == [{"overshoot": 0.1, "settling": np.inf}, {"overshoot": 0.2, "settling": 3.0}]


def test_the_number_of_simulated_theta_is_in_every_row_of_an_agent_that_simulates(tmp_path):
    found = raw(tmp_path, study("Screening", simulated=812), study("GLISp"))
    numbers = found.groupby("agent", observed=True)["simulated"]
    assert numbers.unique().map(list)["Screening"] == [812]
    assert numbers.count()["GLISp"] == 0


def test_versions_are_in_every_row_and_unknown_ones_are_empty(tmp_path):
    found = raw(tmp_path, study("RandomSearch", "camel"), study("Gone", "nowhere"))
    known = found[found["agent"] == "RandomSearch"]
    assert set(known["agent_version"]) == {entry("RandomSearch").version}
    assert set(known["problem_version"]) == {"1"}
    gone = found[found["agent"] == "Gone"]
    assert set(gone["agent_version"]) == set(gone["problem_version"]) == {""}


def test_failures_have_no_row_and_what_has_no_worth_has_nan(tmp_path):
    found = raw(tmp_path, result(), failed(seed=9))
    assert len(found) == 2
    assert found["worth"].isna().all()
    assert len(read_curves(tmp_path / "raw.parquet")) == 0


def test_equal_results_give_equal_bytes_in_whatever_order(tmp_path):
    results = walks({"GLISp": 1.3, "GLIS": 1.5}, n_max=5)
    one = write_raw(results, tmp_path / "one.parquet").read_bytes()
    assert write_raw(results[::-1], tmp_path / "two.parquet").read_bytes() == one
    assert {path.name for path in tmp_path.iterdir()} == {"one.parquet", "two.parquet"}


def test_the_curves_are_those_of_the_results(tmp_path):
    results = walks({"GLISp": 1.3, "Own": 1.1}, n_max=7, per_experiment=2)
    read = read_curves(write_raw(results, tmp_path / "raw.parquet"))
    assert list(read.columns) == [
        "agent",
        "loop",
        "taste",
        "seed",
        "experiment",
        "answers",
        "worth",
        "agent_version",
        "problem_version",
        "n_init",
        "n_max",
    ]
    assert read["worth"].dtype == np.float32
    ours, theirs = campaign_of(results).studies, campaign_of((), read).studies
    assert all(map(np.array_equal, ours["asked"], theirs["asked"]))
    assert all(map(np.allclose, ours["worth"], theirs["worth"]))


def test_without_its_extra_raw_results_are_csv(tmp_path, monkeypatch):
    results = walks({"GLISp": 1.3, "Own": 1.1}, n_max=7)
    columnar = write_raw(results, raw_file(tmp_path))
    with monkeypatch.context() as without:  # pandas itself has loaded it
        without.setitem(sys.modules, "pyarrow", None)
        path = write_raw(results, raw_file(tmp_path))
        for refused in (lambda: read_curves(columnar), lambda: write_raw(results, columnar)):
            with pytest.raises(MissingExtraError, match="pip install pyarrow"):
                refused()
    assert (columnar.name, path.name) == ("raw.parquet", "raw.csv")
    whole, table = pd.read_parquet(columnar), pd.read_csv(path)
    assert [*table.columns] == [*whole.columns]
    for name in ("theta", "kpis", "kpi_names"):
        assert [json.loads(cell) for cell in table[name]] == [[*cell] for cell in whole[name]]
    curves = read_curves(columnar).astype(read_curves(path).dtypes)
    pd.testing.assert_frame_equal(read_curves(path), curves)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "other.parquet").write_text("not a table")
    pd.DataFrame({"agent": ["A"]}).to_parquet(tmp_path / "little.parquet")
    for name in ("other", "little", "missing"):
        with pytest.raises(SettingsError, match="holds no results"):
            read_curves(tmp_path / f"{name}.parquet")
    with pytest.raises(SettingsError, match="cannot write"):
        write_raw([study()], tmp_path / "no" / "raw.parquet")


def test_without_any_result_the_file_is_empty(tmp_path):
    assert len(raw(tmp_path)) == 0
