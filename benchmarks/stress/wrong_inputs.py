"""Throw random wrong inputs at eleven doors of prefcal: is each refused in one clear line?

    python benchmarks/stress/wrong_inputs.py                     # 1,000 inputs: some minutes
    python benchmarks/stress/wrong_inputs.py --count 60 --doors files taste
    python benchmarks/stress/wrong_inputs.py --doors files --only 17   # one input again

Doors are options and values of the commands, scenario files, own Python files, recorded runs, study files,
best.json and verification.json, tunings to export, step tests to identify, requests of a page, tables to
choose from, and calls of `Taste`. Each input is wrong by how it is made, and follows from seed, door and
number alone. It must end in exit code 1 or 2 and in one line (of `check`, in its table), which names what
was wrong in what people typed or wrote: no traceback, no wait, nothing written, no thread left at work.
What is not so is printed with its input, and the exit code is then 1.
"""

import argparse
import asyncio
import contextlib
import json
import os
import random
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any
from unittest import mock

from rich.console import Console
from rich.progress import track
from wrong_doors import COMMANDS, RIG, RUNS, Dice, Said, Wrong, cells, described, noise, other, word

from prefcal_agents.agent import Agent
from prefcal_agents.glisp.agent import GLISp
from prefcal_agents.taste import Taste
from prefcal_app.session import Interview, Phase, actions
from prefcal_app.session.study import agent_as_dict, knobs_as_dicts
from prefcal_app.web.api import Api, Patience, Reports
from prefcal_app.web.serve import make_app
from prefcal_env.errors import PrefcalError
from prefcal_env.study import StudyFile
from prefcal_scenarios import load

_LIMIT = 60  # seconds after which an input that is neither refused nor accepted counts as a fault
_SOON = 5.0  # seconds within which what ran for an input has ended
_LONGEST = 500  # characters of a line that people still read

# --- Judge how an input ended.


class LateError(BaseException):
    """An input takes too long; no `except Exception` on the way may take it for a refusal."""


@contextlib.contextmanager
def at_most(seconds: int) -> Iterator[None]:
    """Raise LateError in the block if it takes longer."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise LateError(f"still at work after {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def state_of(folder: Path) -> dict[str, bytes | None]:
    """Return what is in a folder, and below it."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


def faults(wrong: Wrong, folder: Path) -> list[str]:
    """Let an input be refused in an empty folder, and return what was not right about that."""
    here, home, scratch = (folder / name for name in ("here", "home", "scratch"))
    for place in (here, home, scratch):
        place.mkdir()
    for name, content in wrong.files.items():
        (here / name).write_bytes(content)
    before, running = state_of(folder), {*threading.enumerate()}
    environment = {"XDG_DATA_HOME": str(home), "TMPDIR": str(scratch), "COLUMNS": "100"}
    with mock.patch.dict(os.environ, environment), mock.patch.object(tempfile, "tempdir", str(scratch)):
        try:
            with at_most(_LIMIT):
                said = wrong.call(here)
        except BaseException as error:  # whatever it is, nothing handled it
            if isinstance(error, KeyboardInterrupt):
                raise
            return [f"raised: {''.join(traceback.format_exception(error)[-3:])}"]
    found = _unclear(wrong, said)
    after = state_of(folder)
    if wrong.told:  # the picture is what `check` is for
        after = {name: content for name, content in after.items() if not name.endswith(".png")}
    if said.code and after != before:
        found.append(f"left behind: {sorted(k for k in {*before, *after} if before.get(k) != after.get(k))}")
    # Threads that answer requests are kept for the next ones.
    new = [each for each in {*threading.enumerate()} - running if "AnyIO" not in each.name]
    for thread in new:
        thread.join(_SOON)
    at_work = [each.name for each in new if each.is_alive()]
    found += [f"still at work: {at_work}"] if at_work else []
    held = {name: content[:300] for name, content in wrong.files.items() if name not in RUNS}
    return [f"{each}; files: {held}; said: {str(said)[:600]}" for each in found]


def _unclear(wrong: Wrong, said: Said) -> list[str]:
    """Return what is not clear in what was said."""
    if said.code not in wrong.codes:
        return [f"exit code {said.code}"]
    found = ["a traceback"] if "Traceback (most recent" in said.words + said.out else []
    if said.code == 0:
        return found
    whole = said.words + said.out if wrong.told else said.words
    lines = [line for line in said.words.splitlines() if line.strip()]
    if not wrong.told and len(lines) != 1:
        found.append(f"{len(lines)} lines")
    if any(len(line) > _LONGEST for line in lines):
        found.append(f"a line of {max(map(len, lines))} characters")
    flat = " ".join(whole.split()).casefold()
    if wrong.named and not any(" ".join(word.split()).casefold() in flat for word in wrong.named):
        found.append(f"none of {list(wrong.named)} is named")
    return found


# --- Requests of a page, in this process, and calls of `Taste`.

