"""Run `prefcal look`: read the runs, then show the page, a picture or the KPIs."""

import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from prefcal_app.looking import SideBySide
from prefcal_app.looking.pair import NamedRun
from prefcal_app.looking.table import run_from
from prefcal_app.terminal.showing import show_kpis
from prefcal_env.errors import SettingsError
from prefcal_env.study import study_path
from prefcal_env.tables import TableColumns
from prefcal_scenarios.described.words import listed
from prefcal_scenarios.presentation.wording import printable
from prefcal_scenarios.scenario import KPI

from .interrupt import interruption
from .options import LookOptions
from .studies.files import EXPERIMENT, as_text, existing, numbered, open_described

_SQLITE = b"SQLite format 3\0"


def run(options: LookOptions) -> int:
    """Show the runs; return the exit code.

    Raises:
        PrefcalError: If a run cannot be read, or an option does not fit.
    """
    if len(options.runs) < 2:
        raise SettingsError(
            "name two runs or more: CSV or Parquet files, or STUDY:3 for experiment 3 of a study"
        )
    about = TableColumns(
        time=options.time,
        time_format=options.time_format,
        outputs=tuple(listed([options.outputs])),
        inputs=tuple(listed([options.inputs])),
        reference=_mapped("--reference", options.reference, "level=2"),
        units=_mapped("--unit", options.unit, "level=m"),
        columns=_mapped("--columns", options.columns, "level=TI-101.PV"),
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


def _mapped(option: str, given: Sequence[str], example: str) -> dict[str, str]:
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
    if _is_study(path if path.is_file() else study_path(words)):
        raise SettingsError(f"{words} is a study: say which experiment of it, as {words}:3")
    return run_from(path, about)


def _is_study(path: Path) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(_SQLITE)) == _SQLITE


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
    from prefcal_app.looking.window import LookWindow
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
