"""Show a study in a terminal: its task, a question, answers, progress, and what a plant needs."""

from collections.abc import Iterable, Mapping
from math import isinf, isnan
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_app.session import Interview, Now, Question, Side
from prefcal_app.session.memory import trust_text
from prefcal_app.view import Seen, comparison_view
from prefcal_app.view.brief import current_tuning, how, knob_view, kpi_view
from prefcal_app.view.history import history_view
from prefcal_app.view.sides import theta_view
from prefcal_app.view.simulated import screening_view
from prefcal_app.view.status import in_words
from prefcal_env.knobs.space import KnobSpace
from prefcal_scenarios.presentation.wording import (
    INTERRUPTED,
    ended_text,
    labeled,
    printable,
    printable_lines,
    theta_text,
    with_unit,
)
from prefcal_scenarios.scenario import Scenario

NAMES = {"left": "LEFT", "right": "RIGHT"}
STYLES = {"left": "blue", "right": "dark_orange3"}
KEYS = (
    ("l", "left is better"),
    ("r", "right is better"),
    ("=", "about the same"),
    ("s", "can't tell"),
    ("z", "undo the last answer"),
    ("q, e", "mark left, right as unsafe or very bad"),
    ("a, d", "mark left, right as good enough"),
    ("c", "comment on the next answer"),
    ("b", "blind: hide θ and which experiment is the best so far"),
    ("h", "history"),
    ("w", "where are we"),
    ("t", "all KPIs of both sides, largest difference first, once more"),
    ("p", "ask me an earlier question again"),
    ("f, f", "finish the study"),
    ("x", "stop for now, and say how to go on"),
    ("?", "the task, and these answers"),
)
"""What can be answered, and what it means."""


def say(console: Console, *lines: str, style: str | None = None) -> None:
    """Print lines as they are, whatever is in them; long ones are not broken."""
    for line in lines:
        console.print(printable_lines(line), style=style, markup=False, highlight=False, soft_wrap=True)


def show_brief(interview: Interview, console: Console) -> None:
    """Print everything that a person should know before the first question."""
    show_scenario(interview.scenario, console)
    console.print(Text(how(interview)))
    if start := current_tuning(interview):
        console.print(Text(start))


def show_scenario(scenario: Scenario, console: Console) -> None:
    """Print a scenario's task, knobs and KPIs."""
    console.rule(Text(printable(scenario.title), style="bold"))
    if scenario.brief:
        console.print(Text(printable_lines(scenario.brief)))
    knobs = [knob_view(knob) for knob in scenario.space]
    kpis = [kpi_view(kpi) for kpi in scenario.shown_kpis]
    for title, rows in (
        ("Knobs", [(labeled(k["name"], k["unit"]), k["about"], k["range"]) for k in knobs]),
        ("KPIs", [(labeled(k["title"], k["unit"]), k["about"], k["wanted"]) for k in kpis]),
    ):
        table = Table(title=title, title_justify="left", title_style="bold", box=None, show_header=False)
        for name, about, wanted in (map(printable, row) for row in rows):
            table.add_row(Text(name, style="bold"), Text(about), Text(wanted, style="dim"))
        if rows:
            console.print(table)


def show_keys(console: Console) -> None:
    """Print what can be answered."""
    say(console, *(f"{key:<6}{words}" for key, words in KEYS))


def show_question(
    interview: Interview, now: Now, console: Console, *, blind: bool, seen: Seen | None = None
) -> None:
    """Print a table of the KPIs of both sides, one of θ, and how to answer."""
    question, scenario = now.question, interview.scenario
    assert question is not None
    seen = (Seen() if seen is None else seen).look(interview)
    console.rule(_headline(interview, question))
    if (told := screening_view(interview, now, blind=blind)) is not None:
        offer = f"{told['offer']} (f, and f again, finishes)" if told["offer"] else ""
        for line in filter(None, (told["why"], offer)):
            console.print(Text(printable(line)))
    for name, side in (("left", question.left), ("right", question.right)):
        console.print(Text(_title(name, side, blind=blind), style=STYLES[name]))
    if rows := comparison_view(question, scenario, seen):
        show_kpis(rows, console, NAMES)
    else:
        console.print("There are no KPIs to compare: the page draws the curves (no --terminal).")
    if not blind:
        _show_theta(question, scenario.space, console)
    say(console, "l left, r right, = same, s can't tell, z undo, ? help, x stop")


def _headline(interview: Interview, question: Question) -> str:
    if question.repeats is not None:
        return "An earlier question again (z skips it): which experiment is better?"
    head = interview.planned.place(over=False, further=question.further).capitalize()
    seen = ", two that you have seen" if question.further else ""
    return f"{head}{seen}: which experiment is better?"


def _title(name: str, side: Side, *, blind: bool) -> str:
    title = name.upper()
    if not blind:
        title += f" · experiment {side.index + 1}" + (f" · {side.role}" if side.role else "")
    if side.marks:
        title += f" · marked {', '.join(sorted(side.marks))}"
    if side.counts_as_unsafe:
        title += f" · {INTERRUPTED}"
    elif side.experiment.end.interrupted:
        title += f" · {ended_text(side.experiment)}"
    return title


