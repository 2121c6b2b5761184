"""Show a question in a terminal: two experiments as text and curves."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.panel import Panel as Box
from rich.table import Table
from rich.text import Text

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.live import LiveRig
from prefcal_env.rig import Rig
from prefcal_scenarios.app.presentation.wording import (
    INTERRUPTED,
    ended_text,
    printable,
    with_unit,
)
from prefcal_scenarios.app.session import Interview, Now, Question, Side
from prefcal_scenarios.app.web.view import Seen
from prefcal_scenarios.app.web.view.maneuvers import Pair, pairs_of
from prefcal_scenarios.app.web.view.sides import numbers_view, theta_view
from prefcal_scenarios.app.web.view.simulated import screening_view
from prefcal_scenarios.scenario import Scenario

from .drawing import LEAST, MOST, ROWS, curves, lines_beside_plots

WIDE = 110
"""Smallest width in columns at which the sides are next to each other."""
STYLES = {"left": "blue", "right": "dark_orange3"}
_MOST, _FEW = 6, 3
"""Number of KPIs to show per side, normally and on a low screen."""

KEYS = (
    ("← or l", "left is better"), ("→ or r", "right is better"),
    ("↓ or =", "about the same"), ("s", "can't tell"),
    ("z", "undo the last answer"),
    ("q / e", "mark left / right as unsafe or very bad"),
    ("a / d", "mark left / right as good enough"), ("c", "comment on the next answer"),
    ("b", "blind: hide θ and which experiment is the best so far"),
    ("h", "history"), ("w", "where are we"),
    ("t", "all KPIs of both sides, largest difference first"),
    ("j", "the next maneuver, if there are several"),
    ("p", "ask me an earlier question again"), ("f f", "finish the study"),
    ("x", "stop for now, and say how to go on"), ("?", "the task, and these keys"),
)  # fmt: skip


def show_question(
    interview: Interview, now: Now, console: Console, *, blind: bool, seen: Seen | None = None,
    maneuver: int = 0,
) -> None:  # fmt: skip
    """Print both sides, next to each other if there is room, and the keys.

    The curves of both sides start on the same line and share the study's axes. In a terminal they
    are as high as possible with the headline still visible. Of several maneuvers one is drawn:
    number `maneuver`, starting again after the last.
    """
    question = now.question
    assert question is not None
    seen = (Seen() if seen is None else seen).look(interview)
    console.rule(_headline(interview, question))
    told = _told(interview, now, blind=blind)
    if told.plain:
        console.print(told)
    above = len(console.render_lines(told)) if told.plain else 0
    pairs = pairs_of(interview.scenario, question.left.experiment, question.right.experiment)
    pair = pairs[maneuver % len(pairs)]
    if pair.name:
        at = maneuver % len(pairs) + 1
        _name_maneuver(console, f"Maneuver {at} of {len(pairs)}: {printable(pair.name)}")
        above += 1
    sides = _sides(question, interview.scenario, console, seen, pair, blind=blind, above=above)
    show_boxes(sides, console)
    console.print(
        "[←] left  [→] right  [↓] same  [s] can't tell  [z] undo  [?] all keys  [x] stop",
        markup=False, highlight=False,
    )  # fmt: skip


def show_boxes(sides: Sequence[RenderableType], console: Console) -> None:
    """Print both sides, next to each other if there is room."""
    if console.width < WIDE:
        for side in sides:
            console.print(side)
        return
    grid = Table.grid(expand=True)
    grid.add_column(ratio=1)
    grid.add_column(ratio=1)
    grid.add_row(*sides)
    console.print(grid)


def _name_maneuver(console: Console, words: str) -> None:
    console.print(f"{words}. [j] the next one", markup=False, highlight=False)


def _told(interview: Interview, now: Now, *, blind: bool) -> Text:
    """Return why this is asked, and an offer to stop, if the agent simulates; else nothing."""
    told = screening_view(interview, now, blind=blind)
    if told is None:
        return Text()
    offer = f"{told['offer']} (f f finishes)" if told["offer"] else ""
    return Text("\n".join(printable(line) for line in (told["why"], offer) if line))


def _headline(interview: Interview, question: Question) -> str:
    if question.repeats is not None:
        return "An earlier question again (Esc or z skips it): which experiment is better?"
    head = interview.planned.place(over=False, further=question.further).capitalize()
    seen = ", two that you have seen" if question.further else ""
    return f"{head}{seen}: which experiment is better?"


def _sides(
    question: Question,
    scenario: Scenario,
    console: Console,
    seen: Seen,
    drawn: Pair,
    *,
    blind: bool,
    above: int,
) -> list[RenderableType]:
    """Return both boxes, with equal heights above their curves, for a screen with `above` lines."""
    wide = console.width >= WIDE
    width = (console.width // 2 if wide else console.width) - 6
    pair = {"left": question.left, "right": question.right}
    both = [side.experiment for side in pair.values()]
    runs, panels = (drawn.left, drawn.right), drawn.panels
    for most in (_MOST, _FEW):
        heads = [
            _head(side.experiment, other, scenario, most, blind=blind)
            for side, other in zip(pair.values(), both[::-1], strict=True)
        ]
        heights = [len(console.render_lines(h, console.options.update(width=width))) for h in heads]
        beside = max(lines_beside_plots(e, panels) for e in runs) + max(heights) + 2
        rows = _rows(console, len(panels), beside, above, stacked=1 if wide else 2)
        if rows >= LEAST:
            break
    axes, rows = seen.frame(panels, *runs, maneuver=drawn.name), max(rows, LEAST)
    boxes: list[RenderableType] = []
    for (name, side), run, head, height in zip(pair.items(), runs, heads, heights, strict=True):
        plots = curves(run, panels, axes, width=width, rows=rows, style=STYLES[name])
        gap = [Text("")] * (max(heights) - height if wide else 0)
        title = _title(name, side, blind=blind)
        boxes.append(Box(Group(head, *gap, plots), title=Text(title), border_style=STYLES[name],
                         title_align="left"))  # fmt: skip
    return boxes


def _rows(console: Console, panels: int, beside: int, above: int, *, stacked: int) -> int:
    """Return the lines per plot that fit a question on the screen; the default without one."""
    if not console.is_terminal or not panels:
        return ROWS
    # 3: the headline, the keys, and the next line.
    left = console.height - 3 - above - stacked * beside
    return min(left // (stacked * panels), MOST)


def _head(
    experiment: Experiment, other: Experiment, scenario: Scenario, most: int, *, blind: bool
) -> RenderableType:
    """Return the KPIs and θ of one side."""
    parts: list[RenderableType] = [_kpis(numbers_view(experiment, scenario)["kpis"][:most])]
    if not blind:
        parts.append(_theta(theta_view(scenario.space, experiment, other)))
    return Group(*parts)


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


def _kpis(kpis: list[dict[str, Any]]) -> RenderableType:
    """Return a table of KPIs: title, value, whether it meets its objective, and the objective."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(overflow="fold")
    table.add_column(justify="right", no_wrap=True)
    table.add_column(no_wrap=True)
    for kpi in kpis:
        style = {True: "green", False: "red", None: ""}[kpi["met"]]
        sign = {True: "✓ ", False: "✗ ", None: ""}[kpi["met"]]
        value = Text(with_unit(kpi["text"], kpi["unit"]), style="bold")
        table.add_row(Text(kpi["title"]), value, Text(sign + kpi["objective"], style=style))
    return table


def _theta(knobs: list[dict[str, Any]]) -> RenderableType:
    """Return a table of knobs; brackets, not only style, mark values that differ."""
    values = []
    for knob in knobs:
        value = f"{knob['name']} = {with_unit(knob['text'], knob['unit'])}"
        differs = knob["differs"]
        values.append(Text(f"[{value}]" if differs else value, style="bold" if differs else "dim"))
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_row(Text("θ"), Columns(values, padding=(0, 2)))
    return table


def show_keys(console: Console) -> None:
    """Print all keys."""
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
    columns = ", ".join(rig.columns.headings)
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
        limits = f"limits {change.low:g} to {change.high:g}, at most {change.rate:g} per second"
        line = f"  {change.name}: {change.old:.6g} → {with_unit(f'{change.new:.6g}', change.unit)}"
        console.print(f"{line}   ({limits})", style="bold", markup=False, highlight=False)
    after = "the old values are restored" if rig.after == "restore" else "the new θ stays"
    console.print(
        f"Then {rig.duration:g} s are recorded. Afterward {after}; k stops the run.",
        markup=False, highlight=False,
    )  # fmt: skip
    for words in filter(None, (rig.instructions, live.problem)):
        console.print(words, markup=False)
