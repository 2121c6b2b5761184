"""Show experiments in a terminal, and read what a person types."""

import os
import select
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isinf, isnan
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from prefcal_app.session import Interview, Now
from prefcal_app.view.question import scenario_view
from prefcal_env.compiling import Compiling
from prefcal_env.errors import SettingsError
from prefcal_env.knobs import KnobSpace
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.described.description import COMMA
from prefcal_scenarios.runs import compile_runs
from prefcal_scenarios.scenario import Scenario
from prefcal_scenarios.wording import INTERRUPTED, counted, labeled, printable, printable_lines, with_unit

# --- Read what the person types: answers from a terminal, a file or a pipe, and θ in words.

END = "x"


def ask_line(console: Console, words: str) -> str:
    """Return a line of text from the person; `END` at the end of the input.

    A line from a file or a pipe is printed, as a terminal shows what is typed.
    """
    if sys.stdin.isatty():
        try:
            return console.input(f"{words}: ", markup=False).strip()
        except EOFError:  # Ctrl-D
            return END
    console.print(f"{words}: ", markup=False, end="")
    line = sys.stdin.readline()
    said = line.strip() if line else END
    console.print(printable(said), markup=False, highlight=False, soft_wrap=True)
    return said


def typed() -> str | None:
    """Return the line that was typed at a terminal since the last call; None if there is none.

    A file or a pipe is not read, since its lines are answers.
    """
    if not sys.stdin.isatty() or os.name != "posix":
        return None
    ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    return sys.stdin.readline().strip().lower() if ready else None


def theta_of(text: str, space: KnobSpace, base: tuple[float, ...] | None = None) -> Float[np.ndarray, " n"]:
    """Return the physical θ of `knob=value, ...` in any order, shape (n,).

    Args:
        space: Knobs; a name may be shortened, and has _ for spaces.
        base: Physical θ with the values of knobs that the text leaves out; None if it names all.

    Raises:
        SettingsError: If a knob is unknown, missing or given twice, or a value is not a number.
        KnobError: If a value is outside its knob's range.
    """
    given: dict[str, float] = {}
    for part in COMMA.split(text):
        word, sign, value = (piece.strip() for piece in part.rpartition("="))
        if not sign:
            raise SettingsError(f"expected KNOB=VALUE, got {part.strip()!r} in {text!r}")
        name = knob_called(word, space)
        if name in given:
            raise SettingsError(f"knob {name!r} is given twice in {text!r}")
        try:
            given[name] = float(value)
        except ValueError as error:
            raise SettingsError(f"knob {name!r} must be a number, got {value!r}") from error
    given = {**({} if base is None else dict(zip(space.names, base, strict=True))), **given}
    missing = [name for name in space.names if name not in given]
    if missing:
        raise SettingsError(f"every knob needs a value, {missing} are missing in {text!r}")
    return space.check(np.array([given[name] for name in space.names]))


def knob_called(word: str, space: KnobSpace) -> str:
    """Return the name of the knob that matches `word`, a name or an unambiguous prefix.

    Underscores in `word` match spaces.

    Raises:
        SettingsError: If no knob or more than one knob matches.
    """
    plain = {name.replace(" ", "_"): name for name in space.names}
    wanted = word.replace(" ", "_")
    if wanted in plain:
        return plain[wanted]
    found = [name for key, name in plain.items() if wanted and key.startswith(wanted)]
    if len(found) != 1:
        hint = did_you_mean(word, plain)
        raise SettingsError(f"knob must be one of {', '.join(plain)}, got {word!r}.{hint}".rstrip("."))
    return found[0]


# --- Show a study in a terminal: its task, a question, answers, progress, and what a plant needs.

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
    ("t", "all KPIs of both sides, once more"),
    ("p", "ask me an earlier question again"),
    ("f, f", "finish the study"),
    ("x", "stop for now, and say how to go on"),
    ("?", "the task, and these answers"),
)
"""What can be answered, and what it means."""


