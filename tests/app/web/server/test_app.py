"""Every address of the window, around a real interview; its files, and how errors are told."""

import asyncio
import threading
import tomllib
from hashlib import sha256
from importlib.resources import files

import httpx
import pytest

from prefcal_app.session import Choice, Interview, Phase, actions
from prefcal_app.web.api import Patience
from support.interviews import begin, proceed
from support.windows import make_room

LEFT, RIGHT = Choice.LEFT, Choice.RIGHT


def verdict(room, **changes):
    return {"question": room.question(), "choice": "left", "comment": "", "blind": False, **changes}


def test_now_shows_the_open_question(room):
    shown = room.page().get("/api/now").json()
    assert shown["question"]["id"] == room.question()
    assert (shown["phase"], shown["blind"]) == ("question", False)
    assert room.page().get("/api/now?blind=1").json()["blind"] is True
    assert room.seen == ["poll", "poll"]


def test_forty_polls_wake_with_an_answer_that_they_do_not_hold_up(toy, static):
    interview = begin(toy)
    proceed(interview)
    room = make_room(interview, static, patience=Patience(poll=60.0, after_answer=0.0))
    version = interview.now().version

    async def meet() -> list[httpx.Response]:
        async with room.page().client() as client:
            polls = [asyncio.create_task(client.get(f"/api/now?after={version}")) for _ in range(60)]
            while len(room.seen) < 60:  # all of them are in
                await asyncio.sleep(0)
            answered = await client.post("/api/answer", json=verdict(room))
            return [answered, *await asyncio.gather(*polls)]

    async def in_time() -> list[httpx.Response]:
        return await asyncio.wait_for(meet(), 20)

    answered, *polled = asyncio.run(in_time())
    assert room.page().get("/api/now?after=0").status_code == 200  # at once: another version
    assert answered.json()["version"] > version
    assert all(p.json()["version"] > version for p in polled)


def test_an_answer_is_recorded_with_what_belongs_to_it(room):
    asked = room.interview.now().question
    body = verdict(room, choice="right", comment="θ: it swings", blind=True)
    assert room.post("answer", **body).status_code == 200
    (closed,) = room.interview.now().state.history.comparisons[1:]
    assert (closed.question, closed.comment, closed.blind) == (asked.id, "θ: it swings", True)
    assert closed.answer.preference is asked.preference(Choice.RIGHT)


def test_the_answer_waits_for_the_next_question(toy, static):
    interview = begin(toy)
    proceed(interview)
    room = make_room(interview, static, patience=Patience(after_answer=60.0))
    first = room.question()
    worker = threading.Thread(target=lambda: work_until_another(interview, first))
    worker.start()
    shown = room.post("answer", **verdict(room)).json()
    worker.join()
    assert shown["phase"] == "question"
    assert shown["question"]["id"] != first


def work_until_another(interview: Interview, first: int) -> None:
    while (now := interview.now()).question is None or now.question.id == first:
        interview.wait(now.version, 60.0) if now.phase is Phase.QUESTION else interview.work()


def test_the_study_ends_and_goes_on(room):
    assert room.post("go_on", more=1).status_code == 409
    assert room.post("finish").json()["phase"] == "over"
    assert room.interview.now().state.ended == "stopped"
    assert room.post("go_on", more=10).status_code == 200
    assert room.interview.now().state.n_max == 16
    assert room.post("go_on", more=10_001).status_code == 400


def test_the_questions_per_experiment_are_changed(room):
    assert room.page().get("/api/status").json()["questions"] == 1
    assert room.post("pace", questions=3).status_code == 200
    assert room.page().get("/api/status").json()["questions"] == 3
    for impossible in (0, 100, 1.5, "3"):
        assert room.post("pace", questions=impossible).status_code == 400
    assert room.interview.known.questions == 3


def test_history_and_status_are_shown(room):
    room.post("answer", **verdict(room))
    page = room.page()
    assert page.get("/api/history").status_code == 200
    assert page.get("/api/status").status_code == 200
    asked = page.get("/api/history/1?blind=1")
    assert asked.status_code == 200
    assert asked.json()["question"]["id"] == room.interview.past.asked(1).id
    for answer in ("0", "2", "x", "-1", "1.0", "9" * 30):
        assert page.get(f"/api/history/{answer}").status_code == 404


def test_a_record_that_nobody_waits_for_is_told(room):
    page = room.page(**{"content-type": "text/csv"})
    late = page.post("/api/record?index=0&unsafe=0", content=b"time\n0\n")
    assert (late.status_code, late.json()["kind"]) == (409, "stale")
    assert late.json()["now"]["phase"] == "question"
    assert page.post("/api/record", content=b"time").status_code == 400
    wrong = room.page(**{"content-type": "application/json"})
    assert wrong.post("/api/record?index=0", content=b"time").status_code == 415


def test_a_record_arrives_as_it_was_sent(room, monkeypatch):
    got = []

    def do(self, action):
        got.append(action)
        return self.now()

    monkeypatch.setattr(Interview, "do", do)
    content = bytes(range(256)) * 4000  # larger than any JSON body may be
    page = room.page(**{"content-type": "text/csv; charset=utf-8"})
    address = "/api/record?index=3&unsafe=1&theta=0.5,20,1e-3&again=1"
    assert page.post(address, content=content).status_code == 200
    assert got == [actions.Record(3, content, True, (0.5, 20.0, 0.001), True)]
    for theta in ("", "a", "1,,2", "nan", "1,inf"):
        assert page.post(f"/api/record?index=3&theta={theta}", content=b"x").status_code == 400


def test_only_json_is_taken_as_json(room):
    for kind in ("text/plain", "application/x-www-form-urlencoded", "", "application/jsonp"):
        page = room.page(**{"content-type": kind})
        assert page.post("/api/finish", content=b"{}").status_code == 415
    with_charset = room.page(**{"content-type": "Application/JSON; charset=utf-8"})
    assert with_charset.post("/api/finish", content=b"{}").status_code == 200


def test_closing_is_acknowledged_first(room):
    assert room.post("close", more=1).status_code == 400
    assert not room.closed.is_set()
    assert room.post("close").status_code == 200
    assert room.closed.is_set()


def test_an_unknown_address_or_method_is_told(room):
    page = room.page()
    assert page.get("/api/nothing").json()["kind"] == "refused"
    assert page.get("/api/answer").status_code == 405
    assert page.post("/api/now").status_code == 405
    assert page.get("/nothing").status_code == 404
    assert page.get("/api/now/").status_code == 404


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
    room = make_room(interview, static, patience=Patience(poll=60.0))
    version = interview.now().version

    async def meet() -> httpx.Response:
        async with room.page().client() as client:
            poll = asyncio.create_task(client.get(f"/api/now?after={version}"))
            while not room.api.waiting.borrowed_tokens:
                await asyncio.sleep(0)
            room.reports.folder = tmp_path
            return await asyncio.wait_for(poll, 20)

    assert asyncio.run(meet()).status_code == 200
