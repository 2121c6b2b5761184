"""Show the end: the gain since the first experiment, the report, and what to do next."""

import math
from pathlib import Path
from typing import Any

from prefcal_env.experiments.experiment import Experiment
from prefcal_scenarios.app.presentation.wording import measured, number
from prefcal_scenarios.app.session import Interview, Now, Outlook
from prefcal_scenarios.scenario import KPI

from .compare import NOTICED

_PICTURES = (".png", ".gif")
_MAIN = 3
"""Number of KPIs whose gain is shown, most important first."""


def over_view(
    interview: Interview, now: Now, best: Any, command: str, report: Path | None
) -> dict[str, Any]:
    """Return OVER for the page; `best` is the best experiment in numbers."""
    return {
        "reason": now.state.ended,
        "best": best,
        "gain": None if now.incumbent is None else gain_view(interview, now.incumbent, now),
        "report": report_view(report),
        "command": command,
        "next": next_view(interview, now, report),
    }


def gain_view(interview: Interview, best: int, now: Now) -> dict[str, Any]:
    """Return the main KPIs of the first experiment next to those of the best one."""
    before, after = interview.experiment(0), interview.experiment(best)
    kpis = [k for k in interview.scenario.kpis if k.goal is not None and k.name in before.kpis]
    tuned = bool(now.state.configuration["options"].get("start"))
    return {
        "before": "your current tuning" if tuned else "the first experiment",
        "after": best + 1,
        "same": best == 0,
        "kpis": [_gain(kpi, before, after) for kpi in kpis[:_MAIN]],
    }


def _gain(kpi: KPI, before: Experiment, after: Experiment) -> dict[str, Any]:
    """Return one KPI before and after; a dash if an interrupted or failed run lacks it.

    A value that reads the same, or differs too little to notice, is not called better or worse.
    """
    texts = measured(kpi, before), measured(kpi, after)
    was, now = (e.kpis.get(kpi.name, math.nan) for e in (before, after))
    change = now - was
    worse = kpi.badness(now) - kpi.badness(was)
    verdict = "better" if worse < 0 else "worse" if worse > 0 else ""
    if texts[0] == texts[1]:
        change = 0.0
    if abs(change) < NOTICED * max(abs(was), abs(now)) or change == 0.0:
        verdict = ""
    return {
        "title": kpi.title,
        "about": kpi.about,
        "unit": kpi.unit,
        "before": texts[0],
        "after": texts[1],
        "change": _signed(change) if math.isfinite(change) else "",
        "verdict": verdict,
    }


def _signed(change: float) -> str:
    text = number(abs(change))
    return "no change" if text == "0" else f"{'+' if change > 0 else '−'}{text}"


def next_view(interview: Interview, now: Now, report: Path | None) -> dict[str, Any]:
    """Return what can be done with the result."""
    scenario = interview.scenario
    file = None if report is None or not (report / "best.json").is_file() else report / "best.json"
    usable = scenario.controller is not None and file is not None
    return {
        "python": f"prefcal_scenarios.load_controller({str(file)!r})" if usable else "",
        "download": None if file is None else "/report/best.json",
        "outlook": outlook_view(interview.outlook),
    }


def outlook_view(outlook: Outlook | None) -> dict[str, Any] | None:
    """Return in sentences whether to continue, and the command that widens ranges."""
    if outlook is None:
        return None
    return {"sentences": list(outlook.sentences), "command": outlook.command}


def report_view(folder: Path | None) -> Any:
    """Return the location of the report and its pictures; None if there is no report yet."""
    if folder is None:
        return None
    pictures = sorted(p.name for p in folder.glob("*") if p.suffix in _PICTURES)
    return {
        "place": str(folder / "report.html"),
        "link": "/report/report.html",
        "acceptance": "/report/acceptance.html",
        "pictures": [f"/report/{name}" for name in pictures],
    }
