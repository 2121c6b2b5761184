"""Show a question in a terminal: two experiments as a table."""

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from prefcal_app.session import Interview, Now, Question, Side
from prefcal_app.view import Seen, comparison_view
from prefcal_app.view.simulated import screening_view
from prefcal_env.live import LiveRig
from prefcal_env.rig import Rig
from prefcal_scenarios.presentation.wording import (
    INTERRUPTED,
    ended_text,
    printable,
    with_unit,
)

from .pairs import STYLES, show_kpis, show_theta

NAMES = {"left": "LEFT", "right": "RIGHT"}
KEYS = (
    ("l", "left is better"), ("r", "right is better"),
    ("=", "about the same"), ("s", "can't tell"),
    ("z", "undo the last answer"),
    ("q, e", "mark left, right as unsafe or very bad"),
    ("a, d", "mark left, right as good enough"), ("c", "comment on the next answer"),
    ("b", "blind: hide θ and which experiment is the best so far"),
    ("h", "history"), ("w", "where are we"),
    ("t", "all KPIs of both sides, largest difference first, once more"),
    ("p", "ask me an earlier question again"), ("f, f", "finish the study"),
    ("x", "stop for now, and say how to go on"), ("?", "the task, and these answers"),
)  # fmt: skip
"""What can be answered, and what it means."""


def show_question(
    interview: Interview, now: Now, console: Console, *, blind: bool, seen: Seen | None = None
) -> None:
    """Print a table of the KPIs of both sides, one of θ, and how to answer."""
    question, scenario = now.question, interview.scenario
    assert question is not None
    seen = (Seen() if seen is None else seen).look(interview)
    console.rule(_headline(interview, question))
    if (told := _told(interview, now, blind=blind)).plain:
        console.print(told)
    for name, side in (("left", question.left), ("right", question.right)):
        console.print(Text(_title(name, side, blind=blind), style=STYLES[name]))
    if rows := comparison_view(question, scenario, seen):
        show_kpis(rows, console, NAMES)
    else:
        console.print("There are no KPIs to compare: the page draws the curves (no --terminal).")
    if not blind:
        show_theta(question, scenario.space, console, NAMES)
    console.print(
        "l left, r right, = same, s can't tell, z undo, ? help, x stop",
        markup=False, highlight=False,
    )  # fmt: skip


def _told(interview: Interview, now: Now, *, blind: bool) -> Text:
    """Return why this is asked, and an offer to stop, if the agent simulates; else nothing."""
    told = screening_view(interview, now, blind=blind)
    if told is None:
        return Text()
    offer = f"{told['offer']} (f, and f again, finishes)" if told["offer"] else ""
    return Text("\n".join(printable(line) for line in (told["why"], offer) if line))


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


def show_keys(console: Console) -> None:
    """Print what can be answered."""
    table = Table.grid(padding=(0, 2))
    for key, words in KEYS:
        table.add_row(Text(key, style="bold"), words)
    console.print(table)


def show_next(interview: Interview, now: Now, console: Console) -> None:
    """Print the next θ of a rig, and what its record must contain."""
    rig, sample = interview.scenario.run, now.pending
    assert isinstance(rig, Rig)
    assert sample is not None
    console.rule(f"Experiment {sample.index + 1}: run your plant with these values")
    for knob, value in zip(interview.scenario.space, np.array(sample.theta), strict=True):
        line = f"  {knob.name} = {with_unit(repr(float(value)), knob.unit)}"
        console.print(line, style="bold", markup=False, highlight=False)
    if rig.instructions:
        console.print(rig.instructions, markup=False)
    columns = ", ".join(rig.columns)
    console.print(
        f"The record: a CSV file with the columns {columns}", markup=False, soft_wrap=True
    )


def show_changes(interview: Interview, now: Now, console: Console) -> None:
    """Print what would be written to a live plant: the old and the new value of each knob."""
    rig, sample, live = interview.scenario.run, now.pending, now.live
    assert isinstance(rig, LiveRig)
    assert sample is not None
    assert live is not None
    console.rule(f"Experiment {sample.index + 1}: confirm what is written to the plant")
    for change in live.changes or ():
        part = change.part
        limits = f"limits {part.low:g} to {part.high:g}, at most {part.rate:g} per second"
        line = f"  {part.name}: {change.old:.6g} → {with_unit(f'{change.new:.6g}', part.unit)}"
        console.print(f"{line}   ({limits})", style="bold", markup=False, highlight=False)
    after = "the old values are restored" if rig.after == "restore" else "the new θ stays"
    console.print(
        f"Then {rig.duration:g} s are recorded. Afterward {after}; k and Enter stops the run.",
        markup=False, highlight=False,
    )  # fmt: skip
    for words in filter(None, (rig.instructions, live.problem)):
        console.print(words, markup=False)
