"""What the README and the docs show is executed as it stands.

In a folder with the examples of docs/: first the lines of `console` blocks that begin with
`$ prefcal`, then the Python blocks, which share one namespace. A block after
`<!-- not executed: why -->` is left out. A Python block whose first line is `# NAME.py` is that
file, `<!-- needs: MODULE -->` leaves a page out where an extra is not installed, and
`<!-- run first: FILE.py -->` runs an example before the page.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from prefcal_agents.registry import WORDS

ROOT = Path(__file__).parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
EXTENDED = pytest.mark.documents  # all but the README
BLOCK = re.compile(r"(<!-- not executed:[^>]*-->\s*)?^```(python|console)\n(.*?)^```", re.M | re.S)
SCRIPTS = [*sorted((ROOT / "docs" / "examples").glob("*.py")), *sorted((ROOT / "docs").glob("*.py"))]
SCRIPTS.remove(ROOT / "docs" / "own_plant.py")  # test_own_plant.py runs it
SCRIPTS.remove(ROOT / "docs" / "opcua_server.py")  # it serves until it is ended; see live.md

SHOWN = """
import shlex, sys
from prefcal_app.cli import main
from prefcal_app.report import write
# Not the figures of reports: they take most of the time.
draw, write.draw = write.draw, lambda record, extra: ()
code, *commands = sys.argv[1:]
for sys.argv in map(shlex.split, commands):
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
write.draw, sys.argv = draw, ["-c"]
exec(code, {"__name__": "__main__"})
"""
"""Runs command lines, then code, in one process: a start costs more than most of them."""


def blocks(document, language):
    found = BLOCK.findall(document.read_text())
    return [text for skipped, kind, text in found if kind == language and not skipped]


def run(arguments, folder):
    done = subprocess.run(
        arguments,
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "PREFCAL_DOCS": str(ROOT / "docs"), "XDG_DATA_HOME": str(folder)},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "document",
    [DOCUMENTS[0], *(pytest.param(page, marks=EXTENDED) for page in DOCUMENTS[1:])],
    ids=lambda d: str(d.relative_to(ROOT)),
)
def test_what_a_document_shows_runs(document, tmp_path):
    lines = "".join(blocks(document, "console")).splitlines()
    commands = [line[2:] for line in lines if line.startswith("$ prefcal ")]
    # The first experiments of a study take the same way as the others.
    commands = [line.replace("--n-max 20", "--n-max 4") for line in commands]
    # A hundred simulations take the same way as a thousand.
    quick = "calibrate cstr --simulate 100 --calibrator synthetic"
    commands = [line.replace("calibrate cstr --calibrator synthetic", quick) for line in commands]
    code = "\n".join(blocks(document, "python"))
    if not commands and not code:
        pytest.skip("nothing to run in it")
    for module in re.findall(r"^<!-- needs: (\w+) -->", document.read_text(), re.M):
        pytest.importorskip(module)
    for block in blocks(document, "python"):
        for name in re.findall(r"\A# (\w+\.py)\n", block):
            (tmp_path / name).write_text(block)
    for example in (*(ROOT / "docs").glob("*.py"), *(ROOT / "docs").glob("*.json")):
        shutil.copy(example, tmp_path)  # a reader has them at hand
    for script in re.findall(r"^<!-- run first: ([\w.]+) -->", document.read_text(), re.M):
        run([sys.executable, script], tmp_path)
    run([sys.executable, "-c", SHOWN, code, *commands], tmp_path)


@EXTENDED
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda s: s.name)
def test_a_script_to_copy_runs_and_is_short(script, tmp_path):
    for needed in re.findall(r"^Needs ([\w-]+): pip install", script.read_text(), re.M):
        pytest.importorskip(needed.replace("-", "_"))
    assert "best" in run([sys.executable, str(script)], tmp_path)
    assert len(script.read_text().splitlines()) <= 80


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


@EXTENDED
def test_every_figure_of_a_page_is_there_and_made_by_a_command_and_no_other_is_kept():
    script = ROOT / "benchmarks" / "checks" / "figures.py"
    found = json.loads(run([sys.executable, str(script), "--list"], ROOT))
    assert found["wrong"] == []
    pattern = re.compile(r"figures/([\w-]+\.(?:png|webp))")
    shown = {name for page in DOCUMENTS for name in pattern.findall(page.read_text())}
    assert shown == set(found["made by"])


def test_the_pages_tell_the_numbers_that_their_figures_were_made_with():
    made = json.loads((ROOT / "docs" / "figures" / "made.json").read_text())
    reactor = made["reactor"]
    report = (ROOT / "docs" / "report.md").read_text()
    assert f"{reactor['experiments']} experiments, the first {reactor['initial']} of" in report
    assert f"{reactor['comparisons']} comparisons" in report
    readme = (ROOT / "README.md").read_text()
    assert f"{reactor['comparisons']} comparisons lead from" in readme
    assert f"index of all {reactor['experiments']} experiments" in readme
    story = (ROOT / "docs" / "gallery" / "reactor.md").read_text()
    assert f"| index | {made['index']['broad basin']:.4f} | {made['index']['hole']:.4f} |" in story


def test_a_page_tells_every_word_for_an_agent():
    page = (ROOT / "docs" / "simulate.md").read_text()
    table = page.partition("| `--agent` | what it does |")[2].partition("\n\n")[0]
    told = re.findall(r"`([a-z-]+)`", "".join(line.split("|")[1] for line in table.split("\n")[2:]))
    assert told == list(WORDS)
