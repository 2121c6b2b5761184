"""What tests of pages look for: colors on the screen, and what a checker of accessibility finds."""

import io
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image

if TYPE_CHECKING:
    from playwright.sync_api import Page

Axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe

COLORS = {"runOnly": {"type": "rule", "values": ["color-contrast"]}}


def serious(page: "Page") -> list[Any]:
    """What axe finds in light, and about colors in dark, by the rule and the first element."""
    found = Axe().run(page).response["violations"]
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(350)
    found += Axe().run(page, options=COLORS).response["violations"]
    page.emulate_media(color_scheme="light")
    page.wait_for_timeout(350)
    return [(v["id"], v["nodes"][0]["html"][:120]) for v in found if v["impact"] in ("serious", "critical")]


def pixels(page: "Page", selector: str, color: tuple[int, int, int]) -> int:
    """How many pixels of an element are of a color, nearly."""
    shot = page.locator(selector).screenshot()
    image = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
    return int(np.sum(np.abs(image - color).max(axis=2) < 20))
