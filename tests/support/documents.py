"""What README and docs show, and how it is executed as it stands.

In a folder with the examples of docs/: first the lines of `console` blocks that begin with
`$ prefcal`, then the Python blocks, which share one namespace. A block after
`<!-- not executed: why -->` is left out. A Python block whose first line is `# NAME.py` is that
file, `<!-- needs: MODULE -->` leaves a page out where an extra is not installed, and
`<!-- run first: FILE.py -->` runs an example before the page.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SCRIPTS = [*sorted((ROOT / "docs" / "examples").glob("*.py")), *sorted((ROOT / "docs").glob("*.py"))]
SCRIPTS.remove(ROOT / "docs" / "own_plant.py")  # test_own_plant.py runs it
SCRIPTS.remove(ROOT / "docs" / "opcua_server.py")  # it serves until it is ended; see live.md
BLOCK = re.compile(r"(<!-- not executed:[^>]*-->\s*)?^```(python|console)\n(.*?)^```", re.M | re.S)
OURS = {"prefcal_env", "prefcal_agents", "prefcal_scenarios", "prefcal_app"}
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


def needs_another_distribution(file: Path) -> bool:
    """Whether a page says that it needs a package beside prefcal's own, or imports one."""
    named = re.findall(r"^(?:<!-- needs: |from |import )(prefcal_\w+)", file.read_text("utf-8"), re.M)
    return not OURS.issuperset(named)


def name_of(file: Path) -> str:
    """Return how a test is called that runs `file`."""
    return str(file.relative_to(ROOT))


def blocks(document: Path, language: str) -> list[str]:
    """Return the blocks of a page in this language that are to be executed."""
    found = BLOCK.findall(document.read_text(encoding="utf-8"))
    return [text for skipped, kind, text in found if kind == language and not skipped]


def run(arguments: list[str], folder: Path) -> str:
    """Run a command in `folder`; return what it prints."""
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


def run_document(document: Path, folder: Path) -> None:
    """Run what a page shows, in `folder`."""
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
    text = document.read_text(encoding="utf-8")
    for module in re.findall(r"^<!-- needs: (\w+) -->", text, re.M):
        pytest.importorskip(module)
    for block in blocks(document, "python"):
        for name in re.findall(r"\A# (\w+\.py)\n", block):
            (folder / name).write_text(block)
    for example in (*(ROOT / "docs").glob("*.py"), *(ROOT / "docs").glob("*.json")):
        shutil.copy(example, folder)  # a reader has them at hand
    for script in re.findall(r"^<!-- run first: ([\w.]+) -->", text, re.M):
        run([sys.executable, script], folder)
    run([sys.executable, "-c", SHOWN, code, *commands], folder)


def run_script(script: Path, folder: Path) -> None:
    """Run an example that people copy, and check that it is short and ends with the best."""
    for needed in re.findall(r"^Needs ([\w-]+): pip install", script.read_text("utf-8"), re.M):
        pytest.importorskip(needed.replace("-", "_"))
    assert "best" in run([sys.executable, str(script)], folder)
    assert len(script.read_text("utf-8").splitlines()) <= 80
