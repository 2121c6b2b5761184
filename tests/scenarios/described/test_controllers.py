"""A standard controller is one file and one row: commands, files and best.json follow from them."""

import sys

import numpy as np
import pytest

from prefcal_env import Move
from prefcal_env.controllers import as_data
from prefcal_env.controllers.stored import KINDS, storable
from prefcal_scenarios import names
from prefcal_scenarios.described import description, making


@pytest.mark.parametrize(("word", "kind"), names.CONTROLLERS.items())
def test_every_standard_controller_has_a_scenario_and_a_stored_form(word, kind):
    assert making._maker(word).__name__ == f"{word}_scenario"
    assert kind in KINDS


def test_messages_name_every_standard_controller():
    assert names.either(["pid"]) == "pid"
    assert names.either(["pid", "lqr", "smith"]) == "pid, lqr or smith"
    assert all(f'"{word}"' in description._CONTROLLER for word in names.CONTROLLERS)


class Switch:
    """A controller on or off at r, which another package could add."""

    def __init__(self, high):
        self.high, self.T_s = high, 1.0

    def move(self, measurement):
        return Move(np.array([self.high * (measurement.y_ref[0] > measurement.y[0])]))

    def as_data(self):
        return {"high": self.high}

    @classmethod
    def of_data(cls, data):
        return cls(**data)


def test_a_controller_of_another_file_is_stored_once_its_row_is_there(monkeypatch):
    monkeypatch.delitem(KINDS, "Switch", raising=False)
    assert making.controller_of({"controller": "Switch", "high": 5.0}) is None
    monkeypatch.setattr(making, "CONTROLLERS", {**names.CONTROLLERS, "switch": "Switch"})
    monkeypatch.setattr(making, "import_module", lambda name: storable(Switch) and sys.modules[__name__])
    monkeypatch.setattr(sys.modules[__name__], "switch_scenario", Switch, raising=False)
    made = making.controller_of({"controller": "Switch", "high": 5.0})
    assert made.high == 5.0
    assert as_data(made) == {"controller": "Switch", "high": 5.0}
    monkeypatch.delitem(KINDS, "Switch")
