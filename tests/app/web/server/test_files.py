"""The page's own files, and those of the report."""

import asyncio
import tomllib
from hashlib import sha256
from importlib.resources import files

import httpx
import pytest

from prefcal_app.web.api import Pace
from support.interviews import begin, proceed
from support.windows import make_room


def test_a_file_that_the_browser_has_is_not_sent_again(room, static):
    first = room.page().get("/static/main.js")
    assert first.text == (static / "main.js").read_text()
    assert first.headers["cache-control"] == "no-cache"  # the browser asks whether it has changed
    again = room.page(**{"if-none-match": first.headers["etag"]}).get("/static/main.js")
    assert (again.status_code, again.content) == (304, b"")
    other = room.page(**{"if-none-match": '"other"'}).get("/static/main.js")
    assert other.status_code == 200


def test_plotly_is_the_version_that_its_folder_names(room):
    folder = files("prefcal_app.web") / "static" / "plotly"
    source = tomllib.loads((folder / "SOURCE.toml").read_text(encoding="utf-8"))
    response = room.page().get(f"/static/{source['file']}")
    assert response.status_code == 200
    assert response.headers["content-type"].startswith("text/javascript")
    assert sha256(response.content).hexdigest() == source["sha256"]
    assert f"plotly.js (basic - minified) v{source['version']}".encode() in response.content[:80]
    assert "MIT License" in (folder / "LICENSE").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name", ["notes.txt", "../index.html", "%2e%2e%2findex.html", "..%5cindex.html", "%00", "main.js%00"]
)
def test_only_the_files_of_the_page_are_there(room, name):
    assert room.page().get(f"/static/{name}").status_code == 404


def test_the_report_is_there_once_it_is_written(room, tmp_path):
    page = room.page()
    assert page.get("/report/a.png").status_code == 404
    folder = tmp_path / "report"
    folder.mkdir()
    (tmp_path / "secret.json").write_text("{}")
    for name in ("a.png", "b.html", "c.py", ".d.json", "e.svg"):
        (folder / name).write_bytes(b"content")
    (folder / "link.json").symlink_to(tmp_path / "secret.json")
    (folder / "folder.png").mkdir()
    room.reports.folder = folder
    picture = page.get("/report/a.png")
    assert (picture.content, picture.headers["content-type"]) == (b"content", "image/png")
    policy = page.get("/report/b.html").headers["content-security-policy"]
    assert policy.startswith("sandbox allow-popups; default-src 'none'")
    assert "allow-same-origin" not in policy
    assert room.page(cookie="").get("/report/b.html").status_code == 401
    for name in ("c.py", ".d.json", "e.svg", "link.json", "folder.png", "%2e%2e%2fsecret.json", "z.png"):
        assert page.get(f"/report/{name}").status_code == 404


def test_the_report_wakes_the_pages(toy, static, tmp_path):
    interview = begin(toy)
    proceed(interview)
    room = make_room(interview, static, pace=Pace(poll=60.0))
    version = interview.now().version

    async def meet() -> httpx.Response:
        async with room.page().client() as client:
            poll = asyncio.create_task(client.get(f"/api/now?after={version}"))
            while not room.api.waiting.borrowed_tokens:
                await asyncio.sleep(0)
            room.reports.folder = tmp_path
            return await asyncio.wait_for(poll, 20)

    assert asyncio.run(meet()).status_code == 200
