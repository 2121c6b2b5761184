"""The command that makes the pictures of README and docs notices what has become untrue."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def figures(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "checks")
    return importlib.import_module("figures")


@pytest.fixture
def clone(figures, monkeypatch, tmp_path):
    """A clone with one page and one figure."""
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "FIGURES", tmp_path / "docs" / "figures")
    figures.FIGURES.mkdir(parents=True)
    (figures.FIGURES / "tried.png").touch()
    (tmp_path / "README.md").write_text("![what was tried](docs/figures/tried.png)\n")
    return tmp_path


def test_a_page_whose_figures_are_made_is_not_complained_of(figures, clone):
    assert list(figures.complaints()) == []


def test_a_figure_that_nothing_makes_is_named_with_its_page(figures, clone):
    (clone / "docs" / "more.md").write_text("![by hand](figures/by_hand.png)")
    assert list(figures.complaints()) == [
        "docs/more.md shows by_hand.png, which nothing draws",
        "docs/more.md shows by_hand.png, which is not in docs/figures",
    ]


def test_a_figure_on_no_page_is_named(figures, clone):
    (figures.FIGURES / "left_over.png").touch()
    assert list(figures.complaints()) == ["docs/figures/left_over.png is on no page"]


def test_a_count_that_changed_and_an_index_that_moved_make_figures_stale(figures):
    before = {"initial": 10, "index of the best": 0.7092}
    assert list(figures.differences("reactor", dict(before), before)) == []
    assert list(figures.differences("reactor", {"index of the best": 0.7093}, before)) == []
    (count,) = figures.differences("reactor", {"initial": 6}, before)
    assert count == "reactor: initial is 6 now, the figures in docs say 10"
    assert list(figures.differences("reactor", {"index of the best": 0.75}, before))
    assert list(figures.differences("reactor", {"comparisons": 49}, before))


def test_a_stale_story_ends_the_check_with_1(figures, clone, monkeypatch):
    (figures.FIGURES / "made.json").write_text('{"told": {"initial": 10}}')
    said = []
    for initial, code in ((10, 0), (6, 1)):
        story = {"initial": initial}
        maker = (lambda folder, story=story: ({"a.png": b"png"}, story), ("a.png",))
        monkeypatch.setattr(figures, "MAKERS", {"told": maker, "other": (None, ("tried.png",))})
        assert figures.check(["told"], said.append) == code
    assert "python benchmarks/checks/figures.py" in said[-1]


def test_figures_of_a_campaign_are_taken_from_its_folder(figures, clone, tmp_path):
    said = []
    figures.from_campaigns(tmp_path, said.append)
    assert any(words.startswith("benchmark_gaps.png: left as it is") for words in said)
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "gap-experiments.png").write_bytes(b"new")
    figures.from_campaigns(tmp_path, said.append)
    assert (figures.FIGURES / "benchmark_gaps.png").read_bytes() == b"new"