def show_kpis(rows: Iterable[Mapping[str, Any]], console: Console, names: Mapping[str, str]) -> None:
    """Print the KPIs of two sides, as `comparison_view` returns them; the better one is bold.

    The title of each group, such as a maneuver, is on a line of its own.

    Args:
        rows: A row for each KPI.
        console: Where to print.
        names: Heading of each side, "left" and "right".
    """
    table = _side_by_side("KPI", names)
    table.add_column("right − left", justify="right")
    table.add_column("required")
    group = ""
    for row in rows:
        if row["group"] != group:
            group = row["group"]
            table.add_row(Text(printable(group), style="bold"))
        values = []
        for side in names:
            sign = {True: " ✓", False: " ✗", None: ""}[row[side]["met"]]
            text = with_unit(row[side]["text"], row["unit"]) + sign
            values.append(Text(text, style="bold" if row["better"] == side else ""))
        table.add_row(
            Text(printable(row["title"])),
            *values,
            row["difference"] or "–",
            Text(printable(row["objective"])),
        )
    console.print(table)


def _show_theta(question: Question, space: KnobSpace, console: Console) -> None:
    """Print θ of both sides; brackets, not only style, mark values that differ."""
    table = _side_by_side("θ", NAMES)
    left, right = (side.experiment for side in (question.left, question.right))
    for knobs in zip(theta_view(space, left, right), theta_view(space, right, left), strict=True):
        differs = knobs[0]["differs"]
        values = [with_unit(each["text"], each["unit"]) for each in knobs]
        texts = [
            Text(f"[{value}]", style="bold") if differs else Text(value, style="dim") for value in values
        ]
        table.add_row(Text(printable(knobs[0]["name"])), *texts)
    console.print(table)


def _side_by_side(heading: str, names: Mapping[str, str]) -> Table:
    """Return a table without lines, so that it reads well aloud and through a pipe."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(heading, overflow="fold")
    for side, name in names.items():
        table.add_column(Text(printable(name)), header_style=STYLES[side], justify="right")
    return table


def show_history(interview: Interview, console: Console) -> None:
    """Print every answer."""
    answers = history_view(interview)["answers"]
    if not answers:
        console.print("No answers yet.")
        return
    table = Table(title="History", title_justify="left")
    for heading in ("", "experiment", "against", "verdict", "marks", "comment"):
        table.add_column(heading, overflow="fold")
    for answer in answers:
        said = "retracted" if answer["retracted"] else "again" if answer["repeated"] else ""
        number = f"+{-answer['answer']}" if answer["further"] else str(answer["answer"])
        table.add_row(
            number,
            str(answer["challenger"]),
            str(answer["incumbent"]),
            answer["text"] + (f" ({said})" if said else ""),
            escape(", ".join(answer["marks"])),
            escape(printable(answer["comment"])),
        )
    console.print(table)


def show_status(interview: Interview, console: Console) -> None:
    """Print the best so far, the progress, and how consistent the answers are."""
    now, counts = interview.now(), interview.counts
    plural = "" if counts.comparisons == 1 else "s"
    say(
        console,
        f"{counts.experiments} of {interview.n_max} experiments, {counts.comparisons} comparison{plural}",
    )
    if now.simulated is not None:
        say(console, now.simulated.line)
    if now.incumbent is not None:
        best = theta_text(interview.scenario.space, interview.experiment(now.incumbent).theta)
        say(console, f"best so far, experiment {now.incumbent + 1}: {best}")
    say(console, in_words(interview.consistency))
    if (outlook := interview.outlook) is not None:
        say(console, *outlook.lines)
    if (index := interview.index) is not None:
        say(console, trust_text(index))


def show_next(interview: Interview, now: Now, console: Console) -> None:
    """Print the next θ of a rig, and what its record must contain."""
    source, sample = interview.scenario.source, now.pending
    assert sample is not None
    console.rule(f"Experiment {sample.index + 1}: run your plant with these values")
    for knob, value in zip(interview.scenario.space, np.array(sample.theta), strict=True):
        say(console, f"  {knob.name} = {with_unit(repr(float(value)), knob.unit)}", style="bold")
    if source.instructions:
        say(console, source.instructions)
    say(console, f"The record: a CSV file with the columns {', '.join(source.columns)}")


def show_changes(interview: Interview, now: Now, console: Console) -> None:
    """Print what would be written to a live plant: the old and the new value of each knob."""
    source, sample, live = interview.scenario.source, now.pending, now.live
    assert sample is not None
    assert live is not None
    console.rule(f"Experiment {sample.index + 1}: confirm what is written to the plant")
    for change in live.changes or ():
        rate = "" if isinf(change.rate) else f", at most {change.rate:g} per second"
        limits = f"limits {change.low:g} to {change.high:g}{rate}"
        new = with_unit(f"{change.new:.6g}", change.unit)
        old = "" if isnan(change.old) else f"{change.old:.6g} → "
        say(console, f"  {change.name}: {old}{new}   ({limits})", style="bold")
    recorded = "" if isinf(source.duration) else f"Then {source.duration:g} s are recorded. "
    say(
        console,
        f"{recorded}Afterward {source.afterward}; k and Enter stops the run.",
        *filter(None, (source.instructions, live.problem)),
    )
