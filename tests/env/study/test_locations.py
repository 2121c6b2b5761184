"""Names and paths of studies; files are removed and renamed whole, and never under a process."""

import subprocess
import sys
from pathlib import Path

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import (
    Noted,
    StudyFile,
    make_data_folder,
    remove_study,
    rename_study,
    studies_in_data_folder,
    study_path,
    verify,
)
from prefcal_env.study.beside import LEARNED, SIMULATED, beside_study, head_of


@pytest.fixture(autouse=True)
def _data_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


@pytest.mark.parametrize("text", ["a.prefcal", "./a", "some/a", "a.db", "/x/y"])
def test_a_separator_or_a_suffix_makes_a_path(text):
    assert study_path(text) == Path(text)


def test_a_name_lies_in_the_data_folder(tmp_path):
    path = study_path("mine")
    assert path.is_relative_to(tmp_path)
    assert path.name == "mine.prefcal"
    assert studies_in_data_folder() == []
    make_data_folder(path)
    path.touch()
    assert studies_in_data_folder() == [path]


@pytest.mark.parametrize("name", ["", "so bad", "ä", "a" * 200, "a\x00"])
def test_other_names_are_refused(name):
    with pytest.raises(StudyError, match="letters, digits"):
        study_path(name)


def test_only_the_data_folder_is_made(tmp_path):
    make_data_folder(tmp_path / "elsewhere" / "a.prefcal")
    assert not (tmp_path / "elsewhere").exists()


ELSEWHERE = """
import sys
from prefcal_env.errors import StudyError
from prefcal_env.study import remove_study, rename_study
try:
    remove_study(sys.argv[1]) if len(sys.argv) == 2 else rename_study(sys.argv[1], sys.argv[2])
    print("done")
except StudyError as error:
    print(error)
"""


def made(path):
    file = StudyFile.create(path, {"n_max": 3}, clock=lambda: "now")
    file.append(Noted("first"))
    return file


def in_another_process(*paths):
    words = [sys.executable, "-c", ELSEWHERE, *map(str, paths)]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


def test_a_removed_study_leaves_nothing_behind(tmp_path):
    made(tmp_path / "a.prefcal").close()
    remove_study(tmp_path / "a.prefcal")
    assert list(tmp_path.iterdir()) == []


def test_a_renamed_study_has_every_event(tmp_path):
    made(tmp_path / "a.prefcal").close()
    rename_study(tmp_path / "a.prefcal", tmp_path / "b.prefcal")
    assert [path.name for path in tmp_path.iterdir()] == ["b.prefcal"]
    assert not verify(tmp_path / "b.prefcal")
    with StudyFile.open(tmp_path / "b.prefcal", clock=lambda: "then") as file:
        assert file.state.notes == (("now", "first"),)


def test_a_study_that_is_open_elsewhere_stays(tmp_path):
    path = tmp_path / "a.prefcal"
    with made(path) as file:
        assert "open in another process" in in_another_process(path)
        assert "open in another process" in in_another_process(path, tmp_path / "b.prefcal")
        file.append(Noted("second"))  # it goes on as if nothing had been tried
    with StudyFile.open(path, clock=lambda: "then") as file:
        assert [text for _, text in file.state.notes] == ["first", "second"]
    assert in_another_process(path, tmp_path / "b.prefcal") == "done\n"


def test_a_rename_never_overwrites(tmp_path):
    for name in ("a.prefcal", "b.prefcal"):
        made(tmp_path / name).close()
    before = (tmp_path / "b.prefcal").read_bytes()
    with pytest.raises(StudyError, match="already"):
        rename_study(tmp_path / "a.prefcal", tmp_path / "b.prefcal")
    assert (tmp_path / "b.prefcal").read_bytes() == before
    assert (tmp_path / "a.prefcal").exists()


def test_a_damaged_study_can_be_removed(tmp_path):
    (tmp_path / "a.prefcal").write_text("no database " * 1000)
    remove_study(tmp_path / "a.prefcal")
    assert list(tmp_path.iterdir()) == []


def test_what_is_not_there_is_named(tmp_path):
    with pytest.raises(StudyError, match=r"no study file .*a\.prefcal"):
        remove_study(tmp_path / "a.prefcal")


def test_what_is_kept_beside_a_study_goes_with_it(tmp_path):
    made(tmp_path / "a.prefcal").close()
    for kind in (SIMULATED, LEARNED):
        (tmp_path / f"a.{kind}").write_bytes(head_of(kind, "key"))
    rename_study(tmp_path / "a.prefcal", tmp_path / "b.prefcal")
    assert {path.name for path in tmp_path.iterdir()} == {"b.prefcal", "b.simulated", "b.learned"}
    remove_study(tmp_path / "b.prefcal")
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_that_name_that_is_something_else_stays(tmp_path):
    made(tmp_path / "a.prefcal").close()
    made(tmp_path / "b.simulated").close()
    (tmp_path / "a.simulated").write_bytes(head_of(SIMULATED, ""))
    rename_study(tmp_path / "a.prefcal", tmp_path / "b.prefcal")
    remove_study(tmp_path / "b.prefcal")
    assert not verify(tmp_path / "b.simulated")


@pytest.mark.parametrize("kind", [SIMULATED, LEARNED])
def test_a_study_is_never_what_is_kept_beside_it(tmp_path, kind):
    for name in ("a.prefcal", f"a.{kind}", "a.db", "a"):
        assert beside_study(tmp_path / name, kind).name != name
