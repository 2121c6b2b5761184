"""Take the screenshots of the pages that people look at: two runs, and several maneuvers."""

import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from prefcal_app.looking.table import run_from
from prefcal_app.looking.window import LookWindow
from prefcal_env.tables import TableColumns

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


def maneuvers(folder: Path) -> Shots:
    """Show a question about docs/heated_tank.py: a tab for each of its maneuvers."""
    sys.path.insert(0, str(ROOT / "tests"))
    from support.browser import Watched, chromium, serve

    (folder / "heated_tank.py").write_text((DOCS / "heated_tank.py").read_text("utf-8"), "utf-8")
    with chromium() as browser:
        served = serve(folder, "heated_tank.py:heated_tank", "--agent", "glisp", "--n-max", "8")
        try:
            watched = Watched(browser)
            watched.open(served.link)
            watched.page.wait_for_timeout(500)
            picture = watched.page.screenshot()
            tabs = watched.page.locator("button.tab").count()
        finally:
            served.kill()
    return {"maneuvers.png": picture}, {"maneuvers": tabs}
