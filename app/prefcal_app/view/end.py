"""The end of a study as plain data, and what was simulated."""

import json
import shlex
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_agents.people import Bank
from prefcal_agents.result import find_unbeaten, rows_between
from prefcal_agents.screening.bank import ENOUGH
from prefcal_agents.screening.findings import Findings, Reason
from prefcal_app.session import Interview, Now, Outlook, Question, Side
from prefcal_app.session.study import is_robust, tried_on_plant
from prefcal_app.simulating import (
    Screened,
    as_shown,
    at_stake,
    carried_by,
    menu_names,
    name_wishes,
    named_titles,
    offer,
    rival,
    robust,
    why,
)
from prefcal_app.summary import (
    NONE_SAFE,
    Spread,
    after_a_slip,
    compare,
    kept_on_plant,
    kept_text,
    list_shown,
    unmeasured,
)
from prefcal_env.controllers.forms import (
    ANTI_WINDUP,
    EQUATIONS,
    FILTERED,
    NO_SERIES,
    PARALLEL,
    SERIES,
    PIDParameter,
    pid_forms,
)
from prefcal_env.controllers.written import LANGUAGES, languages_of
from prefcal_env.errors import StudyError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.plain import from_plain
from prefcal_env.study import State
from prefcal_scenarios.runs import WORST
from prefcal_scenarios.scenario import KPI, Scenario, panels_of
from prefcal_scenarios.verification.nominal import DRAWS, STEADY, Redrawn
from prefcal_scenarios.verification.said import NEVER_USED
from prefcal_scenarios.wording import MISSING, exact_number, join_words, number, sentence, with_unit

from . import question
from .question import Seen, question_view, theta_texts, theta_view

# --- Show what a screening agent simulated, why it asks, and whether it offers to stop.

_SPAN = 100.0  # ratio of the largest to the smallest value from which an axis is logarithmic: two decades


def screening_view(interview: Interview, now: Now, sentence: str, *, blind: bool) -> dict[str, Any] | None:
    """Return why the open question is asked, and an offer to stop; None for other agents.

    `sentence` is that of `why_view`. With `blind`, it is not sent: it tells which side is new. While
    the best experiment misses an objective, or its loop is not stable, stopping is not offered.
    """
    if not interview.known.screens:
        return None
    found, missed = interview.known.findings, interview.known.missed
    asks = now.question is not None and now.question.repeats is None and not missed
    asks = asks and not interview.known.none_safe and not interview.known.unstable
    # That the answer hardly changes the result; empty if it may, or while not known.
    stakes = found.stakes if found is not None and found.explained else None
    told = (sentence, "" if stakes is None else at_stake(stakes))
    return {
        "why": "" if blind else " ".join(filter(None, told)),
        "offer": offer(found) if asks and found is not None else "",
    }


def decisive_view(found: Findings | None) -> int | None:
    """Return the number of the answer that the result rests on; None without one, or while not known."""
    decisive = found.decisive if found is not None and found.explained else None
    return None if decisive is None else decisive.answer


def smaller_view(interview: Interview, found: Findings | None) -> list[float] | None:
    """Return θ of the smaller change, to look at and to ask for; None without one, or if it was shown."""
    smaller = found.smaller if found is not None and found.explained else None
    shown = {sample.theta for sample in interview.now().state.history.samples}
    return None if smaller is None or smaller.theta in shown else list(smaller.theta)


def menu_view(interview: Interview) -> list[dict[str, Any]]:
    """Return simulated θ that the person might prefer to the result.

    Those that were shown are left out, and those that gain nothing that can be read.
    """
    screened, found = interview.known.screened(), interview.known.findings
    if screened is None or found is None or not found.explained:
        return []
    now = interview.now()
    samples = now.state.history.samples
    shown = {screened.row(np.array(samples[index].theta)) for index in list_shown(now.state)}
    best = None if now.incumbent is None else screened.row(np.array(samples[now.incumbent].theta))
    placed = [(other, screened.row(np.array(other.theta))) for other in found.menu]
    kept = [(other, row) for other, row in placed if row is not None and row not in shown]
    if best is None:
        return []
    tables = [dict(zip(screened.bank.names, screened.bank.kpis[row], strict=True)) for _, row in kept]
    result = dict(zip(screened.bank.names, screened.bank.kpis[best], strict=True))
    names = menu_names([other for other, _ in kept], tables, result, interview.scenario)
    return [
        {"name": name, "theta": list(other.theta), "row": row}
        for name, (other, row) in zip(names, kept, strict=True)
        if name
    ]


