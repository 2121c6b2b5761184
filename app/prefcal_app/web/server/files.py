"""Hold the page's files in memory; no other file can be requested."""

import gzip
import hashlib
import importlib.util
import threading
from collections.abc import ItemsView, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

PLOTLY = "plotly.min.js"
_TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/x-icon",
}
_TEXT = ("text/", "image/svg")
_PLACEHOLDER = b"?v=VERSION"
"""Placeholder in links, replaced by a version, so that browsers cache a file until it changes.

Do not use it for modules that others import without it: the browser would load them twice.
"""


@dataclass(slots=True)
class Asset:
    """A file of the page.

    Args:
        content: Bytes of the file.
        media_type: Value of the Content-Type header.
        tag: Tag that changes with the content.
        packed: Gzipped bytes; None until they are ready, or if gzip is not worth it.
    """

    content: bytes
    media_type: str
    tag: str = field(default="")
    packed: bytes | None = None

    def __post_init__(self) -> None:
        self.tag = hashlib.sha256(self.content).hexdigest()[:20]

    def pack(self) -> None:
        """Gzip the content and keep the result."""
        if self.media_type.startswith(_TEXT) and len(self.content) > 1024:
            # Without a timestamp the bytes are the same every time.
            self.packed = gzip.compress(self.content, 6, mtime=0)


class Assets:
    """The files of the folder `static`, and plotly.js from the installed plotly package.

    Args:
        folder: Folder of the files; the package's own if None.
    """

    def __init__(self, folder: Traversable | None = None) -> None:
        own = files("prefcal_app.web") / "static" if folder is None else folder
        self._assets = {name: Asset(content, _type(name)) for name, content in _read(own).items()}
        plotly = _plotly()
        if plotly is not None:
            self._assets[PLOTLY] = Asset(plotly.read_bytes(), _TYPES[".js"])
        self._stamp()

    def get(self, name: str) -> Asset | None:
        """Return the file called `name`, or None if there is none."""
        return self._assets.get(name)

    def items(self) -> ItemsView[str, Asset]:
        """Return all files by name."""
        return self._assets.items()

    def pack_all(self) -> threading.Thread:
        """Gzip all files in a thread; until then, files are sent uncompressed."""
        thread = threading.Thread(target=self._pack, name="gzip", daemon=True)
        thread.start()
        return thread

    def _pack(self) -> None:
        for asset in sorted(self._assets.values(), key=lambda asset: len(asset.content)):
            asset.pack()

    def _stamp(self) -> None:
        """Put one version for all files into their links."""
        tags = "".join(f"{name} {asset.tag}\n" for name, asset in sorted(self._assets.items()))
        version = hashlib.sha256(tags.encode()).hexdigest()[:12].encode()
        for name, asset in self._assets.items():
            if name != PLOTLY and asset.media_type.startswith(_TEXT):
                content = asset.content.replace(_PLACEHOLDER, b"?v=" + version)
                self._assets[name] = Asset(content, asset.media_type)


def _read(folder: Traversable) -> dict[str, bytes]:
    if not folder.is_dir():
        return {}
    found = (f for f in folder.iterdir() if f.is_file() and Path(f.name).suffix in _TYPES)
    return {f.name: f.read_bytes() for f in found}


def _type(name: str) -> str:
    return _TYPES[Path(name).suffix]


def _plotly() -> Path | None:
    """Return the path of plotly.js, found without importing plotly, which would take a second."""
    spec = importlib.util.find_spec("plotly")
    if spec is None or spec.origin is None:
        return None
    path = Path(spec.origin).parent / "package_data" / PLOTLY
    return path if path.is_file() else None
