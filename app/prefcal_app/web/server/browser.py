"""Open the window's link in a graphical browser, if there is one."""

import os
import sys
import webbrowser
from collections.abc import Mapping

_TEXT = frozenset({"www-browser", "links", "elinks", "lynx", "w3m", "links2"})
"""Browsers that would take over the terminal and do not run scripts."""
_NO_DISPLAY_NEEDED = ("win32", "cygwin", "darwin")


def open_browser(
    link: str, *, environ: Mapping[str, str] | None = None, platform: str = sys.platform
) -> bool:
    """Open `link` in a graphical browser and return whether one opened. Prints nothing.

    Args:
        link: Link to open.
        environ: Environment variables; those of this process if None.
        platform: Platform name, as in `sys.platform`.
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
    """Return whether a browser needs the terminal: by name, or since it runs in the foreground."""
    name = os.path.basename(str(getattr(browser, "name", "")))
    return name in _TEXT or type(browser) is webbrowser.GenericBrowser
