"""Measure the query window as a person experiences it: waiting, page weight, memory.

Starts `prefcal calibrate cstr` and a headless browser on this machine, answers by keyboard, and
prints medians. The browser starts before the command; everything else is time that a person waits.

    python benchmarks/speed/window.py [--studies 5] [--answers 10] [--scenario cstr]
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

from support.browser import Served, Watched, chromium, serve

CURVES = "() => document.querySelectorAll('.js-plotly-plot .scatterlayer path.js-line').length > 1"
DRAWN = """() => { const { seen } = window;
  return seen.shown && performance.now() - seen.drawn > 300 ? seen : null; }"""
# From the key to the last change within both cards, curves among it, and to the frame after that.
WATCH = """() => { const seen = (window.seen = {});
  addEventListener("keydown", (event) => {
    window.seen = { key: event.timeStamp, question: document.body.dataset.question };
  }, true);
  const pair = document.getElementById("pair");
  new MutationObserver(() => {
    const seen = window.seen;
    if (!seen.key || document.body.dataset.question === seen.question) return;
    seen.drawn = performance.now();
    requestAnimationFrame(() => setTimeout(() => (seen.shown = performance.now())));
  }).observe(pair, { subtree: true, childList: true, attributes: true, characterData: true });
}"""
KEYS = ("ArrowLeft", "ArrowRight", "ArrowRight", "ArrowLeft", "ArrowDown")


def memory(served: Served) -> float:
    """Return the resident memory of the command [MB]."""
    status = Path(f"/proc/{served.process.pid}/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


def first_question(browser, scenario: str) -> tuple[float, float]:
    """Return the seconds from the command to its link, and to curves on the page."""
    with tempfile.TemporaryDirectory() as folder:
        watched = Watched(browser)
        began = time.perf_counter()
        served = serve(Path(folder), scenario)
        linked = time.perf_counter() - began
        watched.page.goto(served.link, wait_until="commit")
        watched.page.wait_for_function(CURVES, timeout=120_000)
        shown = time.perf_counter() - began
        served.kill()
        watched.page.context.close()
        return linked, shown


def answering(browser, scenario: str, answers: int) -> tuple[list[float], dict[str, float]]:
    """Return the seconds from each key to the next question drawn, page weight, and memory."""
    with tempfile.TemporaryDirectory() as folder:
        served, watched = serve(Path(folder), scenario), Watched(browser)
        sizes: dict[str, int] = {}

        def weigh(response) -> None:
            if response.request.resource_type != "fetch":
                length = response.headers.get("content-length", "0")
                sizes[response.url] = int(length)

        watched.page.on("response", weigh)
        watched.open(served.link)
        watched.page.evaluate(WATCH)
        waits, at_first = [], memory(served)
        for k in range(answers):
            watched.page.wait_for_timeout(1500)  # nobody answers at once
            watched.page.keyboard.press(KEYS[k % len(KEYS)])
            seen = watched.page.wait_for_function(DRAWN, polling=50).json_value()
            waits.append((seen["shown"] - seen["key"]) / 1e3)
        asked = watched.page.evaluate("() => fetch('/api/now').then((r) => r.text())")
        figures = {
            "page, compressed [kB]": sum(sizes.values()) / 1e3,
            "of which plotly.js [kB]": max(sizes.values()) / 1e3,
            "one question [kB]": len(asked.encode()) / 1e3,
            "memory at the first question [MB]": at_first,
            f"memory after {answers} answers [MB]": memory(served),
        }
        served.kill()
        return waits, figures


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=5)
    parser.add_argument("--answers", type=int, default=10)
    parser.add_argument("--scenario", default="cstr")
    given = parser.parse_args()
    with chromium() as browser:
        _, compiled = first_question(browser, given.scenario)
        starts = np.array([first_question(browser, given.scenario) for _ in range(given.studies)])
        waits, figures = answering(browser, given.scenario, given.answers)
    link, shown = np.median(starts, axis=0)
    print(f"{given.scenario}: command to link {link:.2f} s, to the first question with its curves")
    print(f"  {shown:.2f} s (median of {len(starts)}; worst {starts[:, 1].max():.2f} s)")
    print(f"  {compiled:.2f} s the first time, which compiles if NUMBA_CACHE_DIR is empty")
    median, late = np.percentile(waits, [50, 95])
    print(
        f"key to next question drawn: median {median * 1e3:.0f} ms, 95 % {late * 1e3:.0f} ms "
        f"({len(waits)} answers)"
    )
    for name, value in figures.items():
        print(f"{name}: {value:.0f}")


if __name__ == "__main__":
    main()
