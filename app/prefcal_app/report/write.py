"""Write the report: the page, the sheet to sign with what a verification says, and the folder."""

import json
import re
from base64 import b64encode
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from prefcal_app.session.study import why_over
from prefcal_app.summary import kept_text
from prefcal_app.view.end import FIRST, NOMINAL, Told, can_go_back, count_first, pid_table
from prefcal_app.view.question import cell, column, row, table, theta_view
from prefcal_env.controllers.forms import ALL, PARALLEL
from prefcal_env.controllers.margins import Margins
from prefcal_env.experiments.experiment import Channel, End, Experiment
from prefcal_env.plain import to_plain
from prefcal_env.plants.jacobians import U
from prefcal_env.sources.source import env_of, plant_of
from prefcal_scenarios.scenario import Picture, Scenario
from prefcal_scenarios.style import WIDTH, png, style
from prefcal_scenarios.verification.nominal import DRAWS, Redrawn, list_margins, margins_said
from prefcal_scenarios.verification.said import BEST, NOT_VARIED, USUAL, VARIED, Verified
from prefcal_scenarios.wording import (
    counted,
    exact_number,
    number,
    put,
    sentence,
    symbols_in,
    with_subscripts,
    with_unit,
)

from .export import NOT_VERIFIED, REBUILD, best_as_json, model, verified_beside, versions
from .pictures import PICTURES, Drawn, best_against, draw, open_loop
from .record import (
    StudyRecord,
    comparison_table,
    comparisons_as_csv,
    controller_text,
    experiment_table,
    foremost,
    gain_of,
    gain_rows,
    pid_forms_of,
    pid_text,
    result_table,
)

# --- Write report.html, a single self-contained file.


