"""A study as DataFrames and in a notebook."""

import numpy as np
import pytest

from prefcal_env.study import StudyFile
from support.studies import small_study

pytest.importorskip("pandas")


def test_a_study_without_experiments_is_an_empty_table():
    knobs = [{"name": "gain", "unit": "1/s", "low": 0.0, "high": 1.0}]
    configuration = {"n_max": 3, "knobs": knobs, "kpis": []}
    with StudyFile.create(":memory:", configuration, clock=lambda: "now") as study:
        assert list(study.to_frame().columns)[:2] == ["gain [1/s]", "ended"]
        assert len(study.to_frame(answers=True)) == 0
        assert "0 experiments, 0 answers" in study._repr_html_()


def test_experiments_and_answers_are_rows_with_their_units():
    with small_study(":memory:") as study:
        frame = study.to_frame()
        assert list(frame.columns)[:3] == ["gain [m/%]", "late [s]", "sum"]
        assert frame.index.name == "experiment"
        assert frame.index.tolist() == [1, 2, 3, 4]
        assert frame["gain [m/%]"].tolist() == pytest.approx([0.05, 0.15, 0.25, 0.35])
        assert frame["sum"].tolist() == pytest.approx([0.05, 0.15, 0.25, 0.35])
        assert np.isinf(frame["late [s]"]).all()
        answers = study.to_frame(answers=True)
        assert answers["preference"].tolist() == [-1, 0, 1]
        assert answers["comment"].tolist()[0] == "answer 1"
        shown = study._repr_html_()
        assert "4 experiments, 3 answers, best experiment 2" in shown
        assert "late [s]" in shown
