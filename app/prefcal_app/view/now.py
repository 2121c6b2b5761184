"""The whole screen as plain data: what is now, the history, and the status."""

from collections.abc import Callable, Iterable, Sequence, Set
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_app.session import Consistency, Interview, Now, Phase
from prefcal_app.session.study import GOOD_ENOUGH, trust_text
from prefcal_app.summary import VERDICTS, list_shown
from prefcal_env.knobs import KnobSpace
from prefcal_env.preferences.answer import Preference
from prefcal_env.preferences.history import Comparison
from prefcal_env.study import State
from prefcal_env.workers import in_time
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.wording import INTERRUPTED, knob_number, marks_text, with_unit

from .end import outlook_view, over_view, screening_view, why_view
from .question import Seen, knob_view, numbers_view, plant_view, question_view, theta_texts, theta_view

# --- List every question and answer.

_WINNERS = {Preference.CHALLENGER: "new", Preference.INCUMBENT: "best", Preference.TIE: "none"}


def history_view(interview: Interview) -> dict[str, Any]:
    """Return all answers in the order given, including repeated questions, and the remarks.

    `number` counts the questions as they were asked, follow-ups among them; `answer` is the number
    for viewing and retracting.
    """
    state = interview.now().state
    asked = (c for c in state.history.comparisons if c.question is not None)
    numbers = {c.question: c.challenger for c in asked}
    numbers |= {c.question: -k for k, c in enumerate(state.history.follow_ups, start=1)}
    answers = [_answer_view(c, numbers) for c in state.answers]
    order = {answer: k for k, answer in enumerate(dict.fromkeys(a["answer"] for a in answers), 1)}
    return {
        "answers": [{**a, "number": order[a["answer"]]} for a in answers],
        "notes": [{"at": at, "text": text} for at, text in state.notes],
    }


def _answer_view(closed: Comparison, numbers: dict[int | None, int]) -> dict[str, Any]:
    again = closed.repeats is not None
    return {
        # A repeated question has the number of the original.
        "answer": numbers.get(closed.repeats if again else closed.question, closed.challenger),
        "at": closed.at,
        "challenger": closed.challenger + 1,
        "incumbent": None if closed.incumbent is None else closed.incumbent + 1,
        "text": VERDICTS[closed.answer.preference],
        "winner": _WINNERS.get(closed.answer.preference, "none"),  # type: ignore[arg-type]
        "comment": closed.comment,
        "blind": closed.blind,
        "marks": marks_text(closed.answer),
        "retracted": closed.retracted,
        "repeated": again,
        "further": closed.after is not None,
    }


def asked_view(
    interview: Interview, answer: int, *, blind: bool = False, seen: Seen | None = None
) -> dict[str, Any]:
    """Return answered question number `answer` as it was shown, on the current axes of the study.

    Raises:
        StaleError: If there is no such question.
    """
    question, closed = interview.past.asked(answer), interview.past.closed(answer)
    seen = (seen or Seen()).look(interview)
    return {
        "answer": answer,
        "question": question_view(question, interview.scenario, blind=blind, seen=seen),
        "verdict": question.choice(closed.answer.preference).value,
        "retracted": closed.retracted,
        "comment": closed.comment,
        "time_unit": question.left.experiment.channels.time_unit,
    }


# --- Show the current state: the phase, the open question, the pending run, and the end.