_TOKEN, _PORT = "the-token", 8765
_HEADS: Mapping[str, str] = {
    "host": f"127.0.0.1:{_PORT}",
    "origin": f"http://127.0.0.1:{_PORT}",
    "cookie": f"prefcal_{_PORT}={_TOKEN}",
    "content-type": "application/json",
}
_BODIES: Mapping[str, Mapping[str, Any]] = {
    "answer": {"question": 7, "choice": "left", "comment": "", "blind": False},
    "mark": {"question": 7, "side": "left", "mark": "unsafe", "on": True},
    "undo": {"version": 99},
    "retract": {"answer": 1},
    "ask_for": {"theta": [0.5, 21.0]},
    "choose": {"theta": [0.5, 21.0], "best": 0},
    "pace": {"questions": 3},
    "fail": {"index": 0, "reason": "broken"},
    "go_on": {"more": 5},
    "judge": {"run": 0, "seed": 1, "best": "a", "acceptable": True},
}


@dataclass
class Page:
    """An open study behind an application, without a socket."""

    interview: Interview
    app: Any

    @classmethod
    def of(cls, scenario: str, answers: int) -> "Page":
        """Open a study in memory, with this many answers."""
        found = load(scenario)
        agent: Agent = GLISp(found.space, n_init=2, n_max=6, seed=0)
        configuration = {
            "scenario": found.name,
            "name": found.name,
            "title": found.title,
            "knobs": knobs_as_dicts(found.space),
            "agent": agent_as_dict(agent),
            "n_max": 6,
            "seed": 0,
            "kpis": [],
            "options": {"calibrator": "human"},
            "versions": {},
        }
        file = StudyFile.create(":memory:", configuration, clock=lambda: "2026-01-01T00:00:00+00:00")
        interview = Interview(found, file, ahead=False)
        for count in range(answers + 1):
            while interview.now().phase is Phase.RUNNING:
                interview.work()
            question = interview.now().question
            if question is not None and count < answers:
                interview.do(actions.Answer(question.id, "left"))
        api = Api(interview, Reports(), threading.Event(), lambda waits: None, Patience(0.05, 0.0))
        return cls(interview, make_app(api, token=_TOKEN, port=_PORT))

    def state(self) -> tuple[Any, ...]:
        """Return what no wrong request may change."""
        return self.interview.now().version, list(self.interview.file.events())

    async def ask(self, method: str, path: str, query: bytes, body: bytes, heads: Mapping[str, str]) -> Said:
        """Return status and body of the answer to a request."""
        scope = {
            "type": "http",
            "http_version": "1.1",
            "method": method,
            "path": path,
            "raw_path": path.encode(errors="replace"),
            "root_path": "",
            "query_string": query,
            "scheme": "http",
            "server": ("127.0.0.1", 1),
            "client": ("127.0.0.1", 2),
            "headers": [(name.encode(), value.encode("latin-1", "replace")) for name, value in heads.items()],
        }
        sent: list[Any] = []

        async def receive() -> dict[str, Any]:
            return {"type": "http.request", "body": body, "more_body": False}

        async def send(message: Any) -> None:
            sent.append(message)

        await self.app(scope, receive, send)
        return Said(sent[0]["status"], b"".join(each.get("body", b"") for each in sent[1:]).decode())


_pages: dict[str, Page] = {}


def asked(folder: Path, kind: str, request: tuple[Any, ...]) -> Said:
    """Return how an open study of this kind answers a request, which may change nothing."""
    if kind not in _pages:
        (folder.parent / "rig.toml").write_text(described(RIG), encoding="utf-8")
        _pages[kind] = Page.of(
            "lag" if kind == "lag" else str(folder.parent / "rig.toml"), 2 * (kind == "lag")
        )
        (folder.parent / "rig.toml").unlink()
    page = _pages[kind]
    before = page.state()
    said = asyncio.run(page.ask(*request))
    assert page.state() == before, "the study changed"
    words = said.words
    with contextlib.suppress(ValueError, TypeError, KeyError):
        words = json.loads(words)["error"]
    return Said(2 if 400 <= said.code < 500 else said.code, words)


def requests(dice: Dice) -> Wrong:
    """Return a wrong request: body, path, method, cookie, host, origin, or the record of a rig."""
    heads = dict(_HEADS)
    name, junk = dice.choice(sorted(_BODIES)), word(dice)
    method, path, query, kind = "POST", f"/api/{name}", b"", "lag"
    plain: Any = dict(_BODIES[name])
    key = dice.choice(sorted(plain))
    body, how = json.dumps(plain).encode(), dice.randrange(7)
    if how == 0:
        body = json.dumps(plain | {key: other(dice, plain[key])}).encode()
    elif how == 1:
        body = json.dumps(dice.choice([plain | {junk: 1}, {junk: 1}, [plain], 3, None])).encode()
    elif how == 2:
        body = dice.choice([body[: dice.randrange(len(body))], noise(dice), b"[" * 50_000, body + b"}"])
    elif how == 3:
        lacks = dice.choice(["host", "origin", "cookie", "content-type"])
        heads[lacks] = dice.choice([junk, "", "null", "http://evil.example", heads[lacks] + "x"])
    elif how == 4:
        method, path = dice.choice(
            [("PUT", path), ("DELETE", path), ("POST", f"{path}{junk}"), ("GET", f"/{junk}")]
        )
    elif how == 5:
        method, path = (
            "GET",
            dice.choice(["/api/look", "/api/now", "/api/history/1", "/static/../../x", "/report/x"]),
        )
        query = dice.choice(
            [b"theta=" + junk.encode(), f"{junk}=1".encode(), b"\xff=1", b"after=-1", b"blind=2"]
        )
    else:
        kind, path, heads["content-type"] = "rig", "/api/record", "text/csv"
        body, query = (
            cells(dice),
            dice.choice([b"index=0"] * 6 + [b"", b"index=x", b"index=9", b"index=0&unsafe=7"]),
        )

    def call(folder: Path) -> Said:
        return asked(folder, kind, (method, path, query, body, heads))

    about = f"{method} {path}?{query!r} {body[:200]!r} {heads}"
    return Wrong(call, about, codes=(2,))


