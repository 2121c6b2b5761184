"""Kill `prefcal calibrate` at random instants while its page is answered, and look for what is lost.

    python benchmarks/stress/kills.py               # 2,000 kills; hours
    python benchmarks/stress/kills.py --kills 20 --kinds glisp

Whoever answers here is a program that posts what the page posts: verdicts, marks and undos, and at the end
choices of another result and verifications; `prefcal verify` is killed, too. After each kill the study must
be there, be sound, and hold every step that was acknowledged since the last kill; once it is over,
best.json, report, acceptance sheet, verification and page must say the same of its best experiment. No
command may end by itself before that. What is not so is printed, and the exit code is then 1.
"""

import argparse
import html
import json
import random
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from http.client import HTTPException
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any

from prefcal_env.errors import ScenarioError, StudyError
from prefcal_env.study import StudyFile, verify
from prefcal_scenarios.verification.said import Verified

KINDS: Mapping[str, Sequence[str]] = {
    "glisp": ("lag", "--simulate", "0", "--n-max", "14"),
    "screening": ("lag", "--simulate", "60", "--n-max", "9"),
    "robust": ("lag", "--simulate", "40", "--n-max", "6", "--robust"),
    "choices": ("lag", "--simulate", "40", "--n-max", "3"),
    "verification": ("lag", "--simulate", "0", "--n-max", "3"),
}
"""Words of `prefcal calibrate` for each kind of study."""
_WAIT = 60.0  # seconds within which all that is written of a result must say the same


class BrokenError(Exception):
    """The command answered with an error of its own."""


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
        return json.loads(self.text(name))

    def text(self, name: str) -> str:
        """Return a file or an answer as it is."""
        with self._opener.open(f"{self._base}/{name}", timeout=60) as response:
            return bytes(response.read()).decode()

    def post(self, name: str, *, steps: int = 1, **body: Any) -> None:
        """Do what a key of the page does, which adds so many steps to the study; a refusal is no step.

        Raises:
            BrokenError: If the command fails.
        """
        headers = {"Content-Type": "application/json", "Origin": self._base}
        request = urllib.request.Request(
            f"{self._base}/api/{name}", json.dumps(body).encode(), headers, method="POST"
        )
        try:
            self._opener.open(request, timeout=60).read()
        except urllib.error.HTTPError as refused:
            if refused.code >= 500:
                raise BrokenError(f"{name}: {refused.code} {refused.read()[:200]!r}") from refused
        else:
            self.acknowledged += steps

    def step(self, dice: random.Random) -> bool:
        """Do one step of a person, and return whether the study is over."""
        now = self.get("api/now")
        if now["phase"] == "question":
            question = now["question"]["id"]
            if dice.random() < 0.1:
                mark, side = dice.choice(("unsafe", "good enough")), dice.choice(("left", "right"))
                on = mark not in now["question"][side]["marks"]  # what is as wished adds no step
                self.post("mark", question=question, side=side, mark=mark, on=on)
            elif dice.random() < 0.1:
                repeated = now["question"]["repeat"]  # then it only skips the question
                self.post("undo", steps=0 if repeated else 1, version=now["version"])
            else:
                choice = dice.choice(("left", "right", "same", "cannot tell"))
                self.post("answer", question=question, choice=choice, comment="", blind=False)
        else:
            time.sleep(0.05)
        return bool(now["phase"] == "over")

    def choose(self, dice: random.Random) -> None:
        """Choose another result at the end: a simulated θ that nobody was shown."""
        now, screened = self.get("api/now"), self.get("api/simulated")
        if now["phase"] == "over" and screened is not None:
            unseen = [point for point in screened["points"] if point["number"] is None and not point["end"]]
            if not unseen:  # all were chosen
                return
            theta = dice.choice(unseen)["theta"]
            self.get(f"api/look?theta={','.join(map(repr, theta))}")
            self.post("choose", theta=theta, best=now["over"]["best"]["number"] - 1)
        elif screened is not None:
            self.step(dice)  # what was killed within a choice is a question again
        time.sleep(dice.uniform(0.0, 0.3))

    def verify(self, dice: random.Random) -> None:
        """Verify the result, and judge one of the worst runs or stop early."""
        self.post("verify", steps=0)
        if dice.random() < 0.2:
            time.sleep(dice.uniform(0.0, 1.0))
            self.post("stop_verifying", steps=0)
        while (told := self.get("api/verification"))["running"]:
            time.sleep(0.1)
        if told["said"] is not None and (worst := told["said"]["worst"]):
            of = {"run": 0, "seed": worst[0]["seed"], "best": told["said"]["best"]}
            self.post("judge", steps=0, **of, acceptable=dice.random() < 0.5)