def now_view(
    interview: Interview,
    *,
    blind: bool = False,
    again: str = "",
    command: str = "",
    remarks: Sequence[str] = (),
    report: Path | None = None,
    seen: Seen | None = None,
) -> dict[str, Any]:
    """Return NOW for the page.

    Args:
        blind: Whether to leave out θ and roles, which are then not even sent.
        again: Command that resumes the study.
        command: Command that repeats the study from the start.
        remarks: What is no longer as it was when the study was begun.
        report: Folder of the finished report.
        seen: Results computed earlier for this study's experiments; none if None.
    """
    now, scenario, seen = interview.now(), interview.scenario, Seen() if seen is None else seen
    question, over = now.question, now.phase is Phase.OVER
    time_unit = "" if question is None else question.left.experiment.channels.time_unit
    sentence, named = ("", ()) if blind else why_view(interview, now)  # it tells which side is new
    return {
        "version": now.version,
        "phase": now.phase.value,
        "blind": blind,
        "scenario": {"name": scenario.name, "title": scenario.title, "time_unit": time_unit},
        "study": {"place": interview.file.path, "again": again, "remarks": list(remarks)},
        "progress": _progress(interview, now),
        "simulated": simulated_view(now),
        "can": sorted(now.can),
        "question": question
        and question_view(question, scenario, blind=blind, seen=seen.look(interview), named=named),
        "problem": now.problem,
        "stopping": _stopping(now),
        "preparing": None if now.preparing is None else asdict(now.preparing),
        "draft": now.draft,
        "rig": _rig(scenario, now.state),
        "live": plant_view(scenario, now.plant),
        "pending": _pending(interview, now, blind=blind),
        "good_enough": _good_enough(now, blind=blind),
        "screening": screening_view(interview, now, sentence, blind=blind),
        "over": over_view(interview, now, best_view(interview, now), command, report, seen) if over else None,
    }


def _stopping(now: Now) -> str | None:
    """Return when a run is stopped and what follows; None if runs cannot be stopped."""
    if now.run_limit is None:
        return None
    finite = isfinite(now.run_limit)
    limit = f"A run is stopped after {in_time(now.run_limit)}" if finite else "Runs have no time limit"
    return (
        f"{limit} (--run-timeout). After a stop, try again or count the run as failed: the study continues."
    )


def _progress(interview: Interview, now: Now) -> dict[str, Any]:
    planned, counts = interview.known.planned, interview.known.counts
    further = now.question is not None and now.question.further
    return {
        "answered": planned.answered,
        "questions": planned.total,
        "text": planned.place(over=now.phase is Phase.OVER, further=further),
        "given": counts.comparisons,
        "experiments": counts.experiments,
        "n_max": interview.known.n_max,
        "running": now.running,
    }


def simulated_view(now: Now) -> dict[str, Any] | None:
    """Return how many θ were simulated unseen, and that as lines; None if none are."""
    found = now.simulated
    if found is None:
        return None
    said = {"line": found.line, "going_on": found.going_on, "pace": found.pace, "progress": found.progress}
    return {**asdict(found), **said}


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
    unsafe = best in now.state.history.interrupted
    return None if unsafe else {"number": None if blind else best + 1}


def best_view(interview: Interview, now: Now) -> Any:
    """Return the best experiment so far in numbers; None before the first."""
    if now.incumbent is None:
        return None
    scenario, experiment = interview.scenario, interview.past.experiment(now.incumbent)
    return {
        **numbers_view(experiment, scenario.shown_kpis),
        "number": now.incumbent + 1,
        "theta": theta_view(scenario.space, experiment, exact=True),
        "copy": _exact(scenario, experiment.theta),
        "marks": marks_of(now.state, now.incumbent, now.state.history.interrupted),
    }


def _exact(scenario: Scenario, theta: Iterable[float]) -> str:
    """Return θ in full precision, a line for each knob, to copy."""
    knobs = zip(scenario.space.knobs, theta, strict=True)
    return "\n".join(f"{k.name} = {with_unit(repr(float(v)), k.unit)}" for k, v in knobs)


def marks_of(state: State, index: int, interrupted: Set[int]) -> list[str]:
    """Return the marks of experiment `index`: the person's, and "unsafe" if it was interrupted."""
    counted = [INTERRUPTED] if index in interrupted else []
    return sorted(state.marks.get(index, ())) + counted


# --- Show the status: the best so far, what was tried and learned, and how consistent answers are.

