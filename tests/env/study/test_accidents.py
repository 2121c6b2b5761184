"""Nothing acknowledged is lost, whatever happens to the file of an open or a closed study."""

import os
import random
import shutil
import sqlite3
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import Noted, StudyFile, data_folder, verify
from support.interviews import clock
from support.studies import CONFIGURATION, small_study


@pytest.fixture(autouse=True)
def at_home(tmp_path, monkeypatch):
    """Keep the data folder of this user out of the tests."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "home"))


def notes(path):
    with StudyFile.open(path, clock=clock(), reading=True) as file:
        return [text for _, text in file.state.notes]


def other_file(path):
    small_study(path.with_name("other")).close()
    path.with_name("other").replace(path)


GONE = {
    "removed": Path.unlink,
    "moved": lambda path: path.rename(path.parents[1] / "elsewhere.prefcal"),
    "replaced": other_file,
    "folder removed": lambda path: shutil.rmtree(path.parent),
    "folder renamed": lambda path: path.parent.rename(path.parents[1] / "renamed"),
}
POSIX = pytest.mark.skipif(os.name != "posix", reason="elsewhere an open file stays where it is")


@POSIX
@pytest.mark.parametrize("accident", GONE.values(), ids=GONE)
def test_no_answer_goes_into_a_file_that_is_gone_and_all_before_are_saved_elsewhere(tmp_path, accident):
    path = tmp_path / "studies" / "a.prefcal"
    path.parent.mkdir()
    with small_study(path) as file:
        file.append(Noted("acknowledged"))
        assert file.trouble() is None
        accident(path)
        for _ in range(2):  # the second refusal names the same copy
            with pytest.raises(StudyError, match=r"moved, renamed, removed or replaced") as told:
                file.append(Noted("refused"))
        assert str(told.value) == file.trouble()
        assert [text for _, text in file.state.notes] == ["acknowledged"]
    copies = [*tmp_path.rglob("*rescued*")]
    assert [notes(copy) for copy in copies] == [["acknowledged"]]
    assert str(told.value).endswith(str(copies[0]))
    assert verify(copies[0]) == ()
    assert copies[0].parent == (path.parent if path.parent.exists() else data_folder())


@POSIX
def test_a_study_that_is_put_back_goes_on(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        path.rename(tmp_path / "b.prefcal")
        with pytest.raises(StudyError, match="moved"):
            file.append(Noted("refused"))
        (tmp_path / "b.prefcal").rename(path)
        file.append(Noted("recorded"))
        assert file.trouble() is None
    assert notes(path) == ["recorded"]


def overwrite(path):
    """Write another study into the same file; SQLite counts as many changes in both."""
    other = path.with_name("other.prefcal")
    with small_study(other) as file:
        file.append(Noted("of another study"))
    path.write_bytes(other.read_bytes())


def cut(path, size):
    with path.open("r+b") as file:
        file.truncate(size)


CHANGES = {
    "overwritten": overwrite,
    "emptied": lambda path: cut(path, 0),
    "cut": lambda path: cut(path, path.stat().st_size - 4096),
}


@POSIX
@pytest.mark.parametrize("accident", CHANGES.values(), ids=CHANGES)
def test_no_answer_goes_into_a_file_that_another_program_changed_and_all_before_are_saved(tmp_path, accident):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        file.append(Noted("acknowledged"))
        accident(path)
        after = path.read_bytes()
        with pytest.raises(StudyError, match="changed by another program") as told:
            file.append(Noted("refused"))
        assert file.trouble() == str(told.value)
    assert path.read_bytes() == after
    (copy,) = tmp_path.glob("*rescued*")
    assert str(told.value).endswith(str(copy))
    assert notes(copy) == ["acknowledged"]
    assert verify(copy) == ()


@POSIX
@pytest.mark.parametrize("answered", [True, False])
def test_a_log_of_another_file_that_appears_beside_it_is_not_taken(tmp_path, answered):
    foreign = sqlite3.connect(tmp_path / "other.db")
    foreign.executescript("PRAGMA journal_mode = WAL; CREATE TABLE a (b); INSERT INTO a VALUES (1)")
    path = tmp_path / "a.prefcal"
    log = tmp_path / "a.prefcal-wal"
    with small_study(path) as file:
        file.append(Noted("acknowledged"))
        shutil.copy(tmp_path / "other.db-wal", log)
        if answered:
            with pytest.raises(StudyError, match="does not belong to"):
                file.append(Noted("refused"))
        assert "does not belong to" in file.trouble()
    log.unlink()
    assert notes(path) == ["acknowledged"]
    foreign.close()


def test_a_copy_of_the_file_alone_during_a_session_holds_every_answer(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        file.append(Noted("acknowledged"))
        assert [p.name for p in tmp_path.iterdir()] == ["a.prefcal"]
        copy = subprocess.run(
            [
                sys.executable,
                "-c",
                "import shutil, sys; shutil.copy(*sys.argv[1:])",
                path,
                tmp_path / "copy.prefcal",
            ],
            check=True,
        )
    assert copy.returncode == 0
    assert notes(tmp_path / "copy.prefcal") == ["acknowledged"]


SECOND = """
import sys
from prefcal_env.errors import StudyError
from prefcal_env.study import StudyFile
try:
    StudyFile.open(sys.argv[1], clock=str)
    print("opened")
