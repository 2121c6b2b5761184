"""Pages and examples that need the benchmark run as they stand, and its figures are made."""

import json
import re
import sys

import pytest

from support.documents import (
    DOCUMENTS,
    ROOT,
    SCRIPTS,
    name_of,
    needs_another_distribution,
    run,
    run_document,
    run_script,
)

PAGES = [*filter(needs_another_distribution, DOCUMENTS)]
EXAMPLES = [*filter(needs_another_distribution, SCRIPTS)]


@pytest.mark.parametrize("document", PAGES, ids=name_of)
def test_what_a_document_shows_runs(document, tmp_path):
    run_document(document, tmp_path)


@pytest.mark.parametrize("script", EXAMPLES, ids=name_of)
def test_a_script_to_copy_runs_and_is_short(script, tmp_path):
    run_script(script, tmp_path)


def test_every_figure_of_a_page_is_there_and_made_by_a_command_and_no_other_is_kept():
    script = ROOT / "benchmarks" / "checks" / "figures.py"
    found = json.loads(run([sys.executable, str(script), "--list"], ROOT))
    assert found["wrong"] == []
    pattern = re.compile(r"figures/([\w-]+\.(?:png|webp))")
    shown = {name for page in DOCUMENTS for name in pattern.findall(page.read_text())}
    assert shown == set(found["made by"])
