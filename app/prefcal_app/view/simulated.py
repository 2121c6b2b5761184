"""Show what a screening agent simulated, why it asks, and whether it offers to stop."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.utility.bank import Bank
from prefcal_agents.utility.menu import between, unbeaten
from prefcal_app.session import Interview, Now, Question, Side
from prefcal_app.session.study.memory import is_robust
from prefcal_app.simulating import Screened, as_shown, at_stake, menu_names, why
from prefcal_app.summary.outlook import after_a_slip
from prefcal_env.knobs.knob import Knob
from prefcal_scenarios.scenario import KPI, Scenario

from .seen import Seen
from .sides import question_view, theta_texts

_SPAN = 100.0
"""Ratio of the largest to the smallest value from which an axis is logarithmic: two decades."""


def screening_view(interview: Interview, now: Now, *, blind: bool) -> dict[str, Any] | None:
    """Return why the open question is asked and an offer to stop; None for other agents.

    With `blind`, the reason is not sent: it tells which side is new. While the best experiment
    misses an objective, stopping is not offered.
    """
    if not interview.known.screens:
        return None
    screened = interview.known.screened()
    prospect = None if screened is None else screened.prospect
    asks = now.question is not None and now.question.repeats is None and not interview.known.missed
    return {
        "why": "" if blind else " ".join(filter(None, (why_view(interview, now), _stakes(screened)))),
        "offer": prospect.offer if asks and prospect is not None else "",
    }


def _stakes(screened: Screened | None) -> str:
    """Return that the answer hardly changes the result; empty if it may, or while not known."""
    carried = None if screened is None else screened.carried
    return "" if carried is None or carried.stakes is None else at_stake(carried.stakes)


def decisive_view(interview: Interview) -> int | None:
    """Return the number of the answer that the result rests on; None without one, or while not known."""
    screened = interview.known.screened()
    carried = None if screened is None else screened.carried
    return None if carried is None or carried.decisive is None else carried.decisive.answer


def smaller_view(interview: Interview) -> list[float] | None:
    """Return θ of the smaller change, to look at and to ask for; None without one, or if it was shown."""
    screened = interview.known.screened()
    carried = None if screened is None else screened.carried
    found = None if carried is None or carried.smaller is None else carried.smaller.theta
    shown = {sample.theta for sample in interview.now().state.history.samples}
    return None if found is None or found in shown else list(found)


def menu_view(interview: Interview) -> list[dict[str, Any]]:
    """Return simulated θ that the person might prefer to the result; those shown are left out."""
    screened = interview.known.screened()
    carried = None if screened is None else screened.carried
    if screened is None or carried is None:
        return []
    names, bank = menu_names(carried.menu, interview.scenario), screened.bank
    shown = {screened.row(np.array(s.theta)) for s in interview.now().state.history.samples}
    return [
        {"name": name, "theta": bank.thetas[row].tolist(), "row": row}
        for row, name in names.items()
        if row not in shown
    ]


def why_view(interview: Interview, now: Now) -> str:
    """Return why the open question is asked, in one sentence; empty while there is no reason."""
    question, screened = now.question, interview.known.screened()
    if question is None or question.repeats is not None or not interview.known.screens:
        return ""
    if question.further:
        return "You have seen both before: your answer settles which of the two is better."
    new = question.challenger
    side = "Left" if new is question.left else "Right"
    requested = new.index in now.state.requested
    if screened is None or screened.reason is None:
        return f"{side} is shown because you asked for it." if requested else ""
    other = question.right if new is question.left else question.left
    scenario = interview.scenario
    told = why(
        as_shown(screened.reason, scenario, new.experiment, other.experiment),
        scenario,
        side=side,
        requested=requested,
        learned=screened.prospect is not None,
        missed=[
            kpi.title
            for kpi in scenario.shown_kpis
            if kpi.met_by(new.experiment) is False and kpi.met_by(other.experiment)
        ],
    )
    history = now.state.history
    slip = history.incumbent != history.by_answers
    return f"{told} {after_a_slip(history, robust=is_robust(now.state))}" if slip else told


def map_view(interview: Interview) -> dict[str, Any] | None:
    """Return the simulated θ for a picture; None until the agent knows them."""
    screened, now = interview.known.screened(current=False), interview.now()
    if screened is None:
        return None
    scenario, question, bank = interview.scenario, now.question, screened.bank
    axes = _axes(screened, scenario)
    rows = {
        index: screened.row(np.array(now.state.history.samples[index].theta))
        for index in sorted(now.state.finished)
    }
    numbers = {row: index + 1 for index, row in rows.items() if row is not None}
    sides = {} if question is None else {"left": question.left, "right": question.right}
    best = None if now.incumbent is None else rows.get(now.incumbent)
    return {
        "version": now.version,
        "axes": [axis.as_json() for axis in axes],
        "chosen": _chosen(screened, axes),
        "points": _points(screened, axes, scenario, numbers),
        "best": best,
        "ways": [] if best is None else _ways(bank, best, [choice["row"] for choice in menu_view(interview)]),
        "sides": {name: rows.get(side.index) for name, side in sides.items()},
        "over": now.state.ended is not None,
        "left_to_ask": max(interview.known.n_max - now.state.history.answered, 0),
    }


def _ways(bank: Bank, best: int, others: list[int]) -> list[tuple[int, ...]]:
    """Return what lies between the best row and each of the others."""
    stops = unbeaten(bank.kpis, ~bank.hopeless) if others else bank.hopeless
    return [between(bank.kpis, stops, best, other) for other in others]


@dataclass(frozen=True, eq=False, slots=True)
class _Axis:
    """One KPI or knob of all simulated θ, in the values that people see; NaN if it has none."""

    of: KPI | Knob
    values: Float[np.ndarray, " m"]
    log: bool

    @property
    def title(self) -> str:
        return self.of.name if isinstance(self.of, Knob) else self.of.title

    def as_json(self) -> dict[str, Any]:
        return {
            "title": self.title,
            "unit": self.of.unit,
            "log": self.log,
            "knob": isinstance(self.of, Knob),
            "about": self.of.about,
        }


def _axes(screened: Screened, scenario: Scenario) -> list[_Axis]:
    """Return the KPIs, in the scenario's order, and the knobs."""
    bank, kpis = screened.bank, {kpi.name: kpi for kpi in scenario.kpis}
    order = [name for name in kpis if name in bank.names]
    order += [name for name in bank.names if name not in kpis]
    about = [kpis.get(name, KPI(name, name.replace("_", " "))) for name in order]
    found = [_of_kpi(kpi, bank.kpis[:, bank.names.index(kpi.name)]) for kpi in about]
    for knob, values in zip(scenario.space, bank.thetas.T, strict=True):
        found.append(_Axis(knob, values, log=knob.scale == "log10"))
    return found


