"""Whatever is done to a study file behind its back is found."""

import sqlite3

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.studies import StudyFile, export_csv, export_json, import_json, verify
from prefcal_env.studies.codec import encode, pack
from support.interviews import clock
from support.studies import experiment, small_study

TAMPERING = {
    "a verdict turned": "UPDATE event SET "
    "body = replace(body, '\"preference\":-1', '\"preference\":1') "
    "WHERE kind = 'answered' AND body LIKE '%\"preference\":-1%'",
    "another time": "UPDATE event SET at = 'never' WHERE seq = 3",
    "another kind": "UPDATE event SET kind = 'undone', body = '{}' WHERE seq = 8",
    "an event in the middle gone": "DELETE FROM event WHERE seq = 5",
    "the first gone": "DELETE FROM event WHERE seq = 1",
    "the last gone": "DELETE FROM event WHERE seq = (SELECT max(seq) FROM event)",
    "the last two gone": "DELETE FROM event WHERE seq >= (SELECT max(seq) - 1 FROM event)",
    "a payload gone": "UPDATE event SET payload = NULL WHERE seq = 3",
    "a payload that is none": "UPDATE event SET payload = x'00' WHERE seq = 3",
    "an event added": "INSERT INTO event SELECT seq + 1, at, kind, body, payload, hash FROM event "
    "WHERE seq = (SELECT max(seq) FROM event)",
    "a hash changed": "UPDATE event SET hash = 'abc' WHERE seq = 4",
    "two swapped": "UPDATE event SET seq = 1000 - seq WHERE seq IN (4, 5); "
    "UPDATE event SET seq = CASE seq WHEN 996 THEN 5 ELSE 4 END WHERE seq > 900",
    "the head moved": "UPDATE head SET count = count - 1",
    "the head gone": "DELETE FROM head",
}


def tamper(path, script):
    connection = sqlite3.connect(path)
    for (name,) in connection.execute(
        "SELECT name FROM sqlite_master WHERE type = 'trigger'"
    ).fetchall():
        connection.execute(f"DROP TRIGGER {name}")
    connection.executescript(script)
    changed = connection.total_changes
    connection.commit()
    connection.close()
    return changed


@pytest.mark.parametrize("script", TAMPERING.values(), ids=TAMPERING)
def test_tampering_is_found(tmp_path, script):
    path = tmp_path / "a.prefcal"
    small_study(path, answers=4).close()
    assert verify(path) == ()
    assert tamper(path, script)
    assert verify(path) != ()


def test_another_experiment_in_place_of_one_is_found(tmp_path):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    connection = sqlite3.connect(path)
    connection.execute("DROP TRIGGER event_is_never_changed")
    other = pack(encode(experiment(0.05, count=5)))
    connection.execute("UPDATE event SET payload = ? WHERE seq = 3", (other,))
    connection.commit()
    connection.close()
    assert any("event 3" in finding for finding in verify(path))


def test_another_compression_of_the_same_experiment_is_no_change(tmp_path):
    import zlib

    path = tmp_path / "a.prefcal"
    small_study(path).close()
    connection = sqlite3.connect(path)
    connection.execute("DROP TRIGGER event_is_never_changed")
    other = zlib.compress(encode(experiment(0.05)), 1)
    connection.execute("UPDATE event SET payload = ? WHERE seq = 3", (other,))
    connection.commit()
    connection.close()
    assert verify(path) == ()


def test_a_file_that_is_not_there_is_told(tmp_path):
    with pytest.raises(StudyError, match="there is no study file"):
        verify(tmp_path / "a.prefcal")


def test_an_export_is_read_back_unchanged(tmp_path):
    with small_study(tmp_path / "a.prefcal") as file:
        text, events = export_json(file), list(file.events())
    path = import_json(text, tmp_path / "b.prefcal")
    assert verify(path) == ()
    with StudyFile.open(path, clock=clock()) as twin:
        assert list(twin.events()) == events
        assert export_json(twin) == text


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('\\"preference\\":-1', '\\"preference\\":1'),
        ('"prefcal study": 1', '"prefcal study": 2'),
        ('"kind": "created"', '"kind": "undone"'),
        ('"seq": 2,', '"seq": 3,'),
        ('"payload": "', '"payload": "!'),
        ('"payload": "eJ', '"payload": "AA'),
        ('"events"', '"event"'),
    ],
)
def test_a_changed_export_is_refused_and_leaves_no_file(tmp_path, old, new):
    with small_study(tmp_path / "a.prefcal") as file:
        text = export_json(file)
    assert old in text
    with pytest.raises(StudyError):
        import_json(text.replace(old, new, 1), tmp_path / "b.prefcal")
    assert [p.name for p in tmp_path.iterdir()] == ["a.prefcal"]


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "null", "{" * 2000, '{"prefcal study": 1, "events": []}']
)
def test_other_text_is_no_export(tmp_path, text):
    with pytest.raises(StudyError, match="no exported study"):
        import_json(text, tmp_path / "b.prefcal")


def test_tables_hold_units_and_no_formulas(tmp_path):
    from prefcal_env.preference import Answer
    from prefcal_env.studies import Answered, Shown, Undone

    with small_study(tmp_path / "a.prefcal") as file:
        file.append(Undone())
        (shown,) = file.append(Shown(3, 0, True))
        file.append(Answered(shown, 3, 0, Answer(1), "=HYPERLINK(1)"))
        export_csv(file, tmp_path / "tables")
    comparisons = (tmp_path / "tables" / "comparisons.csv").read_text("utf-8")
    assert "'=HYPERLINK(1)" in comparisons
    assert "gain [m/%]" in (tmp_path / "tables" / "experiments.csv").read_text("utf-8")
    curves = (tmp_path / "tables" / "trajectories" / "experiment-001.csv").read_text("utf-8")
    assert curves.splitlines()[0] == "time [s],level [m],valve [%]"
    assert len(curves.splitlines()) == 5
