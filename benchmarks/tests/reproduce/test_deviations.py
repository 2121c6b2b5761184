"""The deviations from the paper: the page shows exactly the rows."""

import re
from pathlib import Path

from prefcal_bench.reproduce.paper import DEVIATIONS, TABLE

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "deviations.md").read_text("utf-8")


def test_the_page_shows_exactly_these_rows():
    tables = re.findall(r"(?:^\|.*\n)+", PAGE, re.M)
    assert tables == [TABLE]


def test_every_row_has_its_four_cells_and_names_pages_that_exist():
    for line, row in zip(TABLE.splitlines()[2:], DEVIATIONS, strict=True):
        assert line.count("|") == 5, line
        assert all((row.paper, row.ours, row.why, row.effect))
        for page in re.findall(r"docs/[\w/]+\.md", row.effect):
            assert (ROOT / page).exists()


def test_the_code_names_the_deviations_where_they_stand():
    for path, words in (
        ("prefcal_env/mpc/controller.py", "Deviation: eq. MPC weighs y_0"),
        ("prefcal_env/mpc/controller.py", "N_u + 1"),
        ("prefcal_env/knobs.py", "Deviation: [0, 1]"),
        ("agents/prefcal_agents/search.py", "Deviation: a plain design"),
        ("agents/prefcal_agents/glisp/agent.py", "Deviation: the box"),
    ):
        assert words in (ROOT / path).read_text("utf-8"), path
