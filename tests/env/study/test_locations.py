"""Names and paths of studies."""

from pathlib import Path

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import make_data_folder, studies_in_data_folder, study_path


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
