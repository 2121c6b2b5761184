"""What a release needs says the same everywhere: version, dependencies, references, scripts."""

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

yaml = pytest.importorskip("yaml")

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
CONDA = {"matplotlib": "matplotlib-base"}
"""Packages that conda names differently."""


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def test_citation_recipe_and_project_have_one_version():
    cited, recipe = read("CITATION.cff"), read("conda/recipe.yaml")
    assert cited["version"] == recipe["context"]["version"] == PROJECT["version"]
    assert cited["license"] == recipe["about"]["license"] == PROJECT["license"]
    assert {"cff-version", "message", "title", "authors"} <= set(cited)


def test_the_recipe_needs_what_the_wheel_needs_and_starts_the_same_command():
    recipe = read("conda/recipe.yaml")
    wanted = set()
    for text in PROJECT["dependencies"]:
        name, limits = re.fullmatch(r"([\w.-]+)(.*)", text).groups()
        wanted.add(f"{CONDA.get(name, name)} {limits}".strip())
    needed = [line for line in recipe["requirements"]["run"] if not line.startswith("python ")]
    assert set(needed) == wanted
    assert recipe["build"]["python"]["entry_points"] == [
        f"prefcal = {PROJECT['scripts']['prefcal']}"
    ]
    least = recipe["context"]["python_min"]
    assert PROJECT["requires-python"] == f">={least}"


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.stem)
def test_a_workflow_runs_what_exists_and_may_do_only_what_it_needs(path):
    text, content = path.read_text(encoding="utf-8"), read(path)
    assert content["permissions"] == {"contents": "read"}
    scripts = re.findall(r"python (benchmarks/[\w/]+\.py)", text)
    assert all((ROOT / script).is_file() for script in scripts)
    extras = {e for names in re.findall(r"'\.\[([\w,]+)\]'", text) for e in names.split(",")}
    assert extras <= {*PROJECT["optional-dependencies"], "site"}
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
    step = re.search(
        r"^if ! command -v .*?^fi$", (ROOT / ".ci/run").read_text("utf-8"), re.M | re.S
    )

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
        return (
            [line.split()[0] for line in log.read_text("utf-8").splitlines()]
            if log.exists()
            else []
        )

    assert [called(browser) for browser in browsers] == [[]] * len(browsers)
    assert called(user=0) == ["apt-get", "apt-get"]
    assert called(user=1000) == ["sudo", "sudo"]


def test_ci_runs_on_windows_only_tests_that_send_no_posix_signals():
    steps = read(".github/workflows/ci.yml")["jobs"]["tests"]["steps"]
    tests = {step.get("if", ""): step["run"] for step in steps if "pytest" in step.get("run", "")}
    assert tests == {
        "runner.os != 'Windows'": "python -m pytest -n auto",
        "runner.os == 'Windows'": "python -m pytest -n auto tests/env",
    }


def test_hooks_run_installed_tools():
    (repository,) = read(".pre-commit-config.yaml")["repos"]
    assert repository["repo"] == "local"
    dev = " ".join(
        PROJECT["optional-dependencies"]["dev"] + PROJECT["optional-dependencies"]["test"]
    )
    assert all(hook["entry"].split()[0] in dev for hook in repository["hooks"])


def test_the_paper_has_the_length_and_the_parts_that_the_journal_asks_for():
    text = (ROOT / "paper.md").read_text(encoding="utf-8")
    _, front, body = text.split("---\n", 2)
    about = yaml.safe_load(front)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(about)
    assert 750 <= len(body.split()) <= 1750
    for part in ("Summary", "Statement of need", "Comparison", "How to reproduce",
                 "Acknowledgments", "References"):  # fmt: skip
        assert f"# {part}" in body
    library = (ROOT / about["bibliography"]).read_text(encoding="utf-8")
    keys = set(re.findall(r"@\w+\{(\w+),", library))
    assert set(re.findall(r"@(\w+)", body)) == keys


@pytest.mark.parametrize("figure", ["212", "75;", "233 to 47", "156 to 125", "1,700", "887", "199"])
def test_figures_of_the_paper_are_those_of_the_pages(figure):
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    every = " ".join(page.read_text(encoding="utf-8") for page in pages)
    paper = (ROOT / "paper.md").read_text(encoding="utf-8")
    assert figure in " ".join(paper.split())
    assert figure in " ".join(every.split())


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "SECURITY.md"])
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#]+)[^)]*\)", (ROOT / page).read_text(encoding="utf-8")):
        assert (ROOT / link).exists(), link