def tastes(dice: Dice) -> Wrong:
    """Return a wrong call of `Taste`."""
    good, poor, name = {"overshoot": 1.0, "time": 3.0}, {"overshoot": 2.0, "time": 9.0}, word(dice)
    junk = dice.choice([None, "abc", [], {}, 1j, object(), [1.0], {"a": 1}])
    broken = dice.choice([{**good, "time": junk}, {**good, 3: 1.0}, 3, None, "abc", [1, 2], {"time": junk}])
    answer = dice.choice([2, -2, 0.5, None, "left", [1], float("nan"), 10**400])
    side: Any = dice.choice([(good,), good, junk, (good,) * 3])
    table, seed = dice.choice([3, 2.5, True]), dice.choice([-1, 0.5, "a"])
    usual: Any = dice.choice([3, "abc", {1, 2}, [broken]])
    calls: list[tuple[str, Callable[[], Any]]] = [
        (f"learn([{answer!r}])", lambda: Taste.learn([answer], [(good, poor)])),
        (f"learn on {broken!r}", lambda: Taste.learn([1], [(good, broken)])),
        ("learn with too few pairs", lambda: Taste.learn([1] * dice.randint(2, 5), [(good, poor)])),
        ("learn from nothing", lambda: Taste.learn([], [])),
        (f"learn on {side!r}", lambda: Taste.learn([1], [side])),
        (f"learn with usual {usual!r}", lambda: Taste.learn([1], [(good, poor)], usual=usual)),
        (f"predict {broken!r}", lambda: _learned().predict(good, broken)),
        (f"predict {name}", lambda: _learned().predict({name: 1.0}, {name: 2.0})),
        (f"rank {broken!r}", lambda: _learned().rank([good, broken])),
        (f"rank {name}", lambda: _learned().rank([{name: 1.0}])),
        (f"rank {table!r}", lambda: _learned().rank(table)),
        (f"learn with seed {seed!r}", lambda: Taste.learn([1], [(good, poor)], seed=seed)),
    ]
    about, do = dice.choice(calls)

    def call(folder: Path) -> Said:
        try:
            return Said(0, repr(do()))
        except PrefcalError as error:
            return Said(2, str(error))

    return Wrong(call, f"Taste: {about}", codes=(2,))


def _learned() -> Taste:
    return Taste.learn([1], [({"overshoot": 1.0, "time": 3.0}, {"overshoot": 2.0, "time": 9.0})])


# --- The campaign.

DOORS: Mapping[str, Callable[[Dice], Wrong]] = {**COMMANDS, "requests": requests, "taste": tastes}
"""What makes a wrong input for each door."""


def wrong_input(door: str, number: int, seed: int = 0) -> Wrong:
    """Return one input; it follows from door, number and seed."""
    return DOORS[door](random.Random(f"{seed} {door} {number}"))


def campaign(doors: Sequence[str], numbers: Sequence[int], seed: int, console: Console) -> list[str]:
    """Throw inputs of these numbers at each door, and return what was wrong with how they ended."""
    found = list[str]()
    for door in doors:
        for number in track(numbers, door, console=console, disable=not console.is_terminal):
            wrong = wrong_input(door, number, seed)
            with tempfile.TemporaryDirectory() as name:
                ended = faults(wrong, Path(name))
            found += [f"--doors {door} --only {number}: {wrong.about[:300]}\n    {each}" for each in ended]
        console.print(f"{door}: {len(numbers)} inputs, {len(found)} wrong so far", highlight=False)
    return found


def main(words: Sequence[str] | None = None) -> int:
    """Throw inputs at the doors; return 1 if one was not refused as it must be."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1000, help="number of inputs in all")
    parser.add_argument("--doors", nargs="+", default=list(DOORS), choices=list(DOORS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, help="the one input of this number, of each door")
    given = parser.parse_args(words)
    numbers = range(-(-given.count // len(given.doors))) if given.only is None else [given.only]
    begin = time.monotonic()
    wrong = campaign(given.doors, numbers, given.seed, Console(stderr=True))
    print("\n".join(wrong) or "all were refused in one clear line")
    print(f"{len(given.doors) * len(numbers)} inputs in {time.monotonic() - begin:.0f} s, {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
