"""The table of closed loops on the benchmark's page is that of the published studies."""

from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_the_page_has_the_table_of_the_published_studies(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    import worth_table

    page = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    assert "\n".join(worth_table.lines()) in page, "run benchmarks/campaigns/worth_table.py"
