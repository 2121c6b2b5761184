"""What every page of ours is made of: one file that asks the network for nothing."""

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from importlib.resources import files


def document(title: str, body: str) -> str:
    """A whole page: `title` is plain text, `body` the HTML of its main part."""
    css = files("prefcal_scenarios.report").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f"{body}\n</main>\n</body>\n</html>\n"
    )


def section(heading: str, content: str) -> str:
    """A card: `heading` is plain text, `content` HTML."""
    return f"<section>\n<h2>{escape(heading)}</h2>\n{content}\n</section>"


def image(title: str, kind: str, content: bytes, alt: str) -> str:
    """A picture of `kind` (png, gif) in the page itself; a narrow screen scrolls it."""
    data = b64encode(content).decode("ascii")
    return (
        '<div class="scroll" tabindex="0" role="region" '
        f'aria-label="Figure: {escape(title)}">'
        f'<img src="data:image/{kind};base64,{data}" alt="{escape(alt)}"></div>'
    )


def listing(caption: str, items: Mapping[str, object]) -> str:
    """A table of names and values, all plain text."""
    rows = "".join(
        f'<tr><th scope="row">{escape(str(k))}</th><td class="words">{escape(_text(v))}</td></tr>'
        for k, v in items.items()
    )
    return f"<table>\n<caption>{escape(caption)}</caption>\n<tbody>{rows}</tbody>\n</table>"


def _text(value: object) -> str:
    """A value as people read it: a list without its brackets."""
    return ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
