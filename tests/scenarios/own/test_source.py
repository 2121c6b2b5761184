"""Fingerprints change with everything that a scenario or its model is made of."""

import sys

import pytest

from prefcal_scenarios.own import fingerprint, fingerprint_of_code, module_at

MODEL = "import gains_of_test\nTABLE = 'table.csv'\nmodel = 3\n"


@pytest.fixture
def model(tmp_path, monkeypatch):
    """A loaded file that imports another one and names a table."""
    for name, text in {"model_of_test": MODEL, "gains_of_test": "K = 2\n"}.items():
        (tmp_path / f"{name}.py").write_text(text)
    (tmp_path / "table.csv").write_text("1,2\n")
    module_at(tmp_path / "model_of_test.py")
    yield tmp_path
    for name in ("model_of_test", "gains_of_test"):
        sys.modules.pop(name, None)


@pytest.mark.parametrize("file", ["model_of_test.py", "gains_of_test.py", "table.csv"])
def test_it_changes_with_the_file_what_that_imports_and_the_tables_it_names(model, file):
    before = fingerprint_of_code()
    assert before == fingerprint_of_code()
    path = model / file
    path.write_text(path.read_text() + "\n")
    assert fingerprint_of_code() != before


def test_other_files_and_installed_modules_do_not_change_it(model):
    before = fingerprint_of_code()
    (model / "results.csv").write_text("3,4\n")
    import colorsys  # noqa: F401

    assert fingerprint_of_code() == before


def test_a_fingerprint_follows_content_name_and_configuration_but_not_the_place(tmp_path):
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "own.py").write_text("plant = 1\n")
    here, there = (f"{tmp_path / folder / 'own.py'}:plant" for folder in ("here", "there"))
    before = fingerprint(here)
    assert len(before) == 16
    assert int(before, 16) >= 0
    assert fingerprint(there) == before
    assert fingerprint(f"{here[: -len('plant')]}other") != before
    (tmp_path / "there" / "own.py").write_text("plant = 2\n")
    assert fingerprint(there) != before
    built_in = {fingerprint(name) for name in ("cstr", "overtake", 'overtake {"lanes_count": 3}')}
    assert len(built_in) == 3
    ordered = fingerprint('overtake {"lanes_count": 3, "duration": 20}')
    assert fingerprint('overtake {"duration": 20, "lanes_count": 3}') == ordered


def test_a_fingerprint_follows_the_files_that_a_configuration_or_a_toml_file_names(tmp_path):
    plant, toml = tmp_path / "model.py", tmp_path / "tank.toml"
    plant.write_text("plant = 1\n")
    toml.write_text('controller = "pid"\nplant = "model.py:plant"\n')
    sources = (str(toml), 'pid {"plant": "' + f"{plant}:plant" + '"}')
    before = [fingerprint(source) for source in sources]
    plant.write_text("plant = 2\n")
    assert [a == b for a, b in zip(before, map(fingerprint, sources), strict=True)] == [False] * 2


def test_a_fingerprint_follows_the_modules_that_a_file_imports(tmp_path):
    files = {
        "own.py": "from model import plant\nimport os, parts.valve\nfrom parts import pump\n",
        "model.py": "import constants\n",
        "constants.py": "import model\nK = 1\n",
        "parts/__init__.py": "",
        "parts/valve.py": "from . import seat\n",
        "parts/seat.py": "import top\n",
        "parts/pump.py": "from .seat import x\n",
        "top.py": "",
        "else.py": "",
    }
    (tmp_path / "parts").mkdir()
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    source = f"{tmp_path / 'own.py'}:plant"
    for name in files:
        before = fingerprint(source)
        with (tmp_path / name).open("a") as file:
            file.write("# changed")
        assert (fingerprint(source) != before) is (name != "else.py"), name


def test_modules_that_all_import_each_other_are_read_once_each(tmp_path):
    names = [f"m{k}" for k in range(40)]
    for name in ("own", *names):
        (tmp_path / f"{name}.py").write_text(f"import {', '.join(names)}\n")
    assert len(fingerprint(f"{tmp_path / 'own.py'}:plant")) == 16  # following every path would never end
