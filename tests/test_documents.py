"""What the README and the docs show is executed as it stands, and they are true in small things.

Pages that need the benchmark are run by its own tests.
"""

import json
import re
from importlib import import_module
from operator import attrgetter

import pytest

from prefcal_agents.registry import WORDS
from support.documents import (
    DOCUMENTS,
    ROOT,
    SCRIPTS,
    name_of,
    needs_another_distribution,
    run_document,
    run_script,
)

EXTENDED = pytest.mark.documents  # all but the README
PAGES = [page for page in DOCUMENTS[1:] if not needs_another_distribution(page)]
EXAMPLES = [script for script in SCRIPTS if not needs_another_distribution(script)]


@pytest.mark.parametrize(
    "document", [DOCUMENTS[0], *(pytest.param(page, marks=EXTENDED) for page in PAGES)], ids=name_of
)
def test_what_a_document_shows_runs(document, tmp_path):
    run_document(document, tmp_path)


@EXTENDED
@pytest.mark.parametrize("script", EXAMPLES, ids=name_of)
def test_a_script_to_copy_runs_and_is_short(script, tmp_path):
    run_script(script, tmp_path)


def anchors(document):
    """Return the link targets of a document's headings, as GitHub writes them."""
    headings = re.findall(r"^#+ (.*)$", document.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


def test_links_between_documents_lead_somewhere():
    others = (ROOT / f"{name}.md" for name in ("CHANGELOG", "CONTRIBUTING", "SECURITY"))
    for document in [*DOCUMENTS, *others]:
        for path, anchor in re.findall(r"\]\((?!http)([^)#]*)#?([^)]*)\)", document.read_text()):
            target = document.parent / path if path else document
            assert target.exists(), f"{document.name}: {path}"
            assert not anchor or anchor in anchors(target), f"{document.name}: {path}#{anchor}"


def test_the_indexes_of_the_docs_name_every_page():
    docs = ROOT / "docs"
    entrance = (docs / "index.md").read_text()
    for page in (*docs.glob("*.md"), *(docs / "research").glob("*.md")):
        link = page.relative_to(docs).as_posix()
        assert link == "index.md" or f"({link})" in entrance, link
    for folder in (docs / "api", docs / "gallery"):
        index = (folder / "README.md").read_text()
        for page in folder.glob("*.md"):
            assert page.name == "README.md" or re.search(rf"\({page.name}[)#]", index), page.name


def test_no_document_names_a_host_to_load_from_or_a_path_of_a_machine():
    pattern = re.compile(r"cdn\.|/home/|/root/|/tmp/|C:\\\\")
    for document in DOCUMENTS:
        assert not pattern.search(document.read_text()), document.name


def test_the_pages_tell_the_numbers_that_their_figures_were_made_with():
    made = json.loads((ROOT / "docs" / "figures" / "made.json").read_text())
    reactor = made["reactor"]
    report = (ROOT / "docs" / "report.md").read_text()
    assert f"{reactor['experiments']} experiments, the first {reactor['initial']} of" in report
    assert f"{reactor['comparisons']} comparisons" in report
    drive = made["window"]
    now, before = drive["after"], drive["settling time before"]
    told = f"{drive['answers']} answers later the load settles within {now:.3f} s instead of {before:.3f} s"
    assert f"{told}, and overshoots by {drive['overshoot after']:.1f} %" in (ROOT / "README.md").read_text()
    story = (ROOT / "docs" / "gallery" / "reactor.md").read_text()
    assert f"| index | {made['index']['broad basin']:.4f} | {made['index']['hole']:.4f} |" in story


def test_a_page_tells_every_word_for_an_agent():
    page = (ROOT / "docs" / "simulate.md").read_text()
    table = page.partition("| `--agent` | what it does |")[2].partition("\n\n")[0]
    told = re.findall(r"`([a-z-]+)`", "".join(line.split("|")[1] for line in table.split("\n")[2:]))
    assert told == list(WORDS)


@pytest.mark.parametrize(("which", "count"), [("Screening", 14), ("GLISp", 7)])
def test_each_rule_of_an_agent_names_the_code_that_names_its_number(which, count):
    page = (ROOT / "docs" / "how_it_works.md").read_text()
    rules = page.partition(f"## The rules of {which} in full")[2].partition("\n## ")[0]
    told = re.findall(r"^(\d+)\. \*\*[^*]+\*\* \(`([\w.]+)` in `([\w/]+)\.py`", rules, re.M)
    assert [int(number) for number, *_ in told] == [*range(1, count + 1)]
    for number, name, file in told:
        package = "prefcal_env.preferences" if file == "answer" else "prefcal_agents"
        module = import_module(f"{package}.{file.replace('/', '.')}")
        assert re.search(rf"{which}, rule {number}\b", attrgetter(name)(module).__doc__), (number, name)
