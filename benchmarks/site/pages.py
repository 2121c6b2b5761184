"""Check a built site: links and anchors lead somewhere, and nothing is loaded from the network.

    mkdocs build --strict
    python benchmarks/site/pages.py build/site

MkDocs checks the links that it renders; this also checks HTML in pages, links of docstrings, files
and the theme. Links to other sites are counted, not followed.
"""

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from rich.console import Console

LOADED = {
    "script": ("src",),
    "img": ("src", "srcset"),
    "source": ("src", "srcset"),
    "link": ("href",),
    "iframe": ("src",),
    "video": ("src", "poster"),
    "audio": ("src",),
    "object": ("data",),
    "embed": ("src",),
    "track": ("src",),
    "input": ("src",),
}
"""Attributes that make a browser load something, by tag."""
NOT_LOADED = {"canonical", "alternate", "prev", "next", "author", "license"}
"""Relations of `link` that load nothing."""
_CSS = re.compile(r"""(?:url\(\s*|@import\s+)["']?((?:https?:)?//[^"')\s]+)""")


@dataclass
class _Found(HTMLParser):
    """What a page links to, loads, and can be linked to by."""

    links: set[str] = field(default_factory=set)
    loads: set[str] = field(default_factory=set)
    anchors: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note what the tag links to, loads, or can be linked by."""
        given = {name: value for name, value in attrs if value is not None}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.add(given["href"])
        if tag == "link" and NOT_LOADED & set(given.get("rel", "").split()):
            return
        for name in LOADED.get(tag, ()):
            if name in given:
                parts = given[name].split(",") if name == "srcset" else [given[name]]
                self.loads |= {part.split()[0] for part in parts if part.strip()}


def read(page: Path) -> _Found:
    """Return what is in a page."""
    found = _Found()
    found.feed(page.read_text("utf-8"))
    return found


def target(site: Path, page: Path, link: str) -> Path:
    """Return the file that a link without scheme leads to; a folder stands for its index."""
    path = unquote(urlsplit(link).path)
    if not path:
        return page
    at = (site / path.lstrip("/")) if path.startswith("/") else (page.parent / path)
    at = at.resolve()
    return at / "index.html" if at.is_dir() else at


def is_foreign(link: str) -> bool:
    """Return whether a link leaves the site."""
    parts = urlsplit(link)
    return bool(parts.netloc) or parts.scheme not in ("", "data")


def broken(site: Path) -> Iterator[str]:
    """Yield every link that leads nowhere, and everything loaded from elsewhere."""
    pages = {page.resolve(): read(page) for page in sorted(site.rglob("*.html"))}
    for page, found in pages.items():
        name = page.relative_to(site.resolve())
        for link in sorted(found.loads):
            if is_foreign(link):
                yield f"{name} loads {link}"
        for link in sorted(found.links | found.loads):
            if is_foreign(link) or link.startswith("data:"):
                continue
            at, anchor = target(site, page, link), unquote(urlsplit(link).fragment)
            if not at.is_file():
                yield f"{name}: {link} is not there"
            elif anchor and at in pages and anchor not in pages[at].anchors:
                yield f"{name}: {link} has no such anchor"
    for sheet in sorted(site.rglob("*.css")):
        for link in _CSS.findall(sheet.read_text("utf-8")):
            yield f"{sheet.relative_to(site)} loads {link}"


def main() -> int:
    site, console = Path(sys.argv[1]), Console(soft_wrap=True, highlight=False)
    pages = list(site.rglob("*.html"))
    if not pages:
        console.print(f"[red]{site} holds no page: run mkdocs build --strict first[/]")
        return 1
    wrong = list(broken(site))
    for words in wrong:
        console.print(words, style="red", markup=False)
    away = {link for page in pages for link in read(page).links if is_foreign(link)}
    console.print(f"{len(pages)} pages, {len(wrong)} wrong; {len(away)} links to other sites")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
