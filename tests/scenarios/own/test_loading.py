"""Files that take long to load: a word soon; exit in a file is an error."""

import logging
import sys

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


@pytest.mark.parametrize("text", ["import fractions", "from fractions import Fraction", "import fractions.x"])
def test_a_file_with_the_name_of_a_library_that_it_imports_is_to_be_renamed(tmp_path, text):
    path = tmp_path / "fractions.py"
    path.write_text(f"{text}\n")
    with pytest.raises(ScenarioError, match=r"same name as the library 'fractions', .* rename the file"):
        module_at(path)


def test_a_file_with_the_name_of_a_library_that_nobody_imports_is_loaded(tmp_path):
    path = tmp_path / "xdrlib.py"
    path.write_text("x = 1\n")
    assert module_at(path).x == 1
    del sys.modules["xdrlib"]


@pytest.mark.parametrize("text", ["import wave\nwave.open", "from wave import open", "import wave.more"])
def test_a_file_beside_that_hides_a_library_is_named(tmp_path, text):
    (tmp_path / "wave.py").write_text("x = 1\n")
    path = tmp_path / "own.py"
    path.write_text(f"{text}\n")
    with pytest.raises(ScenarioError, match=r"wave\.py hides the library 'wave': rename it"):
        module_at(path)
    sys.modules.pop("wave", None)


def test_a_mistake_in_a_file_beside_that_hides_nothing_is_told_as_it_is(tmp_path):
    (tmp_path / "tank_of_mine.py").write_text("x = 1\n")
    path = tmp_path / "own.py"
    path.write_text("import tank_of_mine\ntank_of_mine.y\n")
    with pytest.raises(ScenarioError) as caught:
        module_at(path)
    assert "has no attribute 'y'" in str(caught.value)
    assert "rename" not in str(caught.value)
