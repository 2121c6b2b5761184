"""Figures that people read first: listed, of today's agents, and still in their pages."""

import importlib
import subprocess
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def headlines(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "release")
    return importlib.import_module("headlines")


@pytest.fixture
def site(tmp_path, headlines, monkeypatch):
    def write(readme):
        (tmp_path / "docs").mkdir(exist_ok=True)
        (tmp_path / "README.md").write_text(readme)
        return tmp_path

    return write


def test_every_figure_that_people_read_first_is_listed_and_of_today(headlines):
    assert headlines.faults() == []


def test_revisions_are_in_the_history(headlines):
    git = ("git", "-C", str(ROOT))
    shallow = subprocess.run([*git, "rev-parse", "--is-shallow-repository"], capture_output=True)
    if shallow.stdout != b"false\n":
        pytest.skip("needs the whole history of the repository")
    named = sorted({h.revision for h in headlines.read()[0] if h.revision})
    known = subprocess.run(
        [*git, "cat-file", "--batch-check"], input="\n".join(named).encode(), capture_output=True
    )
    lines = known.stdout.decode().splitlines()
    assert [n for n, line in zip(named, lines, strict=True) if " commit " not in line] == []


def test_an_unlisted_figure_is_named_with_the_words_around_it(headlines, site):
    root = site("# prefcal\n\nTen answers are worth 900 experiments, in `f(3)` and [12](a4.md).\n")
    assert "worth 900" in headlines.unlisted("README.md", [], ["12"], root)
    assert headlines.unlisted("README.md", [], ["900", "12"], root) == ""


def test_only_the_first_paragraph_of_other_pages_counts(headlines, site):
    root = site("")
    (root / "docs" / "a.md").write_text("# A 1\n\nNone here.\n\nLater 5.\n")
    assert headlines.readable("docs/a.md", root) == "None here."


def test_a_claim_whose_words_are_gone_is_a_fault(headlines, site):
    root = site("Ten answers.")
    claim = headlines.Headline("worth 900", ("README.md",), "none")
    assert list(claim.faults(root)) == ["README.md no longer says 'worth 900'"]


def test_a_front_page_may_not_state_figures_of_an_older_agent(headlines, site):
    root = site("worth 900")
    claim = headlines.Headline("worth 900", ("README.md",), "none", agent="GLISp 2")
    assert "measure again" in next(claim.faults(root))


def test_a_figure_that_the_published_studies_do_not_give_is_named(headlines, site):
    root = site("worth 900")
    of = {"agent": "GLISp 13", "rows": ("weights, 50 experiments",)}
    claim = headlines.Headline("worth 900", ("README.md",), "none", **of)
    assert "published studies give 505 [339, 734]" in next(claim.faults(root))


def test_headlines_about_agents_are_computed_again_from_published_studies(headlines):
    listed, _ = headlines.read()
    front = [h for h in listed if h.agent and {"README.md", "docs/paper/paper.md"} & set(h.pages)]
    assert front
    assert all(h.rows for h in front)


def test_the_headline_is_the_mean_of_people_of_another_form(headlines):
    found = headlines.published()
    kinds = [found[f"Screening, {kind}, 10 answers"] for kind in ("ideal", "majority", "ranks", "curves")]
    product = np.prod([float(words.partition(" ")[0]) for words in kinds])
    mean = found["Screening, people of another form, 10 answers"]
    assert float(mean) == pytest.approx(product**0.25, rel=0.01)
