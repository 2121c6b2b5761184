"""Study files on the command line: begun, resumed, listed, exported, imported, verified."""

import io
import json
import socket
import sys
import time

import pytest

from prefcal_app.cli import calibrate
from prefcal_app.report.export import tuning_of
from prefcal_app.session import Choice, actions
from prefcal_env.errors import StaleError
from prefcal_env.study import Led, Noted, StudyFile, Suggested, study_path
from support.calibrated import calibrated, copied
from support.interviews import begin, proceed
from toy_study import TOY, toy_scenario

SYNTHETIC = ["--calibrator", "synthetic", "--agent", "random"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a report, and a study among its data."""
    words = [TOY, *SYNTHETIC, "--n-max", "5", "--study", "mine"]
    return calibrated(tmp_path_factory.mktemp("made"), *words)


@pytest.fixture
def study(made, tmp_path):
    copied(made, tmp_path)
    return "mine"


def test_a_study_is_listed_and_shown(prefcal, study):
    _, out, _ = prefcal("studies", "list", "--json")
    (row,) = json.loads(out)
    assert (row["study"], row["experiments"], row["answers"]) == ("mine", 5, 4)
    assert row["state"] == "all compared"
    assert "mine" in prefcal("studies", "list")[1]
    _, out, _ = prefcal("studies", "show", "mine", "--json")
    shown = json.loads(out)
    assert list(shown["best"]) == ["T_s", "N_p", "gain"]
    assert [q["challenger"] for q in shown["questions"]] == [2, 3, 4, 5]
    assert "best T_s [h]" in prefcal("studies", "show", "mine")[1]


def test_no_studies_are_a_hint_not_an_error(done):
    out = done("studies", "list")
    assert "No studies yet" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["cstr", "--study", "mine"], "calibrates 'toy', not 'cstr'"),
        ([TOY, "--study", "no/such/folder/x.prefcal", *SYNTHETIC], "no/such/folder"),
        ([TOY, "--study", "so bad!", *SYNTHETIC], "so bad!"),
    ],
)
def test_what_does_not_fit_the_study_is_refused_in_one_line(prefcal, study, words, message):
    code, out, err = prefcal("calibrate", *words)
    assert (code, out) == (2, "")
    assert err.startswith("prefcal: ")
    assert err.count("\n") == 1
    assert message in err


def test_a_study_is_exported_and_imported_unchanged(prefcal, study, tmp_path):
    assert prefcal("studies", "export", "mine", "--out", "mine.json")[0] == 0
    assert prefcal("studies", "import", "mine.json", "--study", "twin")[0] == 0
    shown = [json.loads(prefcal("studies", "show", n, "--json")[1]) for n in ("mine", "twin")]
    for one in shown:
        one.pop("study"), one.pop("file")
    assert shown[0] == shown[1]
    assert prefcal("studies", "verify", "twin")[0] == 0
    assert prefcal("studies", "export", "mine", "--format", "csv")[1] == "Written: mine\n"
    assert len((tmp_path / "mine" / "comparisons.csv").read_text().splitlines()) == 5


def test_an_export_never_overwrites_its_study(prefcal, refused, study, tmp_path):
    (path,) = (tmp_path / "data").rglob("mine.prefcal")
    before = path.read_bytes()
    for format_ in ("json", "csv"):
        words = ["--format", format_, "--out", str(path)]
        assert "is the study itself" in refused("studies", "export", "mine", *words)
    assert path.read_bytes() == before


@pytest.mark.parametrize("text", ["{}", "[", "3", '{"events": -1.5, "prefcal study": 2}'])
def test_what_is_no_export_is_named(refused, tmp_path, text):
    (tmp_path / "theirs.json").write_text(text)
    assert "theirs.json: this is not an exported study" in refused("studies", "import", "theirs.json")


def test_an_import_never_overwrites_a_study(prefcal, refused, study):
    prefcal("studies", "export", "mine")
    assert "mine.prefcal already: name this one with --study" in refused("studies", "import", "mine.json")
    assert prefcal("studies", "import", "mine.json", "--study", "again")[0] == 0


def test_a_report_is_written_of_any_study(prefcal, done, refused, study, tmp_path):
    assert "is a program" in refused("report", "mine", "--out", "again")
    assert not (tmp_path / "again").exists()
    out = done("report", "mine", "--scenario", TOY, "--out", "again", "--json")
    assert json.loads(out)["experiments"] == 5
    first = (tmp_path / "prefcal-mine" / "best.json").read_text()
    assert (tmp_path / "again" / "best.json").read_text() == first


@pytest.mark.parametrize("change", ["another leads", "another by hand", "a copy alone"])
def test_a_tuning_that_is_not_the_best_of_its_study_any_more_is_refused(study, tmp_path, monkeypatch, change):
    monkeypatch.chdir(tmp_path)
    best = tmp_path / "prefcal-mine" / "best.json"
    content = json.loads(best.read_text())
    assert tuning_of(best).theta.tolist() == list(content["theta"].values())
    best.write_text(json.dumps(content, sort_keys=True))
    assert tuning_of(best).theta.tolist() == list(
        content["theta"].values()
    )  # in another order, as jq -S writes it
    if change == "another by hand":
        del content["written as"]  # as an earlier version wrote it
        best.write_text(json.dumps({**content, "theta": {**content["theta"], "gain": 1.0}}))
        match = f"experiment {content['experiment']}, with other values of the knobs, and the best of mine"
    else:
        if change == "a copy alone":
            (best.parent / "study.json").unlink()  # a copy of best.json alone
        with StudyFile.open(study_path("mine"), clock=str) as file:
            other = next(i for i in range(5) if i != file.state.history.incumbent)
            file.append(Led(other))  # answers one by one still name the first one
        match = f"the best of mine is experiment {other + 1}. Write it anew: prefcal report mine$"
    with pytest.raises(StaleError, match=match):
        tuning_of(best)
    moved = best.parent.rename(tmp_path / "a report")
    if change != "a copy alone":
        match = "prefcal report mine --out '.*a report'$"
    with pytest.raises(StaleError, match=match):
        tuning_of(moved / "best.json")


def test_a_tuning_of_another_study_of_the_same_name_is_not_compared_with_this_one(prefcal, study, tmp_path):
    best = tmp_path / "prefcal-mine" / "best.json"
    study_path("mine").unlink()
    assert tuning_of(best).baseline
    assert prefcal("calibrate", TOY, *SYNTHETIC, "--n-max", "2", "--seed", "7", "--study", "mine")[0] == 0
    assert tuning_of(best).baseline
    (best.parent / "study.json").unlink()
    assert tuning_of(best).baseline


@pytest.mark.parametrize(
    ("part", "said"),
    [
        ({"agent": {"version": 99}}, "with version 99 of RandomSearch: earlier proposals were made by that"),
        ({"options": {"colour": "red"}}, "does not know colour, with which this study was begun"),
        ({}, ""),
    ],
)
def test_a_study_of_another_version_says_so_when_it_goes_on(prefcal, study, part, said):
    with StudyFile.open(study_path("mine"), clock=str, reading=True) as file:
        begun = next(file.events()).event.configuration
        changed = {name: {**begun[name], **more} for name, more in part.items()}
        with StudyFile.create("then.prefcal", {**begun, **changed}, clock=str) as then:
            then.append(Suggested(0, file.state.history.samples[0].z, file.state.history.samples[0].theta))
    code, _, err = prefcal("calibrate", TOY, *SYNTHETIC, "--study", "./then.prefcal", "--n-max", "5")
    assert code == 0, err
    assert said in " ".join(err.split())
    assert ("this study was begun" in " ".join(err.split()).lower()) is bool(said)


@pytest.mark.parametrize("seconds", [0.0, 0.2])
def test_a_study_that_learns_for_long_before_it_goes_on_says_so(prefcal, study, monkeypatch, seconds):
    class Slow(calibrate.Interview):
        def __init__(self, *given, **more):
            time.sleep(seconds)
            super().__init__(*given, **more)

    monkeypatch.setattr(calibrate, "Interview", Slow)
    monkeypatch.setattr(calibrate, "_SOON", 0.1 if seconds else 60.0)
    code, _, err = prefcal("report", "mine", "--scenario", TOY, "--out", "again")
    assert code == 0, err
    assert ("Learning from the 4 answers of this study ..." in err) is bool(seconds)


def test_parquet_without_pyarrow_is_refused_with_what_to_install(
    prefcal, refused, study, monkeypatch, tmp_path
):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "Parquet needs pyarrow: pip install pyarrow, or use CSV" in refused(
        "studies", "export", "mine", "--format", "parquet"
    )
    assert not (tmp_path / "mine").exists()


def test_a_report_that_cannot_be_written_is_told_in_one_line(prefcal, study, tmp_path):
    assert prefcal("report", "mine", "--scenario", TOY, "--out", "again")[0] == 0
    (tmp_path / "again" / "report.html").unlink()
    (tmp_path / "again" / "report.html").mkdir()
    code, _, err = prefcal("report", "mine", "--scenario", TOY, "--out", "again")
    assert code == 2
    assert "cannot write the report into again" in err
    assert "lost nothing" in err


def test_a_report_writes_nothing_to_a_study_that_is_being_answered(prefcal, done, tmp_path):
    interview = begin(toy_scenario(), n_max=12, path=tmp_path / "mine.prefcal")
    for _ in range(2):
        interview.do(actions.Answer(proceed(interview).question.id, Choice.LEFT))
    interview.file.append(Noted(f"{interview.now().phase}, and no proposal yet"))
    out = done("report", "./mine.prefcal", "--scenario", TOY, "--json")
    assert json.loads(out)["questions"] == 2
    assert proceed(interview).question.number == 3, interview.now().problem
    interview.file.close()


def test_a_taken_port_is_told_before_there_is_a_study(prefcal, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        code, _, err = prefcal("calibrate", TOY, "--no-browser", "--port", port)
    assert code == 2
    assert f"port {port} on 127.0.0.1 is taken" in err
    assert not (tmp_path / "data").exists()


def test_the_terminal_answers_from_a_pipe_and_the_study_goes_on(prefcal, monkeypatch):
    words = ["calibrate", TOY, "--terminal", "--n-max", "4", "--n-init", "2", "--study", "piped"]
    monkeypatch.setattr("sys.stdin", io.StringIO("l\nr\n"))
    code, out, err = prefcal(*words)
    assert code == 0, err
    assert "Question 2 of 3" in out
    assert "Resume: prefcal calibrate" in err
    monkeypatch.setattr("sys.stdin", io.StringIO("=\n"))
    code, out, err = prefcal(*words[:3], "--study", "piped")
    assert "Question 3 of 3" in out
    assert "The study is finished: all compared." in out
    assert "Repeat it" not in out  # a person gives other answers
    questions = json.loads(prefcal("studies", "show", "piped", "--json")[1])["questions"]
    assert questions[-1]["verdict"] == "about the same"


@pytest.mark.usefixtures("rig_file")
def test_a_rig_cannot_be_calibrated_unattended(refused):
    words = [*SYNTHETIC, "--n-max", "4"]
    assert "only a person can run" in refused("calibrate", "own.py:rig", *words)
    told = "is a rig that only a person can run: its calibrator is human"
    assert told in refused("calibrate", "own.py:oven", *words)


def test_the_same_line_goes_on_with_a_study_that_was_given_more(prefcal, done, refused):
    words = ["calibrate", TOY, *SYNTHETIC, "--study", "mine", "--json"]
    assert prefcal(*words, "--n-max", "5")[0] == 0
    assert prefcal(*words, "--n-max", "7")[0] == 0
    out = done(*words, "--n-max", "5")
    assert json.loads(out)["experiments"] == 7
    assert "below the 7 that the study has by now" in refused(*words, "--n-max", "6")