@dataclass(slots=True)
class Tenths:
    """Which progress is said where no bar can move, as in a log: each tenth, once."""

    told: int = 0  # number of tenths that were said

    def passed(self, done: int, total: int) -> bool:
        """Return whether another tenth is done than at the last call."""
        before, self.told = self.told, 10 * done // max(total, 1)
        return self.told > before


def say(console: Console, *lines: str, style: str | None = None) -> None:
    """Print lines as they are, whatever is in them; long ones are not broken."""
    for line in lines:
        console.print(printable_lines(line), style=style, markup=False, highlight=False, soft_wrap=True)


def compile_aloud(scenario: Scenario, console: Console) -> None:
    """Compile what runs a scenario, and say so: each part in a line that goes, or in a log the first one."""
    status, told = console.status(""), False

    def tell(part: Compiling) -> None:
        nonlocal told
        status.update(part.words)
        if console.is_terminal:
            status.start()
        elif not told:
            say(console, part.words)
        told = True

    try:
        compile_runs(scenario, tell)
    finally:
        status.stop()


def show_scenario(scenario: Scenario) -> None:
    """Print the task, the knobs and the KPIs of a scenario on standard output."""
    show_brief(scenario_view(scenario), Console(emoji=False))


def show_brief(brief: Mapping[str, Any], console: Console) -> None:
    """Print everything that a person should know before the first question.

    Args:
        brief: What `brief_view` returns; what `scenario_view` returns is enough.
    """
    console.rule(Text(printable(brief["title"]), style="bold"))
    if brief["text"]:
        console.print(Text(printable_lines(brief["text"])))
    for title, rows in (
        ("Knobs", [(labeled(k["name"], k["unit"]), k["about"], k["range"]) for k in brief["knobs"]]),
        ("KPIs", [(labeled(k["title"], k["unit"]), k["about"], k["wanted"]) for k in brief["kpis"]]),
    ):
        table = Table(title=title, title_justify="left", title_style="bold", box=None, show_header=False)
        for name, about, wanted in (map(printable, row) for row in rows):
            table.add_row(Text(name, style="bold"), Text(about), Text(wanted, style="dim"))
        if rows:
            console.print(table)
    for words in filter(None, (brief.get("how"), brief.get("start"))):
        console.print(Text(words))


def show_keys(console: Console) -> None:
    """Print what can be answered."""
    say(console, *(f"{key:<6}{words}" for key, words in KEYS))


def show_question(now: Mapping[str, Any], console: Console) -> None:
    """Print the open question of what `now_view` returns: KPIs and θ of both sides, and the keys."""
    question, screening = now["question"], now["screening"] or {"why": "", "offer": ""}
    console.rule(_headline(now))
    offer = f"{screening['offer']} (f, and f again, finishes)" if screening["offer"] else ""
    for line in filter(None, (screening["why"], offer)):
        console.print(Text(printable(line)))
    for name in NAMES:
        console.print(Text(_title(name, question[name]), style=STYLES[name]))
    if question["comparison"]:
        show_kpis(question["comparison"], console, NAMES)
    else:
        console.print("There are no KPIs to compare: the page draws the curves (no --terminal).")
    if not now["blind"]:
        _show_theta(question["left"]["theta"], question["right"]["theta"], console)
    say(console, "l left, r right, = same, s can't tell, z undo, ? help, x stop")


def _headline(now: Mapping[str, Any]) -> str:
    if now["question"]["repeat"]:
        return "An earlier question again (z skips it): which experiment is better?"
    seen = ", two that you have seen" if now["question"]["further"] else ""
    return f"{now['progress']['text'].capitalize()}{seen}: which experiment is better?"


def _title(name: str, side: Mapping[str, Any]) -> str:
    parts = [name.upper()]
    if side["number"] is not None:
        parts.append(f"experiment {side['number']}")
    if side["role"]:
        parts.append(side["role"])
    if side["marks"]:
        parts.append(f"marked {', '.join(side['marks'])}")
    if side["counts_as_unsafe"]:
        parts.append(INTERRUPTED)
    elif side["interrupted"]:
        parts.append(side["ended"])
    return " · ".join(parts)


