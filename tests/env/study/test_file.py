"""The study file: durable, append-only, shared safely, and clear about trouble."""

import os
import signal
import sqlite3
import subprocess
import sys
import threading

import numpy as np
import pytest

from prefcal_env.errors import StudyError
from prefcal_env.preferences.answer import Answer
from prefcal_env.study import Answered, Finished, Marked, Noted, Shown, StudyFile, Suggested, Undone, verify
from prefcal_env.study import file as schema
from support.interviews import clock
from support.studies import CONFIGURATION, experiment, small_study

THIRD = 0.05 + 0.1 * 3


def reopen(path):
    return StudyFile.open(path, clock=clock())


def test_what_was_appended_is_there_after_reopening(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        state, events = file.state, list(file.events())
    with reopen(path) as again:
        assert again.state == state
        assert list(again.events()) == events
        assert again.experiment(again.state.finished[2]) == experiment(0.25)
    assert verify(path) == ()
    assert [p.name for p in tmp_path.iterdir()] == ["a.prefcal"]  # no log beside it


def test_a_study_in_memory_leaves_no_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with small_study(":memory:") as file:
        assert file.state.history.answered == 4
    assert list(tmp_path.iterdir()) == []


def test_appending_is_all_or_nothing(tmp_path):
    with small_study(tmp_path / "a.prefcal") as file:
        before = list(file.events())
        with pytest.raises(StudyError, match="sample 7 was never proposed"):
            file.append(Noted("first"), Marked(7, "unsafe", True))
        assert list(file.events()) == before
        file.append(Noted("second"))
        assert file.state.notes[-1][1] == "second"


def test_events_can_neither_be_changed_nor_removed(tmp_path):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    connection = sqlite3.connect(path)
    for statement in ("UPDATE event SET at = ''", "DELETE FROM event"):
        with pytest.raises(sqlite3.IntegrityError, match="only appended"):
            connection.execute(statement)
    connection.close()


def test_an_existing_file_is_never_overwritten(tmp_path):
    path = tmp_path / "a.prefcal"
    path.write_text("precious")
    with pytest.raises(StudyError, match="never overwrites"):
        StudyFile.create(path, CONFIGURATION, clock=clock())
    assert path.read_text() == "precious"


def test_an_open_study_can_be_read_but_not_be_opened_for_writing(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as first:
        with pytest.raises(StudyError, match="open in another process"):
            reopen(path)
        first.append(Noted("first"))
        with StudyFile.open(path, clock=clock(), reading=True) as second:
            assert second.state == first.state
            with pytest.raises(StudyError, match="for reading only"):
                second.append(Noted("second"))
        first.append(Noted("third"))
    with reopen(path) as file:
        assert [text for _, text in file.state.notes] == ["first", "third"]
    assert verify(path) == ()


def test_many_threads_append_to_one_study(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        many = [
            threading.Thread(target=lambda k=k: [file.append(Noted(f"{k}")) for _ in range(20)])
            for k in range(6)
        ]
        for thread in many:
            thread.start()
        for thread in many:
            thread.join()
        assert len(file.state.notes) == 120
    assert verify(path) == ()


def test_an_experiment_is_found_by_its_parameters_also_after_an_undo(tmp_path):
    with small_study(tmp_path / "a.prefcal") as file:
        seq = file.state.finished[3]
        file.append(Undone())
        file.append(Undone())
        assert 3 not in file.state.finished
        assert file.find_experiment(np.array([THIRD])) == seq
        assert file.find_experiment(np.array([0.36])) is None
        (shown,) = file.append(Shown(2, 1, True))
        file.append(Answered(shown, 2, 1, Answer(0)))
        file.append(Suggested(3, (THIRD,), (THIRD,)), Finished(3, same_as=seq))
        assert file.experiment(file.state.finished[3]) == experiment(THIRD)


def test_a_full_disk_is_told_and_loses_nothing(tmp_path):
    path = tmp_path / "a.prefcal"
    with small_study(path) as file:
        pages = file._connection.execute("PRAGMA page_count").fetchone()[0]
        file._connection.execute(f"PRAGMA max_page_count = {pages + 1}")
        state = file.state
        big = experiment(0.95, count=20_000)
        with pytest.raises(StudyError, match=r"the disk is full.*Nothing was recorded"):
            file.append(Suggested(4, (0.95,), (0.95,)), (Finished(4), big))
        assert file.state == state
        file._connection.execute("PRAGMA max_page_count = 1073741823")
        file.append(Suggested(4, (0.95,), (0.95,)), (Finished(4), big))
    assert verify(path) == ()


def limited(folder, code, *, bytes_):
    """Run Python code in a process that may write files of `bytes_` only."""
    resource = pytest.importorskip("resource", reason="only POSIX limits the size of files")

    def before():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_, bytes_))

    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=before,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_DISABLE_JIT": "1"}
        # The limit would cut compiled modules short, too, which every later process would load.
        | {"PYTHONDONTWRITEBYTECODE": "1"},
    )


