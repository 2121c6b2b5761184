"""A room with an open question, and served studies, for the tests of the window."""

import contextlib

import pytest

from prefcal_scenarios.catalog import load
from support.browser import Watched, serve, window_on
from support.interviews import begin, proceed
from support.windows import make_room
from toy_study import TOY, toy_scenario


@pytest.fixture(scope="session")
def toy():
    return toy_scenario()


@pytest.fixture(scope="session")
def static(tmp_path_factory):
    """A page's files, small ones."""
    folder = tmp_path_factory.mktemp("static")
    (folder / "index.html").write_text('<script src="/static/main.js"></script>')
    (folder / "main.js").write_text("// " + "plain " * 400)
    (folder / "notes.txt").write_text("not for the page")
    return folder


def room_of(toy, static):
    """A room in which the first question of the toy is open."""
    interview = begin(toy)
    proceed(interview)
    return make_room(interview, static)


@pytest.fixture
def room(toy, static):
    return room_of(toy, static)


@pytest.fixture(scope="module")
def shared_room(toy, static):
    """The same one for all tests of a file, for requests that change nothing."""
    return room_of(toy, static)


@pytest.fixture
def window(tmp_path, toy):
    """Serve a study, of the toy by default, from this process."""
    with contextlib.ExitStack() as served:

        def start(scenario=None, n_max=13, **more):
            chosen = load(scenario) if isinstance(scenario, str) else scenario or toy
            return served.enter_context(window_on(chosen, tmp_path / "mine.prefcal", n_max, **more))

        yield start


@pytest.fixture
def opened(browser, window):
    """Open a study, of the toy by default, in a page that has nothing to complain of."""
    pages = []

    def start(scenario=None, n_max=13, **options):
        served, watched = window(scenario, n_max), Watched(browser, **options)
        pages.append(watched)
        watched.open(served.link)
        return served, watched

    yield start
    assert [watched.errors for watched in pages] == [[]] * len(pages)


@pytest.fixture
def command(tmp_path):
    """Start `prefcal calibrate` on a study in an empty folder; killed in the end."""
    started = []

    def start(scenario=TOY, *words, n_max=13):
        served = serve(tmp_path, scenario, "--n-max", str(n_max), *words)
        started.append(served)
        return served

    yield start
    for served in started:
        served.kill()