def why_view(interview: Interview, now: Now) -> tuple[str, Sequence[str]]:
    """Return why the open question is asked, in one sentence, and the titles of the KPIs that it names.

    The sentence is empty while there is no reason.
    """
    question, found = now.question, interview.known.findings
    if question is None or question.repeats is not None or not interview.known.screens:
        return "", ()
    if question.further:
        return "You have seen both before: your answer settles which of the two is better.", ()
    new = question.challenger
    side = "Left" if new is question.left else "Right"
    requested = new.index in now.state.requested
    if found is None or found.reason is None:
        return (f"{side} is shown because you asked for it." if requested else ""), ()
    scenario, history = interview.scenario, now.state.history
    reason, missed = _shown_reason(found.reason, question, scenario)
    learned = found.chance_of_better is not None
    shown = best = None
    if reason.kept is not None:
        shown, best = (interview.known.nominal(each.index) for each in (new, question.incumbent))
    told = why(
        reason,
        scenario,
        side=side,
        requested=requested,
        learned=learned,
        missed=missed,
        shown=shown,
        best=best,
    )
    if history.incumbent != history.by_answers:
        told = f"{told} {after_a_slip(history, robust=is_robust(now.state))}"
    return told, list(dict.fromkeys([*named_titles(reason, scenario), *missed]))


def _shown_reason(reason: Reason, asked: Question, scenario: Scenario) -> tuple[Reason, list[str]]:
    """Return the reason as people can read it, and the titles of objectives that only the new one misses."""
    new, best = asked.challenger.experiment, asked.incumbent.experiment
    lost = [kpi for kpi in scenario.shown_kpis if kpi.met_by(new) is False and kpi.met_by(best)]
    return as_shown(reason, scenario, new, best), [kpi.title for kpi in lost]