_POINTS = 81  # number of points of a slice through the surrogate


def status_view(interview: Interview) -> dict[str, Any]:
    """Return STATUS for the page."""
    now = interview.now()
    return {
        "best": best_view(interview, now),
        "tried": _tried(interview, now),
        "slices": _slices(interview, now),
        "consistency": {"text": in_words(interview.known.consistency), "can_repeat": "repeat" in now.can},
        "outlook": outlook_view(interview.known.outlook),
        "questions": interview.known.questions,
        "simulated": simulated_view(now),
        "trust": "" if (index := interview.known.index) is None else trust_text(index),
    }


def in_words(consistency: Consistency) -> str:
    """Return repeats and cycles as sentences."""
    repeats = "No question has been asked twice yet."
    if consistency.repeated:
        repeats = f"{consistency.agreed} of {consistency.repeated} repeated questions got the same answer."
    if not consistency.cycles:
        return f"{repeats} The answers do not contradict each other."
    circles = "; ".join(" over ".join(str(i + 1) for i in cycle) for cycle in consistency.cycles)
    return f"{repeats} Preferred in a circle: {circles}."


def _tried(interview: Interview, now: Now) -> dict[str, Any]:
    state, space = now.state, interview.scenario.space
    winners = set(state.history.incumbents())
    interrupted = state.history.interrupted
    return {
        "knobs": [knob_view(knob) for knob in space],
        "experiments": [
            {
                "number": index + 1,
                "theta": list(state.history.samples[index].theta),
                "text": theta_texts(space, state.history.samples[index].theta),
                "best": index == now.incumbent,
                "was_best": index in winners,
                "ended": interview.past.end(index).value,
                "marks": marks_of(state, index, interrupted),
            }
            for index in list_shown(state)
        ],
    }


def _slices(interview: Interview, now: Now) -> list[dict[str, Any]] | None:
    surrogate = interview.known.surrogate
    if surrogate is None or now.incumbent is None:
        return None
    thetas = [now.state.history.samples[index].theta for index in sorted(now.state.finished)]
    best = interview.past.experiment(now.incumbent).theta
    return slices_view(interview.scenario.space, best, np.array(thetas), surrogate)


def slices_view(
    space: KnobSpace,
    best: Float[np.ndarray, " n"],
    tried: Float[np.ndarray, "N n"],
    surrogate: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]],
) -> list[dict[str, Any]]:
    """Return the learned cost along each knob through the best θ, for the page and the report.

    Only the order of learned costs has a meaning: they are the square root of the difference to
    the lowest one shown, which emphasizes low ones.

    Args:
        best: Best θ, physical, shape (n,).
        tried: θ of every experiment, physical, shape (N, n).
        surrogate: Learned cost of m physical θ.
    """
    base = space.encode(best)
    paths = [_path(space, base, k) for k in range(len(space))]
    costs = [surrogate(thetas) for thetas in (tried, *paths)]
    lowest = float(min(cost.min() for cost in costs))
    seen, *lines = (np.sqrt(np.maximum(cost - lowest, 0.0)).tolist() for cost in costs)
    return [
        {
            "knob": knob_view(knob),
            "x": paths[k][:, k].tolist(),
            "y": lines[k],
            "samples": {"x": tried[:, k].tolist(), "y": seen},
            "best": float(best[k]),
        }
        for k, knob in enumerate(space)
    ]


def _path(space: KnobSpace, base: Float[np.ndarray, " n"], k: int) -> Float[np.ndarray, "m n"]:
    """Return θ over the whole range of knob `k` through the cube point `base`, ascending."""
    z = np.repeat(base[None], _POINTS, axis=0)
    z[:, k] = np.linspace(0.0, 1.0, _POINTS)
    thetas = np.unique(np.array([space.decode(row) for row in z]), axis=0)
    return np.asarray(thetas[np.argsort(thetas[:, k])])
