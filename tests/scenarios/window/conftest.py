"""A room with an open question, for the tests of the window."""

import pytest

from prefcal_scenarios.scenario import load
from support.interviews import begin, proceed
from support.windows import TOY, make_room


@pytest.fixture
def toy():
    return load(f"{TOY}:toy")


@pytest.fixture
def static(tmp_path):
    """A page's files, small ones."""
    folder = tmp_path / "static"
    folder.mkdir()
    (folder / "index.html").write_text('<script src="/static/main.js?v=VERSION"></script>')
    (folder / "main.js").write_text("// " + "plain " * 400)
    (folder / "notes.txt").write_text("not for the page")
    return folder


@pytest.fixture
def room(toy, static):
    """The first question of the toy is open."""
    interview = begin(toy)
    proceed(interview)
    return make_room(interview, static)
