"""How things stand: the phase, the open question, what is waited for, and the end."""

from pathlib import Path
from typing import Any

import numpy as np

from prefcal_env.rig import Rig
from prefcal_env.studies import State, Suggested, counted_unsafe
from prefcal_scenarios.interview import Interview, Now, Phase
from prefcal_scenarios.interview.moment import GOOD_ENOUGH
from prefcal_scenarios.report.wording import INTERRUPTED, number, quantity, with_unit
from prefcal_scenarios.scenario import Scenario

from .sides import numbers_view, question_view, theta_view

_PICTURES = (".png", ".gif")


def now_view(
    interview: Interview,
    *,
    blind: bool = False,
    again: str = "",
    command: str = "",
    report: Path | None = None,
) -> dict[str, Any]:
    """NOW, as the page takes it.

    Args:
        interview: What is shown.
        blind: Whether θ and roles are hidden; they are not even sent.
        again: The command that takes the study up again.
        command: The command that repeats it from the start.
        report: Folder of the finished report.
    """
    now, scenario = interview.now(), interview.scenario
    asked = None
    if now.question is not None:
        asked = question_view(now.question, scenario, blind=blind)
    return {
        "version": now.version,
        "phase": now.phase.value,
        "blind": blind,
        "scenario": {"name": scenario.name, "title": scenario.title, "time_unit": _time(now)},
        "study": {"place": interview.study.path, "again": again},
        "progress": _progress(interview, now),
        "can_undo": now.can_undo,
        "question": asked,
        "problem": now.problem,
        "pending": _pending(now.pending, scenario, blind=blind),
        "good_enough": _good_enough(now, blind=blind),
        "over": _over(interview, now, command, report) if now.phase is Phase.OVER else None,
    }


def _time(now: Now) -> str:
    return "" if now.question is None else now.question.left.experiment.channels.time_unit


def _progress(interview: Interview, now: Now) -> dict[str, int]:
    """Comparisons are one fewer than experiments: the first is compared with nothing."""
    answered = max(len(now.state.closed) - 1, 0)
    return {
        "answered": answered,
        "comparisons": interview.n_max - 1,
        "experiments": len(now.state.finished),
        "n_max": interview.n_max,
    }


def _pending(sample: Suggested | None, scenario: Scenario, *, blind: bool) -> Any:
    """The sample that is run, awaited or failed. A rig's person has to see θ: he runs it."""
    if sample is None:
        return None
    rig = scenario.run if isinstance(scenario.run, Rig) else None
    knobs = list(zip(scenario.space, sample.theta, strict=True))
    hidden = blind and rig is None
    return {
        "index": sample.index,
        "number": sample.index + 1,
        "theta": [] if hidden else [
            {"name": k.name, "unit": k.unit, "text": number(v), "exact": repr(float(v))}
            for k, v in knobs
        ],
        "copy": "" if hidden else "\n".join(
            f"{k.name} = {with_unit(repr(float(v)), k.unit)}" for k, v in knobs
        ),
        "columns": [] if rig is None else list(rig.columns.headings),
        "instructions": "" if rig is None else rig.instructions,
    }  # fmt: skip


def _good_enough(now: Now, *, blind: bool) -> Any:
    best = now.incumbent
    if best is None or GOOD_ENOUGH not in now.state.marks.get(best, frozenset()):
        return None
    return {"number": None if blind else best + 1}


def best_view(interview: Interview, now: Now) -> Any:
    """The best experiment so far in numbers; None before the first."""
    if now.incumbent is None:
        return None
    scenario, experiment = interview.scenario, interview.experiment(now.incumbent)
    knobs = zip(scenario.space, experiment.theta, strict=True)
    return {
        **numbers_view(experiment, scenario),
        "number": now.incumbent + 1,
        "theta": theta_view(scenario.space, experiment, np.False_),
        "copy": "\n".join(f"{k.name} = {quantity(float(v), k.unit)}" for k, v in knobs),
        "marks": marks_of(now.state, now.incumbent),
    }


def marks_of(state: State, index: int) -> list[str]:
    """What experiment `index` is marked as, by the person, and by how its run ended."""
    counted = [INTERRUPTED] if index in counted_unsafe(state) else []
    return sorted(state.marks.get(index, ())) + counted


def _over(interview: Interview, now: Now, command: str, report: Path | None) -> dict[str, Any]:
    return {
        "reason": now.state.ended,
        "best": best_view(interview, now),
        "report": report_view(report),
        "command": command,
    }


def report_view(folder: Path | None) -> Any:
    """Where the report is, and its pictures; None while there is none."""
    if folder is None:
        return None
    pictures = sorted(p.name for p in folder.glob("*") if p.suffix in _PICTURES)
    return {
        "place": str(folder / "report.html"),
        "pictures": [f"/report/{name}" for name in pictures],
    }
