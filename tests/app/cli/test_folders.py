"""One report folder per study: no report ever replaces another study's."""

import json

import pytest

from prefcal_app.report.record import Owner, claim_default, claim_given
from prefcal_env.errors import SettingsError
from toy_study import TOY

QUICK = ["calibrate", TOY, "--calibrator", "synthetic", "--agent", "random", "--n-max", "4"]
MINE, OTHERS = Owner("1", "mine", "toy"), Owner("2", "other", "toy")


def test_a_study_goes_on_in_its_own_folder(prefcal, tmp_path):
    assert prefcal(*QUICK, "--study", "mine")[0] == 0
    assert prefcal("calibrate", TOY, "--study", "mine", "--n-max", "6")[0] == 0
    assert prefcal("report", "mine", "--scenario", TOY)[0] == 0
    assert prefcal("report", "mine", "--scenario", TOY, "--out", "prefcal-mine")[0] == 0
    assert [p.name for p in tmp_path.glob("prefcal-*")] == ["prefcal-mine"]
    marker = json.loads((tmp_path / "prefcal-mine" / "study.json").read_text("utf-8"))
    assert (marker["study"], marker["scenario"]) == ("mine", TOY)


def test_unattended_studies_that_differ_do_not_share_a_folder(prefcal, tmp_path):
    assert prefcal(*QUICK)[0] == 0
    best = (tmp_path / "prefcal-toy-0" / "best.json").read_bytes()
    code, out, err = prefcal(*QUICK[:-1], "6")
    assert code == 0
    assert "prefcal-toy-0-2/report.html" in out
    assert "prefcal-toy-0 holds another study's report" in err
    assert prefcal(*QUICK)[0] == 0  # the same study: the same folder
    assert (tmp_path / "prefcal-toy-0" / "best.json").read_bytes() == best
    assert len(list(tmp_path.glob("prefcal-*"))) == 2


def test_a_folder_of_another_study_is_refused_before_anything_runs(prefcal, tmp_path):
    assert prefcal(*QUICK, "--study", "first", "--out", "here")[0] == 0
    before = {p.name: p.read_bytes() for p in (tmp_path / "here").iterdir()}
    code, out, err = prefcal(*QUICK, "--study", "second", "--out", "here")
    assert (code, out) == (2, "")
    assert "prefcal: --out here holds the report of study 'first': choose another folder" in err
    assert {p.name: p.read_bytes() for p in (tmp_path / "here").iterdir()} == before
    assert prefcal("studies", "show", "second")[0] == 2  # it was not even started
    code, _, err = prefcal(*QUICK, "--out", "here")
    assert "--out here holds the report of study 'first'" in err


def test_a_report_whose_study_is_not_known_is_not_replaced(tmp_path):
    (tmp_path / "report.html").write_text("of an older version, or of another program")
    with pytest.raises(SettingsError, match="holds a report whose study is not known"):
        claim_given(tmp_path, MINE)
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_a_folder_without_a_report_is_given_back(tmp_path):
    claim_default(tmp_path / "here", MINE).release()
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "notes.txt").write_text("mine")
    claim_given(tmp_path / "there", MINE).release()
    assert [p.name for p in tmp_path.iterdir()] == ["there"]  # it was the user's
    assert [p.name for p in (tmp_path / "there").iterdir()] == ["notes.txt"]


def test_a_run_that_ends_takes_the_folder_from_nobody_else(tmp_path):
    first, second = claim_given(tmp_path / "x", MINE), claim_given(tmp_path / "x", MINE)
    second.release()
    assert (tmp_path / "x" / "study.json").is_file()
    first.release()
    second.renew()
    assert (tmp_path / "x" / "study.json").is_file()
