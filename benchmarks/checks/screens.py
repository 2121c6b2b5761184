"""Take the screenshots of the pages that people look at: runs, maneuvers, and the query window."""

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prefcal_app.looking.look import LookWindow, run_from
from prefcal_app.session.study import challenger_left
from prefcal_env.tables import TableColumns

if TYPE_CHECKING:
    from support.browser import Watched

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_FIRST = re.compile(r"^```python\n(.*?)^```", re.M | re.S)
Shots = tuple[dict[str, bytes], Mapping[str, float]]


def looking(folder: Path) -> Shots:
    """Show the two tables of docs/look.md on the page of `prefcal look`, with their KPIs."""
    sys.path.insert(0, str(ROOT / "tests"))
    from support.browser import Watched, chromium

    found = _FIRST.search((DOCS / "look.md").read_text("utf-8"))
    assert found is not None
    subprocess.run([sys.executable, "-c", found[1]], cwd=folder, check=True)
    reading = TableColumns(inputs=("valve",), reference={"level": "2"})
    runs = [run_from(folder / name, reading) for name in ("before.csv", "after.csv")]
    with LookWindow(runs) as window, chromium() as browser:
        page = Watched(browser).page
        page.goto(window.link)
        page.wait_for_selector("#right-plot .js-line")
        page.keyboard.press("t")
        page.wait_for_selector("#compare:not([hidden])")
        page.wait_for_timeout(500)
        picture = page.screenshot()
    errors = {
        f"integrated error, {run.name}": float(run.experiment.kpis["integrated error of level"])
        for run in runs
    }
    return {"look.png": picture}, errors


@contextmanager
def _served(folder: Path, *words: str) -> Iterator["Watched"]:
    """Serve a calibration, and open its page."""
    sys.path.insert(0, str(ROOT / "tests"))
    from support.browser import Watched, chromium, serve

    with chromium() as browser:
        served = serve(folder, *words)
        try:
            watched = Watched(browser)
            watched.open(served.link)
            yield watched
        finally:
            served.kill()


def maneuvers(folder: Path) -> Shots:
    """Show a question about docs/heated_tank.py: a tab for each of its maneuvers."""
    (folder / "heated_tank.py").write_text((DOCS / "heated_tank.py").read_text("utf-8"), "utf-8")
    with _served(folder, "heated_tank.py:heated_tank", "--agent", "glisp", "--n-max", "8") as watched:
        watched.page.wait_for_timeout(500)
        picture = watched.page.screenshot()
        tabs = watched.page.locator("button.tab").count()
    return {"maneuvers.png": picture}, {"maneuvers": tabs}


def window(folder: Path, answers: Sequence[Mapping[str, Any]]) -> bytes:
    """Return the query window of the reactor after these answers, as `studies show` tells them."""
    with _served(folder, "cstr") as watched:
        for asked in answers:
            won = asked["verdict"].startswith("new")
            left = challenger_left(0, asked["challenger"] - 1) == won
            watched.answer("ArrowLeft" if left else "ArrowRight")
        watched.page.wait_for_timeout(500)
        picture: bytes = watched.page.screenshot()
    return picture