def show_kpis(rows: Iterable[Mapping[str, Any]], console: Console, names: Mapping[str, str]) -> None:
    """Print the KPIs of two sides, as `compare` returns them; the better one is bold.

    The title of each group, such as a maneuver, is on a line of its own.

    Args:
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


def _show_theta(
    left: Iterable[Mapping[str, Any]], right: Iterable[Mapping[str, Any]], console: Console
) -> None:
    """Print θ of both sides; brackets, not only style, mark values that differ."""
    table = _side_by_side("θ", NAMES)
    for knobs in zip(left, right, strict=True):
        values = [with_unit(each["text"], each["unit"]) for each in knobs]
        differs = knobs[0]["differs"]
        texts = [Text(f"[{v}]", style="bold") if differs else Text(v, style="dim") for v in values]
        table.add_row(Text(printable(knobs[0]["name"])), *texts)
    console.print(table)


def _side_by_side(heading: str, names: Mapping[str, str]) -> Table:
    """Return a table without lines, so that it reads well aloud and through a pipe."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(heading, overflow="fold")
    for side, name in names.items():
        table.add_column(Text(printable(name)), header_style=STYLES[side], justify="right")
    return table


def show_history(answers: Sequence[Mapping[str, Any]], console: Console) -> None:
    """Print every answer of what `history_view` returns."""
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


def show_status(now: Mapping[str, Any], status: Mapping[str, Any], console: Console) -> None:
    """Print the best so far, the progress, and how consistent the answers are."""
    progress, best, outlook = now["progress"], status["best"], status["outlook"]
    most, given = counted(progress["n_max"], "experiment"), counted(progress["given"], "comparison")
    lines = [f"{progress['experiments']} of {most}, {given}"]
    if status["simulated"] is not None:
        lines.append(status["simulated"]["line"])
    if best is not None:
        theta = " · ".join(f"{k['name']} {with_unit(k['text'], k['unit'])}" for k in best["theta"])
        lines.append(f"best so far, experiment {best['number']}: {theta}")
    lines.append(status["consistency"]["text"])
    if outlook is not None:
        lines += [*outlook["sentences"], outlook["command"]]
    say(console, *filter(None, [*lines, status["trust"]]))


def show_next(interview: Interview, now: Now, console: Console) -> None:
    """Print the next θ of a rig, and what its record must contain."""
    source, sample = interview.scenario.source, now.pending
    assert sample is not None
    console.rule(f"Experiment {sample.index + 1}: run your plant with these values")
    for knob, value in zip(interview.scenario.space, np.array(sample.theta), strict=True):
        say(console, f"  {knob.name} = {with_unit(repr(float(value)), knob.unit)}", style="bold")
    say(console, *filter(None, (source.instructions, interview.known.promise)))
    say(console, f"The record: a CSV file with the columns {', '.join(source.columns)}")


def show_changes(interview: Interview, now: Now, console: Console) -> None:
    """Print what would be written to a live plant: the old and the new value of each knob."""
    source, sample, plant = interview.scenario.source, now.pending, now.plant
    assert sample is not None
    assert plant is not None
    console.rule(f"Experiment {sample.index + 1}: confirm what is written to the plant")
    for change in plant.changes or ():
        rate = "" if isinf(change.rate) else f", at most {change.rate:g} per second"
        limits = f"limits {change.quantity.low:g} to {change.quantity.high:g}{rate}"
        new = with_unit(f"{change.new:.6g}", change.unit)
        old = "" if isnan(change.old) else f"{change.old:.6g} → "
        say(console, f"  {change.name}: {old}{new}   ({limits})", style="bold")
    recorded = "" if isinf(source.duration) else f"Then {source.duration:g} s are recorded. "
    say(
        console,
        f"{recorded}Afterward {source.afterward}{'; k and Enter stops the run' if source.stops else ''}.",
        *filter(None, (source.instructions, interview.known.promise, plant.problem)),
    )
