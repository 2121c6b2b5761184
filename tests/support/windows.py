"""The application around a real interview of the toy scenario, without a socket."""

import asyncio
import threading
from dataclasses import dataclass, field
from pathlib import Path

import httpx
from starlette.applications import Starlette

from prefcal_app.session import Interview
from prefcal_app.web.api import Api, Patience, Reports
from prefcal_app.web.serve import make_app

TOKEN, PORT = "the-token", 8765
HOST = f"127.0.0.1:{PORT}"
ORIGIN = f"http://{HOST}"
COOKIE = f"prefcal_{PORT}={TOKEN}"


@dataclass
class Page:
    """Requests to an application, as a browser makes them, without a socket."""

    app: Starlette
    headers: dict[str, str]

    def request(self, method: str, path: str, **options) -> httpx.Response:
        """One request."""

        async def send() -> httpx.Response:
            async with self.client() as client:
                return await client.request(method, path, **options)

        return asyncio.run(send())

    def client(self) -> httpx.AsyncClient:
        """For several requests at once."""
        transport = httpx.ASGITransport(self.app)  # raises what the application raises
        return httpx.AsyncClient(transport=transport, base_url=ORIGIN, headers=self.headers)

    def get(self, path: str, **options) -> httpx.Response:
        """One GET."""
        return self.request("GET", path, **options)

    def post(self, path: str, **options) -> httpx.Response:
        """One POST."""
        return self.request("POST", path, **options)


@dataclass
class Room:
    """An application, what it is about, and a page that has the cookie."""

    interview: Interview
    app: Starlette
    reports: Reports
    closed: threading.Event
    api: Api
    seen: list[str] = field(default_factory=list)

    def page(self, *, cookie: str = COOKIE, **headers: str) -> Page:
        """Requests as a page of ours makes them; what is empty is left out."""
        given = {"cookie": cookie, "origin": ORIGIN, **headers}
        return Page(self.app, {name: value for name, value in given.items() if value})

    def post(self, action: str, **body: object):
        """An action, as the page asks for it."""
        return self.page().post(f"/api/{action}", json=body)

    @property
    def events(self) -> list[object]:
        """What the study file holds."""
        return list(self.interview.file.events())

    def question(self) -> int:
        """Id of the open question."""
        question = self.interview.now().question
        assert question is not None
        return question.id


def make_room(interview: Interview, static: Path | None = None, *, patience: Patience | None = None) -> Room:
    """A room around `interview`, in which nobody is let wait."""
    reports, closed, seen = Reports(), threading.Event(), []
    patience = patience or Patience(poll=0.05, after_answer=0.0)
    api = Api(interview, reports, closed, lambda waits: seen.append("poll"), patience)
    app = make_app(api, token=TOKEN, port=PORT, static=static)
    return Room(interview, app, reports, closed, api, seen)