def _of_kpi(kpi: KPI, badness: Float[np.ndarray, " m"]) -> _Axis:
    """Return the axis of a KPI: logarithmic if its values are positive and span two decades."""
    values = np.where(np.isfinite(badness), badness, np.nan)
    if kpi.goal == "higher":
        values = -values
    known = values[np.isfinite(values)]
    log = len(known) > 0 and bool(0 < known.min() < known.max() / _SPAN)
    title = f"{kpi.title}: distance from its target" if kpi.goal == "target" else kpi.title
    return _Axis(replace(kpi, title=title), values, log)


def _chosen(screened: Screened, axes: list[_Axis]) -> list[int]:
    """Return the two axes shown first: the KPIs that matter most, else the first ones."""
    reason, names = screened.reason, [axis.of.name for axis in axes]
    by = () if reason is None else (*reason.better_in, *reason.worse_in)
    places = [names.index(name) for name in by if name in names]
    return list(dict.fromkeys([*places, *range(len(names))]))[:2]


def _points(
    screened: Screened, axes: list[_Axis], scenario: Scenario, numbers: dict[int, int]
) -> list[dict[str, Any]]:
    bank = screened.bank
    stopped = np.isinf(bank.kpis).all(axis=1)  # or it has no value for another reason
    values = np.array([axis.values for axis in axes]).T
    return [
        {
            "theta": theta,
            "text": theta_texts(scenario.space, theta),
            "values": [None if v != v else float(f"{v:.6g}") for v in row],
            "end": "failed" if bank.failed[i] else "stopped" if stopped[i] else "",
            "number": numbers.get(i),
        }
        for i, (theta, row) in enumerate(zip(bank.thetas.tolist(), values.tolist(), strict=True))
    ]


def look_view(interview: Interview, theta: tuple[float, ...], seen: Seen | None = None) -> dict[str, Any]:
    """Return a simulated θ beside the best so far, as a question shows two experiments.

    Nothing is recorded. Before the first experiment, it stands beside itself.
    """
    scenario = interview.scenario
    experiment = interview.look_at(np.array(theta))
    now = interview.now()
    new = Side(-1, experiment, challenger=True, role="simulated")
    old = new
    if now.incumbent is not None:
        old = Side(now.incumbent, interview.past.experiment(now.incumbent), False, role="best so far")
    study = (Seen() if seen is None else seen).look(interview)
    view = question_view(Question(0, 0, old, new), scenario, blind=False, seen=study)
    for side in ("left", "right"):
        view[side]["number"] = view[side]["number"] or None  # 0: not shown yet
    return {"question": view, "time_unit": experiment.channels.time_unit}
