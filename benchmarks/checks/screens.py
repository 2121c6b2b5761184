"""Take the pictures of the pages that people look at: runs, maneuvers, and a study that moves."""

import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from PIL import Image

from prefcal_app.looking.look import LookWindow, run_from
from prefcal_app.session.study import challenger_left
from prefcal_env.tables import TableColumns

if TYPE_CHECKING:
    from support.browser import Watched

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PICTURED = 5  # number of answers before the picture of the query window
_ASKS_ELSE_OR_ENDS = """before => document.body.dataset.phase === 'over'
    || document.body.dataset.phase === 'question' && document.body.dataset.question !== before"""
# What is said of the result arrives piece by piece: it is all there when nothing changes for a while.
_SAYS_ALL = """() => {
    const words = document.getElementById('view-over').innerText, now = performance.now();
    if (window.words !== words) [window.words, window.since] = [words, now];
    return now - window.since > 15_000;
}"""
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


def calibrating(folder: Path, verdicts: Sequence[str]) -> tuple[bytes, bytes, int]:
    """Answer the questions about the servo drive like this, as `studies show` tells it, until the end.

    Returns:
        An animated WebP of the whole study, a picture of the question after `PICTURED` answers, and
        the number of answers.
    """
    shots: list[tuple[bytes, float]] = []
    picture = b""
    with _served(folder, "servo") as watched:
        page = watched.page
        for answered, verdict in enumerate(verdicts):
            page.mouse.move(0, 0)
            page.wait_for_timeout(500)
            # The first two can be read, the others show that there are not many.
            asking, pressing = ((2.4, 0.5), (1.6, 0.4))[answered] if answered < 2 else (0.3, 0.2)
            shots.append((page.screenshot(), asking))
            if answered == PICTURED:
                picture = shots[-1][0]
            page.hover(_button(answered, verdict))
            page.mouse.down()
            shots.append((page.screenshot(), pressing))
            before = watched.question()
            page.mouse.up()
            page.wait_for_function(_ASKS_ELSE_OR_ENDS, arg=before, timeout=120_000)
            if page.evaluate("document.body.dataset.phase") == "over":
                break
            watched.question(before)
        page.wait_for_function(_SAYS_ALL, timeout=180_000)
        shots.append((page.screenshot(), 2.4))
        page.eval_on_selector(".gain table", "table => table.scrollIntoView({ block: 'end' })")
        shots.append((page.screenshot(), 3.3))
    if not picture:
        raise RuntimeError(
            f"the study ended after {answered + 1} answers: there is no question {PICTURED + 1}"
        )
    return _moving(shots), picture, answered + 1


def _button(answered: int, verdict: str) -> str:
    """Return the button of a verdict: the challenger of question n is experiment n + 1."""
    if verdict == "about the same":
        return "#verdict-same"
    left = challenger_left(0, answered + 1) == (verdict == "newer better")
    return "#verdict-left" if left else "#verdict-right"


def _moving(shots: Sequence[tuple[bytes, float]]) -> bytes:
    """Return screenshots, each with its seconds, as an animated WebP that repeats."""
    first, *others = (Image.open(BytesIO(shot)).convert("RGB") for shot, _ in shots)
    times = [round(1000 * seconds) for _, seconds in shots]
    film = BytesIO()
    first.save(film, "WEBP", save_all=True, append_images=others, duration=times, loop=0, method=6)
    return film.getvalue()
