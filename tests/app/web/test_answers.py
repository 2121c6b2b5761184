"""Errors are told in a sentence, with a status that fits."""

import sqlite3

import pytest

from prefcal_app.session.actions import Finish
from prefcal_env.errors import PrefcalError, RecordError, StaleError, StudyError


@pytest.mark.parametrize(
    ("error", "status", "kind"),
    [
        (StaleError("late"), 409, "stale"),
        (RecordError("column 3"), 422, "record"),
        (StudyError("the disk is full"), 507, "study"),
        (PrefcalError("no"), 422, "refused"),
    ],
)
def test_errors_are_told_in_a_sentence(room, monkeypatch, error, status, kind):
    def fail(self, flow):
        raise error

    monkeypatch.setattr(Finish, "_take", fail)
    response = room.post("finish")
    told = response.json()
    assert (response.status_code, told["kind"], told["error"]) == (status, kind, str(error))
    assert (told["now"] is not None) == (status == 409)


def test_a_fault_of_ours_is_told_and_logged(room, monkeypatch, caplog):
    def fail(self, flow):
        raise sqlite3.InterfaceError("a bug")

    monkeypatch.setattr(Finish, "_take", fail)
    response = room.post("finish")
    assert response.status_code == 500
    assert "a bug" in response.json()["error"]
    assert response.headers["cache-control"] == "no-store"
    assert "a bug" in caplog.text
