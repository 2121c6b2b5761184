"""Files that take long to load: a word soon; exit in a file is an error."""

import logging

import pytest

from prefcal_env.errors import ScenarioError
from prefcal_scenarios import own
from prefcal_scenarios.own import SAYS, module_at


@pytest.fixture
def said(monkeypatch):
    """What is said while a file loads; it is said soon."""
    words = []
    listener = logging.Handler(logging.INFO)
    listener.emit = lambda record: words.append(record.getMessage())
    monkeypatch.setattr(SAYS, "handlers", [listener])
    monkeypatch.setattr(own, "_SOON", 0.3)
    SAYS.setLevel(logging.INFO)
    yield words
    SAYS.setLevel(logging.NOTSET)


def test_a_file_that_takes_long_to_load_is_named_with_its_line(tmp_path, said):
    path = tmp_path / "own.py"
    path.write_text("import time\ntime.sleep(1.5)\n")
    module_at(path)
    (words,) = said
    assert "loading own.py takes a while, it is in own.py:2: time.sleep(1.5)" in words


def test_nothing_is_said_of_a_file_that_loads_quickly(tmp_path, said):
    path = tmp_path / "own.py"
    path.write_text("x = 1\n")
    assert module_at(path).x == 1
    assert said == []


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("sys.exit(4)", r"SystemExit: 4 \(line 2\), in own.py:2: sys.exit\(4\)"),
        ("raise GeneratorExit", r"GeneratorExit: +\(line 2\)"),
    ],
)
def test_a_file_that_ends_the_program_is_an_error_with_its_line(tmp_path, line, words):
    path = tmp_path / "own.py"
    path.write_text(f"import sys\n{line}\n")
    with pytest.raises(ScenarioError, match=r"cannot load .*own.py': " + words):
        module_at(path)
