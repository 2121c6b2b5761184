"""The table of docs/simulate.md is about its example, and its first row is true of a seed."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_the_page_has_a_row_for_each_study_and_the_first_seed_is_within_it(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "checks")
    import simulate_page

    page = simulate_page.PAGE.read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (.+? answers) \| ([\d.% |]+) \|$", page, re.M))
    names = simulate_page.example()
    studies = simulate_page.studies(names)
    assert list(rows) == list(studies), "run benchmarks/checks/simulate_page.py"
    middle, low, high = (float(n.rstrip("%")) for n in rows["Screening, 10 answers"].split(" | "))
    [share] = simulate_page.beaten(names, [studies["Screening, 10 answers"](0)])
    assert low <= middle <= high
    assert low - 0.05 <= 100 * share <= high + 0.05
