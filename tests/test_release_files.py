"""What a release needs says the same everywhere: version, dependencies, references, scripts."""

import re
import shutil
import subprocess
import tomllib
from itertools import pairwise
from pathlib import Path
from statistics import geometric_mean

import pytest

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[1]
PAPER = ROOT / "docs" / "paper"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def test_citation_and_project_have_one_version():
    cited = read("CITATION.cff")
    assert cited["version"] == PROJECT["version"]
    assert cited["license"] == PROJECT["license"]
    assert {"cff-version", "message", "title", "authors"} <= set(cited)


def headings(changelog):
    """Return the versions that the headings of a changelog name, newest first."""
    return re.findall(r"^## \[(.+?)\]", changelog, re.MULTILINE)


def test_the_changelog_begins_with_what_is_unreleased_or_this_version():
    first, *others = headings((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"))
    released = others if first == "Unreleased" else [first, *others]
    assert released[:1] in ([], [PROJECT["version"]])


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.stem)
def test_a_workflow_runs_what_exists_and_may_do_only_what_it_needs(path):
    text, content = path.read_text(encoding="utf-8"), read(path)
    assert content["permissions"] == {"contents": "read"}
    scripts = re.findall(r"python (benchmarks/[\w/]+\.py)", text)
    assert all((ROOT / script).is_file() for script in scripts)
    extras = {e for names in re.findall(r"'\.\[([\w,-]+)\]'", text) for e in names.split(",")}
    assert extras <= set(PROJECT["optional-dependencies"])
    for name, job in content["jobs"].items():
        assert "timeout-minutes" in job, name
        if name == "publish":
            assert "vars.PUBLISH" in job["if"]  # off until an owner switches it on
    assert "secrets." not in text


@pytest.mark.parametrize("path", FORMS, ids=lambda p: p.stem)
def test_a_form_has_what_a_form_needs(path):
    form = read(path)
    if path.stem == "config":
        assert form == {"blank_issues_enabled": False}
        return
    assert {"name", "description", "body"} <= set(form)
    names = [part.get("id") for part in form["body"] if part["type"] != "markdown"]
    assert all(names)
    assert len(set(names)) == len(names)


def test_ci_takes_each_browser_that_the_tests_take(tmp_path):
    """Without one it installs one, as root or by sudo; with any of them it installs nothing."""
    taken = re.search(
        r"map\(shutil.which, \((.*?)\)\)", (ROOT / "tests/support/browser.py").read_text("utf-8")
    )
    browsers = re.findall(r'"([\w-]+)"', taken[1])
    assert len(browsers) > 1
    step = re.search(r"^if ! command -v .*?^fi$", (ROOT / ".ci/run").read_text("utf-8"), re.M | re.S)

    def called(*programs, user=0):
        folder = tmp_path / "-".join((*programs, str(user)))
        folder.mkdir()
        for name in (*programs, "apt-get", "sudo", "id"):
            says = f"echo {user}" if name == "id" else f'echo "{name} $*" >> "{folder}/log"'
            (folder / name).write_text(f"#!/bin/sh\n{says}\n", encoding="utf-8")
            (folder / name).chmod(0o755)
        shell = [shutil.which("bash"), "-euc", step[0]]
        subprocess.run(shell, env={"PATH": str(folder)}, check=True)
        log = folder / "log"
        return [line.split()[0] for line in log.read_text("utf-8").splitlines()] if log.exists() else []

    assert [called(browser) for browser in browsers] == [[]] * len(browsers)
    assert called(user=0) == ["apt-get", "apt-get"]
    assert called(user=1000) == ["sudo", "sudo"]


def test_ci_runs_on_windows_only_tests_that_send_no_posix_signals():
    steps = read(".github/workflows/ci.yml")["jobs"]["tests"]["steps"]
    tests = {step.get("if", ""): step["run"] for step in steps if "pytest" in step.get("run", "")}
    assert tests == {
        "runner.os != 'Windows'": "python -m pytest -n auto tests benchmarks/tests",
        "runner.os == 'Windows'": "python -m pytest -n auto tests/env",
    }


def test_hooks_run_installed_tools():
    (repository,) = read(".pre-commit-config.yaml")["repos"]
    assert repository["repo"] == "local"
    extras = PROJECT["optional-dependencies"]
    dev = " ".join(extras["dev"] + extras["test"])
    assert all(hook["entry"].split()[0] in dev for hook in repository["hooks"])


def test_the_paper_has_the_length_and_the_parts_that_the_journal_asks_for():
    text = (PAPER / "paper.md").read_text(encoding="utf-8")
    _, front, body = text.split("---\n", 2)
    about = yaml.safe_load(front)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(about)
    assert 750 <= len(body.split()) <= 1750
    for part in (
        "Summary",
        "Statement of need",
        "Comparison",
        "How to reproduce",
        "Acknowledgments",
        "References",
    ):
        assert f"# {part}" in body
    library = (PAPER / about["bibliography"]).read_text(encoding="utf-8")
    keys = set(re.findall(r"@\w+\{(\w+),", library))
    assert set(re.findall(r"@(\w+)", body)) == keys


def cells(line):
    return [cell.strip().replace("**", "") for cell in line.strip().strip("|").split("|")]


def row(page, first, *headings):
    """Return what the only row of a page that begins with `first` has under these headings."""
    lines = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()
    found, names = [], []
    for before, line in pairwise(["", *lines]):
        if line.startswith("|") and not before.startswith("|"):
            names = cells(line)
        elif line.startswith("|") and cells(line)[0] == first and set(headings) <= set(names):
            found.append([cells(line)[names.index(name)] for name in headings])
    (only,) = found
    return only


@pytest.fixture(scope="module")
def paper():
    return " ".join((PAPER / "paper.md").read_text(encoding="utf-8").split())


def test_worth_of_answers_in_the_paper_is_that_of_its_note(paper):
    (weights, priorities), random = (
        row("research/kpis.md", agent, "weights, 50", "priorities, 50")
        for agent in ("GLISp, version 13", "RandomSearch")
    )
    assert (
        f"are worth {weights} if people trade KPIs off, and {priorities} if they have priorities; "
        f"50 random experiments are worth {random[0]} and {random[1]}"
    ) in paper


def test_worth_of_screening_in_the_paper_is_that_of_its_campaign(paper):
    worth = {
        taste: row("research/screening.md", taste, "10", "version 2, 10")[0]
        for taste in ("ideal", "majority", "ranks", "curves")
    }
    mean = geometric_mean(float(words.partition(" ")[0]) for words in worth.values())
    said = re.search(r"are worth (\d+) in the geometric mean over four kinds", paper)
    assert said is not None
    assert float(said[1]) == pytest.approx(mean, abs=1)  # the page's figures are rounded
    assert f"and {worth['curves']} to the hardest kind" in paper
