"""Files that take long to load: a word soon, and an end in time; exit in a file is an error."""

import logging
import signal

import pytest

from prefcal_env.errors import ScenarioError
from prefcal_scenarios.own import loading
from prefcal_scenarios.own.own_file import module_at


@pytest.fixture
def said(monkeypatch):
    """What is said while a file loads; it is said at once, and the time limit is short."""
    words = []
    listener = logging.Handler(logging.INFO)
    listener.emit = lambda record: words.append(record.getMessage())
    monkeypatch.setattr(loading.SAYS, "handlers", [listener])
    monkeypatch.setattr(loading, "_SOON", 0.3)
    monkeypatch.setattr(loading, "_LIMIT", 0.2)
    monkeypatch.setattr(loading, "_GRACE", 60.0)  # a busy machine may need long to raise
    # A shell ignores the signal in what it starts in the background.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    loading.SAYS.setLevel(logging.INFO)
    yield words
    loading.SAYS.setLevel(logging.NOTSET)
    signal.signal(signal.SIGINT, before)


def test_a_file_that_never_ends_loading_is_named_with_its_line_and_ended(tmp_path, said):
    path = tmp_path / "own.py"
    path.write_text("import time\nwhile True:\n    time.sleep(0.01)\n")
    with pytest.raises(ScenarioError, match=r"loading own.py took longer than 0.2 s and was ended"):
        module_at(path)
    (words,) = said
    assert "loading own.py takes a while, it is in own.py:3: time.sleep(0.01)" in words


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
