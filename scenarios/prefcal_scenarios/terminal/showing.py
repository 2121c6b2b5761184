"""A question in a terminal: two experiments in words and curves."""

from typing import Any

import numpy as np
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.panel import Panel as Box
from rich.table import Table
from rich.text import Text

from prefcal_env.rig import Rig
from prefcal_scenarios.interview import Interview, Now, Question
from prefcal_scenarios.report.wording import INTERRUPTED, with_unit
from prefcal_scenarios.scenario import Scenario, panels_of
from prefcal_scenarios.window.view.sides import numbers_view, theta_view

from .drawing import curves

WIDE = 110
"""Columns from which both sides stand beside each other."""
STYLES = {"left": "blue", "right": "dark_orange3"}
_MOST = 6
"""KPIs of a side that are shown."""

KEYS = (
    ("← or l", "left is better"), ("→ or r", "right is better"),
    ("shift ← or L", "left is much better"), ("shift → or R", "right is much better"),
    ("↓ or =", "about the same"), ("s", "can't tell"), ("z", "undo"),
    ("q / e", "mark left / right unsafe or very bad"),
    ("a / d", "mark left / right good enough"), ("c", "comment on the next answer"),
    ("b", "blind: hide θ and which one is new"), ("h", "history"), ("w", "where are we"),
    ("p", "ask an earlier question again"), ("f f", "finish the study"),
    ("x", "stop for now; everything is saved"), ("?", "these keys"),
)  # fmt: skip


def show_question(interview: Interview, now: Now, console: Console, *, blind: bool) -> None:
    """Both sides, side by side where there is room, and the keys."""
    question, scenario = now.question, interview.scenario
    assert question is not None
    wide = console.width >= WIDE
    width = (console.width // 2 if wide else console.width) - 6
    sides = [_side(question, name, scenario, width, blind=blind) for name in ("left", "right")]
    head = f"Comparison {question.number} of {interview.n_max - 1}"
    if question.repeats is not None:
        head = "An earlier question again"
    elif question.further:
        head = "A further comparison of two that you have seen"
    console.rule(f"{head}: which experiment is better?")
    if wide:
        grid = Table.grid(expand=True)
        grid.add_column(ratio=1)
        grid.add_column(ratio=1)
        grid.add_row(*sides)
        console.print(grid)
    else:
        for side in sides:
            console.print(side)
    much = "[L] [R] much better  " if wide else ""  # 80 columns hold no more
    console.print(
        f"[←] left  [→] right  {much}[↓] same  [s] can't tell  [z] undo  [?] all keys  [x] stop",
        markup=False, highlight=False,
    )  # fmt: skip


def _side(
    question: Question, name: str, scenario: Scenario, width: int, *, blind: bool
) -> RenderableType:
    side = getattr(question, name)
    other = question.right if name == "left" else question.left
    panels = panels_of(scenario, side.experiment.channels)
    differing = side.experiment.theta != other.experiment.theta
    parts: list[RenderableType] = [_kpis(numbers_view(side.experiment, scenario)["kpis"])]
    if not blind:
        parts.append(_theta(theta_view(scenario.space, side.experiment, differing)))
    parts.append(curves(side.experiment, question, panels, width, STYLES[name]))
    title = name.upper()
    if not blind:
        roles = ("earlier", "later") if question.further else ("best so far", "new")
        title += f" · experiment {side.index + 1} · {roles[side.challenger]}"
    if side.marks:
        title += f" · marked {', '.join(sorted(side.marks))}"
    if side.counts_as_unsafe:
        title += f" · {INTERRUPTED}"
    elif side.experiment.end.interrupted:
        title += f" · {side.experiment.end.value}"
    return Box(Group(*parts), title=Text(title), border_style=STYLES[name], title_align="left")


def _kpis(kpis: list[dict[str, Any]]) -> RenderableType:
    """One a line: what, how much, whether it meets its objective, and the objective."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    table.add_column(no_wrap=True)
    for kpi in kpis[:_MOST]:
        style = {True: "green", False: "red", None: ""}[kpi["met"]]
        sign = {True: "✓ ", False: "✗ ", None: ""}[kpi["met"]]
        value = Text(with_unit(kpi["text"], kpi["unit"]), style="bold")
        table.add_row(Text(kpi["title"]), value, Text(sign + kpi["objective"], style=style))
    return table


def _theta(knobs: list[dict[str, Any]]) -> RenderableType:
    """What differs is set off by brackets, not by style alone."""
    values = []
    for knob in knobs:
        value = f"{knob['name']} = {with_unit(knob['text'], knob['unit'])}"
        differs = knob["differs"]
        values.append(Text(f"[{value}]" if differs else value, style="bold" if differs else "dim"))
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_row(Text("θ"), Columns(values, padding=(0, 2)))
    return table


def show_keys(console: Console) -> None:
    """All keys."""
    table = Table.grid(padding=(0, 2))
    for key, words in KEYS:
        table.add_row(Text(key, style="bold"), words)
    console.print(table)


def show_next(interview: Interview, now: Now, console: Console) -> None:
    """The next θ of a rig, and what its record has to hold."""
    rig, sample = interview.scenario.run, now.pending
    assert isinstance(rig, Rig)
    assert sample is not None
    console.rule(f"Experiment {sample.index + 1}: run your plant with")
    for knob, value in zip(interview.scenario.space, np.array(sample.theta), strict=True):
        line = f"  {knob.name} = {with_unit(repr(float(value)), knob.unit)}"
        console.print(line, style="bold", markup=False, highlight=False)
    if rig.instructions:
        console.print(rig.instructions, markup=False)
    columns = ", ".join(rig.columns.headings)
    console.print(
        f"Its record: a CSV file with the columns {columns}", markup=False, soft_wrap=True
    )
