"""Show the current state: the phase, the open question, the pending run, and the end."""

from collections.abc import Iterable, Set
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

from prefcal_app.session import Interview, Now, Phase
from prefcal_app.session.study.now import GOOD_ENOUGH
from prefcal_env.study import State
from prefcal_env.workers import in_time
from prefcal_scenarios.presentation.wording import INTERRUPTED, knob_number, with_unit
from prefcal_scenarios.scenario import Scenario

from .end import over_view
from .preview import plant_view
from .seen import Seen
from .sides import numbers_view, question_view, theta_view
from .simulated import screening_view


def now_view(
    interview: Interview,
    *,
    blind: bool = False,
    again: str = "",
    command: str = "",
    report: Path | None = None,
    seen: Seen | None = None,
) -> dict[str, Any]:
    """Return NOW for the page.

    Args:
        interview: Interview to show.
        blind: Whether to leave out θ and roles, which are then not even sent.
        again: Command that resumes the study.
        command: Command that repeats the study from the start.
        report: Folder of the finished report.
        seen: Results computed earlier for this study's experiments; none if None.
    """
    now, scenario, seen = interview.now(), interview.scenario, Seen() if seen is None else seen
    question, over = now.question, now.phase is Phase.OVER
    time_unit = "" if question is None else question.left.experiment.channels.time_unit
    return {
        "version": now.version,
        "phase": now.phase.value,
        "blind": blind,
        "scenario": {"name": scenario.name, "title": scenario.title, "time_unit": time_unit},
        "study": {"place": interview.file.path, "again": again},
        "progress": _progress(interview, now),
        "simulated": simulated_view(now),
        "can": sorted(now.can),
        "question": question and question_view(question, scenario, blind=blind, seen=seen.look(interview)),
        "problem": now.problem,
        "stopping": _stopping(now),
        "preparing": None if now.preparing is None else asdict(now.preparing),
        "draft": now.draft,
        "rig": _rig(scenario, now.state),
        "live": plant_view(scenario, now.plant),
        "pending": _pending(interview, now, blind=blind),
        "good_enough": _good_enough(now, blind=blind),
        "screening": screening_view(interview, now, blind=blind),
        "over": over_view(interview, now, best_view(interview, now), command, report, seen) if over else None,
    }


def _stopping(now: Now) -> str | None:
    """Return when a run is stopped and what follows; None if runs cannot be stopped."""
    if now.run_limit is None:
        return None
    limit = "Runs have no time limit"
    if isfinite(now.run_limit):
        limit = f"A run is stopped after {in_time(now.run_limit)}"
    return (
        f"{limit} (--run-timeout). After a stop, try again or count the run as failed: the study continues."
    )


def _progress(interview: Interview, now: Now) -> dict[str, Any]:
    """Return the progress."""
    planned = interview.known.planned
    further = now.question is not None and now.question.further
    return {
        "answered": planned.answered,
        "questions": planned.total,
        "text": planned.place(over=now.phase is Phase.OVER, further=further),
        "given": interview.known.counts.comparisons,
        "experiments": interview.known.counts.experiments,
        "n_max": interview.known.n_max,
        "running": now.running,
    }


def simulated_view(now: Now) -> dict[str, Any] | None:
    """Return how many θ were simulated unseen, and that as lines; None if none are."""
    found = now.simulated
    if found is None:
        return None
    return {**asdict(found), "line": found.line, "going_on": found.going_on}


def _pending(interview: Interview, now: Now, *, blind: bool) -> Any:
    """Return the sample that is running, awaited or failed. On a rig, θ is always shown."""
    sample, scenario = now.pending, interview.scenario
    if sample is None:
        return None
    source = scenario.source
    knobs = list(zip(scenario.space.knobs, sample.theta, strict=True))
    hidden = blind and not source.asks
    return {
        "index": sample.index,
        "number": sample.index + 1,
        "theta": []
        if hidden
        else [
            {"name": k.name, "unit": k.unit, "text": knob_number(k, v), "exact": repr(float(v))}
            for k, v in knobs
        ],
        "copy": "" if hidden else _exact(scenario, sample.theta),
        "instructions": source.instructions,
        "promise": interview.known.promise if source.asks and now.question is None else "",
    }


def _rig(scenario: Scenario, state: State) -> dict[str, Any] | None:
    """Return, for a rig, the columns of a record and the records that can be replaced."""
    if scenario.source.asks != "record":
        return None
    return {
        "columns": list(scenario.source.columns),
        "recorded": [] if state.ended else [index + 1 for index in sorted(state.finished)],
    }


def _good_enough(now: Now, *, blind: bool) -> Any:
    best = now.incumbent
    if best is None or GOOD_ENOUGH not in now.state.marks.get(best, frozenset()):
        return None
    if best in now.state.history.unsafe(automatic=True):
        return None
    return {"number": None if blind else best + 1}


def best_view(interview: Interview, now: Now) -> Any:
    """Return the best experiment so far in numbers; None before the first."""
    if now.incumbent is None:
        return None
    scenario, experiment = interview.scenario, interview.past.experiment(now.incumbent)
    return {
        **numbers_view(experiment, scenario.shown_kpis),
        "number": now.incumbent + 1,
        "theta": theta_view(scenario.space, experiment),
        "copy": _exact(scenario, experiment.theta),
        "marks": marks_of(now.state, now.incumbent, now.state.history.unsafe(automatic=True)),
    }


def _exact(scenario: Scenario, theta: Iterable[float]) -> str:
    """Return θ in full precision, a line for each knob, to copy."""
    knobs = zip(scenario.space.knobs, theta, strict=True)
    return "\n".join(f"{k.name} = {with_unit(repr(float(v)), k.unit)}" for k, v in knobs)


def marks_of(state: State, index: int, interrupted: Set[int]) -> list[str]:
    """Return the marks of experiment `index`: the person's, and "unsafe" if it was interrupted."""
    counted = [INTERRUPTED] if index in interrupted else []
    return sorted(state.marks.get(index, ())) + counted
