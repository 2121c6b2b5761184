"""Parquet files of logged data, which pyarrow reads."""

import numpy as np
import pandas as pd
import pytest

from prefcal_env.errors import RecordError
from prefcal_env.experiments.experiment import Channel, Channels
from prefcal_env.sources import Rig
from prefcal_env.tables import TableColumns, from_frame

pytest.importorskip("pyarrow", reason="needs pyarrow: pip install pyarrow")


def test_a_file_gives_the_same_as_its_frame_also_as_bytes_of_a_rig(tmp_path):
    index = pd.date_range("2026-11-23", periods=3, freq="1s", tz="Europe/Berlin")
    frame = pd.DataFrame({"level [m]": [1, 2.5, 3], "valve [%]": [5, 6, 7]}, index=index)
    frame.to_parquet(tmp_path / "run.parquet")
    use = {"outputs": "level", "inputs": ["valve"]}
    assert from_frame(tmp_path / "run.parquet", 1.0, **use) == from_frame(frame, 1.0, **use)
    rig = Rig(Channels((Channel("level", "m"),), (Channel("valve", "%"),), (), "s"), ())
    e = rig.read((tmp_path / "run.parquet").read_bytes(), np.ones(1))
    assert np.array_equal(e.x[:, 0], [1, 2.5, 3])


def test_a_broken_file_is_refused():
    with pytest.raises(RecordError, match="the Parquet file cannot be read"):
        from_frame(b"PAR1xxxx", 1.0)


def test_a_small_file_of_very_many_rows_is_refused_before_they_are_read(tmp_path):
    rows = 2_500_001
    path = tmp_path / "zeros.parquet"
    pd.DataFrame({"time": np.zeros(rows), "level": np.zeros(rows)}).to_parquet(path)
    assert path.stat().st_size < 1e6
    with pytest.raises(RecordError, match=r"5,000,000 cells, got 2,500,001 rows of 2 columns"):
        TableColumns(outputs=["level"]).read(path, [0.0])
