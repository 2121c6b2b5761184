"""The command that prints the numbers of the project counts what it says."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
CODE = """
import os

class Plant:
    level: float
    _hidden: float

    def run(self):
        import json
        self.ended = True

        def inner():
            from math import pi

    @property
    def name(self):  # a comment for people
        return ""
"""


@pytest.fixture
def house(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "checks")
    return importlib.import_module("house")


def test_members_late_imports_and_comments_are_counted_once(house, tmp_path):
    tree = ast.parse(CODE)
    assert house.public_members(tree.body[1]) == {"level", "run", "ended", "name"}
    assert house.late_imports(tree) == 2
    file = tmp_path / "plant.py"
    file.write_text(CODE + "pi = 3  # type: ignore\n")
    assert house.comments(file) == 1
    assert house.lines([file]) == CODE.count("\n") + 1


def test_every_number_has_a_target_and_what_counts_is_named(house):
    rows = {row.what: row for row in house.rows(traced=False)}
    assert len(rows) == 11
    assert rows["floors inside a package"].met
    assert rows["public names at the three doors"].value <= 60
    late = rows["imports inside functions"]
    assert late.value == sum(int(place.split()[-1]) for place in late.where)
    twice = rows["class names that exist twice"]
    assert len(twice.where) == twice.value
    assert not house.Count("comments", 16, 40, least=True).met
