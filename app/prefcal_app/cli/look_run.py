"""Run `prefcal look`, `prefcal verify` and `prefcal export`."""

import re
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich import progress as bar
from rich.console import Console
from rich.table import Table

from prefcal_app.looking import SideBySide
from prefcal_app.looking.look import run_from
from prefcal_app.looking.pair import NamedRun
from prefcal_app.report.export import export_controller, holds
from prefcal_app.report.verifying import judge, picture, verify_best, written_beside
from prefcal_app.terminal.showing import Tenths, ask_line, compile_aloud, say, show_kpis
from prefcal_env.errors import SettingsError
from prefcal_env.study import study_path
from prefcal_env.tables import TableColumns
from prefcal_scenarios.described.description import listed
from prefcal_scenarios.runs import Progress
from prefcal_scenarios.scenario import KPI, Scenario
from prefcal_scenarios.verification.said import BEST, FILE, NOT_VARIED, VARIED, Verified
from prefcal_scenarios.wording import printable, put, sentence

from .calibrate import interruption
from .options import ExportOptions, LookOptions, VerifyOptions
from .result import plain
from .studies.files import EXPERIMENT, as_text, existing, numbered, open_described

# --- Run `prefcal look`: read the runs, then show the page, a picture or the KPIs.

_SQLITE = b"SQLite format 3\0"


def look_at(options: LookOptions) -> int:
    """Show the runs; return the exit code."""
    if len(options.runs) < 2:
        raise SettingsError(
            "name two runs or more: CSV, Parquet or Excel files, or STUDY:3 for experiment 3 of a study"
        )
    about = TableColumns(
        time=options.time,
        time_format=options.time_format,
        outputs=tuple(listed([options.outputs])),
        inputs=tuple(listed([options.inputs])),
        reference=mapped("--reference", options.reference, "level=2"),
        units=mapped("--unit", options.unit, "level=m"),
        columns=mapped("--columns", options.columns, "level=TI-101.PV"),
    )
    runs = _named([_run(words, about) for words in options.runs])
    look = SideBySide.of(runs[0], runs[1], align=options.align or None)
    picture = None if options.out is None else look.save(options.out)
    if options.json:
        written = {} if picture is None else {"picture": str(picture)}
        print(as_text(_as_dict(runs, look) | written), flush=True)
        return 0
    for line in (*(f"{each.name}: {each.about}" for each in runs), *look.notes):
        print(printable(line), flush=True)
    if picture is not None:
        print(f"Picture: {picture}", flush=True)
    elif options.terminal:
        names = {"left": look.left.name, "right": look.right.name}
        show_kpis(look.kpis(), Console(emoji=False), names)
    else:
        _serve(runs, options)
    return 0


def mapped(option: str, given: Sequence[str], example: str) -> dict[str, str]:
    """Return the texts by name in options such as "level=m"."""
    found = {}
    for text in given:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not (name and equals and value):
            raise SettingsError(f"{option} must look like {example}, got {text!r}")
        found[name] = value
    return found


def _run(words: str, about: TableColumns) -> NamedRun:
    """Return the run that a word names: a file, or an experiment of a study."""
    path, study = Path(words).expanduser(), EXPERIMENT.fullmatch(words)
    if study is not None and not path.is_file():
        return _of_study(study[1], study[2])
    if path.is_file() and path.suffix == ".json":
        raise SettingsError(
            f"{words} holds a controller, not a run: name an experiment of the study instead, "
            "such as mine:best"
        )
    file = path if path.is_file() else study_path(words)
    if file.is_file():
        with file.open("rb") as opened:
            if opened.read(len(_SQLITE)) == _SQLITE:
                raise SettingsError(f"{words} is a study: say which experiment of it, as {words}:3")
    return run_from(path, about)


def _of_study(name: str, which: str) -> NamedRun:
    with open_described(existing(name)) as file:
        state = file.state
        index = numbered(name, which, state)
        experiment = file.experiment(state.finished[index])
        kpis = tuple(KPI(**row) for row in state.configuration.get("kpis", ()))
    known = tuple(kpi for kpi in kpis if kpi.name in experiment.kpis)
    return NamedRun(f"{name}:{index + 1}", experiment, known, f"experiment {index + 1} of study {name}")


