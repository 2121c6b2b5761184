"""Whatever is done to a study file behind its back is found."""

import sqlite3

import pytest

from prefcal_env.errors import StudyError
from prefcal_env.study import StudyFile, export_json, import_json, verify
from support.interviews import clock
from support.studies import small_study, tamper

TAMPERING = {
    "no JSON": "UPDATE event SET body = 'so' WHERE seq = 3",
    "another event": """UPDATE event SET body = '{"kind":"undone"}' WHERE seq = 2""",
    "an event in the middle gone": "DELETE FROM event WHERE seq = 5",
    "the first gone": "DELETE FROM event WHERE seq = 1",
    "all gone": "DELETE FROM event",
    "a payload gone": "UPDATE event SET payload = NULL WHERE seq = 3",
    "a payload that is none": "UPDATE event SET payload = x'00' WHERE seq = 3",
    "a payload too many": "UPDATE event SET payload = (SELECT payload FROM event WHERE seq = 3) "
    "WHERE seq = 4",
    "an answer given twice": "INSERT INTO event SELECT seq + 1, at, body, payload, 0 FROM event "
    "WHERE seq = (SELECT max(seq) FROM event)",
    "two swapped": "UPDATE event SET seq = 1000 - seq WHERE seq IN (2, 3); "
    "UPDATE event SET seq = CASE seq WHEN 998 THEN 3 ELSE 2 END WHERE seq > 900",
    "a question about another experiment": "UPDATE event SET "
    "body = replace(body, '\"challenger\":1', '\"challenger\":0') "
    "WHERE body LIKE '%\"shown\"%'",
    "a repeated question that never was": "INSERT INTO event SELECT seq + 1, at, "
    """'{"kind":"shown","challenger":1,"incumbent":0,"challenger_left":true,"repeats":2}', NULL, """
    "0 FROM event WHERE seq = (SELECT max(seq) FROM event)",
    "an experiment of an event that has none": "INSERT INTO event SELECT seq + 1, at, "
    """'{"kind":"finished","index":1,"same_as":2}', NULL, 0 """
    "FROM event WHERE seq = (SELECT max(seq) FROM event)",
}


@pytest.mark.parametrize("signed", [False, True], ids=["by accident", "with checksums"])
@pytest.mark.parametrize("script", TAMPERING.values(), ids=TAMPERING)
def test_damage_is_found(tmp_path, script, signed):
    path = tmp_path / "a.prefcal"
    small_study(path, answers=4).close()
    assert verify(path) == ()
    assert tamper(path, script, signed=signed)
    assert verify(path) != ()


@pytest.mark.parametrize(
    ("statement", "name"),
    [
        ("DROP TRIGGER event_is_never_changed", "event_is_never_changed"),
        ("CREATE TABLE further (a TEXT)", "further"),
        ("ALTER TABLE event ADD COLUMN more TEXT", "event"),
    ],
)
def test_changed_tables_are_found(tmp_path, statement, name):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    connection = sqlite3.connect(path)
    connection.execute(statement)
    connection.close()
    assert verify(path) == (f"{name!r} is not as prefcal created it",)


def test_a_page_that_went_bad_is_found(tmp_path):
    path = tmp_path / "a.prefcal"
    small_study(path).close()
    content = bytearray(path.read_bytes())
    content[4096:8192] = bytes(4096)  # where the events begin
    path.write_bytes(content)
    assert any("the file is damaged" in finding for finding in verify(path))


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
        ('"preference": -1', '"preference": 7'),
        ('"prefcal study": 2', '"prefcal study": 3'),
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


@pytest.mark.parametrize("text", ["", "{}", "[]", "null", "{" * 2000])
def test_other_text_is_no_export(tmp_path, text):
    with pytest.raises(StudyError, match="not an exported study"):
        import_json(text, tmp_path / "b.prefcal")
