"""The suite has two parts: what `pytest` runs anywhere within minutes, and the extended one.

`pytest` alone runs the first part, `pytest -m extended` the second one. Named files and folders
run in full, except campaigns, and `-m` overrides all of this. What a test lacks is said once for
each cause at the end of a run, and is never an error.
"""

import re
from collections import Counter
from collections.abc import Iterable
from fnmatch import fnmatch
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
EXTENDED = {
    "browser": ("app/looking/test_window.py", "app/web/test_accessibility.py", "app/web/test_page*.py"),
    "commands": ("app/cli/test_[!c]*.py", "app/cli/test_ch*.py"),
    "documents": ("test_notebooks.py", "test_own_*.py", "test_parts.py", "test_release_files.py"),
    "fmu": ("worlds/fmu/*",),
    "libraries": (
        "env/controllers/test_margins.py",
        "env/study/test_exports.py",
        "env/tables/test_parquet.py",
        "worlds/casadi/*",
        "worlds/control/*",
        "worlds/do_mpc/*",
        "worlds/optuna/*",
        "worlds/test_deleted.py",
    ),
    "notebook": ("worlds/notebook/*",),
    "processes": (
        "env/study/test_disk.py",
        "env/test_jit.py",
        "env/workers/*",
        "scenarios/isolated/*",
        "scenarios/many/*",
        "scenarios/verification/test_varied_runs.py",
        "app/test_crash.py",
    ),
    "servers": ("worlds/live/*",),
    "slow": (
        "agents/acquisition/test_penalty.py",
        "agents/baselines/test_glis.py",
        "agents/glisp/test_[cknqs]*.py",
        "agents/history/test_lessons.py",
        "agents/models/test_learned_cost.py",
        "agents/screening/test_[abcg]*.py",
        "env/mpc/test_exact.py",
        "env/plants/test_identify.py",
        "env/plants/test_integrate.py",
        "app/session/test_[cfps]*.py",
        "app/view/test_now.py",
        "scenarios/cases/overtake/test_picture.py",
        "scenarios/described/test_*_scenario.py",
        "scenarios/described/test_identified.py",
        "app/test_failed_runs.py",
        "app/test_report.py",
        "test_imports.py",
        "test_trace_proposal.py",
    ),
}
"""Markers, and the files below tests/ that get them. Single tests carry theirs in their file."""
CHROMIUM_LACKS = "needs Chromium: apt-get install chromium"
WHOLE = "the whole file"
LACKS = re.compile(r"needs (?P<what>.+?): (?P<how>.+)")
NO_MODULE = re.compile(r"could not import '(?P<what>\w+)")


def part_of(path: Path) -> str | None:
    """Return the marker that a file's tests get, None in the first part."""
    name = path.relative_to(TESTS).as_posix() if path.is_relative_to(TESTS) else ""
    for marker, patterns in EXTENDED.items():
        if any(fnmatch(name, pattern) for pattern in patterns):
            return marker
    return None


def pytest_configure(config: pytest.Config) -> None:
    """Leave out what was not asked for."""
    if not config.option.markexpr:
        named = config.args_source is config.ArgsSource.ARGS
        config.option.markexpr = "not campaign" + ("" if named else " and not extended")


def _is_first_part(config: pytest.Config) -> bool:
    return config.option.markexpr.endswith("and not extended")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what would not run: importing all tests takes longer than many do."""
    return True if _is_first_part(config) and part_of(collection_path) else None


class _WholeFile(pytest.Item):
    """Stands for the tests of a file that cannot be imported, so that they are counted."""

    lacks = ""

    def runtest(self) -> None:
        pytest.skip(self.lacks)


class _File(pytest.Module):
    """A file that may lack a module: skipped as a whole, also by the workers of xdist."""

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        try:
            return super().collect()
        except pytest.skip.Exception as missing:
            whole: _WholeFile = _WholeFile.from_parent(self, name=WHOLE)
            whole.lacks = str(missing.msg)
            return [whole]


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module:
    """Collect a file whose missing modules are counted."""
    file: _File = _File.from_parent(parent, path=module_path)
    return file


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark by file, and each test that opens a browser."""
    for item in items:
        if marker := part_of(item.path):
            item.add_marker(marker)
        if "running_browser" in getattr(item, "fixturenames", ()):
            item.add_marker("browser")
        long = item.get_closest_marker("campaign")
        if not long and any(item.get_closest_marker(marker) for marker in EXTENDED):
            item.add_marker("extended")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test without its browser, before it makes a study for it."""
    if item.get_closest_marker("browser"):
        from support.browser import CHROMIUM

        pytest.importorskip("playwright")
        if CHROMIUM is None:
            pytest.skip(CHROMIUM_LACKS)


def _lacked(reason: str) -> str | None:
    if found := NO_MODULE.search(reason):
        return f"{found['what']}: pip install -e '.[dev]'"
    if found := LACKS.search(reason):
        return f"{found['what']}: {found['how']}"
    return None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests lack what, and where it comes from."""
    lacking: Counter[tuple[str, str]] = Counter()
    for report in terminalreporter.stats.get("skipped", ()):
        if lacked := _lacked(report.longrepr[2]):
            lacking[lacked, "file" if report.nodeid.endswith(WHOLE) else "test"] += 1
    for (lacked, kind), count in lacking.most_common():
        needing = f"{kind} needs" if count == 1 else f"{kind}s need"
        terminalreporter.line(f"{count} {needing} {lacked}")
    if _is_first_part(terminalreporter.config):
        terminalreporter.line("Not run: the extended part, pytest -m extended (CONTRIBUTING.md)")
