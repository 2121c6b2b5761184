"""Does the site serve people with impaired sight, and keyboards? axe-core's serious findings.

    npm install --prefix FOLDER axe-core
    mkdocs build --strict
    python benchmarks/checks/outside/site_axe.py build/site FOLDER/node_modules/axe-core/axe.min.js

Pages of every kind, in light and in dark, at the width of a phone, a tablet and a screen. Also
reports pages that scroll sideways. Exits with 1 if anything serious or critical is found.
"""

import argparse
import functools
import http.server
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import Page, sync_playwright
from rich.console import Console

ROOT = Path(__file__).parents[3]
PAGES = (
    "", "start/", "guides/", "pid/", "team/", "gallery/", "gallery/pid/", "environments/",
    "api/", "api/knobs/", "api/agents/", "how_it_works/", "benchmarks/", "deviations/",
    "changelog/",
)  # fmt: skip
WIDTHS = (380, 900, 1440)
"""Widths of the window in pixels."""
_RUN = """() => axe.run(document, {resultTypes: ['violations']}).then(found => found.violations.map(
    v => [v.impact, v.id, v.nodes.length, v.nodes[0].html.slice(0, 160)]))"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files without a log."""

    def log_message(self, *words: Any) -> None:
        """Say nothing."""


def findings(page: Page, axe: str) -> Iterator[str]:
    """Yield what is seriously wrong with the page that is open."""
    page.evaluate(axe)
    for impact, rule, count, html in page.evaluate(_RUN):
        if impact in ("serious", "critical"):
            yield f"{impact}: {rule}, {count} times, first {html}"
    if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
        yield "scrolls sideways"


def look(address: str, axe: str, console: Console) -> int:
    """Print the findings of all pages, schemes and widths; return their number."""
    sys.path.insert(0, str(ROOT / "tests"))
    from support.browser import CHROMIUM, FLAGS

    wrong = 0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for scheme in ("light", "dark"):
            for width in WIDTHS:
                context = browser.new_context(
                    viewport={"width": width, "height": 900}, color_scheme=scheme, bypass_csp=True
                )  # fmt: skip
                page = context.new_page()
                for name in PAGES:
                    page.goto(address + name)
                    page.wait_for_timeout(300)
                    for words in findings(page, axe):
                        wrong += 1
                        console.print(f"/{name} {scheme} {width}: {words}", markup=False)
                context.close()
        browser.close()
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("site", type=Path, help="folder of the built site")
    parser.add_argument("axe", type=Path, help="axe.min.js of axe-core")
    options = parser.parse_args()
    handler = functools.partial(Quiet, directory=str(options.site))
    console = Console(soft_wrap=True, highlight=False)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/"
        wrong = look(address, options.axe.read_text("utf-8"), console)
        server.shutdown()
    console.print(f"{len(PAGES)} pages, light and dark, {len(WIDTHS)} widths: {wrong} serious")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
