"""Show the end: what was gained, the report, and what to do next."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from prefcal_app.session import Interview, Now, Outlook
from prefcal_app.summary.gain import Baseline, gained

from . import tables
from .seen import Seen


def over_view(
    interview: Interview, now: Now, best: Any, command: str, report: Path | None, seen: Seen
) -> dict[str, Any]:
    """Return OVER for the page; `best` is the best experiment in numbers."""
    return {
        "reason": now.state.ended,
        "best": best,
        "gain": None if now.incumbent is None else _gain(interview, now.incumbent, now, seen),
        "report": report_view(report),
        "command": command,
        "next": next_view(interview, now, report),
    }


def _gain(interview: Interview, best: int, now: Now, seen: Seen) -> dict[str, Any]:
    baseline = Baseline.of(now.state)
    both = interview.experiment(baseline.index), interview.experiment(best)
    rows = gained(*both, interview.scenario.shown_kpis, seen.look(interview).spread)
    return gain_view(baseline, best, rows)


def gain_view(baseline: Baseline, best: int, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the KPIs of the baseline next to those of the best experiment.

    Args:
        baseline: Experiment that the result is compared with.
        best: Index of the best experiment.
        rows: What `gained` returns of both.
    """
    kinds = {"better": "words yes", "worse": "words no", "": ""}
    lines = [
        tables.row(
            row["title"],
            [
                tables.cell(row["before"]),
                tables.cell(row["after"], row["met"], "best"),
                tables.cell(row["change"]),
                tables.cell(row["verdict"], kind=kinds[row["verdict"]]),
            ],
            unit=row["unit"],
            aim=row["objective"],
            about=row["about"],
        )
        for row in rows
    ]
    heads = ("", f"{baseline.name} ({baseline.index + 1})", f"best ({best + 1})", "change", "")
    caption = "Largest change first. ✓ meets the objective, ✗ does not."
    return {
        "title": f"What was gained over the {baseline.name}",
        "none": f"No experiment was better than the {baseline.name}: "
        f"experiment {best + 1} is still the best.",
        "same": best == baseline.index,
        "table": tables.table("What was gained", heads, lines, caption),
    }


def next_view(interview: Interview, now: Now, report: Path | None) -> dict[str, Any]:
    """Return what can be done with the result."""
    scenario = interview.scenario
    file = None if report is None or not (report / "best.json").is_file() else report / "best.json"
    usable = scenario.controller is not None and file is not None
    return {
        "python": f"prefcal_app.load_controller({str(file)!r})" if usable else "",
        "download": None if file is None else "/report/best.json",
        "outlook": outlook_view(interview.outlook),
    }


def outlook_view(outlook: Outlook | None) -> dict[str, Any] | None:
    """Return in sentences whether to continue, and the command that widens ranges."""
    if outlook is None:
        return None
    return {"sentences": list(outlook.sentences), "command": outlook.command}


def report_view(folder: Path | None) -> Any:
    """Return the location of the report; None if there is no report yet."""
    if folder is None:
        return None
    return {
        "place": str(folder / "report.html"),
        "link": "/report/report.html",
        "acceptance": "/report/acceptance.html",
    }
