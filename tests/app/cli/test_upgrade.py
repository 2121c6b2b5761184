"""Studies of every released version open, go on, and give a report and exports with the same best.

`tests/data/studies/make.py` writes those of the present version; older ones never change.
"""

import csv
import hashlib
import importlib
import json
import shutil
import tomllib
from pathlib import Path

import pytest

from prefcal_app.session import Interview
from prefcal_env.study import StudyFile
from prefcal_scenarios import load
from support.interviews import answer_all, clock

KEPT = Path(__file__).parents[2] / "data" / "studies"
STUDIES = sorted(KEPT.glob("*.prefcal"))
PROJECT = Path(__file__).parents[3] / "pyproject.toml"
DIGESTS = {
    "0.1.0-glisp.json": "e1bbbfd91caaaa3ab5c211452a2865cf80e81dc51a383918564230f4ba4859de",
    "0.1.0-glisp.prefcal": "f8732df60140a82ffc3c07b6027529dbb4b79f4da5e2a5e274c5bf7363490d8a",
    "0.1.0-screening.json": "5cd258938b108638d24fdd43acaa474528ad7d8f38f37a852c125fcc48cdf015",
    "0.1.0-screening.prefcal": "081e2f459f054fae99a63d7185392079147e679f5d6a10cdadd4427d52540b36",
}
"""SHA-256 of each kept file. Add those of a new version; those of a released one never change."""


@pytest.fixture(params=STUDIES, ids=lambda path: path.stem)
def kept(request, tmp_path):
    """Copy a kept study, and its scenario, into an empty folder; return it with its facts."""
    path = request.param
    shutil.copy(path, tmp_path / "kept.prefcal")
    shutil.copy(KEPT / "first_order.py", tmp_path)
    return tmp_path / "kept.prefcal", json.loads(path.with_suffix(".json").read_text("utf-8"))


def trusted(facts):
    """Return the words with which a user says that they trust the scenario of a study."""
    own = facts["scenario"] if ".py" in facts["scenario"] else None
    return ["--scenario", own] if own else []


def test_the_present_version_has_kept_its_studies():
    names = {path.name for path in STUDIES}
    version = tomllib.loads(PROJECT.read_text("utf-8"))["project"]["version"]
    present = {f"{version}-{agent}.prefcal" for agent in ("glisp", "screening")}
    assert present <= names, "run tests/data/studies/make.py"
    assert all(path.stat().st_size < 200_000 for path in STUDIES)


def test_no_kept_file_has_changed():
    files = [*STUDIES, *KEPT.glob("*.json")]
    found = {path.name: path.read_bytes() for path in files}
    for name in (name for name in found if name.endswith(".json")):
        found[name] = found[name].replace(b"\r\n", b"\n")  # as Git may write them on Windows
    assert {name: hashlib.sha256(content).hexdigest() for name, content in found.items()} == DIGESTS


@pytest.fixture
def make(monkeypatch):
    monkeypatch.syspath_prepend(KEPT)
    return importlib.import_module("make")


def test_studies_are_kept_under_the_version_of_the_project_alone(make, tmp_path):
    project = tmp_path / "pyproject.toml"
    project.write_text('[project]\nversion = "7.1.0"\n')
    assert make.present("7.1.0", project) == "7.1.0"
    with pytest.raises(make.RefusedError, match=r"7\.0\.0 is installed.* names 7\.1\.0"):
        make.present("7.0.0", project)


def test_a_kept_study_is_replaced_only_on_demand(make, tmp_path):
    names = make.places("7.1.0", tmp_path)
    assert {path.name for path in names.values()} == {"7.1.0-glisp.prefcal", "7.1.0-screening.prefcal"}
    facts, other = tmp_path / "7.1.0-screening.json", tmp_path / "7.0.0-glisp.prefcal"
    for path in (facts, other):
        path.write_text("kept")
    with pytest.raises(make.RefusedError, match=r"7\.1\.0-screening\.json exist already"):
        make.places("7.1.0", tmp_path)
    assert facts.read_text() == "kept"
    assert make.places("7.1.0", tmp_path, again=True) == names
    assert (facts.exists(), other.exists()) == (False, True)


def test_a_kept_study_is_sound_and_has_the_same_best(kept, prefcal):
    path, facts = kept
    code, out, _ = prefcal("studies", "verify", str(path))
    assert (code, out[:5]) == (0, "Sound")
    with StudyFile.open(path, clock=clock()) as file:
        state, events = file.state, list(file.events())
        best = state.history.incumbent
        assert sorted({type(each.event).__name__.lower() for each in events}) == facts["kinds"]
        assert (len(state.finished), len(state.answers)) == (facts["experiments"], facts["answers"])
        assert best == facts["best"]
        assert list(state.history.samples[best].theta) == facts["theta"]
        assert dict(file.experiment(state.finished[best]).kpis) == facts["kpis of the best"]


def test_a_kept_study_goes_on(kept, done):
    path, facts = kept
    more = facts["experiments"] + 2
    if trusted(facts):  # a person's: no command answers it
        with StudyFile.open(path, clock=clock()) as file:
            interview = Interview(load(facts["scenario"]), file, ahead=False)
            interview.steps.go_on(2)
            answer_all(interview, lambda number: None)
            interview.close()
            assert len(file.state.finished) == more
        return
    words = ["--study", str(path), "--n-max", str(more), "--json", "--out", "more"]
    out = done("calibrate", facts["scenario"], *words)
    assert json.loads(out)["experiments"] == more


def test_a_kept_study_gives_its_report_and_its_exports(kept, prefcal, done, tmp_path):
    path, facts = kept
    before = path.read_bytes()
    words = [str(path), *trusted(facts), "--out", "report", "--json"]
    out = done("report", *words)
    assert list(json.loads(out)["best"].values()) == facts["theta"]
    assert (tmp_path / "report" / "report.html").stat().st_size > 10_000
    stored = json.loads((tmp_path / "report" / "best.json").read_text("utf-8"))
    assert list(stored["theta"].values()) == facts["theta"]
    assert prefcal("studies", "export", str(path), "--format", "csv", "--out", "tables")[0] == 0
    rows = list(csv.DictReader((tmp_path / "tables" / "experiments.csv").open(encoding="utf-8")))
    assert len(rows) == facts["experiments"]
    assert prefcal("studies", "export", str(path), "--out", "kept.json")[0] == 0
    assert prefcal("studies", "import", "kept.json", "--study", "./again.prefcal")[0] == 0
    with StudyFile.open(tmp_path / "again.prefcal", clock=clock()) as file:
        assert file.state.history.incumbent == facts["best"]
    assert path.read_bytes() == before
