"""The two parts of the suite: nothing is lost between them, and what is missing is said."""

import subprocess
import sys
from pathlib import Path

import pytest

from support import browser, parts

FILES = [path.relative_to(parts.TESTS).as_posix() for path in parts.TESTS.rglob("test_*.py")]
WHOLE, SINGLE = (
    "import pytest\npytest.importorskip('not_there')\ndef test_a(): 1 / 0\n",
    (
        "import pytest\n"
        "def test_b(): pytest.importorskip('not_there')\n"
        "def test_c(): pytest.skip('needs a plant: call the plant manager')\n"
        "def test_d(): pytest.skip('only on Tuesdays')\n"
        "@pytest.mark.extended\n"
        "def test_e(): pass\n"
        "@pytest.mark.campaign\n"
        "def test_f(): 1 / 0\n"
    ),
)


@pytest.fixture
def run(tmp_path):
    """Run two small files of tests that lack things, with these words: what is printed."""
    (tmp_path / "test_whole.py").write_text(WHOLE)
    (tmp_path / "test_single.py").write_text(SINGLE)
    (tmp_path / "pytest.ini").write_text(
        f"[pytest]\npythonpath = {parts.TESTS}\ntestpaths = .\nmarkers =\n campaign\n extended\n"
    )
    (tmp_path / "conftest.py").write_text('pytest_plugins = ["support.parts"]\n')

    def start(*words):
        done = subprocess.run(
            [sys.executable, "-m", "pytest", *words],
            cwd=tmp_path,
            text=True,
            capture_output=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return start


@pytest.mark.parametrize(
    ("words", "counts"),
    [
        ((), "4 skipped, 2 deselected"),
        (("test_single.py", "test_whole.py"), "1 passed, 4 skipped, 1 deselected"),
        (("-m", "extended"), "1 passed, 5 deselected"),
    ],
    ids=["alone", "named files", "the extended part"],
)
def test_named_files_run_in_full_and_pytest_alone_runs_the_first_part(run, words, counts):
    assert counts in run(*words)


@pytest.mark.parametrize("words", [(), ("-n", "2")], ids=["one process", "two workers"])
def test_what_is_missing_is_said_once_for_each_cause_and_is_no_failure(run, words):
    assert sorted(line for line in run(*words).splitlines() if " need" in line) == [
        "1 file needs not_there: pip install -e '.[dev]'",
        "1 test needs a plant: call the plant manager",
        "1 test needs not_there: pip install -e '.[dev]'",
    ]


def test_a_test_with_a_browser_is_extended_and_needs_chromium(request, monkeypatch):
    item = pytest.Function.from_parent(request.node.parent, name="test_x", callobj=lambda browser: 0)
    parts.pytest_collection_modifyitems([item])
    assert {"browser", "extended"} <= {mark.name for mark in item.iter_markers()}
    monkeypatch.setattr(browser, "CHROMIUM", None)
    with pytest.raises(pytest.skip.Exception, match="needs Chromium: apt-get install chromium"):
        parts.pytest_runtest_setup(item)


def test_a_campaign_is_in_neither_part(request):
    item = pytest.Function.from_parent(request.node.parent, name="test_x", callobj=lambda: 0)
    item.add_marker("slow")
    item.add_marker("campaign")
    parts.pytest_collection_modifyitems([item])
    assert "extended" not in {mark.name for mark in item.iter_markers()}


def test_only_the_fixture_opens_a_browser():
    users = [f for f in FILES if "with chromium()" in (parts.TESTS / f).read_text("utf-8")]
    assert users == [Path(__file__).relative_to(parts.TESTS).as_posix()]


@pytest.mark.parametrize("marker", parts.EXTENDED)
def test_every_row_of_the_table_names_files_that_are_there(marker):
    for pattern in parts.EXTENDED[marker]:
        assert any(parts.fnmatch(name, pattern) for name in FILES), pattern
