"""Look at runs: as a picture, as KPIs, or on a page."""

from base64 import b64encode
from collections.abc import Awaitable, Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from prefcal_app.summary import Spread, compare
from prefcal_app.web.api import Pages, Reports, as_json, digits, error_response, explain, read_query, to_json
from prefcal_app.web.security import Assets, Hosts
from prefcal_app.web.serve import Site, guard
from prefcal_env.errors import ExperimentError, RecordError
from prefcal_env.experiments.experiment import End, Experiment, table_of
from prefcal_env.experiments.panels import Plot, named
from prefcal_env.tables.frame import ALLOWED, TableColumns
from prefcal_env.tables.historian import NO_HEADING, tidy
from prefcal_env.tables.sheet import Sheet, parts_of, sheet_of
from prefcal_env.tables.times import Instants, gap_words, gaps, instants, usual_time_columns
from prefcal_env.units import same
from prefcal_scenarios.scenario import KPI
from prefcal_scenarios.wording import picture_at, printable, put, with_unit

from .pair import NamedRun, aligned, aligned_view, measured_run

# --- Serve runs on a local page, two at a time.

_KEPT = 8  # number of pairs whose views are kept: each can take megabytes


class LookWindow(Site):
    """The page of at least two runs, a `Site` of its own, served inside `with LookWindow(runs) as window:`.

    Args:
        align: Whether both runs of a pair start at 0; see `aligned`.
    """

    def __init__(
        self, runs: Sequence[NamedRun], *, align: bool | None = None, host: str = "127.0.0.1", port: int = 0
    ) -> None:
        def make(*, token: str, port: int, hosts: Hosts) -> Starlette:
            pages = Pages(Assets(), Reports(), token, port, "look.html")
            return guard(pages, _routes(runs, align), hosts)

        super().__init__(make, host=host, port=port)


def _routes(runs: Sequence[NamedRun], align: bool | None) -> list[Route]:
    @lru_cache(_KEPT)
    def pair(left: int, right: int) -> bytes:
        return to_json(aligned_view(*aligned(runs[left], runs[right], align=align)))

    def listed(query: bytes) -> bytes:
        return to_json({"runs": [{"name": run.name, "about": run.about} for run in runs]})

    def chosen(query: bytes) -> bytes:
        places = read_query(query, {"left": digits, "right": digits})
        left, right = places.get("left", 0), places.get("right", 1)
        if max(left, right) >= len(runs):
            raise HTTPException(404)
        return pair(left, right)

    return [Route("/api/runs", _endpoint(listed)), Route("/api/pair", _endpoint(chosen))]


def _endpoint(view: Callable[[bytes], bytes]) -> Callable[[Request], Awaitable[Response]]:
    async def answer(request: Request) -> Response:
        try:
            return as_json(await run_in_threadpool(view, request.scope["query_string"]))
        except HTTPException:
            raise
        except Exception as error:
            return error_response(*explain(error))

    return answer


# --- Look at two runs: as plain data, a picture in a notebook, or the page in a browser.


def look(
    left: Experiment,
    right: Experiment,
    *,
    names: tuple[str, str] = ("left", "right"),
    align: bool | None = None,
) -> "SideBySide":
    """Compare two runs from anywhere: in a notebook, the result shows their picture and KPIs.

    Args:
        left: A run, for example from `recorded`, `from_frame` or a study.
        right: Another run. Its time base, its length and its signals may differ.
        names: Names of both, as shown to people.
        align: Whether to draw both from time 0; None to do so only if their times do not overlap.

    Raises:
        ExperimentError: If one of them is not an experiment.
    """
    runs = []
    for side, name, experiment in zip(("left", "right"), names, (left, right), strict=True):
        if not isinstance(experiment, Experiment):
            raise ExperimentError(
                f"the {side} run must be an Experiment, got {type(experiment).__name__}: "
                "prefcal_env.from_frame makes one of a table"
            )
        runs.append(run_of(str(name), experiment))
    return SideBySide.of(*runs, align=align)


