"""Hold the page's files in memory; no other file can be requested."""

from collections.abc import Mapping
from hashlib import sha256
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

_STATIC = files("prefcal_app.web") / "static"
_PLOTLY = "plotly-basic.min.js"
_TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
"""Types by suffix. Those of the system are not used: on some, scripts are plain text."""


class Assets:
    """The files of the folder `static`, and plotly.js, which has a folder of its own there.

    Args:
        folder: Folder of the files; the package's own if None.
    """

    def __init__(self, folder: Traversable | None = None) -> None:
        own = _STATIC if folder is None else folder
        found = list(own.iterdir()) if own.is_dir() else []
        # Compare with existing names instead of joining paths: no name can leave the folder.
        wanted = [file for file in found if file.is_file() and Path(file.name).suffix in _TYPES]
        self._contents = {file.name: file.read_bytes() for file in wanted}
        self._contents[_PLOTLY] = (_STATIC / "plotly" / _PLOTLY).read_bytes()
        self._tags = {
            name: f'"{sha256(content).hexdigest()[:20]}"' for name, content in self._contents.items()
        }

    def response(self, name: str, request: Request) -> Response:
        """Return the file called `name`, or that the browser has it already.

        Raises:
            HTTPException: If there is no such file.
        """
        if name not in self._contents:
            raise HTTPException(404)
        # Browsers ask each time whether it has changed.
        headers = {"cache-control": "no-cache", "etag": self._tags[name]}
        if self._tags[name] in request.headers.get("if-none-match", ""):
            return Response(status_code=304, headers=headers)
        media_type = _TYPES[Path(name).suffix]
        return Response(self._contents[name], headers=headers, media_type=media_type)
