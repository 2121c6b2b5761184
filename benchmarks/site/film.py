"""Make the moving picture of the landing page: a calibration of the servo on the real page.

`python benchmarks/checks/figures.py --only film` calls it.
"""

import json
import sys
from collections.abc import Callable, Mapping
from io import BytesIO
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[2]
SCENARIO, CALIBRATOR, SEED = "servo", "weights", 0
EXPERIMENTS = 8
"""Number of experiments shown, so there is one question less."""
WIDTH, HEIGHT = 1200, 750
"""Size of the page in pixels."""
SHOWN = (960, 600)
"""Size of the picture in pixels."""
_CAPTION = """([text, button]) => {
  document.querySelectorAll('.verdict').forEach(v => v.style.outline = '');
  if (button) document.querySelector(button).style.outline = '4px solid #f9a825';
  let pill = document.getElementById('film-caption');
  if (!pill) {
    pill = document.createElement('div');
    pill.id = 'film-caption';
    pill.style.cssText = 'position:fixed;left:50%;top:56%;transform:translate(-50%,-50%);'
      + 'z-index:99;padding:10px 22px;border-radius:24px;background:#1a237e;color:#fff;'
      + 'font:600 22px sans-serif;box-shadow:0 2px 12px #0006;white-space:nowrap';
    document.body.append(pill);
  }
  pill.textContent = text;
  pill.hidden = !text;
  pill.style.display = text ? '' : 'none';
}"""

Frames = list[tuple[bytes, int]]
"""Screenshots, with the milliseconds for which each is shown."""


def film(folder: Path, prefcal: Callable[..., str]) -> tuple[dict[str, bytes], Mapping[str, float]]:
    """Calibrate the servo on the page, answered as by a person whose taste is known.

    Args:
        folder: Empty folder for studies and reports.
        prefcal: Function that runs the command `prefcal` with its words and returns its output.
    """
    path = folder / "answers.prefcal"
    prefcal("calibrate", SCENARIO, "--calibrator", CALIBRATOR, "--seed", str(SEED), "--n-max",
            str(EXPERIMENTS), "--study", str(path), "--out", str(folder / "answers"))  # fmt: skip
    asked = json.loads(prefcal("studies", "show", str(path), "--json"))["questions"]
    frames = recorded(folder, [(q["challenger"], q["verdict"]) for q in asked])
    pages = [Image.open(BytesIO(shot)).convert("RGB").resize(SHOWN) for shot, _ in frames]
    buffer = BytesIO()
    pages[0].save(buffer, format="WEBP", save_all=True, append_images=pages[1:], loop=0,
                  duration=[ms for _, ms in frames], quality=72, method=6)  # fmt: skip
    still = BytesIO()
    pages[0].save(still, format="WEBP", quality=80, method=6)
    pictures = {"film.webp": buffer.getvalue(), "film_still.webp": still.getvalue()}
    return pictures, {"questions": len(asked)}


def recorded(folder: Path, asked: list[tuple[int, str]]) -> Frames:
    """Answer on the page as `asked` says, (challenger, verdict) each; return what was seen."""
    sys.path.insert(0, str(ROOT / "tests"))
    from prefcal_scenarios.app.session.order import challenger_left
    from support.browser import Watched, chromium, serve

    frames: Frames = []
    with chromium() as browser:
        served = serve(folder, SCENARIO, "--seed", str(SEED), "--n-max", str(EXPERIMENTS))
        try:
            page = Watched(browser, viewport={"width": WIDTH, "height": HEIGHT})
            page.open(served.link)
            page.page.get_by_role("button", name="Got it").click()
            for number, (challenger, verdict) in enumerate(asked):
                page.page.wait_for_timeout(400)
                frames.append((page.page.screenshot(), 1700 if number < 3 else 1000))
                left = challenger_left(SEED, challenger - 1) == verdict.startswith("new")
                side, arrow = ("left", "←") if left else ("right", "→")
                page.page.evaluate(
                    _CAPTION, [f"{arrow}  the {side} one is better", f"#verdict-{side}"]
                )
                frames.append((page.page.screenshot(), 1000 if number < 3 else 700))
                page.page.evaluate(_CAPTION, ["", ""])
                if number + 1 < len(asked):
                    page.answer("ArrowLeft" if left else "ArrowRight")
            page.page.keyboard.press("ArrowLeft" if left else "ArrowRight")
            page.phase("over")
            page.page.wait_for_timeout(1500)
            frames.append((page.page.screenshot(), 4500))
        finally:
            served.kill()
    return frames
