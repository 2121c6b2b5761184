"""The site: every public name and page is on it, links lead somewhere, nothing needs a network."""

import ast
import functools
import http.server
import importlib
import re
import threading
from pathlib import Path

import pytest

from support.browser import Watched

mkdocs = pytest.importorskip("mkdocs.config")
pytest.importorskip("material")

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
PACKAGES = {
    "prefcal_env": ROOT / "prefcal_env",
    "prefcal_agents": ROOT / "agents" / "prefcal_agents",
    "prefcal_scenarios": ROOT / "scenarios" / "prefcal_scenarios",
    "prefcal_app": ROOT / "app" / "prefcal_app",
    "prefcal_bench": ROOT / "benchmarks" / "prefcal_bench",
}
INTERNAL = (
    "prefcal_app",
    "prefcal_bench.cli",
    "prefcal_bench.reproduce",
    "prefcal_env.workers",
    "prefcal_scenarios.isolated",
)
"""Command line, page and what runs them: people use the command, not the code, but for the names
of `prefcal_app` itself."""


@pytest.fixture
def hooks(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "site")
    return importlib.import_module("hooks")


@pytest.fixture
def check(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "site")
    return importlib.import_module("pages")


def public_names():
    """Yield (module, name) of every name that an `__init__` of the packages exports."""
    for package, folder in PACKAGES.items():
        for path in sorted(folder.rglob("__init__.py")):
            inside = path.parent.relative_to(folder)
            module = ".".join([package, *inside.parts])
            if module.startswith(INTERNAL) and module != "prefcal_app":
                continue
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.ImportFrom):
                    for alias in node.names:
                        if alias.asname == alias.name:
                            yield module, alias.name


def test_every_public_name_has_its_place_in_the_api_reference():
    text = "\n".join(page.read_text("utf-8") for page in (DOCS / "api").glob("*.md"))
    shown = re.findall(r"^::: ([\w.]+)$", text, re.M)
    # A subpackage may export again what its package exports: one place is enough.
    places = {(name.partition(".")[0], name.rpartition(".")[2]) for name in shown}
    names = list(public_names())
    missing = [f"{m}.{n}" for m, n in names if (m.partition(".")[0], n) not in places]
    assert missing == []
    assert len(names) > 200
    assert len(shown) == len(set(shown))


def nav(items, folder=""):
    """Yield (section, page) of a navigation."""
    for item in items:
        if isinstance(item, str):
            yield folder, item
            continue
        for title, inside in item.items():
            if isinstance(inside, str):
                yield folder, inside
            else:
                yield from nav(inside, f"{folder}/{title}" if folder else title)


@pytest.fixture(scope="module")
def config():
    return mkdocs.load_config(str(ROOT / "mkdocs.yml"), plugins=["search"])


def test_every_page_is_in_the_navigation_once(config):
    pages = [page for _, page in nav(config["nav"])]
    there = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")} - {"paper/paper.md"}
    root = {"architecture.md", "changelog.md", "contributing.md", "security.md"}
    assert set(pages) == there | root
    assert len(pages) == len(set(pages))


def test_every_guide_and_every_example_ends_with_what_to_do_next(config):
    sections = ("Guides/", "Gallery")
    pages = [page for section, page in nav(config["nav"]) if f"{section}/".startswith(sections)]
    pages.remove("gallery/README.md")
    for page in ["start.md", *pages]:
        headings = re.findall(r"^## (.*)$", (DOCS / page).read_text("utf-8"), re.M)
        assert headings[-1] == "What next", page
    assert len(pages) > 20


def section(text, anchor):
    """Return the section of a page whose heading has this anchor."""
    parts = re.split(r"^## (.*)\n", text, flags=re.M)
    (found,) = [
        words
        for heading, words in zip(parts[1::2], parts[2::2], strict=True)
        if re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") == anchor
    ]
    return found


