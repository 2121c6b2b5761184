"""Reads the HTML that is written: tags in order, attributes, tables."""

from html.parser import HTMLParser

VOID = {"meta", "img", "br", "link"}


class Outline(HTMLParser):
    """Collects tags and attributes, and refuses tags that are not closed in order."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags = [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def all(self, tag):
        return [attrs for name, attrs in self.tags if name == tag]


def assert_accessible(page):
    """Language, headings, texts for pictures, tables with captions, and a dark scheme."""
    outline = Outline(page)
    assert outline.all("html") == [{"lang": "en"}]
    assert len(outline.all("h1")) == 1
    assert all(len(a["alt"]) > 40 for a in outline.all("img"))
    assert all("scope" in a for a in outline.all("th"))
    assert len(outline.all("caption")) == len(outline.all("table"))
    assert "prefers-color-scheme: dark" in page