except StudyError as error:
    print(error)
"""
REMOVES = SECOND.replace("StudyFile.open(sys.argv[1], clock=str)", "remove_study(sys.argv[1])").replace(
    "import StudyFile", "import remove_study"
)
LOCKED = """
import sqlite3, sys
try:
    sqlite3.connect(sys.argv[1], timeout=0, isolation_level=None).execute("BEGIN IMMEDIATE")
except sqlite3.OperationalError as error:
    print(error)
"""
NAMES = {
    "relative": lambda path: path.parent / ".." / path.parent.name / path.name,
    "hard link": lambda path: os.link(path, path.with_name("b")) or path.with_name("b"),
    "symbolic link": lambda path: os.symlink(path, path.with_name("b")) or path.with_name("b"),
}


@POSIX
@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES)
def test_a_second_process_is_told_at_once_under_any_name(tmp_path, name):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        words = [sys.executable, "-c", SECOND, name(path)]
        assert (
            "open in another process"
            in subprocess.run(words, capture_output=True, text=True, check=True).stdout
        )
        file.append(Noted("first"))
        assert verify(path) == ()
    assert notes(path) == ["first"]


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere SQLite's lock alone is held")
@pytest.mark.parametrize("second", [SECOND, REMOVES], ids=["opens", "removes"])
def test_the_lock_lasts_between_two_steps(tmp_path, second):
    path, said = tmp_path / "a.prefcal", []

    def come_between(statement):
        """Start another process just before SQLite locks the file again, as a rare one happens to."""
        if statement == "BEGIN IMMEDIATE":
            words = [sys.executable, "-c", second, path]
            said.append(subprocess.run(words, capture_output=True, text=True, check=True).stdout)

    with small_study(path) as file:
        file._connection.set_trace_callback(come_between)
        file.append(Noted("first"))
        file._connection.set_trace_callback(None)
    assert len(said) == 2
    assert all("open in another process" in words for words in said)
    assert notes(path) == ["first"]


@POSIX
def test_the_digest_of_an_open_study_is_that_of_its_file_and_unlocks_nothing(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        file.append(Noted("first"))
        found = file.digest
        words = [sys.executable, "-c", LOCKED, path]
        assert (
            subprocess.run(words, capture_output=True, text=True, check=True).stdout == "database is locked\n"
        )
    assert found == sha256(path.read_bytes()).hexdigest()


KILLED = """
import os, signal, sys
from prefcal_env.study import Noted, StudyFile
from prefcal_env.study.fold import Recorded
file = StudyFile.open(sys.argv[1], clock=str)
file._connection.execute("PRAGMA cache_size = 1")  # so pages are written before the end of a step
file._connection.execute("PRAGMA cache_spill = 1")
file._check_file()
row = Recorded(file._last + 1, "now", Noted("x" * 200_000))
file._insert([(row, None)])
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture
def killed(tmp_path):
    """A study whose process was killed within a step; return it and the log that this left."""
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        file.append(Noted("acknowledged"))
    subprocess.run([sys.executable, "-c", KILLED, path], check=False)
    log = path.with_name("a.prefcal-journal")
    assert log.stat().st_size
    return path, log


@POSIX
def test_a_step_that_a_kill_interrupts_is_rolled_back(killed):
    path, log = killed
    assert notes(path) == ["acknowledged"]
    assert not log.exists()
    assert verify(path) == ()


