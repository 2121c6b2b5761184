"""A browser is opened where one can be seen, never in the terminal."""

import webbrowser

import pytest

from prefcal_app.web import open_browser

SCREEN = {"DISPLAY": ":0"}


class Graphical(webbrowser.BaseBrowser):
    """Remembers what it was asked to open."""

    def __init__(self, name="firefox", works=True):
        super().__init__(name)
        self.opened, self._works = [], works

    def open(self, url, new=0, autoraise=True):
        self.opened.append(url)
        return self._works


def found(monkeypatch, browser):
    monkeypatch.setattr(webbrowser, "get", lambda using=None: browser)
    return browser


@pytest.mark.parametrize(
    ("environ", "platform", "opens"),
    [
        (SCREEN, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({"DISPLAY": ""}, "linux", False),
        ({}, "darwin", True),
    ],
)
def test_a_graphical_browser_is_opened_where_there_is_a_display(monkeypatch, environ, platform, opens):
    browser = found(monkeypatch, Graphical())
    assert open_browser("http://x/", environ=environ, platform=platform) is opens
    assert browser.opened == ["http://x/"] * opens


@pytest.mark.parametrize("name", ["w3m", "/usr/bin/lynx", "www-browser", "links", "elinks"])
def test_no_browser_that_would_run_in_the_terminal_is_opened(monkeypatch, name):
    browser = found(monkeypatch, Graphical(name))
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")
    assert browser.opened == []
    found(monkeypatch, webbrowser.GenericBrowser("/bin/false"))
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")


def test_no_browser_is_no_error(monkeypatch):
    def none(using=None):
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", none)
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")
    found(monkeypatch, Graphical(works=False))
    assert not open_browser("http://x/", environ=SCREEN, platform="linux")
