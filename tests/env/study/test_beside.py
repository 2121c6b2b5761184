"""What is kept beside a study: whole, of the same key, or nothing; and what is something else stays."""

import os

import pytest

from prefcal_env.study.beside import LEARNED, beside_study, read_learned, write_learned


@pytest.fixture
def kept(tmp_path):
    study = tmp_path / "mine.prefcal"
    write_learned(study, "key", b"draws" * 100)
    assert read_learned(study, "key") == b"draws" * 100
    return study


def flipped(content):
    return content[:200] + bytes([content[200] ^ 1]) + content[201:]


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: b"",
        lambda content: content[:-1],
        lambda content: content[:20],
        lambda content: content + b"x",
        lambda content: content.replace(b"key", b"KEY"),
        lambda content: content.replace(b"learned", b"simulated"),
        flipped,
    ],
    ids=["empty", "cut", "cut in its head", "longer", "foreign", "of another kind", "flipped"],
)
def test_what_is_damaged_or_foreign_is_nothing_and_written_again(kept, damage):
    path = beside_study(kept, LEARNED)
    path.write_bytes(damage(path.read_bytes()))
    assert read_learned(kept, "key") == b""
    write_learned(kept, "key", b"again")
    assert read_learned(kept, "key") == b"again"


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "missing/a"])
def test_a_place_that_cannot_be_is_nothing(tmp_path, name):
    write_learned(tmp_path / name, "key", b"draws")
    assert read_learned(tmp_path / name, "key") == b""
    assert list(tmp_path.iterdir()) == []


def test_a_folder_or_another_file_of_that_name_stays(tmp_path):
    (tmp_path / "mine.learned").mkdir()
    (tmp_path / "yours.learned").write_text("a diary")
    os.mkfifo(tmp_path / "ours.learned")  # without a writer: whoever opens it waits for one
    for name in ("mine", "yours", "ours"):
        write_learned(tmp_path / f"{name}.prefcal", "key", b"draws")
        assert read_learned(tmp_path / f"{name}.prefcal", "key") == b""
    assert (tmp_path / "mine.learned").is_dir()
    assert (tmp_path / "yours.learned").read_text() == "a diary"
    assert (tmp_path / "ours.learned").is_fifo()
