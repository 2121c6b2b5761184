"""Opening the window's link in a browser, where there is one to be seen."""

import os
import sys
import webbrowser
from collections.abc import Mapping

_TEXT = frozenset({"www-browser", "links", "elinks", "lynx", "w3m", "links2"})
"""Browsers that would take the terminal over, and run no script."""
_NO_DISPLAY_NEEDED = ("win32", "cygwin", "darwin")


def open_browser(
    link: str, *, environ: Mapping[str, str] | None = None, platform: str = sys.platform
) -> bool:
    """Open `link` in a graphical browser; whether one was opened. Prints nothing.

    Args:
        link: What to open.
        environ: Environment variables; those of this process if None.
        platform: As `sys.platform`.
    """
    variables = os.environ if environ is None else environ
    display = any(variables.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if not display and platform not in _NO_DISPLAY_NEEDED:
        return False
    try:
        browser = webbrowser.get()
        if _is_text(browser):
            return False
        return bool(browser.open(link))
    except (webbrowser.Error, OSError):
        return False


def _is_text(browser: webbrowser.BaseBrowser) -> bool:
    """Whether it needs the terminal: by its name, or because the library runs it in front."""
    name = os.path.basename(str(getattr(browser, "name", "")))
    return name in _TEXT or type(browser) is webbrowser.GenericBrowser
