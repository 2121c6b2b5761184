"""Trouble with the file itself: its name, its folder, its owner, and others who use it."""

import os
import re
import sqlite3
import subprocess
import sys
import threading

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import Noted, StudyFile, export_json, import_json, verify
from support.interviews import clock
from support.studies import CONFIGURATION, small_study, tamper

NAMES = ["a" * 300 + ".prefcal", "a\0.prefcal", "\ud800.prefcal"]


@pytest.mark.parametrize("name", NAMES, ids=["too long", "with a zero", "half a character"])
def test_an_impossible_name_is_refused(tmp_path, name):
    with small_study(":memory:") as file:
        text = export_json(file)
    for attempt in (
        lambda: StudyFile.create(tmp_path / name, CONFIGURATION, clock=clock()),
        lambda: StudyFile.open(tmp_path / name, clock=clock()),
        lambda: verify(tmp_path / name),
        lambda: import_json(text, tmp_path / name),
    ):
        with pytest.raises(StudyError):
            attempt()
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_experiment_is_told_by_its_file_and_event(tmp_path):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    tamper(path, "UPDATE event SET payload = zeroblob(length(payload)) WHERE seq = 3")
    with (
        StudyFile.open(path, clock=clock()) as file,
        pytest.raises(StudyError, match=r"event 3 of .*a\.prefcal.*damaged.*--start"),
    ):
        file.experiment(3)


def test_a_study_that_is_read_for_long_is_told_and_goes_on_once_it_is_free(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        state = file.state
        file._connection.execute("PRAGMA busy_timeout = 20")
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN")
        other.execute("SELECT * FROM event").fetchall()
        with pytest.raises(StudyError, match=r"another process is using.*Nothing was recorded"):
            file.append(Noted("too early"))
        assert file.state == state
        other.execute("ROLLBACK")
        other.close()
        file.append(Noted("in time"))
    assert verify(path) == ()


def test_a_study_that_grows_meanwhile_is_sound_and_opened(tmp_path):
    path = tmp_path / "a.prefcal"
    enough = threading.Event()

    def write():
        while not enough.wait(0.01):
            file.append(Noted("more"))

    with small_study(path) as file:
        writer = threading.Thread(target=write)
        writer.start()
        try:
            for _ in range(20):
                assert verify(path) == ()
                StudyFile.open(path, clock=clock(), reading=True).close()
        finally:
            enough.set()
            writer.join()


SOMEBODY_ELSE = """
import os, sys
from prefcal_env.errors import StudyError
from prefcal_env.study import Noted, StudyFile
from support.interviews import clock
os.setuid(65534)
path = sys.argv[1]
for attempt in (
    lambda: StudyFile.open(path, clock=clock()).append(Noted("never")),
    lambda: StudyFile.create(path + ".new", {"n_max": 3}, clock=clock()),
):
    try:
        print("done", attempt())
    except StudyError as error:
        print("told", error)
"""


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() != 0, reason="only root can become somebody else")
@pytest.mark.parametrize(
    ("folder_mode", "opened"),
    [
        (0o755, "is read-only"),
        (0o777, "is read-only"),  # the file alone is root's
        (0o700, "Permission denied"),
    ],
    ids=["folder", "file", "nothing"],
)
def test_somebody_elses_study_is_told_and_left_alone(tmp_path, folder_mode, opened):
    folder = tmp_path / "theirs"
    folder.mkdir()
    path = folder / "a.prefcal"
    small_study(path).close()
    before = path.read_bytes()
    for above in (tmp_path, *tmp_path.parents):  # pytest keeps its folders to their owner
        if above.name.startswith(("pytest-", "popen-", "test_")):
            above.chmod(0o755)
    folder.chmod(folder_mode)
    done = subprocess.run(
        [sys.executable, "-c", SOMEBODY_ELSE, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    first, second = done.stdout.splitlines()
    assert re.match(rf"told cannot (open|write to) the study .*{opened}", first)
    assert second.startswith("done" if folder_mode == 0o777 else "told cannot begin the study")
    assert path.read_bytes() == before


def test_what_a_kill_left_of_a_study_is_not_in_the_way_of_the_next(tmp_path):
    """In a container, every process has the same id."""
    left = tmp_path / f".a.prefcal.{os.getpid()}.part"
    small_study(left).close()
    small_study(tmp_path / "a.prefcal").close()
    with small_study(":memory:") as file:
        import_json(export_json(file), tmp_path / "b.prefcal")
    assert verify(tmp_path / "a.prefcal") == verify(tmp_path / "b.prefcal") == ()
