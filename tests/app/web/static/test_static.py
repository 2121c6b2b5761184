"""The page's files, as text: what a browser test would only see as something odd."""

import re
from importlib.resources import files

import pytest

STATIC = files("prefcal_app.web") / "static"
FILES = {f.name: f.read_text(encoding="utf-8") for f in STATIC.iterdir() if f.is_file()}
SCRIPTS = sorted(name for name in FILES if name.endswith(".js"))


def test_every_module_has_one_address_or_it_would_run_twice():
    pages = FILES["index.html"] + FILES["look.html"]
    linked = re.findall(r'<script type="module" src="/static/([^"]+)"', pages)
    imported = {f for s in SCRIPTS for f in re.findall(r'from "\./([^"]+)"', FILES[s])}
    assert linked == ["main.js", "look.js"]
    assert imported <= set(SCRIPTS)


@pytest.mark.parametrize("name", SCRIPTS)
def test_data_only_ever_becomes_text(name):
    for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("):
        assert word not in FILES[name]


@pytest.mark.parametrize("name", sorted(FILES))
def test_nothing_comes_from_elsewhere_and_nothing_is_inline(name):
    own = FILES[name].replace('"http://www.w3.org/2000/svg"', "")  # a name, not an address
    assert not re.search(r"(https?:)?//[\w-]+\.[\w.]+/", own)
    assert not re.search(r"<script(?![^>]*\bsrc=)|\bon(click|load|error)=", FILES[name])


@pytest.mark.parametrize("name", sorted(FILES))
def test_files_stay_small(name):
    assert FILES[name].count("\n") < 250


def test_every_element_that_the_scripts_name_is_on_the_page_or_made_by_them():
    ids = set(re.findall(r'\bid="([^"]+)"', FILES["index.html"] + FILES["look.html"]))
    made = {i for s in SCRIPTS for i in re.findall(r'id: "([^"]+)"', FILES[s])}
    wanted = {i for s in SCRIPTS for i in re.findall(r'\$\("([^"]+)"\)', FILES[s])}
    assert wanted <= ids | made
