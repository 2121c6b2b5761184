"""Show the end: what was gained over the experiment to beat, the report, and what to do next."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from prefcal_app.session import Interview, Now, Outlook
from prefcal_app.summary.compare import Spread, compared, unmeasured
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.study import State
from prefcal_scenarios.kpis import WORST
from prefcal_scenarios.presentation.wording import MISSING
from prefcal_scenarios.scenario import KPI

from . import tables
from .seen import Seen
from .sides import theta_view
from .simulated import decisive_view, menu_view, smaller_view

FIRST, CURRENT = "first experiment", "current tuning"
"""Names of the first experiment: without and with a tuning that the person gave."""

_SLIGHT = 0.05
"""Share of a usual difference in the study below which a change is neither better nor worse."""


def baseline_of(state: State) -> str:
    """Return what the first experiment is, with which the result is compared.

    That is "current tuning" if the person gave its values, the name of a reference of the scenario
    if the study started with that, or "first experiment".
    """
    start = state.configuration["options"].get("start") or ()
    if not start:
        return FIRST
    return CURRENT if "=" in start[0] else str(start[0])


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
        "decisive": decisive_view(interview),
        "menu": menu_view(interview),
        "smaller": smaller_view(interview),
    }


def _gain(interview: Interview, best: int, now: Now, seen: Seen) -> dict[str, Any]:
    both = interview.past.experiment(0), interview.past.experiment(best)
    baseline, scenario = baseline_of(now.state), interview.scenario
    rows = gained(*both, scenario.shown_kpis, seen.look(interview).spread)
    return gain_view(baseline, best, rows, theta_view(scenario.space, both[0]))


def gain_view(
    baseline: str, best: int, rows: Sequence[Mapping[str, Any]], before: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return the KPIs of the baseline next to those of the best experiment.

    Args:
        baseline: What the first experiment is; see `baseline_of`.
        best: Index of the best experiment.
        rows: What `gained` returns of both.
        before: θ of the baseline, as `theta_view` returns it: the way back, if the person gave it.
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
    heads = ("", f"{baseline} (1)", f"best ({best + 1})", "change", "")
    caption = "Largest change first. ✓ meets the objective, ✗ does not."
    return {
        "title": f"What was gained over the {baseline}",
        "none": f"No experiment was better than the {baseline}: experiment {best + 1} is still the best.",
        "same": best == 0,
        "table": tables.table("What was gained", heads, lines, caption),
        "before": before if best and baseline != FIRST else [],
        "back": f"To go back, set the values of the {baseline}; best.json has them, too.",
    }


def gained(
    before: Experiment, after: Experiment, kpis: Sequence[KPI], spread: Spread
) -> list[dict[str, Any]]:
    """Return a row for each KPI before and after, largest change first, unmeasured ones last.

    An objective that is met only before or only after comes before all others. Otherwise a change
    is large if it is so in the study and beside the value itself: people know by how many percent
    a KPI changed, and not what is usual.

    The only comparison of the result with what was before: page, terminal, report and acceptance
    sheet show these rows. `change` is empty if a value is missing or infinite, or both meet their
    target alike; `verdict` is "better", "worse", or empty for a slight change and without a goal.

    Args:
        before: Experiment of the baseline.
        after: Best experiment.
        kpis: KPIs to show.
        spread: What is usual in the study.
    """
    rows = [row for row in compared(before, after, kpis, spread) if row["group"] in ("", WORST)]
    rows.sort(key=lambda row: (row["left"]["met"] == row["right"]["met"], -row["change"]))
    found = [_row(row) for row in rows]
    missing = [kpi for kpi in kpis if not {kpi.name} & {*before.kpis, *after.kpis}]
    return found + list(map(_row, unmeasured(before, after, missing)))


def _row(row: dict[str, Any]) -> dict[str, Any]:
    verdict = {"left": "worse", "right": "better", None: ""}[row["better"]]
    before, after = row["left"], row["right"]
    same = "no change" if before["text"] == after["text"] != MISSING else ""
    return {
        **{name: row[name] for name in ("title", "about", "unit", "objective")},
        "before": before["text"],
        "after": after["text"],
        "met": after["met"],
        "change": row["difference"] or same,
        "verdict": verdict if row["size"] >= _SLIGHT else "",
    }


def next_view(interview: Interview, now: Now, report: Path | None) -> dict[str, Any]:
    """Return what can be done with the result."""
    scenario = interview.scenario
    file = None if report is None or not (report / "best.json").is_file() else report / "best.json"
    usable = scenario.controller is not None and file is not None
    return {
        "python": f"prefcal_app.load_controller({str(file)!r})" if usable else "",
        "download": None if file is None else "/report/best.json",
        "outlook": outlook_view(interview.known.outlook),
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
