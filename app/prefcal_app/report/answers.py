"""Answer, on the acceptance sheet, what a colleague asks who has to answer for the tuning, too."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from prefcal_app.view.end import FIRST
from prefcal_env.errors import ScenarioError
from prefcal_scenarios import verification
from prefcal_scenarios.presentation.folder import put
from prefcal_scenarios.presentation.wording import number, with_unit
from prefcal_scenarios.verification.verified import Verified, margins_said

from .export import versions
from .html import environment
from .record import StudyRecord
from .tables import pid_forms_of

FILE = "acceptance.html"
"""Name of the file of the sheet."""
_PART = re.compile(r"<!-- verified (\d+) -->.*?<!-- end -->", re.DOTALL)
"""The part of the sheet that changes when the tuning is verified, with its room and that of curves in mm."""
_UNKNOWN = "not verified"
_RUN = (
    f"{_UNKNOWN}: other gains, dead times, noise, loads and set points than modeled. Run prefcal verify "
    "best.json, which completes this sheet."
)
_WIDE, _MOST = 100, 440
"""Characters of a line of an answer, and the most of an answer."""
LINE, MOST_VERIFIED = 3.4, 15
"""Height of a line of an answer in mm, and the usual number of lines of what was verified."""
_LOW = 25.0
"""Smallest height of curves that tell anything, in mm."""

Answers = list[tuple[str, str]]
"""Questions, in a few words, each with its answer."""


def answers(record: StudyRecord) -> Answers:
    """Return what is asked about the study: who and how, why this tuning, its form, and the way back."""
    by, digits = (record.origin.get(key) for key in ("answered by", "fingerprint of the scenario"))
    counts = ", ".join(f"{words} {n}" for words, n in record.verdict_counts().items() if n)
    each = f" ({counts}; each one in comparisons.csv)" if record.questions else ""
    partial = "; the study is not complete" if record.partial else ""
    digest = f" SHA-256 of the study file: {record.digest}." if record.digest else ""
    made = f", fingerprint of the scenario {digits}" if digits else ""
    promise, told = ("", ()) if record.outlook is None else (record.outlook.promise, record.outlook.result)
    found = {
        "Who answered": f"{len(record.trials)} experiments, {record.questions} comparisons by "
        f"{by or 'a score'}{each}{partial}.{digest}",
        "On which model": f"{record.source}{made}, prefcal {versions()['prefcal']}.",
        "Enough answers": promise
        or "Not stated: only where candidates are simulated, at the end of a study.",
        "Why this one": " ".join(told)
        or "It is the best by the answers, each of which is in comparisons.csv.",
        "The PID": _pid(record),
        "The way back": _back(record),
    }
    return [(question, _short(answer, "report.html")) for question, answer in found.items() if answer]


def _pid(record: StudyRecord) -> str:
    """Return the form of a tuned PID, and what of it was not tuned; empty for other controllers."""
    parts = [p for p, *_ in pid_forms_of(record)]
    if not parts:
        return ""
    fixed = [
        p for p in parts if not p.derived and p.name.partition(" ")[0] not in record.scenario.space.names
    ]
    rest = ", ".join(f"{p.name} {with_unit(number(p.value), p.unit)}" for p in fixed)
    return (
        "ISA form: K_p (b r − y + 1/T_i ∫(r − y) dt + T_d d(c r − y)/dt), derivative filtered with T_f. "
        f"Parallel form: K_i and K_d in place of K_p/T_i and K_p T_d.{f' Not tuned: {rest}.' if rest else ''}"
    )


def _back(record: StudyRecord) -> str:
    assert record.best is not None
    before, after, name = record.before.number, record.best.number, record.baseline
    said = f"Before: {name} (experiment {before}). After: experiment {after}."
    if before == after:
        said += f" No experiment beat the {name}." if record.questions else " Nothing was compared."
    if name == FIRST:
        return f"{said} It was chosen by prefcal: the tuning in use was not given (--start)."
    return f"{said} To go back, set the parameters of the column “{name}”; best.json has them, too."


def unverified(record: StudyRecord, why: str = "") -> Answers:
    """Return what is asked about margins and other plants before anything is verified, and why."""
    assert record.best is not None
    scenario, both = record.scenario, [record.best.experiment, record.before.experiment]
    try:
        known = verification.cases.subject_of(scenario.source, scenario.space).margins
        found = [known(each.theta) for each in both]
    except ScenarioError:  # such as a file that runs in a process of its own
        found = ["prefcal verify best.json computes them if the plant is known as equations"]
    said = margins_said(found, both[0].channels.time_unit)
    return [("Margins", _margins(*said)), ("Other plants", f"{_RUN} {why}." if why else _RUN)]


def verified_answers(verified: Verified) -> Answers:
    """Return what was verified: margins, other plants, what varied, and what nobody looked at."""
    found = {
        "Margins": _margins(verified.margins, verified.basis),
        "Other plants": f"{verified.statement} {verified.limits_kept}",
    }
    for worst in verified.worst[:1]:
        found["Worst run"] = f"{worst.words}{f' ({worst.verdict})' if worst.verdict else ''}: {worst.text}."
    found["Hurts most"] = next(iter(verified.effects), _UNKNOWN)
    found["Varied"] = f"{'; '.join(verified.varied) or 'nothing'}. Beyond these ranges: {_UNKNOWN}."
    found["Not verified"] = " ".join(f"{text[:1].upper()}{text[1:]}." for text in verified.left_out) or "–"
    return [(question, _short(answer, "verification.json")) for question, answer in found.items()]


def _margins(rows: Sequence[Sequence[str]], basis: str) -> str:
    """Return margins with those before in brackets, if they are known, and what they hold for."""
    if not rows:
        return f"{_UNKNOWN}: {basis}"
    words = (f"{name} {after}{f' (before {old[0]})' if old else ''}" for name, after, *old in rows)
    return f"{', '.join(words)}: {basis}."


def _short(text: str, rest: str) -> str:
    """Return a text that fits on the page, and where all of it is."""
    return text if len(text) <= _MOST else f"{text[: _MOST - 30].rsplit(' ', 1)[0]} … ({rest} has all)"


def left(room: float, holds: Answers) -> float:
    """Return the height that curves may have beside these answers, in mm; 0 if that is too little."""
    height = room - LINE * sum(1 + len(answer) // _WIDE for _, answer in holds)
    return height if height >= _LOW else 0.0


def section(holds: Answers, room: float) -> str:
    """Return the part of the sheet that a verification changes, as HTML; it and curves have `room` mm."""
    template: Any = environment().get_template("report/parts.html.j2").module
    style = f"<style>figure img {{ max-height: {left(room, holds):.0f}mm; }}</style>"
    return f"<!-- verified {room:.0f} -->{style}{template.answers(holds)}<!-- end -->"


def refresh(folder: Path) -> None:
    """Write what is verified of the best.json in a folder on the sheet there, if there is one.

    Raises:
        ScenarioError: If verification.json cannot be read.
        OSError: If the sheet cannot be written.
    """
    path, verified = folder / FILE, Verified.read(folder)
    if verified is None or not path.is_file():
        return
    holds, text = verified_answers(verified), path.read_text(encoding="utf-8")
    put(path, _PART.sub(lambda part: section(holds, float(part[1])), text, count=1).encode())