AT_THE_END: Mapping[str, Callable[[Visitor, random.Random], None]] = {
    "choices": Visitor.choose,
    "verification": Visitor.verify,
}
"""What is done again and again once a study of this kind is over."""


def steps_in(study: Path) -> tuple[int, bool]:
    """Return how many steps of people a study holds, and whether it is over. It is closed."""
    with StudyFile.open(study, clock=str, reading=True) as file:
        kinds = [type(each.event).__name__ for each in file.events()]
        answered = sum(kind == "Answered" for kind in kinds) - 1  # nobody is asked about the first one
        steps = max(answered, 0) + kinds.count("Undone") + kinds.count("Marked")
        return steps, bool(file.state.ended)


def disagreements(study: Path, visitor: Visitor) -> list[str]:
    """Return what is said of the best experiment of a study that is over, if it is not one thing.

    The report comes soon after the end, so what disagrees is looked at again for a while.
    """
    end, wrong = time.monotonic() + _WAIT, ["nothing was looked at"]
    while wrong and time.monotonic() < end:
        with StudyFile.open(study, clock=str, reading=True) as file:
            index = file.state.history.incumbent or 0
            theta = list(file.state.history.samples[index].theta)
        wrong = compare_once(index + 1, theta, visitor)
        time.sleep(0.1)
    return wrong


def compare_once(number: int, theta: Sequence[float], visitor: Visitor) -> list[str]:
    """Return what of page and files does not name the best experiment of the study."""
    try:
        best, seen = json.loads(raw := visitor.text("report/best.json")), visitor.get("api/now")
        report, sheet = (words_of(visitor.text(f"report/{name}.html")) for name in ("report", "acceptance"))
        said = visitor.get("api/verification")["said"]
    except urllib.error.HTTPError as error:  # other errors: it was killed
        return [f"{error.url}: {error}"]
    told = {
        "best.json": (list(best["theta"].values()), best["experiment"]) == (theta, number),
        "page": seen["over"] is not None and seen["over"]["best"]["number"] == number,
        "report": re.search(rf"experiment {number} is still the best|best \({number}\)", report) is not None,
        "sheet": f"experiment {number} unit" in sheet,
        "verification": said is None or said["best"] == sha256(raw.encode()).hexdigest(),
        "verification on the sheet": said is None or said["statement"] in sheet,
    }
    wrong = [name for name, agrees in told.items() if not agrees]
    return [f"{', '.join(wrong)}: not of experiment {number} of the study, {theta}"] if wrong else []


def words_of(page: str) -> str:
    """Return the text of a page in one line."""
    return " ".join(
        html.unescape(re.sub(r"<(style|svg).*?</\1>|<[^>]+>", " ", page, flags=re.DOTALL)).split()
    )