def _named(runs: Sequence[NamedRun]) -> list[NamedRun]:
    """Return the runs with different names: files of the same name are numbered."""
    names = [run.name for run in runs]
    return [
        run
        if names.count(run.name) == 1
        else replace(run, name=f"{run.name} ({names[:k].count(run.name) + 1})")
        for k, run in enumerate(runs)
    ]


def _as_dict(runs: Sequence[NamedRun], look: SideBySide) -> dict[str, Any]:
    return {
        "runs": [
            {
                "name": run.name,
                "read": run.about,
                "rows": len(run.experiment.t),
                "duration": run.experiment.duration,
                "time_unit": run.experiment.channels.time_unit,
                "kpis": [
                    {"name": k.name, "unit": k.unit, "value": run.experiment.kpis[k.name]} for k in run.kpis
                ],
            }
            for run in runs
        ],
        "comparison": look.kpis(),
        "notes": list(look.notes),
    }


def _serve(runs: Sequence[NamedRun], options: LookOptions) -> None:
    """Serve the page until Ctrl-C."""
    # Imported here: pictures need no web server.
    from prefcal_app.looking.look import LookWindow
    from prefcal_app.web import open_browser

    served = LookWindow(runs, align=options.align or None, host=options.host, port=options.port)
    with interruption(others=True) as ctrl_c, served as window:
        if window.warning:
            print(window.warning, file=sys.stderr)
        # On a line of its own, unwrapped and flushed, so that programs can read it.
        print(window.link, flush=True)
        if window.link_for_others:
            print(f"From other machines:\n{window.link_for_others}", flush=True)
        if options.browser and not open_browser(window.link):
            print("No browser found: open the link yourself. Ctrl-C ends.", file=sys.stderr)
        with suppress(KeyboardInterrupt), ctrl_c.allowed():
            while True:
                time.sleep(0.5)


# --- Run `prefcal verify`: vary the plant of a tuning, say and keep what came of it, ask about the worst.

_VERDICTS = {"y": True, "n": False}


@contextmanager
def _bars() -> Iterator[Progress]:
    """Yield a function of the number of runs that arrived and of all, for a bar, and one of further runs.

    Where no bar can move, as in a log, it writes a line after each tenth of the runs.
    """
    columns = bar.TextColumn("{task.description}"), bar.BarColumn(), bar.MofNCompleteColumn()
    times = bar.TimeElapsedColumn(), bar.TimeRemainingColumn()
    console = Console(stderr=True, emoji=False)
    display = bar.Progress(*columns, *times, console=console, disable=not console.is_terminal)
    planned, tenths = 0, Tenths()

    def tell(arrived: int, total: int | None) -> None:
        nonlocal planned
        if not display.task_ids:  # not before: an error of the first steps is one line
            display.start()
            display.add_task("varied runs")
            planned = total or 0
        further = (total or 0) > planned
        if further and len(display.task_ids) == 1:
            display.add_task("task as stated, other tunings")
        before = planned * further
        done, of = arrived - before, (total or 0) - before
        if tenths.passed(done, of) and display.disable:
            say(console, f"{display.tasks[-1].description}: {done} of {of}")
        display.update(display.task_ids[-1], completed=done, total=of)

    try:
        yield tell
    finally:
        if display.task_ids:
            display.stop()


def verify(options: VerifyOptions) -> int:
    """Verify the tuning; return the exit code."""
    best, console = _best(options.best), Console(emoji=False)

    def prepare(scenario: Scenario) -> None:
        compile_aloud(scenario, Console(stderr=True, emoji=False))
        ctrl_c.check()  # a press while something is compiled is swallowed there

    # `kill` is Ctrl-C here: what was run until then counts. Processes are fresh, so none inherits it.
    with _bars() as progress, interruption(others=True) as ctrl_c, ctrl_c.allowed():
        said = verify_best(
            best,
            options.runs,
            limits=options.limit,
            ranges=dict(_range(text) for text in options.range),
            jobs=options.jobs,
            timeout=options.run_timeout,
            progress=progress,
            prepare=prepare,
            seed=options.seed,
        )
    show(said, console)
    if beside := written_beside(said, best.parent):
        say(
            console,
            f"Kept in {best.parent / beside}: {best.parent / FILE} has more runs than these {said.made}, so "
            "it stays, as do sheet and report. To replace it, remove it first.",
        )
        return 0
    for k in range(len(said.worst)):
        drawn = best.parent / picture(k)
        where = drawn if drawn.is_file() else "could not be run again to draw it"
        say(console, f"Worst run {k + 1}, beside the nominal one: {where}")
    if sys.stdin.isatty():
        for k, each in enumerate(said.worst):
            told = ask_line(console, f"Worst run {k + 1} ({each.words}): acceptable? (y/n)").lower()
            if told in _VERDICTS:
                judge(best.parent, k, acceptable=_VERDICTS[told])
    say(console, f"Kept in {best.parent / FILE}.")
    return 0


