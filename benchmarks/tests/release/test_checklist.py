"""The checklist of a release names each file that does not name the version as it should."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
FILES = {
    "pyproject.toml": '[project]\nversion = "2.0.0"\n',
    "benchmarks/pyproject.toml": '[project]\nversion = "2.0.0"\ndependencies = ["prefcal==2.0.0"]\n',
    "CITATION.cff": "version: 2.0.0\ndate-released: 2030-01-01\n",
    "CHANGELOG.md": "# Changelog\n\n## [Unreleased]\n\n## [2.0.0] - 2030-01-01\n",
}


@pytest.fixture
def checklist(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "release")
    return importlib.import_module("checklist")


@pytest.fixture
def clone(tmp_path):
    """A clone that is ready for release 2.0.0."""
    (tmp_path / "benchmarks").mkdir()
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_files_that_agree_are_not_complained_of(checklist, clone):
    assert list(checklist.faults(clone)) == []
    assert list(checklist.faults(clone, "v2.0.0")) == []


def test_another_tag_is_refused(checklist, clone):
    assert list(checklist.faults(clone, "v2.0.1")) == ["the tag is v2.0.1, but the version 2.0.0"]


def test_with_another_tag_the_command_ends_with_1():
    command = [sys.executable, ROOT / "benchmarks/release/checklist.py", "--tag", "v0.0.0-no-tag"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "the tag is v0.0.0-no-tag" in done.stderr


@pytest.mark.parametrize(
    ("file", "old", "new", "told"),
    [
        ("benchmarks/pyproject.toml", '"2.0.0"', '"2.0.1"', "benchmarks/pyproject.toml has version 2.0.1"),
        ("benchmarks/pyproject.toml", "==2.0.0", "==1.0.0", "does not need prefcal==2.0.0"),
        ("CITATION.cff", "version: 2.0.0", "version: 2.0.01", "CITATION.cff does not say"),
        ("CITATION.cff", "date-released: 2030-01-01\n", "", "CITATION.cff has no 'date-released"),
        ("CITATION.cff", "2030-01-01", "2030-01-02", "dates the version 2030-01-01, CITATION.cff 2030-01-02"),
        ("CHANGELOG.md", "## [2.0.0] - 2030-01-01", "", "CHANGELOG.md has no heading"),
        ("CHANGELOG.md", " - 2030-01-01", "", "CHANGELOG.md has no heading"),
    ],
)
def test_a_file_that_disagrees_is_named(checklist, clone, file, old, new, told):
    text = (clone / file).read_text()
    assert old in text
    (clone / file).write_text(text.replace(old, new))
    (fault,) = checklist.faults(clone)
    assert told in fault