@cache
def environment(*packages: str) -> Environment:
    """Return the template environment, which escapes all values but `Markup`.

    Args:
        packages: Packages with further templates.
    """
    made = Environment(
        loader=ChoiceLoader([PackageLoader(each, ".") for each in ("prefcal_app", *packages)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters |= {"subscripts": with_subscripts, "symbols": symbols_in, "data_uri": data_uri}
    made.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "sort_keys": True}
    css = files("prefcal_app.report").joinpath("report.css").read_text(encoding="utf-8")
    made.globals["css"] = Markup(css)
    return made


REPORT = "report.html"
"""Name of the file of the report."""


def page(
    record: StudyRecord, drawn: Sequence[Drawn], verified: Verified | str = "", loop: bytes = b""
) -> str:
    """Return the text of report.html, with what was verified and the open loop as for `sheet`."""
    view: dict[str, Any] = {"lead": lead(record), "rebuild": REBUILD, "origin": record.origin}
    view |= {"kept": kept_text(record.kept), "why_over": why_over(record.ended)}
    if record.best is not None:
        view["origin"] |= {"model": model(record)}
        view |= {
            "theta": theta_view(record.scenario.space, record.best.experiment, exact=True),
            "pid": pid_table(pid_forms_of(record), record.baseline),
            "experiments": experiment_table(record),
            "gain": gain_of(record),
            "result": result_table(record),
            "verdict": _top_of(record, verified),
            "verified": Markup(_in_report(verified, loop, record)),
        }
    if record.asked and not record.scored:
        view["comparisons"] = comparison_table(record)
    template = environment().get_template("report/report.html.j2")
    return template.render(record=record, drawn=drawn, versions=versions(), **view)


def data_uri(content: bytes) -> str:
    """Return a data URI with the PNG `content`."""
    return f"data:image/png;base64,{b64encode(content).decode('ascii')}"


def lead(record: StudyRecord) -> str:
    """Return what the study consists of, as a sentence without its period."""
    tried = counted(len(record.trials), "experiment")
    if record.scored:
        return f"Calibrated by its score, without comparisons: {tried}"
    verdicts = ", ".join(f"{words} {n}" for words, n in record.verdict_counts().items())
    return f"Calibrated by preferences: {tried}, {counted(record.questions, 'comparison')} ({verdicts})"


# --- Answer, on the acceptance sheet, what a colleague asks who has to answer for the tuning, too.

FILE = "acceptance.html"
"""Name of the file of the sheet."""
_PART = re.compile(r"<!-- verified -->.*?<!-- end -->", re.DOTALL)
"""The part of the sheet or report that a verification changes."""
_TOP = re.compile(r"<!-- verdict -->.*?<!-- end -->", re.DOTALL)
"""The verdict, above the tables of the sheet and the report."""
_UNKNOWN = "not verified"
_RUN = (
    f"{_UNKNOWN}: how it does if gains, dead times, noise, loads and set points all differ from the model. "
    "Run prefcal verify best.json, which completes this page."
)
_BRIEF = 214  # most characters of what an experiment is: two lines
NOISE_ALONE = f"KPIs with {DRAWS} draws of the sensor noise, and nothing else varied"
"""Label of the table of `Redrawn`."""
LOOP = "open_loop.png"
"""Name of the picture from which margins are read."""
_LOOP_ALT = "Nyquist diagram of the open loop, before and after, with the margins that it shows"

Required = Sequence[tuple[str, str, bool | None]]
"""Title, limits and whether they are kept, of KPIs that only a verification limits, see `Verified`."""
Answers = list[tuple[str, str | tuple[str, ...] | dict[str, str]]]
"""Questions, in a few words, each with its answer: a text, a list, which is set small, or lines to copy."""


def answers(record: StudyRecord) -> Answers:
    """Return what is asked about the study: who and how, why this tuning, its form, and the way back."""
    by = record.origin.get("answered by", "a score")
    counts = ", ".join(f"{words} {n}" for words, n in record.verdict_counts().items() if n)
    each = f" ({counts}; each one in comparisons.csv)" if record.questions else ""
    partial = "; the study is not complete" if record.partial else ""
    digest = f" SHA-256 of the study file: {record.digest}." if record.digest else ""
    said = record.outlook
    promise, unbeaten, told = ("", "", ()) if said is None else (said.promise, said.unbeaten, said.result)
    more = [] if said is None else [said.ends, said.command, said.more]
    only = "only where candidates are simulated, at the end of a study"
    found = {
        "Who answered": f"{counted(len(record.trials), 'experiment')}, "
        f"{counted(record.questions, 'comparison')} by {by}{each}{partial}.{digest}",
        "On which model": model(record),
        "Experiment": " ".join(filter(None, (_shorten_brief(record.scenario.brief), _say_noise(record)))),
        "Left to gain": " ".join(filter(None, (promise, record.trust, *more)))
        if promise
        else f"Not stated: {'the study was left before its end' if record.partial else only}.",
        "Why this one": " ".join(
            filter(None, (unbeaten, *(each for each in told if each not in record.robust)))
        )
        or "It is the best by the answers, each of which is in comparisons.csv.",
        "Robust study": " ".join(record.robust),
        "The PID": pid_text(record),
        "The controller": controller_text(record),
        "On the plant": kept_text(record.kept),
        "The way back": _back(record),
    }
    return [(question, answer) for question, answer in found.items() if answer]


def _shorten_brief(brief: str) -> str:
    """Return what an experiment is, by the first sentences of the brief: those that fit into two lines."""
    ends = [k for k in (m.end() for m in re.finditer(r"\.(?=\s|$)", brief)) if k <= _BRIEF]
    return brief[: ends[-1]] if ends else ""


def _say_noise(record: StudyRecord) -> str:
    """Return that all experiments have the same draw of the sensor noise; "" without noise."""
    noise = record.noise
    if not noise or (isinstance(noise, Redrawn) and noise.lacking):
        return ""
    seed = record.settings.get("seed", 0)
    return f"All experiments have the same draw of the sensor noise (seed {seed}), see Other noise."


def _back(record: StudyRecord) -> str:
    before, after, name = record.before.number, record.result.number, record.baseline
    said = f"Before: {name} (experiment {before}). After: experiment {after}."
    if before == after:
        said += f" No experiment beat the {name}." if record.questions else " Nothing was compared."
    if name == FIRST:
        return f"{said} It was chosen by prefcal: the tuning in use was not given (--start)."
    if not can_go_back(name):
        return f"{said} Whether the {name} was in use is not known."
    return f"{said} To go back, set the parameters of the column “{name}”; best.json has them, too."


def unverified(record: StudyRecord, why: str = "") -> Answers:
    """Return what is asked about margins and other plants before anything is verified, and why."""
    said = margins_said(record.margins, record.before.experiment.channels.time_unit)
    known = record.noise
    other: str | tuple[str, ...] = f"{_UNKNOWN}: {known}" if isinstance(known, str) else known.texts
    found: Answers = [("Other plants", f"{_RUN} {why}." if why else _RUN), ("Margins", _margins(*said))]
    return [*found, ("Other noise", other)] if known else found


def _verdicts(verified: Verified) -> dict[str, str | dict[str, str]]:
    """Return what the verdict rests on, the worst run, and what hurts most."""
    found: dict[str, str | dict[str, str]] = {"Other plants": f"{verified.statement} {verified.limits_kept}"}
    if verified.lines:
        found["Usual limits"] = {"lines": "\n".join(verified.lines)}
    found["Margins"] = sentence(verified.basis)
    if verified.misses:
        found["Misses"] = " ".join(map(sentence, verified.misses))
    for worst in verified.worst[:1]:
        found["Worst run"] = f"{worst.words}{f' ({worst.verdict})' if worst.verdict else ''}: {worst.text}."
    found["Hurts most"] = "; ".join(verified.hurting) or _UNKNOWN
    return found


def verified_answers(verified: Verified) -> Answers:
    """Return what was verified, what varied, and what nobody looked at, in words for the sheet."""
    margins = _margins(verified.margins, verified.basis)
    found: Answers = [*{**_verdicts(verified), "Margins": margins}.items()]
    if verified.runs:
        spans = tuple(f"{name}: {low} to {high}" for name, _, _, low, high, *_ in verified.kpis)
        found.append(("KPIs, 5 to 95 %", (*spans, *filter(None, [verified.outside]))))
    if verified.noise:
        found.append(("Other noise", verified.noise.texts))
    rows = (f"{name} {span}{f' ({kind})' * (kind != USUAL)}" for name, span, kind in verified.varied)
    drawn = [f"drawn with seed {verified.seed}"] if verified.runs else []
    found.append(("Varied", (*rows, *drawn, f"beyond these ranges: {_UNKNOWN}")))
    return [*found, ("Not varied", tuple(f"{what} ({why})" for what, why in verified.left_out))]


def verdict_of(record: StudyRecord, verified: Verified | str = "") -> str:
    """Return the verdict above the tables of the sheet, of a study and what was verified of it."""
    if isinstance(verified, Verified):
        return verified.verdict
    own = record.result.experiment
    missed = [kpi for kpi in record.kpis if kpi.met(0.0) is not None and kpi.met_by(own) is False]
    runs, margins = (", ".join(k.title for k in missed if k.margin == each) for each in (False, True))
    lost = f"Does not hold: {runs}, required of the experiment itself, not kept. " if runs else ""
    if own.end in (End.UNSAFE, End.FAILED):
        lost = f"Does not hold: the experiment itself ended early: {own.end.value}. "
    lost += "The loop is not stable. " if any(kpi.unstable(own) for kpi in record.kpis) else ""
    lost += f"Margins not kept: {margins}. " if margins else ""
    return f"{lost}{NOT_VERIFIED} {verified}.".removesuffix(" .")


def top(verdict: str, advice: Sequence[str] = ()) -> str:
    """Return the verdict and what to do next, which stand above the tables of sheet and report, as HTML."""
    first, *rest = re.split(r"(?<=\.) (?=[A-Z])", verdict, maxsplit=1)
    made = f'<p class="verdict"><strong>{symbols_in(first)}</strong> {symbols_in("".join(rest))}</p>'
    if advice:
        said = '</p><p class="verdict">'.join(symbols_in(sentence(each)) for each in advice)
        made += f'<p class="verdict"><strong>What next:</strong> {said}</p>'
    return f"<!-- verdict -->{made}<!-- end -->"


def _top_of(record: StudyRecord, verified: Verified | str) -> Markup:
    advice = verified.advice if isinstance(verified, Verified) else ()
    return Markup(top(verdict_of(record, verified), advice))


def verified_tables(verified: Verified) -> dict[str, list[dict[str, Any]]]:
    """Return tables of what `varied` and what not, and of margins and KPIs (`tables`), without empty ones."""

    def made(
        label: str, heads: Sequence[str], rows: Sequence[Sequence[str]], kind: str = "", note: str = ""
    ) -> list[dict[str, Any]]:
        if not rows:
            return []
        shown = [row(name, [cell(each, kind=kind) for each in cells], kind=kind) for name, *cells in rows]
        return [table(label, [column(head, kind=kind) for head in heads], shown, note)]

    varied = made("What varied", VARIED, verified.varied, "words")
    varied += made("What was not varied, and why", NOT_VARIED, verified.left_out, "words")
    found = made("Stability margins", verified.margin_columns, verified.margins)
    found += made("KPIs of the varied plants", verified.kpi_columns, verified.kpis, note=verified.outside)
    remarks = " ".join(map(sentence, verified.noise.remarks))
    found += made(NOISE_ALONE, verified.noise_columns, verified.noise.rows, note=remarks)
    return {"varied": varied, "tables": found}


def _in_report(verified: Verified | str, loop: bytes, record: StudyRecord | None = None) -> str:
    """Return the part of the report that a verification changes, as HTML; without one, as on the sheet."""
    parts: Any
    tables: Any
    parts, tables = (environment().get_template(f"report/{n}.html.j2").module for n in ("parts", "tables"))
    if not isinstance(verified, Verified):
        made = parts.answers(unverified(record, verified) if record else [])
    else:
        each = (t for group in verified_tables(verified).values() for t in group)
        made = parts.answers([*_verdicts(verified).items()]) + Markup().join(map(tables.table, each))
    drawn = parts.image("Open loop", data_uri(loop), _LOOP_ALT) if loop else ""
    return f"<!-- verified -->{made}{drawn}<!-- end -->"


def _margins(rows: Sequence[Sequence[str]], basis: str) -> str | tuple[str, ...]:
    """Return margins with those before in brackets, if they are known, and what they hold for."""
    return (*list_margins(rows), basis) if rows else f"{_UNKNOWN}: {basis}"


def section(holds: Answers, loop: bytes = b"") -> str:
    """Return the part of the sheet that a verification changes, as HTML."""
    template: Any = environment().get_template("report/parts.html.j2").module
    drawn = f'<figure class="loop"><img src="{data_uri(loop)}" alt="{_LOOP_ALT}"></figure>' if loop else ""
    return f"<!-- verified -->{template.answers(holds)}{drawn}<!-- end -->"


def refresh(folder: Path) -> None:
    """Write what is verified of the best.json in a folder on the sheet and the report there, if they are.

    Raises:
        ScenarioError: If verification.json cannot be read.
        OSError: If one cannot be written.
    """
    verified = Verified.read(folder)
    if verified is None:
        return
    loop = _drawn_in(folder)
    verdict = top(verified.verdict, verified.advice)
    _renew(folder / FILE, section(verified_answers(verified), loop), verdict, verified.required)
    _renew(folder / REPORT, _in_report(verified, loop), verdict)


def _drawn_in(folder: Path) -> bytes:
    """Return the picture of the open loop in a folder; empty if there is none."""
    return (folder / LOOP).read_bytes() if (folder / LOOP).is_file() else b""


def _renew(path: Path, made: str, verdict: str, required: Required = ()) -> None:
    """Write the parts of a file anew that a verification changes."""
    if path.is_file():
        text = _TOP.sub(lambda _: verdict, path.read_text(encoding="utf-8"), count=1)
        put(path, _require(_PART.sub(lambda _: made, text, count=1), required).encode())


# --- Fill in the acceptance sheet of a study: before and after on one or two pages, with lines to sign.

_MOST_ROWS, _LIMITS = 16, 4  # largest number of knobs, and of KPIs with limits; how many of them are limits
_HIGH, _BESIDE, _INCH, _PANELS = (62.0, 80.0), 112.0, 25.4, 3
"""Height of curves beside the open loop and alone, width beside it, an inch, in mm; most panels."""
_KPI = ("title", "objective", "before", "after", "unit", "met")  # what the sheet says of a KPI
_NEAR = 1e-6  # share of its size by which a value may miss a limit and still count as being at it


def sheet(record: StudyRecord, verified: Verified | str = "", loop: bytes = b"") -> str:
    """Return the text of the sheet, which prints on one or two A4 or Letter pages.

    Args:
        record: Record of the study.
        verified: What was verified of the result, or why that is not known; empty if nothing was.
        loop: Picture of the open loop; empty if there is none.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    if isinstance(verified, Verified):
        holds, required = verified_answers(verified), verified.required
    else:
        holds, required = unverified(record, verified), ()
    # What is not verified yet will add the open loop beside the curves.
    narrow = loop or plant_of(record.scenario.source) is not None
    size = (_HIGH[0], _BESIDE) if narrow else (_HIGH[1], WIDTH * _INCH)
    picture = _curves(record, *size)
    template = environment().get_template("report/acceptance.html.j2")
    made = template.render(
        record=record,
        sheet=sheet_of(record),
        verdict=_top_of(record, verified),
        holds=Markup(section(holds, loop)),
        curves=picture and data_uri(picture),
    )
    return _require(made, required)


_NOT_REQUIRED = re.compile(
    r'<th scope="row">(.*?)</th><td>(?:–|[^<]* \(verify\))</td>'
    r'(<td>.*?</td><td class="best">.*)<td[^>]*>.*</td></tr>'
)
"""Row of the sheet's table of a KPI that the study does not limit: its title, and the cells of values."""


def _require(text: str, required: Required) -> str:
    """Return a sheet whose table of KPIs has the limits that only its verification has, see `Verified`."""
    stated = {str(with_subscripts(title)): (f"{limits} (verify)", met) for title, limits, met in required}

    def renew(row: re.Match[str]) -> str:
        limits, met = stated.get(row[1], ("–", None))
        words, kind = _MET[met]
        last = f'<td class="{kind}">{words}' if kind else f"<td>{words}"
        return f'<th scope="row">{row[1]}</th><td>{limits}</td>{row[2]}{last}</td></tr>'

    return _NOT_REQUIRED.sub(renew, text)


def sheet_of(record: StudyRecord) -> dict[str, Any]:
    """Return the content of the sheet of a study with a completed experiment.

    Returns:
        `of`: name and dates of the study, which follow "Acceptance sheet"; `answers`: what is asked;
        `knobs`: table of the knobs, and of a PID in its parallel form; `kpis`: table of the KPIs,
        what decided first, of limits kept, and how the runs ended; `more_knobs`, `more_kpis`:
        numbers of those that are beyond the most rows.
    """
    before, after = record.before, record.result
    gains = gain_rows(record)
    knobs, kpis = list(_knobs(record)), [_row(*(kpi[name] for name in _KPI)) for kpi in gains]
    decided = kpis[: count_first(gains)]  # what is left out last, with limits
    kept = limits_kept(before.experiment, after.experiment, resting(record.scenario))
    limits = list(kept)[:_LIMITS]
    limits.append(_row("run ended", "", before.experiment.end.value, after.experiment.end.value))
    shown = foremost(
        kpis, _MOST_ROWS - len(limits), lambda kpi: kpi in decided or kpi["cells"][0]["text"] != "–"
    )
    heads = [record.baseline, f"experiment {after.number}", "unit"]
    rows, columns = [*shown, *limits], ["KPI", "required", *heads, "met"]
    when = record.origin.get("when (UTC)")
    return {
        "of": f"{f' of study {record.study}' if record.study else ''}{f', {when} (UTC)' if when else ''}",
        "knobs": table(
            "Controller parameters", ["parameter", *heads, "range"], knobs[:_MOST_ROWS], kind="sheet"
        ),
        "kpis": table("Key performance indicators", columns, rows, kind="sheet"),
        "more_knobs": len(knobs[_MOST_ROWS:]),
        "more_kpis": len(kpis) - len(shown),
        "answers": answers(record),
    }


_MET = {True: ("yes", "yes"), False: ("NO", "no"), None: ("–", "")}
"""Word and kind of the last cell in the table of KPIs."""


def _row(
    name: str, limits: str, before: str, after: str, unit: str = "", met: bool | None = None
) -> dict[str, Any]:
    """Return a line of the table of KPIs."""
    verdict, kind = _MET[met]
    new = cell(after, kind="best")
    return row(name, [cell(limits or "–"), cell(before), new, cell(unit), cell(verdict, kind=kind)])


def _knobs(record: StudyRecord) -> Iterator[dict[str, Any]]:
    """Yield a line for each knob, then the gains of a PID in its parallel form."""
    before, after = record.before.experiment, record.result.experiment
    lines = [
        (
            knob.name,
            f"{number(knob.low)} to {number(knob.high)}",
            *(exact_number(float(e.theta[i])) for e in (before, after)),
            knob.unit,
        )
        for i, knob in enumerate(record.scenario.space)
    ]
    lines += [
        (p.name, p.derived, old, new, p.unit)
        for p, new, old in pid_forms_of(record)
        if p.derived and p.form in (PARALLEL, ALL)
    ]
    for name, limits, old, new, unit in lines:
        yield row(name, [cell(old), cell(new, kind="best"), cell(unit), cell(limits)])


def resting(scenario: Scenario) -> U | None:
    """Return the inputs before the first move, shape (n_u,); None if a scenario does not say them."""
    return getattr(getattr(env_of(scenario.source), "task", None), "u0", None)


def limits_kept(before: Experiment, after: Experiment, u0: U | None = None) -> Iterator[dict[str, Any]]:
    """Yield a line for each input and output with limits, how long it was there, and for each input's moves.

    An input saturates at a limit. An output is outside beyond one. Both are shares of the time;
    several runs of an experiment (maneuvers, variants) count together. The first move starts at the
    inputs `u0`, shape (n_u,); if they are not known, it does not count, and the line says so.
    """
    named = [(True, i, c) for i, c in enumerate(after.channels.y)]
    named = [(False, i, c) for i, c in enumerate(after.channels.u)] + named
    for output, i, channel in named:
        if limits := _limits(channel):
            old, new = (_share(e, i, channel, output=output) for e in (before, after))
            what = "outside its limits" if output else "saturated"
            yield _row(f"{channel.name} {what}", limits, old, new)
    for i, channel in enumerate(after.channels.u):
        start, said = ([], " after the first") if u0 is None else ([float(u0[i])], "")
        old, new = (number(_largest_move(e, i, start)) for e in (before, after))
        yield _row(f"{channel.name}, largest step between samples{said}", "", old, new, channel.unit)


def _largest_move(experiment: Experiment, i: int, start: list[float]) -> float:
    """Return the largest change of an input from one instant to the next; NaN if it was not recorded.

    It begins with that from `start`, one number, or none to leave that out.
    """
    runs = [run for run in experiment.runs or (experiment,) if len(run.t) > 1]
    moves = [np.abs(np.diff(run.u[:, i], prepend=start)) for run in runs]
    return max((float(each.max()) for each in moves), default=np.nan)


def _limits(channel: Channel) -> str:
    """Return the limits as text; empty without any."""
    low, high = np.isfinite(channel.low), np.isfinite(channel.high)
    if low and high:
        return with_unit(f"{number(channel.low)} to {number(channel.high)}", channel.unit)
    if low or high:
        sign, limit = ("≥", channel.low) if low else ("≤", channel.high)
        return f"{sign} {with_unit(number(limit), channel.unit)}"
    return ""


def _share(experiment: Experiment, i: int, channel: Channel, *, output: bool) -> str:
    """Return the share of the time as text; a dash if the signal was not recorded."""
    there = total = 0.0
    for run in experiment.runs or (experiment,):
        values = run.output(i) if output else run.u[:, i] if len(run.t) else None
        if values is None or len(run.t) < 2:
            continue
        steps = np.diff(run.t)  # values are held until the next instant
        there += float(steps[_is_there(values[:-1], channel, output=output)].sum())
        total += float(steps.sum())
    if not total:
        return "–"
    if not there:
        return "never"
    percent = 100 * there / total
    return f"{number(round(percent, 1))} % of the time" if percent >= 0.05 else "< 0.1 % of the time"


def _is_there(values: Float[np.ndarray, " K"], channel: Channel, *, output: bool) -> Bool[np.ndarray, " K"]:
    """Return where an input is at a limit, or an output beyond one."""
    ends = [limit for limit in (channel.low, channel.high) if np.isfinite(limit)]
    near = _NEAR * max(map(abs, (*ends, 1e-300)))
    margin = near if output else -near
    outside: Bool[np.ndarray, " K"] = (values < channel.low - margin) | (values > channel.high + margin)
    return outside


def _curves(record: StudyRecord, height: float, width: float) -> bytes:
    """Return a PNG of the curves, `height` by `width` mm; empty if neither run has a record.

    Raises:
        ScenarioError: If a panel of the scenario does not exist in an experiment.
    """
    most, wide = height / _INCH, width / _INCH
    with style():
        drawn = best_against(record, references=False, panels=_PANELS, most=most, width=wide)
        return b"" if drawn is None else png(drawn)


# --- Write the folder of a report; every file appears whole or not at all.


def write_report(record: StudyRecord, folder: Path, extra: Sequence[Picture] = ()) -> Path:
    """Write the report's files into `folder`; return the path of report.html.

    Equal studies give equal bytes. Files of an earlier report in `folder` are replaced.

    Args:
        record: Record of the study, complete or not.
        folder: Existing folder.
        extra: Additional figures of the scenario.
    """
    if record.best is not None:
        put(folder / BEST, best_as_json(record).encode())
    else:
        for file in (BEST, FILE, LOOP, NOMINAL):
            (folder / file).unlink(missing_ok=True)
    put(folder / "comparisons.csv", comparisons_as_csv(record).encode())
    drawn = draw(record, extra)
    for stale in {p.file for p in (*PICTURES, *extra)} - {d.picture.file for d in drawn}:
        (folder / stale).unlink(missing_ok=True)
    for d in drawn:
        put(folder / d.picture.file, d.content)
    verified: Verified | str = ""
    if record.best is not None:
        verified = verified_beside(folder / BEST)
        if not (isinstance(verified, Verified) and _drawn_in(folder)):
            keep_loop(folder, record.scenario, record.margins, record.noise)
        put(folder / FILE, sheet(record, verified, _drawn_in(folder)).encode())
    put(folder / REPORT, page(record, drawn, verified, _drawn_in(folder)).encode())
    return folder / REPORT


def keep_loop(folder: Path, scenario: Scenario, found: Sequence[Margins | str], noise: Redrawn | str) -> None:
    """Write what is told of the nominal loop and the picture of the open one into a folder, or remove them.

    They are no part of best.json, which stays the same to the byte whether they were there in time or not.
    """
    plant = plant_of(scenario.source)
    told = Told(list_margins(margins_said(found, plant.time_unit)[0]) if plant is not None else (), noise)
    if told != Told():
        put(folder / NOMINAL, f"{json.dumps(to_plain(told), ensure_ascii=False, indent=2)}\n".encode())
    else:
        (folder / NOMINAL).unlink(missing_ok=True)
    if plant is not None and (drawn := open_loop(found, scenario.kpis, plant)):
        put(folder / LOOP, drawn)
    else:
        (folder / LOOP).unlink(missing_ok=True)