def _best(place: str) -> Path:
    """Return the path of a best.json, which may be named by its folder."""
    return Path(place, BEST) if Path(place).is_dir() else Path(place)


def _range(text: str) -> tuple[str, float | list[float]]:
    """Return name and change of "dead time=0:0.5" or "parameter=0.2"."""
    name, _, change = (part.strip() for part in text.partition("="))
    try:
        ends = [float(end) for end in change.split(":")]
    except ValueError:
        ends = []
    if not name or len(ends) not in (1, 2):
        raise SettingsError(f'--range must look like parameter=0.2 or "dead time=0:0.5", got {text!r}')
    return name, ends[0] if len(ends) == 1 else ends


def show(said: Verified, console: Console) -> None:
    """Print a verification in a terminal."""
    more = [each for each in (said.statement, said.limits_kept) if each not in said.verdict]
    say(console, "Does it hold?", *(f"  {each}" for each in (said.verdict, *more)), *said.lines)
    for line in (*said.misses, *said.advice):
        say(console, f"  {sentence(line)}")
    if said.varied:
        console.print(_table(VARIED, said.varied))
    if said.left_out:
        console.print(_table(NOT_VARIED, said.left_out))
    say(console, "What margin has it?", f"  {sentence(said.basis)}")
    if said.margins_kept:
        say(console, f"  {said.margins_kept}")
    if said.margins:
        console.print(_table(said.margin_columns, said.margins))
    console.print(_table(said.kpi_columns, said.kpis))
    if said.noise:
        console.print(_table(said.noise_columns, said.noise.rows))
    for line in (*filter(None, [said.outside]), *map(sentence, said.noise.remarks), *_lines(said)):
        say(console, line)


def _lines(said: Verified) -> Iterator[str]:
    """Yield what hurts most, and the worst runs."""
    if said.effects:  # they come after all random runs, and an interruption may end before
        yield "What hurts most, one at a time:"
    yield from (f"  {text}" for text in said.hurting)
    if said.worst:
        yield "Worst runs:"
    for each in said.worst:
        yield f"  {each.words}: {each.text}"


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    table = Table(box=None, header_style="bold")
    for name in columns:
        table.add_column(plain(name), overflow="fold")
    for row in rows:
        table.add_row(*map(plain, row))
    return table


# --- Run `prefcal export`: write a tuned controller in the form of the plant's system.


def export(options: ExportOptions) -> None:
    """Write the controller of a best.json into a file, or print it."""
    best = _best(options.best)
    text = export_controller(
        best, options.to, name=options.name, time=options.time, spans=_spans(options.ranges)
    )
    if options.out is None:
        print(text, end="", flush=True)
        return
    if not options.out.parent.is_dir():
        raise SettingsError(f"--out must be in an existing folder, got {str(options.out)!r}")
    put(options.out, text.encode())
    print(f"Written: {options.out}. {holds(best)}", flush=True)


def _spans(ranges: str) -> tuple[float, float] | None:
    """Return the widths of the ranges of output and input; None if none were given."""
    if not ranges:
        return None
    number = r"\s*([-+]?\d*\.?\d+(?:e[-+]?\d+)?)\s*"
    found = re.fullmatch(f"{number}:{number},{number}:{number}", ranges)
    if found is None:
        raise SettingsError(f"--ranges must look like 0:200,0:100, output then input, got {ranges!r}")
    low, high, least, most = map(float, found.groups())
    if not (low < high and least < most):
        raise SettingsError(f"--ranges must have low first, then high, of output and input, got {ranges!r}")
    return high - low, most - least
