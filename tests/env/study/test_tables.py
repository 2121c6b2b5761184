"""A study as DataFrames and in a notebook."""

import pytest

from prefcal_env.study import StudyFile

pytest.importorskip("pandas")


def test_a_study_without_experiments_is_an_empty_table():
    knobs = [{"name": "gain", "unit": "1/s", "low": 0.0, "high": 1.0}]
    configuration = {"n_max": 3, "knobs": knobs, "kpis": []}
    with StudyFile.create(":memory:", configuration, clock=lambda: "now") as study:
        assert list(study.to_frame().columns)[:2] == ["gain [1/s]", "ended"]
        assert len(study.to_frame(answers=True)) == 0
        assert "0 experiments, 0 answers" in study._repr_html_()
