"""The map of the project is true: what ARCHITECTURE.md names exists, and so do CI's scripts."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
PACKAGES = sorted(
    path.parent.relative_to(ROOT).as_posix()
    for depth in ("prefcal_*", "*/prefcal_*")
    for path in ROOT.glob(f"{depth}/__init__.py")
)
HOMES = [ROOT, *(ROOT / each for package in PACKAGES for each in (Path(package).parent, package))]
"""A path is relative to one of these, as the page writes it."""
PATHS = sorted(
    {path for path in re.findall(r"`(?:python )?([\w./]+)[^`]*`", TEXT) if re.search(r"/|\.py", path)}
    | {link.partition("#")[0] for link in re.findall(r"\]\(([^)]+)\)", TEXT)}
)
FOLDERS = [
    (package, name)
    for package in PACKAGES
    for row in re.findall(rf"^\| `{package}/` \|[^|]*\|(.*)\|$", TEXT, re.M)
    for name in re.findall(r"`([\w/.]+)`", row)
]

PAGES = [ROOT / ".ci" / "run", *ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))]
COMMANDS = sorted(
    {
        path
        for page in PAGES
        for path in re.findall(r"python3? (benchmarks/[\w/]+\.py)", page.read_text(encoding="utf-8"))
    }
)


@pytest.mark.parametrize("path", PATHS)
def test_every_path_exists(path):
    assert any((home / path).exists() for home in HOMES)


@pytest.mark.parametrize(("package", "name"), FOLDERS, ids=[name for _, name in FOLDERS])
def test_every_part_of_a_package_is_in_it(package, name):
    stem = name.removesuffix(".py")
    assert [*(ROOT / package).rglob(stem), *(ROOT / package).rglob(f"{stem}.py")]


@pytest.mark.parametrize("path", COMMANDS)
def test_every_script_that_ci_or_a_page_runs_exists(path):
    assert (ROOT / path).is_file()


def test_the_page_names_every_package_and_many_paths():
    assert {package for package, _ in FOLDERS} == set(PACKAGES)
    assert len(PATHS) > 30
    assert len(COMMANDS) > 10