def run_of(name: str, experiment: Experiment, about: str = "") -> NamedRun:
    """Return an experiment as a run to look at, with KPIs that every run has."""
    measured, kpis = measured_run(experiment)
    return NamedRun(name, measured, kpis, about)


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Two runs beside each other, with the same curves."""

    left: NamedRun
    right: NamedRun
    panels: tuple[Plot, ...]  # panels from top to bottom; a run that lacks a curve has no values there
    known: tuple[KPI, ...]  # KPIs that either run has
    notes: tuple[str, ...] = ()  # what was changed to make them comparable, in sentences

    @classmethod
    def of(cls, left: NamedRun, right: NamedRun, *, align: bool | None = None) -> "SideBySide":
        """Return two runs beside each other; for `align`, see `aligned`."""
        return cls(*aligned(left, right, align=align))

    def kpis(self) -> list[dict[str, Any]]:
        """Return the KPIs of both runs with their differences, the largest first."""
        return compare(self.left.experiment, self.right.experiment, self.known, Spread())

    def png(self) -> bytes:
        """Return the picture of both runs over each other; references are dotted."""
        # Imported here: plotting takes half a second to import.
        from prefcal_app.report.pictures import DrawnRun, overlaid
        from prefcal_scenarios.style import BEST, OTHERS, png, style

        looks = ((BEST, "-"), (OTHERS[0], (0, (5, 1.6))))
        curves = [
            DrawnRun(run.experiment, printable(run.name).replace("$", r"\$"), color, 1.7, dashes)
            for run, (color, dashes) in zip((self.left, self.right), looks, strict=True)
        ]
        with style():
            return png(overlaid(lambda *_: self.panels, curves))

    def save(self, path: str | Path) -> Path:
        """Write the picture of both runs to a PNG file and return its path.

        Raises:
            SettingsError: If `path` does not end in .png, or its folder does not exist or cannot be
                written to.
        """
        target = picture_at(path)
        put(target, self.png())
        return target

    def show(self, wait: Callable[[], object] = input) -> None:
        """Open the page of both runs in a browser, until Enter is pressed: until `wait` returns."""
        from prefcal_app.web import open_browser

        with LookWindow((self.left, self.right)) as window:
            print(window.link, flush=True)
            open_browser(window.link)
            wait()

    def _repr_html_(self) -> str:
        """Return picture and KPIs for a notebook, self-contained."""
        left, right = self.left.name, self.right.name
        rows = [
            (
                # Without maneuvers there are no groups.
                named(row["title"], row["group"]) if row["group"] else row["title"],
                *(with_unit(row[side]["text"], row["unit"]) for side in ("left", "right")),
                row["difference"] or "–",
            )
            for row in self.kpis()
        ]
        picture = b64encode(self.png()).decode()
        return (
            f'<img alt="{escape(left)} and {escape(right)}" '
            f'src="data:image/png;base64,{picture}">'
            f"{table_of(('KPI', left, right, 'difference'), rows)}"
        )


# --- Guess what the columns of a table are, read them as a run, and say what was taken for what.

_MOST = 12  # number of columns shown if none are named: more panels are no longer readable


def run_from(path: Path, about: TableColumns | None = None) -> NamedRun:
    """Return the run in a file, with a sentence on what was taken for what.

    Args:
        path: CSV, Parquet or Excel file, with a heading "name" or "name [unit]" for each column.
        about: What is known of the columns: names, units, references and time. A reference is a
            number as text, or the heading of a column. The rest is found from the headings.

    Raises:
        RecordError: If the file is no table, or a column is missing or holds no numbers.
    """
    try:
        return _run_from(path, TableColumns() if about is None else about)
    except RecordError as error:
        raise RecordError(f"{path}: {error}") from error


def _run_from(path: Path, about: TableColumns) -> NamedRun:
    sheet, time, found, mended = _timed_sheet(path, about)
    names = _names(sheet, about)
    reference = _references(sheet, about, names)
    beside = {time, *(names[name] for name in about.inputs)}
    beside |= {sheet.column(r, "") for r in reference.values() if isinstance(r, str)}
    outputs, left_out = _outputs(sheet, about, {n: i for n, i in names.items() if i not in beside})
    _check_shown(about, outputs)
    reference = {name: value for name, value in reference.items() if name in outputs}
    used = (*outputs, *about.inputs)
    # The page shows times as they are, and needs every row. Look computes KPIs of its own, and
    # nobody says that the run was unsafe.
    columns = replace(
        about,
        columns={n: h for n, h in about.columns.items() if n in used},
        time=sheet.headings[time],
        outputs=outputs,
        reference=reference,
        units={n: u for n, u in about.units.items() if n in (*used, "time", sheet.name(time))},
        from_zero=False,
        allow=ALLOWED,
        max_rows=None,
        kpis=None,
        end=End.TIME_UP,
    )
    experiment = columns.read(sheet, [0.0])  # θ is not known
    taken = {"outputs": outputs, "inputs": about.inputs, "references of": reference}
    words = [f"{what} {', '.join(found)}" for what, found in taken.items() if found]
    places = {name: names[name] for name in used}
    places |= {f"{n} ref": sheet.column(r, "") for n, r in reference.items() if isinstance(r, str)}
    if len(long := gaps(experiment.t)):
        mended.append(f"{gap_words(experiment.t, int(long[0]), found.unit, len(long))}: bridged")
    bridged = _bridged(sheet, places, outputs)
    converted = _converted(sheet, experiment, names, reference)
    said = (found.words(sheet, time), *words, *converted, *mended, *bridged, *left_out)
    return run_of(path.name, experiment, "; ".join(said))


def _check_shown(about: TableColumns, outputs: Collection[str]) -> None:
    """Refuse a reference of what is no output: it would neither be drawn nor measured."""
    for name in about.reference:
        if name not in outputs:
            there = "an input" if name in about.inputs else "not shown"
            raise RecordError(
                f"{name!r} has a reference but is {there}: the outputs are {', '.join(outputs)}; "
                f"add it with --outputs, or leave --reference {name}=... out"
            )


def _timed_sheet(path: Path, about: TableColumns) -> tuple[Sheet, int, Instants, list[str]]:
    """Return the rows that have a time, the number of its column, times, and what reading will mend."""
    sheet = sheet_of(path, {*about.columns.values(), *about.outputs, *about.inputs})
    if not len(sheet.frame):
        raise RecordError("a table needs a line of headings and rows of values, got headings only")
    if sheet.uneven:
        raise RecordError(sheet.uneven)
    named = about.columns.get("time", about.time)
    time = sheet.column(named, "") if named else (usual_time_columns(sheet) or [0])[0]
    column, said = sheet.frame[time], []
    there = np.asarray(column.notna() & (column.astype(str).str.strip() != ""))
    if not there.any():
        raise RecordError(
            f"column {parts_of(sheet.headings[time])[0]!r} should hold the time but is empty: "
            "name another one with --time"
        )
    if not there.all():
        said.append(f"{(~there).sum()} of {len(there)} rows have no time and are left out")
        sheet = sheet.take(np.flatnonzero(there))
    guessed = not named and not usual_time_columns(sheet)
    sheet, time = tidy(sheet, time, about.time_format, used=about.used(), repeated=True)
    found = instants(sheet, time, None, about.time_format, about.counted_in(sheet.name(time)))
    t, back = found.t, bool((np.diff(found.t) < 0).any())
    if guessed and (back or sheet.name(time) == "T"):
        raise RecordError(
            f"no column is called time, and {sheet.name(time)!r} may be none: name the right one with --time"
        )
    said += [*sheet.said, *found.said]
    if back:
        said.append("rows sorted by time")
    ordered = np.unique(t)
    if repeated := len(t) - len(ordered):
        said.append(f"of rows with the same time only the last one is kept ({repeated} left out)")
    return sheet, time, found, said


def _names(sheet: Sheet, about: TableColumns) -> dict[str, int]:
    """Return the number of each column by its name; columns without a heading have none."""
    names = {name: sheet.column(heading, "") for name, heading in about.columns.items()}
    renamed = {*names.values()}
    for i, heading in enumerate(sheet.headings):
        plain = parts_of(heading)[0]
        if plain and i not in renamed:
            names.setdefault(plain, i)
    for name in (*about.outputs, *about.inputs, *about.reference):
        if name not in names:
            names[name] = sheet.column(name, "")  # says which there are
    for name in about.units:
        if name not in {"time", *names}:
            sheet.column(name, "")
    return names


def _references(sheet: Sheet, about: TableColumns, names: Mapping[str, int]) -> dict[str, Any]:
    """Return the reference of each output: a number, or the heading of a column."""
    bases = {name: name.removesuffix(" ref") for name in names if name.endswith(" ref")}
    found: dict[str, Any] = {
        base: sheet.headings[names[name]] for name, base in bases.items() if base in names
    }
    for name, text in about.reference.items():
        try:
            found[name] = sheet.headings[names[text]] if text in names else float(text)
        except ValueError:
            found[name] = sheet.headings[sheet.column(text, "")]
    return found


def _outputs(
    sheet: Sheet, about: TableColumns, there: Mapping[str, int]
) -> tuple[tuple[str, ...], list[str]]:
    """Return the outputs among the columns that are `there`, and what was left out."""
    import pandas as pd

    if about.outputs:
        return tuple(about.outputs), []
    aside = _aside(sheet)
    there = {name: i for name, i in there.items() if i not in sheet.aside}
    columns = {name: sheet.frame[i] for name, i in there.items()}
    is_numeric = pd.api.types.is_numeric_dtype
    numeric = [n for n, values in columns.items() if is_numeric(values) and values.notna().any()]
    text = [name for name in there if name not in numeric]
    for name in text:
        if sheet.is_almost_numeric(there[name]):
            sheet.numbers(there[name])  # says which cell holds no number
    if not numeric:
        headings = ", ".join(parts_of(h)[0] for h in sheet.headings)
        raise RecordError(f"there is no column of numbers beside the time, only {headings}")
    said = [*aside, *([f"without numbers and left out: {', '.join(text[:5])}"] if text else [])]
    if len(numeric) > _MOST:
        said.append(f"only the first {_MOST} of {len(numeric)} columns: choose others with --outputs")
    return tuple(numeric[:_MOST]), said


def _converted(
    sheet: Sheet, experiment: Experiment, names: Mapping[str, int], reference: Mapping[str, Any]
) -> Iterator[str]:
    """Yield which columns are in another unit than the curves that were made of them."""
    channels = experiment.channels
    columns = [(names[c.name], c.unit) for c in (*channels.y, *channels.u)]
    aims = [(reference.get(c.name), c.unit) for c in channels.y]
    columns += [(sheet.column(aim, ""), unit) for aim, unit in aims if isinstance(aim, str)]
    for column, unit in columns:
        name, found = parts_of(sheet.headings[column])
        if found and unit and not same(found, unit):
            yield f"{name} converted from {found} to {unit}"


def _aside(sheet: Sheet) -> Iterable[str]:
    """Yield which columns are left out because they are nothing that was measured."""
    for why in dict.fromkeys(sheet.aside.values()):
        found = [i for i, other in sheet.aside.items() if other == why]
        names = ", ".join(sheet.name(i) or f"column {i + 1}" for i in found)
        yield (
            f"left out, as they hold {why}: {names}"
            if why != NO_HEADING
            else f"left out without a heading: {names}"
        )


def _bridged(sheet: Sheet, places: Mapping[str, int], outputs: Collection[str]) -> Iterable[str]:
    """Yield which columns have bad values, and empty cells before and after their last value."""
    filled, shorter, bad, lasts = [], [], {}, {}
    for name, place in places.items():
        values = sheet.numbers(place)
        there = np.flatnonzero(np.isfinite(values))
        if cells := sheet.bad.get(place):
            bad[name] = cells
        if len(there) and len(there) <= there[-1]:
            filled.append(name)
        if len(there) and there[-1] < len(values) - 1:
            shorter.append(name)
        lasts[name] = int(there[-1]) if len(there) else -1
        if len(there) and there[0] and name.endswith(" ref"):
            yield f"{name} is not known before its first value, and nothing is measured there"
    if bad:
        every = [words for cells in bad.values() for words in cells.values()]
        gaps = "1 bad value is a gap" if len(every) == 1 else f"{len(every)} bad values are gaps"
        yield f"{gaps} in {', '.join(bad)} ({', '.join([*dict.fromkeys(every)][:3])})"
    if filled:
        yield f"empty cells filled from their neighbors in {', '.join(filled)}"
    end = max(lasts[name] for name in outputs)
    shorter = [name for name in shorter if lasts[name] < end]
    if end < len(sheet.frame) - 1:
        yield "the run ends where no output has a value any more"
    if shorter:
        yield f"no values in the last rows of {', '.join(shorter)}: the last one is held while others go on"
