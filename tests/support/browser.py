"""A real browser on a real query window: what the tests of the page share."""

import contextlib
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from prefcal_app.session import Background
from prefcal_app.web import Window
from prefcal_env.study import State
from prefcal_scenarios.scenario import Scenario
from support.interviews import begin
from support.processes import start
from support.studies import state_of

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SHOTS = Path(os.environ.get("PREFCAL_SHOTS", "screenshots"))
# No name is resolved but the loopback address: whatever asks for the network fails, and is seen.
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-sync",
    "--disable-background-networking",
    "--disable-component-update",
    "--host-resolver-rules=MAP * ~NOTFOUND , EXCLUDE 127.0.0.1",
]


@dataclass
class Command:
    """A running `prefcal calibrate`, and its link."""

    process: subprocess.Popen[str]
    link: str
    study: Path

    @property
    def state(self) -> State:
        """What the study file says by now."""
        return state_of(self.study)

    def kill(self) -> None:
        """SIGKILL: nothing can be tidied up."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> str:
        """Ctrl-C; what it printed."""
        self.process.send_signal(signal.SIGINT)
        return self.process.communicate(timeout=60)[0]


def serve(folder: Path, scenario: str, *words: str, study: str = "mine.prefcal") -> Command:
    """Start the command in `folder`, and wait for its link."""
    path = folder / study
    process = start(
        folder,
        "calibrate",
        scenario,
        "--study",
        str(path),
        "--no-browser",
        "--out",
        str(folder / "report"),
        *words,
    )
    assert process.stdout is not None
    link = process.stdout.readline().strip()
    if not link.startswith("http://127.0.0.1:"):
        _, errors = process.communicate(timeout=30)
        raise AssertionError(f"no link but {link!r}: {errors}")
    return Command(process, link, path)


@dataclass(frozen=True)
class Served:
    """A query window of this process: its link, and the study."""

    link: str
    study: Path

    @property
    def state(self) -> State:
        """What the study file says by now."""
        return state_of(self.study)


@contextlib.contextmanager
def window_on(scenario: Scenario, study: Path, n_max: int, remarks: Sequence[str] = ()) -> Iterator[Served]:
    """Serve an interview about `scenario` from this process, as `prefcal calibrate` does."""
    interview = begin(scenario, n_max=n_max, path=study, ahead=True)
    with Window(interview, remarks=remarks) as window, Background(interview):
        yield Served(window.link, study)
    interview.file.close()


@contextlib.contextmanager
def chromium() -> Iterator["Browser"]:
    """A headless browser that resolves no name; tests take the fixture `browser`."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


class Watched:
    """A page that notes every request, every error, and whatever the console complains of."""

    def __init__(self, browser: "Browser", **options: Any) -> None:
        self.page: Page = browser.new_context(
            **{"viewport": {"width": 1280, "height": 720}, **options}
        ).new_page()
        self.page.set_default_navigation_timeout(60_000)  # a busy machine is no failure
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._note)

    def _note(self, message: Any) -> None:
        # A refused request is the test's own doing; the page shows it.
        if message.type == "error" and "Failed to load resource" not in message.text:
            self.errors.append(message.text)

    def open(self, link: str) -> None:
        """Open the link, and wait for the first curves."""
        self.page.goto(link, timeout=60_000)
        self.question()

    def question(self, other_than: str = "") -> str:
        """Wait for a question, another one than `other_than`, with its curves: its id."""
        self.page.wait_for_function(
            "other => document.body.dataset.phase === 'question' && "
            "document.body.dataset.question !== other && "
            "document.querySelectorAll('.js-plotly-plot .scatterlayer path.js-line').length > 1",
            arg=other_than,
            timeout=60_000,
        )
        # The page takes no verdict in the first moment of a question.
        self.page.wait_for_timeout(200)
        return str(self.page.evaluate("document.body.dataset.question"))

    def answer(self, key: str) -> str:
        """Press `key`, and wait for the next question: its id."""
        before = self.question()
        self.page.keyboard.press(key)
        return self.question(before)

    def phase(self, phase: str) -> None:
        """Wait for a phase."""
        self.page.wait_for_selector(f"body[data-phase='{phase}']", timeout=60_000)

    def shot(self, name: str) -> bytes:
        """A screenshot, kept where the artifacts of a test run are."""
        SHOTS.mkdir(parents=True, exist_ok=True)
        return self.page.screenshot(path=SHOTS / f"{name}.png")