def test_every_example_of_the_gallery_is_a_card_with_its_picture_and_runs():
    gallery = DOCS / "gallery"
    cards = re.findall(
        r"!\[\]\(\.\./figures/(gallery_\w+\.png)\)\s+\*\*\[[^]]+\]\(([\w./-]+\.md)#?([\w-]*)\)",
        (gallery / "README.md").read_text("utf-8"),
    )
    here = {path.name for path in gallery.glob("*.md")} - {"README.md"}
    assert {page for _, page, _ in cards if "/" not in page} == here
    assert len(cards) >= 12
    assert {picture for picture, _, _ in cards} == {
        path.name for path in (DOCS / "figures").glob("gallery_*")
    }
    for picture, page, anchor in cards:
        text = (gallery / page).read_text("utf-8")
        shown = section(text, anchor) if anchor else text
        assert f"figures/{picture})" in shown, page
        assert re.search(r"^```(python|console)\n", shown, re.M), page


@pytest.mark.parametrize(
    ("link", "folder", "expected"),
    [
        ("pid.md", "docs", "pid.md"),
        ("../README.md", "docs", "index.md"),
        ("../README.md#try-it", "docs", "start.md"),
        ("../../CHANGELOG.md", "docs/research", "../changelog.md"),
        ("../ARCHITECTURE.md#where-to-add", "docs", "architecture.md#where-to-add"),
        ("docs/deviations.md#conclusions", "", "deviations.md#conclusions"),
        ("tests/test_imports.py", "", "source/tests/test_imports.py"),
        ("../LICENSE", "docs", "source/LICENSE"),
        ("https://example.org/README.md", "docs", "https://example.org/README.md"),
        ("#keys", "docs", "#keys"),
        ("nowhere.md", "", "nowhere.md"),
    ],
)
def test_links_lead_to_where_things_are_on_the_site(hooks, link, folder, expected):
    assert hooks.moved(link, folder) == expected


def test_a_file_outside_of_the_docs_is_copied_if_a_page_links_to_it(hooks):
    pages = [("", "[t](tests/test_imports.py) and [p](docs/pid.md)"), ("docs/api", "[no](x.md)")]
    assert list(hooks.linked_sources(pages)) == ["tests/test_imports.py"]


def test_the_check_finds_what_is_broken_and_what_comes_from_elsewhere(check, tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "index.html").write_text(
        '<h2 id="here">x</h2><a href="../#top">up</a><a href="#there">no</a><a href="../b/">no</a>'
        '<script src="https://cdn.example/x.js"></script><link rel="canonical" href="https://e.x/">'
        '<img srcset="../p.png 1x, //img.example/q.png 2x" src="data:image/png;base64,AA">'
    )
    (tmp_path / "index.html").write_text('<p id="top"><a href="a/#here">a</a><a href="https://e.x">e</a>')
    (tmp_path / "p.png").touch()
    (tmp_path / "s.css").write_text('@import "https://fonts.example/f.css"; a{background:url(p.png)}')
    assert list(check.broken(tmp_path)) == [
        "a/index.html loads //img.example/q.png",
        "a/index.html loads https://cdn.example/x.js",
        "a/index.html: #there has no such anchor",
        "a/index.html: ../b/ is not there",
        "s.css loads https://fonts.example/f.css",
    ]


@pytest.fixture(scope="module")
def site(tmp_path_factory, config):
    """The site without the API reference, which takes most of the time; CI builds all of it."""
    from mkdocs.commands.build import build

    folder = tmp_path_factory.mktemp("site")
    config["site_dir"] = str(folder)
    build(config)
    handler = functools.partial(Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files without a log."""

    def log_message(self, *words):
        """Say nothing."""


def test_pages_and_search_work_without_a_network(site, browser):
    watched = Watched(browser)
    failed = []
    watched.page.on("response", lambda r: r.status >= 400 and failed.append(r.url))
    for page in ("", "start/", "gallery/", "gallery/reactor/", "research/archive/", "changelog/"):
        watched.page.goto(site + page)
        assert watched.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    # The search listens to keys: it may miss a value that is set at once.
    watched.page.get_by_role("textbox", name="Search").press_sequentially("windup")
    watched.page.wait_for_selector(".md-search-result__link[href*='pid/']")
    assert failed == []
    assert watched.errors == []
    assert all(url.startswith((site, "data:", "blob:")) for url in watched.requests)