class Command:
    """`prefcal calibrate` as it runs, to be killed later.

    Args:
        folder: Folder to run in; what it says goes to a file there.
        words: Words of the command.
    """

    def __init__(self, folder: Path, words: Sequence[str]) -> None:
        self._said, self._killed = folder / "stderr.txt", threading.Event()
        with self._said.open("w", encoding="utf-8") as errors:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "prefcal_app", "calibrate", *words],
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )

    def kill_in(self, seconds: float) -> None:
        """Kill it after so many seconds."""

        def strike() -> None:
            self._killed.set()  # before it is: what fails without this failed by itself
            self.process.kill()

        timer = threading.Timer(seconds, strike)
        timer.daemon = True
        timer.start()

    def failure(self, error: Exception, *, may_end: bool) -> list[str]:
        """Return what went wrong when it answered with `error`, if it was not the kill.

        With `may_end`, the study is over: the command may have ended well.
        """
        by_itself, code = not self._killed.is_set(), None
        with suppress(subprocess.TimeoutExpired):
            code = self.process.wait(20)
        if isinstance(error, BrokenError):
            return [str(error)]
        if (not by_itself and code == -signal.SIGKILL) or (may_end and code == 0):
            return []
        last = self._said.read_text(encoding="utf-8", errors="replace").strip()[-500:]
        return [f"{'it goes on' if code is None else f'it ended with {code}'} after {error!r}: {last}"]

    def end(self) -> None:
        """Kill it now."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def kill_one(
    folder: Path, kind: str, study: Path, dice: random.Random, *, kill: bool = True
) -> tuple[int, bool, list[str]]:
    """Let one command be answered until it is killed.

    Args:
        folder: Folder to run in.
        kind: Kind of the study.
        study: Study file.
        dice: When it is killed, and what is answered.
        kill: Whether it is killed before best.json of a study that is over was looked at.

    Returns:
        Steps acknowledged, whether best.json was looked at, and what went wrong.
    """
    out = str(study.with_suffix(""))
    command = Command(folder, [*KINDS[kind], "--study", str(study), "--out", out, "--no-browser"])
    assert command.process.stdout is not None
    visitor, over = None, False
    if kill and dice.random() < 0.15:  # while it starts
        command.kill_in(dice.uniform(0.2, 3.0))
    try:
        visitor = Visitor(command.process.stdout.readline().strip())
        if kill:
            command.kill_in(dice.uniform(0.1, 6.0))
        while not over:
            over = visitor.step(dice)
        at_the_end = AT_THE_END.get(kind, lambda visitor, dice: None)
        while kill and kind in AT_THE_END:
            at_the_end(visitor, dice)
        at_the_end(visitor, dice)
        return visitor.acknowledged, True, disagreements(study, visitor)
    except (BrokenError, OSError, ValueError, EOFError, HTTPException) as error:
        wrong = command.failure(error, may_end=kill and over)
        return 0 if visitor is None else visitor.acknowledged, False, wrong
    finally:
        command.end()


def kill_verify(folder: Path, study: Path, dice: random.Random) -> list[str]:
    """Kill `prefcal verify` of a result; return what went wrong: its files are whole, and best.json stays."""
    out = study.with_suffix("")
    before = (out / "best.json").read_bytes()
    words = [sys.executable, "-m", "prefcal_app", "verify", str(out / "best.json"), "--runs", "40"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    process = subprocess.Popen(words, cwd=folder, **quiet)
    wrong = list[str]()
    try:
        _, said = process.communicate(timeout=dice.uniform(0.5, 6.0))
        wrong += (
            [] if process.returncode == 0 else [f"prefcal verify: {said.decode(errors='replace')[-500:]}"]
        )
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
    try:
        Verified.read(out)
    except ScenarioError as error:
        wrong.append(str(error))
    return wrong if (out / "best.json").read_bytes() == before else [*wrong, "best.json changed"]


def lost(study: Path, before: int, steps: int) -> tuple[list[str], int, bool]:
    """Look for what a kill has lost.

    Args:
        study: Study file.
        before: Steps that it held before.
        steps: Steps acknowledged since then.

    Returns:
        What went wrong, the steps that it holds, and whether it is over.
    """
    held, finished, wrong = 0, False, list[str]()
    if study.exists():  # or it had not begun, or nobody had answered
        try:
            wrong += verify(study)
            held, finished = steps_in(study)
        except StudyError as error:
            return [*wrong, f"the study cannot be read: {error}"], 0, False
    if held - before < steps:
        found = f"{held - before} more are recorded" if study.exists() else "the study is gone"
        wrong.append(f"{steps} steps acknowledged after {before}, {found}")
    return wrong, held, finished


def campaign(kind: str, kills: int, seed: int, folder: Path) -> list[str]:
    """Kill that many commands of a kind, and return what went wrong, a line each."""
    dice, wrong, number, held, finished = random.Random(seed), list[str](), 0, 0, False
    total = over = 0
    for count in range(kills):
        study = folder / f"{kind}-{number}.prefcal"
        # A study that was over at the last kill is looked at to its end: its report must come.
        kill = not finished or (kind in AT_THE_END and dice.random() < 0.6)
        steps, ended, failed = kill_one(folder, kind, study, dice, kill=kill)
        if ended and kind == "verification" and not failed:
            failed = kill_verify(folder, study, dice)
        missing, held, finished = lost(study, held, steps)
        wrong += [f"{kind}, kill {count + 1}: {words}" for words in (*failed, *missing)]
        total, over = total + steps, over + ended
        if ended or failed or missing:  # what is wrong once is told once
            number, held, finished = number + 1, 0, False
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
