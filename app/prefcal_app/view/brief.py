"""Write the briefing: the task, what its knobs and KPIs mean, and how long it takes."""

from typing import Any

from prefcal_app.session import Interview
from prefcal_scenarios.presentation.wording import limits_text
from prefcal_scenarios.scenario import KPI, Scenario

from .sides import knob_view

_SECONDS = 15
"""Seconds for one comparison at a calm pace."""


def brief_view(interview: Interview) -> dict[str, Any]:
    """Return the task, what the person is asked to do, and how a tuning in use is compared."""
    return {**scenario_view(interview.scenario), "how": _how(interview), "start": _current_tuning(interview)}


def scenario_view(scenario: Scenario) -> dict[str, Any]:
    """Return the task, the knobs and the KPIs of a scenario in words."""
    return {
        "title": scenario.title,
        "text": scenario.brief,
        "knobs": [knob_view(knob) for knob in scenario.space],
        "kpis": [_kpi_view(kpi) for kpi in scenario.shown_kpis],
        "panels": [panel.title or panel.name for panel in scenario.panels],
    }


def _how(interview: Interview) -> str:
    """Return what the person is asked to do, and how long it takes."""
    planned = interview.known.planned
    asked = (
        "You are shown two experiments at a time and say which one went better: "
        f"{planned.total} question{'' if planned.total == 1 else 's'}"
    )
    minutes = max(round(planned.total * _SECONDS / 60), 1)
    pace = f"about {minutes} minute{'' if minutes == 1 else 's'} at {_SECONDS} s each"
    took = "at the pace of your experiments" if interview.scenario.source.asks else pace
    return (
        f"{asked}, {took}. Follow your own judgment: there is no right answer, and “about the "
        "same” and “can't tell” are answers too. Every answer is saved at once; you can stop and "
        "resume at any time, and finish as soon as one experiment is good enough."
    )


def _current_tuning(interview: Interview) -> str:
    """Return how to compare with the tuning in use; empty if the study starts from a given one."""
    if interview.file.state.configuration["options"].get("start"):
        return ""
    values = ", ".join(f"{knob.name.replace(' ', '_')}=…" for knob in interview.scenario.space)
    return (
        "Is a tuning in use now? Start the command again with a new study and "
        f'--start "{values}": then the result is compared with it, and not with a first '
        "experiment that prefcal chose."
    )


def _kpi_view(kpi: KPI) -> dict[str, str]:
    """Return a KPI in words, with its objective."""
    direction = "" if kpi.goal is None else f"{kpi.goal} is better"
    wanted = limits_text(kpi) or direction
    return {"title": kpi.title, "unit": kpi.unit, "about": kpi.about, "wanted": wanted}
