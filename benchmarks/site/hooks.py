"""Make the site from the Markdown that GitHub shows, too: pages and files outside of docs/.

MkDocs knows only docs/. The files in `PAGES` become pages of the site, every other file that a page
links to is copied to source/, and links follow. `mkdocs.yml` names this file.
"""

import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
PAGES = {
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Pages made of files outside of docs/."""
PLACES = {**PAGES, "README.md": "index.md", "README.md#try-it": "start.md"}
"""Page of the site for what else links name; with an anchor, for that section."""
_LINK = re.compile(r"(\]\()([^)\s]+)(\))")


ICON = ROOT / "app" / "prefcal_app" / "web" / "static" / "icon.svg"


def moved(link: str, folder: str) -> str:
    """Return a link for the site, relative to the folder of its page in docs/.

    Args:
        link: Target as written in the Markdown file, for example `../README.md#try-it`.
        folder: Folder of that file in the repository: "docs", "docs/research", or "" for the root,
            whose files become pages at the top of the site.
    """
    path, _, anchor = link.partition("#")
    target = posixpath.normpath(posixpath.join(folder, path))
    if ":" in link or not path or target.startswith(".."):
        return link
    if f"{target}#{anchor}" in PLACES:
        found, anchor = PLACES[f"{target}#{anchor}"], ""
    elif target in PLACES:
        found = PLACES[target]
    elif target.startswith("docs/"):
        found = target.removeprefix("docs/")
    elif (ROOT / target).is_file():
        found = f"source/{target}"
    else:
        return link
    inside = posixpath.relpath(folder, "docs") if folder else "."
    return posixpath.relpath(found, inside) + (f"#{anchor}" if anchor else "")


def rewritten(text: str, folder: str) -> str:
    """Return Markdown with the links of the site; `folder` as in `moved`."""
    return _LINK.sub(lambda m: m[1] + moved(m[2], folder) + m[3], text)


def linked_sources(pages: list[tuple[str, str]]) -> Iterator[str]:
    """Yield the files outside of docs/ that pages, (folder, Markdown), link to."""
    for folder, text in pages:
        for _, link, _ in _LINK.findall(text):
            at = posixpath.normpath(
                posixpath.join(
                    "docs", posixpath.relpath(folder or "docs", "docs"), moved(link, folder).partition("#")[0]
                )
            )
            if at.startswith("docs/source/"):
                yield at.removeprefix("docs/source/")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Offer other versions only if `mike` builds the site, since only then there are any."""
    if "MIKE_DOCS_VERSION" not in os.environ:
        config.extra.pop("version", None)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and files that are outside of docs/."""
    pages = [("", (ROOT / name).read_text("utf-8")) for name in PAGES]
    for path in (ROOT / "docs").rglob("*.md"):
        pages.append((path.parent.relative_to(ROOT).as_posix(), path.read_text("utf-8")))
    files.append(File.generated(config, "icon.svg", abs_src_path=str(ICON)))
    for name, page in PAGES.items():
        text = rewritten((ROOT / name).read_text("utf-8"), "")
        files.append(File.generated(config, page, content=text))
    for source in sorted(set(linked_sources(pages))):
        files.append(File.generated(config, f"source/{source}", abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Let links lead to where things are on the site."""
    if page.file.src_uri in PAGES.values():
        return markdown
    return rewritten(markdown, posixpath.join("docs", posixpath.dirname(page.file.src_uri)).rstrip("/"))


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Name the dialog of the search, which the theme leaves without a name for screen readers."""
    dialog = 'data-md-component="search" role="dialog"'
    return output.replace(dialog, f'{dialog} aria-label="Search"')