@POSIX
def test_a_log_left_by_a_crash_swallows_no_other_study(killed):
    path, log = killed
    path.rename(path.with_name("moved"))
    with pytest.raises(StudyError, match=r"a\.prefcal-journal does not belong"):
        StudyFile.create(path, CONFIGURATION, clock=clock())
    with small_study(path.with_name("other.prefcal"), now=lambda: "another time") as file:
        file.append(Noted("of another study"))
    path.with_name("other.prefcal").rename(path)
    before = path.read_bytes()
    for attempt in (notes, verify):
        with pytest.raises(StudyError, match=r"a\.prefcal-journal does not belong"):
            attempt(path)
    assert path.read_bytes() == before
    log.rename(path.with_name("moved-journal"))
    assert notes(path) == ["of another study"]
    assert notes(path.with_name("moved")) == ["acknowledged"]


@POSIX
def test_a_log_left_by_a_crash_does_not_damage_an_earlier_copy(killed):
    path, log = killed
    kept = log.read_bytes()
    assert notes(path) == ["acknowledged"]
    copy = path.read_bytes()
    with StudyFile.open(path, clock=clock()) as file:
        file.append(Noted("later"))
        file.append(Noted("still later"))
    log.write_bytes(kept)
    with pytest.raises(StudyError, match="does not belong"):
        StudyFile.open(path, clock=clock())
    path.write_bytes(copy)  # the state that the log was written for
    assert notes(path) == ["acknowledged"]


def read(path):
    with StudyFile.open(path, clock=clock(), reading=True) as file:
        found = file.state.finished.values()
        return list(file.events()), [file.experiment(seq) for seq in found]


@pytest.mark.parametrize("kind", ["flipped bit", "cut"])
def test_damage_of_a_closed_study_is_told_in_words(tmp_path, kind):
    path, damaged = tmp_path / "a.prefcal", tmp_path / "b.prefcal"
    small_study(path, answers=5).close()
    sound, before, draw = path.read_bytes(), read(path), random.Random(7)
    told = 0
    for _ in range(60):
        at = draw.randrange(len(sound))
        content = bytearray(sound[:at] if kind == "cut" else sound)
        if kind != "cut":
            content[at] ^= 1 << draw.randrange(8)
        damaged.write_bytes(content)
        try:
            found = verify(damaged)
            assert read(damaged) == before or found
        except StudyError:
            told += 1
    assert told > 5


def test_a_table_that_is_a_view_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    connection = sqlite3.connect(path)
    connection.executescript(
        "DROP TABLE event; CREATE VIEW event AS WITH RECURSIVE endless(seq) AS (SELECT 1 UNION "
        "ALL SELECT seq + 1 FROM endless) SELECT seq, '' AS at, '' AS body, NULL AS payload, "
        "0 AS checksum FROM endless;"
    )
    connection.close()
    with pytest.raises(StudyError, match=r"'event' of .* is not as created"):
        StudyFile.open(path, clock=clock())
    assert "'event' is not as prefcal created it" in verify(path)


def test_a_path_that_sqlite_would_take_for_an_address_is_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small_study("file:a.prefcal?mode=memory").close()
    assert [path.name for path in tmp_path.iterdir()] == ["file:a.prefcal?mode=memory"]
    small_study(Path(":memory:")).close()
    assert verify(tmp_path / ":memory:") == ()


def test_a_path_that_is_too_long_is_told(tmp_path):
    folder = tmp_path / ("d" * 200) / ("e" * 200)
    folder.mkdir(parents=True)
    for attempt in (small_study, verify):
        with pytest.raises(StudyError, match=r"has \d+ bytes, at most 480"):
            attempt(folder / ("f" * 100))


def test_a_step_that_the_folder_did_not_take_at_first_is_recorded_once(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        file._connection = Failing(file._connection)
        file.append(Noted("once"))
        file.append(Noted("twice"))
    assert notes(path) == ["once", "twice"]


class Failing:
    """Connection whose first COMMIT raises an error after it was done."""

    def __init__(self, connection):
        self._connection, self._failed = connection, False

    def __getattr__(self, name):
        return getattr(self._connection, name)

    def execute(self, statement, *values):
        found = self._connection.execute(statement, *values)
        if statement == "COMMIT" and not self._failed:
            self._failed = True
            raise sqlite3.OperationalError("disk I/O error")
        return found