def test_a_disk_that_takes_no_more_bytes_is_told(tmp_path):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    code = (
        "from support.interviews import clock\n"
        "from support.studies import compared\n"
        "from prefcal_env.errors import StudyError\n"
        "from prefcal_env.study import StudyFile\n"
        "file = StudyFile.open('a.prefcal', clock=clock())\n"
        "try:\n"
        "    for index in range(4, 500):\n"
        "        compared(file, index)\n"
        "        print('safe', index, flush=True)\n"
        "except StudyError as error:\n"
        "    print('told', error)\n"
    )
    done = limited(tmp_path, code, bytes_=120_000)
    *safe, told = done.stdout.splitlines()
    assert told.startswith("told cannot write to the study"), done.stdout + done.stderr
    assert "Nothing was recorded" in told
    assert verify(path) == ()
    with reopen(path) as file:
        assert file.state.history.answered >= 4 + len(safe)


@pytest.mark.parametrize("content", [b"", b"no database", b"SQLite format 3\x00" + bytes(100)])
def test_another_file_is_refused(tmp_path, content):
    path = tmp_path / "a.prefcal"
    path.write_bytes(content)
    with pytest.raises(StudyError):
        reopen(path)
    assert path.read_bytes() == content


def test_another_programs_database_is_refused(tmp_path):
    path = tmp_path / "a.prefcal"
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE event (seq INTEGER)")
    connection.commit()
    connection.close()
    with pytest.raises(StudyError, match="not a study of prefcal"):
        reopen(path)


@pytest.mark.parametrize(
    ("version", "advice"), [(schema.VERSION + 1, "install a newer prefcal"), (1, "start the study again")]
)
def test_another_format_is_refused_and_left_alone(tmp_path, version, advice):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version = {version}")
    connection.close()
    before = path.read_bytes()
    for read in (reopen, verify):
        with pytest.raises(StudyError, match=f"has format {version} .*{advice}"):
            read(path)
    assert path.read_bytes() == before


def test_a_study_without_experiments_is_an_empty_table():
    knobs = [{"name": "gain", "unit": "1/s", "low": 0.0, "high": 1.0}]
    configuration = {"n_max": 3, "knobs": knobs, "kpis": []}
    with StudyFile.create(":memory:", configuration, clock=lambda: "now") as study:
        assert list(study.to_frame().columns)[:2] == ["gain [1/s]", "ended"]
        assert len(study.to_frame(answers=True)) == 0
        assert "0 experiments, 0 answers" in study._repr_html_()


def test_only_answers_about_new_experiments_have_a_number():
    with small_study(":memory:", answers=2) as study:
        (again,) = study.append(Shown(1, 0, True, study.state.history.comparisons[1].question))
        study.append(Answered(again, 1, 0, Answer(0)))
        (further,) = study.append(Shown(2, 0, True))
        study.append(Answered(further, 2, 0, Answer(1)))
        answers = study.to_frame(answers=True)
    assert answers["challenger"].tolist() == [2, 3, 2, 3]
    assert answers.index.isna().tolist() == [False, False, True, True]


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
        assert answers.index.tolist() == [1, 2, 3]
        shown = study._repr_html_()
        assert "4 experiments, 3 answers, best experiment 2" in shown
        assert "late [s]" in shown
