"""Serve the page, its files, and the files of the finished report."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response

from prefcal_app.web.server.files import Assets
from prefcal_app.web.server.security import NO_COOKIE, REPORT_POLICY, cookie, same

TYPES: Mapping[str, str] = {
    ".png": "image/png",
    ".csv": "text/csv; charset=utf-8",
    ".json": "application/json",
    ".html": "text/html; charset=utf-8",
}


@dataclass(slots=True)
class Reports:
    """The location of the finished report, known only at the end.

    Args:
        folder: Folder of the report; None until it is written.
    """

    folder: Path | None = None

    def read(self, name: str) -> tuple[bytes, str] | None:
        """Return content and type of the report's file `name`, or None if it cannot be shown."""
        media_type = TYPES.get(Path(name).suffix)
        if self.folder is None or media_type is None or name.startswith("."):
            return None
        try:
            # Compare with existing names instead of joining paths: no name can leave the folder.
            for path in self.folder.iterdir():
                if path.name == name and path.is_file() and not path.is_symlink():
                    return path.read_bytes(), media_type
        except OSError:
            pass
        return None


@dataclass(frozen=True, slots=True)
class Pages:
    """Handlers of everything that a browser loads without a script.

    Args:
        assets: Files of the page.
        reports: Finished report.
        token: Secret of the link.
        port: Port, part of the cookie's name.
        page: File of the page that the link opens.
    """

    assets: Assets
    reports: Reports
    token: str
    port: int
    page: str = "index.html"

    async def open(self, request: Request) -> Response:
        """Return the page and set the cookie that all other requests need."""
        if not same(request.path_params["token"], self.token):
            return PlainTextResponse(NO_COOKIE.error, NO_COOKIE.status)
        response = await self.index(request)
        response.headers["set-cookie"] = cookie(self.token, self.port)
        return response

    async def index(self, request: Request) -> Response:
        """Return the page."""
        return self.assets.response(self.page, request)

    async def static(self, request: Request) -> Response:
        """Return a file of the page."""
        return self.assets.response(request.path_params["file"], request)

    async def report(self, request: Request) -> Response:
        """Return a file of the report; its page has its own scripts and runs in a sandbox."""
        found = await run_in_threadpool(self.reports.read, request.path_params["file"])
        if found is None:
            raise HTTPException(404)
        content, media_type = found
        headers = {}
        if media_type.startswith("text/html"):
            headers["content-security-policy"] = REPORT_POLICY
        return Response(content, headers=headers, media_type=media_type)