def map_view(interview: Interview) -> dict[str, Any] | None:
    """Return the simulated θ for a picture; None until the agent knows them."""
    screened, now = interview.known.screened(current=False), interview.now()
    if screened is None:
        return None
    scenario, question, bank = interview.scenario, now.question, screened.bank
    axes = _axes(screened, scenario)
    rows = {
        index: screened.row(np.array(now.state.history.samples[index].theta))
        for index in list_shown(now.state)
    }
    # Of a time, what has no value never happened.
    time_unit = interview.past.experiment(min(rows)).channels.time_unit if rows else ""
    numbers = {row: index + 1 for index, row in rows.items() if row is not None}
    sides = {} if question is None else {"left": question.left, "right": question.right}
    best = None if now.incumbent is None else rows.get(now.incumbent)
    return {
        "version": now.version,
        "axes": [axis.as_json(time_unit) for axis in axes],
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
    stops = find_unbeaten(bank.kpis, ~bank.hopeless) if others else bank.hopeless
    return [rows_between(bank.kpis, stops, best, other) for other in others]


@dataclass(frozen=True, eq=False, slots=True)
class _Axis:
    """One KPI or knob of all simulated θ, in the values that people see; NaN if it has none."""

    of: KPI | Knob
    values: Float[np.ndarray, " m"]
    log: bool

    @property
    def title(self) -> str:
        return self.of.name if isinstance(self.of, Knob) else self.of.title

    def as_json(self, time_unit: str) -> dict[str, Any]:
        return {
            "title": self.title,
            "unit": self.of.unit,
            "log": self.log,
            "knob": isinstance(self.of, Knob),
            "about": self.of.about,
            "time": isinstance(self.of, KPI) and bool(time_unit) and self.of.unit == time_unit,
        }


def _axes(screened: Screened, scenario: Scenario) -> list[_Axis]:
    """Return the KPIs, in the scenario's order, and the knobs."""
    bank, kpis = screened.bank, {kpi.name: kpi for kpi in scenario.kpis}
    order = [*{kpi.of or name: name for name, kpi in kpis.items() if name in bank.names}.values()]
    order += [name for name in bank.names if name not in kpis]
    about = [kpis.get(name, KPI(name, name.replace("_", " "))) for name in order]
    found = [_of_kpi(kpi, bank.kpis[:, bank.names.index(kpi.name)]) for kpi in about]
    for knob, values in zip(scenario.space, bank.thetas.T, strict=True):
        found.append(_Axis(knob, values, log=knob.scale == "log10" and knob.low > 0))
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
    reason, names = screened.findings.reason, [axis.of.name for axis in axes]
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
    old = new = Side(-1, experiment, challenger=True, role="simulated")
    if now.incumbent is not None:
        old = Side(now.incumbent, interview.past.experiment(now.incumbent), False, role="best so far")
    study = (Seen() if seen is None else seen).look(interview)
    view = question_view(Question(0, 0, old, new), scenario, blind=False, seen=study)
    for side in ("left", "right"):
        view[side]["number"] = view[side]["number"] or None  # 0: not shown yet
    return {"question": view, "time_unit": experiment.channels.time_unit}


# --- Show the end: what was gained over the experiment to beat, the report, and what to do next.

CURRENT = "current tuning"  # name of the first experiment if the person gave its values
FIRST, RESULT = NEVER_USED
"""Its name if nobody gave it, and the begin of that if it is the result of another study."""

_SLIGHT = 0.05  # share of a usual difference in the study below which a change is neither better nor worse


def baseline_of(state: State) -> str:
    """Return what the first experiment is, with which the result is compared.

    That is "current tuning" if the person gave its values, the name of a reference of the scenario, of an
    experiment of another study or of its result if the study started with that, or "first experiment".
    """
    start = state.configuration["options"].get("start") or ()
    if not start:
        return FIRST
    *folders, name = str(start[0]).split("/")
    if name.endswith(".json"):
        return RESULT + (folders[-1] if folders else "an earlier study")
    return CURRENT if "=" in name else name


def can_go_back(baseline: str) -> bool:
    """Return whether the person gave the first experiment as what there was before."""
    return not baseline.startswith(NEVER_USED)


def over_view(
    interview: Interview, now: Now, best: Any, command: str, report: Path | None, seen: Seen
) -> dict[str, Any]:
    """Return OVER for the page; `best` is the best experiment in numbers."""
    outlook = interview.known.outlook
    return {
        "reason": now.state.ended,
        "words": interview.known.why_over,
        "best": best,
        "gain": None if now.incumbent is None else _gain(interview, now.incumbent, now, seen, report),
        "missed": "" if outlook is None else outlook.missed,
        "why": reasons(interview),
        "held": held(interview),
        "report": report_view(report),
        "command": command,
        "next": next_view(interview, report),
        "decisive": decisive_view(interview.known.findings),
        "menu": menu_view(interview),
        "smaller": smaller_view(interview, interview.known.findings),
        "trial": trial_view(interview, now),
    }


def reasons(interview: Interview) -> list[str]:
    """Return why this experiment is the result, in a few sentences; none if there is none."""
    if interview.now().incumbent is None:
        return []
    if interview.known.none_safe:
        return [NONE_SAFE]
    outlook, found = interview.known.outlook, interview.known.findings
    said = [] if outlook is None else [outlook.unbeaten]
    if found is not None and found.concluded and found.explained:
        scenario, run = interview.scenario, interview.past.experiment
        said += [
            name_wishes(found, scenario, interview.known.index),
            carried_by(found.decisive),
            rival(found, scenario, run),
        ]
    # If an answer speaks against the result, `unbeaten` says so.
    return [*filter(None, said)] or ["No experiment that was compared is better by what was answered."]


def held(interview: Interview) -> list[str]:
    """Return how the result of a robust study holds, a sentence each; empty for other studies."""
    found = interview.known.findings
    known = None if found is None or not found.concluded else found.robustness
    nominal = interview.known.nominal(interview.now().incumbent)
    return [] if known is None else list(robust(known, interview.scenario, nominal))


def _gain(interview: Interview, best: int, now: Now, seen: Seen, report: Path | None) -> dict[str, Any]:
    both = interview.past.experiment(0), interview.past.experiment(best)
    scenario, noise = interview.scenario, Told.read(report).noise
    held = runs_held(interview.known.findings)
    rows = gained(*both, scenario.shown_kpis, seen.look(interview).spread, held, noise=noise)
    before = theta_view(scenario.space, both[0], exact=True)
    found = gain_view(baseline_of(now.state), best, rows, before)
    return {**found, "noise": tell_noise(rows, noise), "curves": curves_of_both(*both, scenario)}


def curves_of_both(before: Experiment, after: Experiment, scenario: Scenario) -> dict[str, Any] | None:
    """Return the result (left) over the baseline (right), as a question has its sides; None if alike.

    There is one panel of the response that differs most, where several maneuvers ran in the one in which
    it does, and one of the input that moves for it. Both have axes of their own and all the time in
    which things happen.
    """
    pair = question.pair_view(after, before, partial(panels_of, scenario), (), Seen())
    part = max((pair, *pair["others"]), key=lambda part: (part["differ"] or {"size": 0.0})["size"])
    if part["differ"] is None:
        return None
    inputs = [i for i, panel in enumerate(part["panels"]) if panel["shape"] == "step"]
    shown = list(dict.fromkeys([part["differ"]["panel"], *inputs[:1]]))
    return {
        "maneuver": part["maneuver"],
        "time_unit": after.channels.time_unit,
        "panels": [part["panels"][i] for i in shown],
        "axes": {
            "x": [part["windows"][0][0], part["windows"][-1][1]],
            "y": [part["axes"]["y"][i] for i in shown],
        },
        "windows": [],
        **{
            side: {
                name: [part[side][name][i] for i in shown]
                for name in ("curves", "references", "limits", "stories")
            }
            for side in ("left", "right")
        },
    }


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
    kinds = {"better": "words yes", "worse": "words no", WITHIN_NOISE: "words", "": ""}
    lines = [
        question.row(
            row["title"],
            [
                question.cell(row["before"]),
                question.cell(row["after"], row["met"], "best"),
                question.cell(row["change"]),
                question.cell(row["verdict"], kind=kinds[row["verdict"]]),
            ],
            unit=row["unit"],
            aim=row["objective"],
            about=row["about"],
        )
        for row in rows
    ]
    heads = ("", f"{baseline} (1)", f"best ({best + 1})", "change", "")
    caption = "What gained most first, then what that cost. ✓ meets the objective, ✗ does not."
    return {
        "title": f"What was gained over the {baseline}",
        "none": f"No experiment was better than the {baseline}: experiment {best + 1} is still the best.",
        "same": best == 0,
        "headline": _headline(rows) if best else "",
        "table": question.table("What was gained", heads, lines, caption),
        "first": count_first(rows),
        "before": before if best and can_go_back(baseline) else [],
        "back": f"To go back, set the values of the {baseline}; best.json has them, too.",
    }


def _headline(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the largest gain in words; "" without one."""
    for row in (each for each in rows if each["verdict"] == "better"):
        change = with_unit(f"{row['before']} → {row['after']}", row["unit"])
        return f"{row['title'][:1].upper()}{row['title'][1:]}: {change}"
    return ""


_GAINS = 3  # largest gains that are shown before what they cost


def count_first(rows: Sequence[Mapping[str, Any]]) -> int:
    """Return how many rows of `gained` are shown before all others: the largest gains, and all they cost."""
    verdicts = [row["verdict"] for row in rows]
    return min(verdicts.count("better"), _GAINS) + verdicts.count("worse") or min(len(rows), _GAINS)


def runs_held(found: Findings | None) -> tuple[int, int] | None:
    """Return in how many of `ENOUGH` varied runs the baseline and the result hold, if that was asked."""
    known = None if found is None else found.robustness
    return None if known is None or known.first is None else (known.first, known.kept)


def gained(
    before: Experiment,
    after: Experiment,
    kpis: Sequence[KPI],
    spread: Spread,
    held: tuple[int, int] | None = None,
    noise: Redrawn | str = "",
) -> list[dict[str, Any]]:
    """Return a row for each KPI before and after: the largest gains, all that they cost, then the others.

    Among each, an objective that is met only before or only after comes first. Otherwise a change
    is large if it is so in the study and beside the value itself: people know by how many percent
    a KPI changed, and not what is usual. Unmeasured KPIs come last.

    The only comparison of the result with what was before: page, terminal, report and acceptance
    sheet show these rows in this order. `change` is empty if a value is missing or infinite, or both
    meet their target alike; `verdict` is "better", "worse", or empty without a goal and for a slight
    change, unless that decides whether the objective is met; what changes its sign with other draws of
    the noise is neither, but `WITHIN_NOISE`.

    Args:
        before: Experiment of the baseline.
        after: Best experiment.
        kpis: KPIs to show.
        spread: What is usual in the study.
        held: What `runs_held` returns, which comes before all.
        noise: KPIs with other draws of the sensor noise; a text if they are not known.
    """
    unsteady = {} if isinstance(noise, str) else noise.unsteady
    rows = [row for row in compare(before, after, kpis, spread) if row["group"] in ("", WORST)]
    rows.sort(key=lambda row: (row["left"]["met"] == row["right"]["met"], -row["change"]))
    found = [_row(row, unsteady) for row in rows]
    better, worse = ([row for row in found if row["verdict"] == v] for v in ("better", "worse"))
    alike = [row for row in found if row["verdict"] in ("", WITHIN_NOISE)]
    found = [*better[:_GAINS], *worse, *better[_GAINS:], *alike]
    missing = [kpi for kpi in kpis if not {kpi.name} & {*before.kpis, *after.kpis}]
    first = [] if held is None else [_held_row(*held)]
    return [*first, *found, *(_row(row, {}) for row in unmeasured(before, after, missing))]


WITHIN_NOISE = "within noise"
"""Verdict of a change that is better with some draws of the sensor noise, and worse with others."""


def tell_noise(rows: Sequence[Mapping[str, Any]], noise: Redrawn | str) -> str:
    """Return what of `gained` holds with other draws of the sensor noise, in sentences; "" without noise."""
    if not noise:
        return ""
    first = "All experiments share one draw of the sensor noise."
    if isinstance(noise, str):
        return f"{first} Others were not tried at the end of the study: {noise}."
    changed = any(row["verdict"] for row in rows) and any(len(row) > 3 for row in noise.rows)
    within = [f"{r['title']} ({noise.unsteady[r['title']]})" for r in rows if r["verdict"] == WITHIN_NOISE]
    draws = f"{DRAWS} others"
    if noise.lacking:
        first, draws = f"The runs that were compared are without {noise.lacking}.", f"{DRAWS} draws of it"
    said = f" Of {draws}, at least {STEADY} confirm each “better” and “worse” that is measured in a run."
    but = f" Within the noise: {join_words(within)}." if within else ""
    return " ".join([f"{first}{said}{but}" if changed else first, *map(sentence, noise.remarks)])


def _held_row(before: int, after: int) -> dict[str, Any]:
    more = after - before
    return {
        "title": f"varied runs that hold, of {ENOUGH}",
        "about": "How many runs with varied plants keep the limits that the run as modeled keeps",
        "unit": "",
        "objective": "",
        "before": f"{before}",
        "after": f"{after}",
        "met": None,
        "change": f"{more:+d}".replace("-", "−") if more else "no change",
        "verdict": "" if abs(more) < _SLIGHT * ENOUGH else "better" if more > 0 else "worse",
    }


def _row(row: dict[str, Any], unsteady: Collection[str]) -> dict[str, Any]:
    verdicts = {"left": "worse", "right": "better", None: ""}
    before, after = row["left"], row["right"]
    same = "no change" if before["text"] == after["text"] != MISSING else ""
    verdict = verdicts[row["better"]] if row["size"] >= _SLIGHT or before["met"] != after["met"] else ""
    return {
        **{name: row[name] for name in ("title", "about", "unit", "objective")},
        "before": before["text"],
        "after": after["text"],
        "met": after["met"],
        "change": row["difference"] or same,
        "verdict": WITHIN_NOISE if verdict and row["title"] in unsteady else verdict,
    }


def pid_rows(
    space: KnobSpace, best: Mapping[str, Any], before: Mapping[str, Any], time_unit: str
) -> list[tuple[PIDParameter, str, str]]:
    """Return each parameter of a tuned PID in each form, with its best value and that before.

    A dash stands for what only the other of the two has, such as the tracking time of a PI.

    Args:
        space: Knobs of the study.
        best: Settings of the best controller; for other controllers than PIDs there are no rows.
        before: Settings of the one before.
        time_unit: Unit of time.
    """
    knobs = {knob.name: knob for knob in space}
    units = {name: knob.unit for name, knob in knobs.items()}

    def text(p: PIDParameter) -> str:
        knob = knobs.get(p.name.partition(" ")[0])  # "b (set-point weight of K_p)"
        return number(p.value) if knob is None else exact_number(p.value)

    new, old = ({p.name: p for p in pid_forms(of, units, time_unit)} for of in (best, before))
    if not new:
        return []
    told = [{name: text(p) for name, p in forms.items()} for forms in (new, old)]
    every = new | {name: p for name, p in old.items() if name not in new}
    return [(p, told[0].get(name, MISSING), told[1].get(name, MISSING)) for name, p in every.items()]


def pid_table(rows: Sequence[tuple[PIDParameter, str, str]], baseline: str) -> dict[str, Any] | None:
    """Return what `pid_rows` returns as a table; None for other controllers than PIDs."""
    if not rows:
        return None
    lines = [
        question.row(
            p.name,
            (question.cell(p.form, kind="words"), question.cell(new, kind="best"), question.cell(old)),
            unit=p.unit,
        )
        for p, new, old in rows
    ]
    gains, series = rows[0][1:], [texts for p, *texts in rows if p.form == SERIES]
    # Without a gain there is no PID, whose forms are not known then.
    lacks = any(t == MISSING != gain for texts in series for t, gain in zip(texts, gains, strict=True))
    none = f" {MISSING}: {NO_SERIES}." if lacks else ""
    caption = (
        "ISA form: K_p (b r − y + 1/T_i ∫(r − y) dt + T_d d(c r − y)/dt). Of the error e = r − y, parallel: "
        f"{EQUATIONS[PARALLEL]}; series: {EQUATIONS[SERIES]}. {FILTERED} {ANTI_WINDUP}{none}"
    )
    caption += f" To go back, set the values of the {baseline}." if can_go_back(baseline) else ""
    return question.table("The PID in each form", ("", "form", "best", baseline), lines, caption)


def next_view(interview: Interview, report: Path | None) -> dict[str, Any]:
    """Return what can be done with the result."""
    file = None if report is None or not (report / "best.json").is_file() else report / "best.json"
    usable = interview.scenario.controller is not None and file is not None
    return {
        **_written(interview, file),
        "python": f"prefcal_app.load_controller({str(file)!r})" if usable else "",
        "download": None if file is None else "/report/best.json",
        "verifies": file is not None and interview.scenario.source.candidates is None,
        "outlook": outlook_view(interview.known.outlook),
    }


def _written(interview: Interview, best: Path | None) -> dict[str, Any]:
    """Return the PID of a best.json in each form, commands that write its controller as code, and margins."""
    nothing: dict[str, Any] = {"forms": None, "export": [], "margins": ""}
    if best is None:
        return nothing
    # The file has what the scenario says of its controller: a page never waits for somebody's function.
    try:
        content = json.loads(best.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):  # somebody edits it, or has moved it
        return nothing
    settings, before = _table(content, "settings"), _table(content, "before")
    time = str(_table(content, "channels").get("time_unit", ""))
    rows = pid_rows(interview.scenario.space, settings, _table(before, "settings"), time)
    commands = [
        {"command": shlex.join(["prefcal", "export", str(best), "--to", word]), "what": LANGUAGES[word]}
        for word in languages_of(settings)
    ]
    forms = pid_table(rows, str(before.get("what", "")))
    return {"forms": forms, "export": commands, "margins": margins_beside(best)}


NOMINAL = "nominal.json"
"""Name of the file of `Told` in the folder of a report."""


@dataclass(frozen=True, slots=True)
class Told:
    """What is told of the nominal loop beside a best.json, in words."""

    margins: tuple[str, ...] = ()  # margins, a text each
    # KPIs with other draws of the sensor noise, or why they are not known
    noise: Redrawn | str = field(default_factory=Redrawn)

    @classmethod
    def read(cls, folder: Path | None) -> "Told":
        """Return what is in a folder; nothing if there is none, or if somebody edits it."""
        with suppress(OSError, ValueError, RecursionError, StudyError):
            if folder is not None:
                content = json.loads((folder / NOMINAL).read_text("utf-8"))
                return from_plain(content, cls, StudyError, NOMINAL)
        return cls()


def margins_beside(best: Path) -> str:
    """Return the margins beside a best.json, as a sentence; "" if they are not known."""
    return tell_margins(Told.read(best.parent).margins)


def tell_margins(words: Sequence[str]) -> str:
    """Return margins in words, a text each, as a sentence; "" without any."""
    return f"Margins of the nominal loop: {'; '.join(words)}." if words else ""


def _table(content: Any, name: str) -> Mapping[str, Any]:
    found = content.get(name) if isinstance(content, Mapping) else None
    return found if isinstance(found, Mapping) else {}


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


# --- Try the result on the plant: old and new, or A and B if it is hidden which is which.


def trial_view(interview: Interview, now: Now) -> dict[str, Any] | None:
    """Return what is needed to try old and new, openly and blind; None if they cannot be tried.

    On a rig, θ is shown in a blind trial, too, since somebody has to enter it; KPIs and numbers are
    not. A live plant gets it from prefcal. The page does not draw `index`.
    """
    blind, live = tried_on_plant(now.state, now.incumbent), "try_on_plant" in now.can
    if blind is None or not (live or "keep_on_plant" in now.can):
        return None
    best = blind[0] or blind[1]
    baseline = baseline_of(now.state)

    def side(index: int, name: str, *, hidden: bool = False) -> dict[str, Any]:
        experiment = interview.past.experiment(index)
        shown = [] if hidden else theta_view(interview.scenario.space, experiment)
        return {"index": index, "name": name, "theta": [{**knob, "differs": False} for knob in shown]}

    return {
        "best": best,
        "open": [side(0, f"Old: {baseline} (experiment 1)"), side(best, f"New: experiment {best + 1}")],
        "blind": [side(index, name, hidden=live) for name, index in zip("AB", blind, strict=True)],
        "kept": kept_text(kept_on_plant(now.state)),
        "live": _on_live_plant(interview, now, best) if live else None,
    }


def _on_live_plant(interview: Interview, now: Now, best: int) -> dict[str, Any]:
    """Return how far a trial on a live plant is, and what it may write, which does not tell A from B."""
    tried = None if now.plant is None else now.plant.trial
    samples = now.state.history.samples
    changes = () if tried is None else tried.changes or ()
    both = [sorted(pair) for pair in zip(samples[0].theta, samples[best].theta, strict=True)]
    values = [" or ".join(dict.fromkeys(f"{value:.6g}" for value in pair)) for pair in both]
    return {
        "blind": tried is not None and tried.blind,
        "moves": tried is not None and tried.moves,
        "reads": tried is not None and not (tried.moves or changes or tried.problem),
        "wanted": None if tried is None else tried.wanted,
        "shown": None if tried is None else tried.shown,
        "problem": "" if tried is None else tried.problem,
        "changes": [
            {**question.change_view(each), "new": value} for each, value in zip(changes, values, strict=False)
        ],
    }
