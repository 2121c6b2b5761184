"""Kill `prefcal calibrate` at random instants while its page is answered, and look for what is lost.

    python benchmarks/campaigns/kills.py               # 2,000 kills; hours
    python benchmarks/campaigns/kills.py --kills 20 --kinds glisp

Whoever answers here is a program that posts what the page posts: verdicts, marks and undos. After each
kill the study must be sound, and hold every step that was acknowledged; once it is over, best.json must
be its best experiment. What is not so is printed, and the exit code is then 1.
"""

import argparse
import json
import random
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from contextlib import suppress
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any

from prefcal_env.study import StudyFile, verify

KINDS: Mapping[str, Sequence[str]] = {
    "glisp": ("lag", "--simulate", "0", "--n-max", "14"),
    "screening": ("lag", "--simulate", "60", "--n-max", "9"),
    "robust": ("lag", "--simulate", "40", "--n-max", "6", "--robust"),
}
"""Words of `prefcal calibrate` for each kind of study."""


class Visitor:
    """A page without a browser: it posts to a command that runs, and counts what was acknowledged.

    Args:
        link: Link that the command printed.
    """

    def __init__(self, link: str) -> None:
        self._base, self.acknowledged = link.partition("/open/")[0], 0
        self._opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(CookieJar()))
        self._opener.open(link, timeout=60).read()

    def get(self, name: str) -> Any:
        """Return what the page gets."""
        with self._opener.open(f"{self._base}/{name}", timeout=60) as response:
            return json.loads(response.read())

    def post(self, name: str, **body: Any) -> None:
        """Do what a key of the page does; a refusal is no step."""
        headers = {"Content-Type": "application/json", "Origin": self._base}
        request = urllib.request.Request(
            f"{self._base}/api/{name}", json.dumps(body).encode(), headers, method="POST"
        )
        try:
            self._opener.open(request, timeout=60).read()
        except urllib.error.HTTPError as refused:
            if refused.code >= 500:
                raise AssertionError(f"{name}: {refused.code} {refused.read()[:200]!r}") from refused
        else:
            self.acknowledged += 1

    def step(self, dice: random.Random) -> bool:
        """Do one step of a person, and return whether the study is over."""
        now = self.get("api/now")
        if now["phase"] == "question":
            question = now["question"]["id"]
            if dice.random() < 0.1:
                mark = dice.choice(("unsafe", "good enough"))
                self.post("mark", question=question, side=dice.choice(("left", "right")), mark=mark, on=True)
            elif dice.random() < 0.1:
                self.post("undo", version=now["version"])
            else:
                choice = dice.choice(("left", "right", "same", "cannot tell"))
                self.post("answer", question=question, choice=choice, comment="", blind=False)
        else:
            time.sleep(0.05)
        return bool(now["phase"] == "over")


def steps_in(study: Path) -> int:
    """Return how many steps of people a study holds. It is closed."""
    with StudyFile.open(study, clock=str, reading=True) as file:
        kinds = [type(each.event).__name__ for each in file.events()]
        answered = sum(kind == "Answered" for kind in kinds) - 1  # nobody is asked about the first one
        return max(answered, 0) + kinds.count("Undone") + kinds.count("Marked")


def disagreements(study: Path, visitor: Visitor) -> list[str]:
    """Return what best.json and a study that is over say of the best experiment, if it is not one thing."""
    best = None
    for _ in range(600):  # the report comes soon after the end
        with suppress(urllib.error.HTTPError, json.JSONDecodeError):  # other errors: it was killed
            best = visitor.get("report/best.json")
            break
        time.sleep(0.1)
    with StudyFile.open(study, clock=str, reading=True) as file:
        index = file.state.history.incumbent or 0
        theta = list(file.state.history.samples[index].theta)
    if best is None:
        return ["best.json was not written"]
    told = list(best["theta"].values())
    return [] if (told, best["experiment"]) == (theta, index + 1) else [f"best.json: {best}, study: {theta}"]


def kill_one(folder: Path, kind: str, study: Path, dice: random.Random) -> tuple[int, bool, list[str]]:
    """Let one command be answered until it is killed.

    Returns:
        Steps acknowledged, whether the study was over, and what disagreed then.
    """
    words = [*KINDS[kind], "--study", str(study), "--out", str(study.with_suffix("")), "--no-browser"]
    process = subprocess.Popen(
        [sys.executable, "-m", "prefcal_app", "calibrate", *words],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    visitor, over, wrong = None, False, list[str]()
    if dice.random() < 0.15:  # while it starts
        threading.Timer(dice.uniform(0.2, 3.0), process.kill).start()
    try:
        visitor = Visitor(process.stdout.readline().strip())
        threading.Timer(dice.uniform(0.1, 6.0), process.kill).start()
        while not over:
            over = visitor.step(dice)
        wrong = disagreements(study, visitor)
    except (OSError, ValueError, EOFError, urllib.error.URLError):  # killed
        wrong = []
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    return 0 if visitor is None else visitor.acknowledged, over, wrong


def campaign(kind: str, kills: int, seed: int, folder: Path) -> list[str]:
    """Kill that many commands of a kind, and return what went wrong, a line each."""
    dice, wrong, number, acknowledged = random.Random(seed), list[str](), 0, 0
    total = over = 0
    for count in range(kills):
        study = folder / f"{kind}-{number}.prefcal"
        steps, ended, disagreed = kill_one(folder, kind, study, dice)
        acknowledged, total, over = acknowledged + steps, total + steps, over + ended
        wrong += [f"{kind}, kill {count + 1}: {words}" for words in disagreed]
        if not study.exists():  # it had not begun, or nobody had answered
            acknowledged = 0
            continue
        wrong += [f"{kind}, kill {count + 1}: {words}" for words in verify(study)]
        if (held := steps_in(study)) < acknowledged:
            wrong.append(f"{kind}, kill {count + 1}: {acknowledged} steps acknowledged, {held} recorded")
        if ended:
            number, acknowledged = number + 1, 0
    print(
        f"{kind}: {kills} kills, {total} steps acknowledged, {over} studies over, {len(wrong)} wrong",
        flush=True,
    )
    return wrong


def main(words: Sequence[str] | None = None) -> int:
    """Kill commands of each kind; return 1 if something went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=2000, help="number of kills in all")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(words)
    wrong = list[str]()
    with tempfile.TemporaryDirectory() as name:
        for kind in options.kinds:
            wrong += campaign(kind, -(-options.kills // len(options.kinds)), options.seed, Path(name))
    print("\n".join(wrong) or "nothing was lost")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
