"""A study as CSV and Parquet: the same values, and every column explained."""

import csv

import numpy as np
import pytest

from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Channel, Channels
from prefcal_env.study import Finished, StudyFile, Suggested, export_csv, export_parquet
from prefcal_env.study.archive import dictionary_file
from support.studies import experiment, small_study

pq = pytest.importorskip("pyarrow.parquet", reason="needs pyarrow: pip install pyarrow")


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
    told = read(folder / dictionary_file("csv"))
    assert all(row["meaning"] and row["type"] for row in told)
    for name in ("comparisons.csv", "experiments.csv"):
        headings = [
            f"{r['column']} [{r['unit']}]" if r["unit"] else r["column"] for r in told if r["file"] == name
        ]
        assert headings == list(read(folder / name)[0])
    known = {f"{r['column']} [{r['unit']}]" for r in told if r["file"] == "trajectories"}
    curves = read(folder / "trajectories" / "experiment-001.csv")
    assert set(curves[0]) <= known
    gain = next(r for r in told if r["column"] == "gain")
    assert (gain["unit"], gain["type"], gain["meaning"]) == ("m/%", "number", "Controller parameter")
    late = next(r for r in told if r["column"] == "late")
    assert (late["unit"], late["meaning"]) == ("s", "KPI: late")
    for path in columnar.glob("*.parquet"):
        schema = pq.read_schema(path)
        rows = [r for r in read(columnar / dictionary_file("parquet")) if r["file"] == path.name]
        assert schema.names == [row["column"] for row in rows]
        for field, row in zip(schema, rows, strict=True):
            about = {k.decode(): v.decode() for k, v in field.metadata.items()}
            assert (about["unit"], about["meaning"]) == (row["unit"], row["meaning"])


def test_columns_that_share_a_name_keep_their_values_under_names_of_their_own(tmp_path):
    a, rows = Channel("a", "m"), np.arange(4.0)[:, None]
    channels = Channels(x=(a, a), u=(Channel("a (2)", "%"),), y=(Channel("a", "m"),))
    run = experiment(
        0.5,
        channels=channels,
        x=np.hstack([rows, rows + 10]),
        signals={"a [m]": rows[:, 0] + 20},
        y=rows + 30,
    )
    with small_study(":memory:", answers=0) as study:
        study.append(Suggested(1, (0.5,), (0.5,)), (Finished(1), run))
        export_csv(study, tmp_path)
        export_parquet(study, tmp_path)
    table = pq.read_table(tmp_path / "trajectories.parquet")
    told = [r for r in read(tmp_path / dictionary_file("parquet")) if r["file"] == "trajectories.parquet"]
    assert table.column_names == [row["column"] for row in told]
    assert len(set(table.column_names)) == len(table.column_names)
    curves = read(tmp_path / "trajectories" / "experiment-002.csv")
    assert [curves[0][name] for name in ("a [m]", "a (2) [m]")] == ["0.0", "10.0"]
    assert curves[0]["a [m] (2)"] == "20.0"
    first = table.to_pandas().query("experiment == 2").iloc[0]
    assert [first[name] for name in ("a", "a (2)", "a [m] (2)")] == [0.0, 10.0, 20.0]
    about = [r for r in read(tmp_path / dictionary_file("csv")) if r["file"] == "trajectories"]
    known = {f"{r['column']} [{r['unit']}]" if r["unit"] else r["column"] for r in about}
    assert set(curves[0]) <= known


def test_references_that_change_are_columns_with_units(tmp_path):
    steps = {
        "t_control": np.array([0.0, 2.0]),
        "u_control": np.zeros((2, 1)),
        "y_ref": np.array([[2.0], [3.0]]),
        "iterations": np.zeros(2, int),
        "solve_time": np.zeros(2),
        "solved": np.ones(2, bool),
    }
    with small_study(":memory:", answers=0) as study:
        study.append(Suggested(1, (0.5,), (0.5,)), (Finished(1), experiment(0.5, **steps)))
        export_csv(study, tmp_path)
        export_parquet(study, tmp_path)
    curves = read(tmp_path / "trajectories" / "experiment-002.csv")
    assert [row["Reference of level [m]"] for row in curves] == ["2.0", "2.0", "3.0", "3.0"]
    mine = pq.read_table(tmp_path / "trajectories.parquet").to_pandas().query("experiment == 2")
    assert mine["Reference of level"].tolist() == [2.0, 2.0, 3.0, 3.0]


def test_a_second_export_leaves_the_other_format_and_nothing_of_a_longer_study(tmp_path):
    with small_study(":memory:", answers=3) as study:
        export_csv(study, tmp_path)
    (tmp_path / "trajectories" / "mine.csv").write_text("mine")
    with small_study(":memory:", answers=1) as study:
        export_csv(study, tmp_path)
        told = (tmp_path / dictionary_file("csv")).read_text("utf-8")
        export_parquet(study, tmp_path)
    left = {path.name for path in (tmp_path / "trajectories").iterdir()}
    assert left == {"experiment-001.csv", "experiment-002.csv", "mine.csv"}
    assert (tmp_path / dictionary_file("csv")).read_text("utf-8") == told
    files = {row["file"] for row in read(tmp_path / dictionary_file("parquet"))}
    assert files == {f"{n}.parquet" for n in ("comparisons", "experiments", "trajectories")}


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
