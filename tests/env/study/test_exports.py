"""A study as CSV and Parquet: the same values, and every column explained."""

import csv
from itertools import pairwise

import numpy as np
import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import Finished, StudyFile, Suggested, export_csv, export_parquet
from prefcal_env.study.exports import DICTIONARY
from support.studies import experiment, small_study

pq = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def exported(tmp_path):
    """Export a small study in both formats; return both folders and the study."""
    with small_study(":memory:") as study:
        yield export_csv(study, tmp_path / "csv"), export_parquet(study, tmp_path / "pq"), study


def read(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def same(text, value):
    """Return whether a cell of CSV is a value of Parquet."""
    if value is None:
        return text == ""
    if isinstance(value, float):
        return float(text) == value
    return text in (str(value), f"'{value}")


def test_both_formats_have_the_same_values(exported):
    folder, columnar, study = exported
    for name in ("comparisons", "experiments"):
        rows, table = read(folder / f"{name}.csv"), pq.read_table(columnar / f"{name}.parquet")
        assert len(rows) == table.num_rows > 2
        for k, heading in enumerate(rows[0]):
            for row, value in zip(rows, table.column(k).to_pylist(), strict=True):
                assert same(row[heading], value), heading
    thetas = pq.read_table(columnar / "experiments.parquet").column("gain").to_pylist()
    samples = study.state.history.samples
    assert thetas == [s.theta[0] for s in samples[: len(thetas)]]


def test_all_curves_are_one_table_with_the_number_of_the_experiment(exported):
    folder, columnar, study = exported
    table = pq.read_table(columnar / "trajectories.parquet").to_pandas()
    files = sorted((folder / "trajectories").glob("*.csv"))
    assert sorted(set(table["experiment"])) == list(range(1, len(files) + 1))
    for number, seq in enumerate(study.state.finished.values(), start=1):
        run = study.experiment(seq)
        mine = table[table["experiment"] == number]
        assert np.array_equal(mine["time"], run.t)
        assert np.array_equal(mine["level"], run.x[:, 0])


def test_every_column_of_every_file_is_in_the_dictionary_with_unit_and_meaning(exported):
    folder, columnar, _ = exported
    told = read(folder / DICTIONARY)
    assert all(row["meaning"] and row["type"] for row in told)
    for name in ("comparisons.csv", "experiments.csv"):
        headings = [
            f"{r['column']} [{r['unit']}]" if r["unit"] else r["column"]
            for r in told if r["file"] == name
        ]  # fmt: skip
        assert headings == list(read(folder / name)[0])
    known = {f"{r['column']} [{r['unit']}]" for r in told if r["file"] == "trajectories"}
    curves = read(folder / "trajectories" / "experiment-001.csv")
    assert set(curves[0]) <= known
    gain = next(r for r in told if r["column"] == "gain")
    assert (gain["unit"], gain["type"], gain["meaning"]) == (
        "m/%",
        "number",
        "Controller parameter",
    )
    late = next(r for r in told if r["column"] == "late")
    assert (late["unit"], late["meaning"]) == ("s", "KPI: late")
    for path in columnar.glob("*.parquet"):
        schema = pq.read_schema(path)
        rows = [r for r in read(columnar / DICTIONARY) if r["file"] == path.name]
        assert len(schema) == len(rows)
        for field, row in zip(schema, rows, strict=True):
            about = {k.decode(): v.decode() for k, v in field.metadata.items()}
            assert (about["unit"], about["meaning"]) == (row["unit"], row["meaning"])


def test_columns_of_parquet_have_names_of_their_own(exported):
    _, columnar, _ = exported
    names = pq.read_schema(columnar / "trajectories.parquet").names
    assert all(a != b for a, b in pairwise(sorted(names)))


def test_a_kpi_that_one_experiment_lacks_is_empty(tmp_path):
    with small_study(":memory:", answers=0) as study:
        study.append(Suggested(1, (0.5,), (0.5,)), (Finished(1), experiment(0.5, kpis={"new": 7})))
        export_parquet(study, tmp_path)
    table = pq.read_table(tmp_path / "experiments.parquet")
    assert table.column("new").to_pylist() == [None, 7.0]
    assert table.column("late").to_pylist()[1] is None


def test_a_study_without_experiments_has_tables_without_rows(tmp_path):
    knobs = [{"name": "gain", "unit": "1/s", "low": 0.0, "high": 1.0}]
    configuration = {"n_max": 3, "knobs": knobs, "kpis": []}
    with StudyFile.create(":memory:", configuration, clock=lambda: "now") as study:
        export_parquet(study, tmp_path)
    assert pq.read_table(tmp_path / "experiments.parquet").num_rows == 0
    assert pq.read_table(tmp_path / "trajectories.parquet").num_rows == 0


@pytest.mark.parametrize("export", [export_csv, export_parquet])
def test_a_folder_that_cannot_be_written_is_named(export, tmp_path):
    (tmp_path / "file").write_text("")
    with small_study(":memory:") as study, pytest.raises(StudyError, match="file"):
        export(study, tmp_path / "file")
