"""Check a scenario with one trial run: everything about it that a study relies on."""

import json
import shlex
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, fields
from io import BytesIO
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table
from rich.text import Text

from prefcal_app.report.export import jsonable
from prefcal_env.errors import ConnectionLostError, LiveError, RecordError, ScenarioError
from prefcal_env.experiments.experiment import Channels, Experiment
from prefcal_env.experiments.maneuvers import by_maneuver
from prefcal_env.experiments.panels import KINDS
from prefcal_env.knobs.knob import Knob
from prefcal_env.live import LiveRig
from prefcal_env.own_line import as_exception, in_words, located
from prefcal_env.preferences.answer import Answer
from prefcal_env.rig import Rig
from prefcal_env.study.codec import decode, encode
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.options import words_of
from prefcal_scenarios.kpis import grouped
from prefcal_scenarios.own.checks import check_experiment, kpi_problems, theta_problems
from prefcal_scenarios.own.tracking import tracking_rows
from prefcal_scenarios.presentation.folder import picture_at, put
from prefcal_scenarios.presentation.wording import (
    measured,
    number,
    printable,
    quantity,
    theta_text,
    with_unit,
)
from prefcal_scenarios.scenario import KPI, Scenario, with_found_kpis

from .choices import start_of

_SIGNS = {True: ("✓", "green"), False: ("✗", "bold red"), None: ("·", "dim")}
_FIRST = " (the very first run on a machine compiles for half a minute)"
_DRAWS = 2000
"""Number of random θ to try if the constraints exclude the middle of the box."""
_GOALS = {
    "lower": "lower is better",
    "higher": "higher is better",
    "target": "the middle of its range is best",
    None: "for information: nothing is learned from it",
}


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check: the subject, whether it passed (None: information), and details."""

    what: str
    ok: bool | None
    words: str


@dataclass(slots=True)
class Checkup:
    """Checks of one scenario, in order; later checks reuse the trial run.

    Args:
        scenario: Scenario to check.
        theta: θ of the trial run, physical, shape (n,).
    """

    scenario: Scenario
    theta: Float[np.ndarray, " n"]
    experiment: Experiment | None = None
    findings: list[Finding] = field(default_factory=list)

    @property
    def is_live(self) -> bool:
        """Return whether prefcal drives the plant itself, so that a check runs nothing."""
        return isinstance(self.scenario.run, LiveRig)

    @property
    def is_rig(self) -> bool:
        """Return whether only a person can run the scenario; its record is then made up."""
        return isinstance(self.scenario.run, Rig)

    def steps(self) -> Iterator[tuple[str, Callable[[], None]]]:
        """Yield a description of each step and a function that runs it and adds its findings."""
        yield "looking at the knobs", self._step("knobs", self._knobs)
        yield "running θ", self._step("run", self._run)
        if self.experiment is None:
            return
        for words, what, check in (
            ("looking at its record", "record", self._record),
            ("looking at the panels", "panels", self._panels),
            ("looking at the KPIs", "KPIs", self._kpis),
            ("computing the cost", "cost", self._cost),
            ("asking the calibrators", "calibrators", self._calibrators),
            ("running θ once more", "same again", self._again),
            ("running the references", "references", self._references),
            ("making the controller", "controller", self._controller),
            ("storing the experiment", "study file", self._stored),
        ):
            yield words, self._step(what, check)

    def _step(self, what: str, check: Callable[[], Iterator[Finding]]) -> Callable[[], None]:
        def do() -> None:
            try:
                self.findings += check()
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # a user's code can raise anything
                self.findings.append(Finding(what, False, in_words(as_exception(error, "it"))))

        return do

    def _ran(self) -> Experiment:
        assert self.experiment is not None
        return self.experiment

    def _knobs(self) -> Iterator[Finding]:
        space = self.scenario.space
        yield Finding("knobs", True, f"{len(space)}: {', '.join(map(_range_of, space))}")
        if self.scenario.brief:
            yield Finding("brief", None, " ".join(self.scenario.brief.split()))
        if not space.allows(self.theta):
            yield Finding("constraints", False, f"θ = {space.named(self.theta)} is not allowed")

    def _run(self) -> Iterator[Finding]:
        start = time.perf_counter()
        if isinstance(self.scenario.run, Rig):
            self.experiment = _made_up(self.scenario.run, self.theta)
            yield Finding("run", None, "only you can run this rig: a made-up record is checked")
            return
        if isinstance(self.scenario.run, LiveRig):
            yield from _live(self.scenario.run, self.theta)
            return
        result: object = self.scenario.run(self.theta.copy(), seed=0)
        took = time.perf_counter() - start
        if not isinstance(result, Experiment):
            check_experiment(self.scenario, self.theta, result)  # raises if anything is wrong
            return
        self.experiment = result
        self.scenario = with_found_kpis(self.scenario, result)
        yield Finding("run", True, f"{took:.2g} s, ended: {result.end.value}")
        wrong = list(theta_problems(self.scenario.space, self.theta, result))
        rounded = not wrong and not np.allclose(result.theta, self.theta, rtol=1e-9, atol=0)
        words = f"it ran {result.theta.tolist()}: rounded" if rounded else "as requested"
        yield Finding("θ of the experiment", not wrong, "; ".join(wrong) or words)

    def _record(self) -> Iterator[Finding]:
        e = self._ran()
        if not len(e.t):
            yield Finding("record", False, "the run left no record: t is empty")
            return
        parts = [name for name in by_maneuver(e) if name]
        what = f"maneuvers ({', '.join(parts)})" if parts else "variants"
        variants = f", {len(e.runs)} {what}" if e.runs else ""
        unsolved = int(np.sum(~e.solved))
        held = f"; {unsolved} unsolved, which held the input" if unsolved else ""
        until = quantity(e.duration, e.channels.time_unit)
        words = f"{len(e.t)} instants up to {until}, {len(e.t_control)} steps{held}{variants}"
        yield Finding("record", True, f"{words}; states and inputs are finite")
        yield from _channels(e.channels)

    def _panels(self) -> Iterator[Finding]:
        e = self._ran()
        if not self.scenario.panels:
            yield Finding("panels", None, "none given: all states, inputs and other outputs")
        for panel in self.scenario.panels:
            what = f"panel {panel.name!r}"
            try:
                plot = panel.plot(e) if len(e.t) else panel.absent()
            except ScenarioError as error:
                yield Finding(what, False, str(error).removeprefix(f"{what}: "))
                continue
            values = plot.values(e)
            seen = values[np.isfinite(values)]
            if not len(seen):
                yield Finding(what, False, "it has no finite value")
                continue
            span = f"from {quantity(float(seen.min()), '')} to"
            top = quantity(float(seen.max()), plot.channel.unit)
            yield Finding(what, True, f"one of the {KINDS[plot.kind]}, {span} {top}")

    def _kpis(self) -> Iterator[Finding]:
        e = self._ran()
        for words in kpi_problems(self.scenario, e.kpis):
            yield Finding("KPIs", e.end.interrupted and None, words)
        for kpi in self.scenario.kpis:
            if kpi.name in e.kpis:
                yield _kpi(kpi, e)
        known = {kpi.name for kpi in self.scenario.kpis} | tracking_rows(e.channels).keys()
        known |= {kpi.name for _, kpi in grouped(self.scenario.shown_kpis, e)}
        spare = sorted(set(e.kpis) - known)
        if spare:
            yield Finding(
                "other KPIs", None, f"returned, but not shown anywhere: {', '.join(spare)}"
            )

    def _cost(self) -> Iterator[Finding]:
        if self.scenario.cost is None:
            yield Finding("cost", None, "none: only people, or calibrators, can compare")
            return
        value = float(self.scenario.cost(self._ran()))
        yield Finding("cost", bool(np.isfinite(value)), f"{value:.4g}")

    def _calibrators(self) -> Iterator[Finding]:
        for name, make in self.scenario.calibrators.items():
            what = f"calibrator {name!r}"
            try:
                given = Answer.of(make(0).prefer(self._ran(), self._ran()))
            except Exception as error:  # the user's code can raise anything
                yield Finding(what, False, in_words(located(error)))
                continue
            verdict = "abstains" if given.preference is None else given.preference.name.lower()
            yield Finding(what, True, f"the same experiment twice: {verdict}")

    def _again(self) -> Iterator[Finding]:
        if self.is_rig:
            return
        first, second = self._ran(), self.scenario.run(self.theta.copy(), seed=0)
        if first == second:
            yield Finding("same again", True, "the same θ and seed give the same experiment")
            return
        names = [f.name for f in fields(Experiment) if f.name not in ("solve_time", "runs")]
        differ = [n for n in names if not _same(getattr(first, n), getattr(second, n))]
        where = ", ".join(differ) or "runs"
        yield Finding(
            "same again", False, f"the same θ and seed give another experiment: {where} differ; "
            "take randomness from the seed only",
        )  # fmt: skip

    def _references(self) -> Iterator[Finding]:
        for name, theta in self.scenario.references.items():
            what = f"reference {name!r}"
            if self.is_rig:
                yield Finding(what, None, "not run: this is a rig")
                continue
            try:
                theta = np.array(theta, dtype=float)
                result: object = self.scenario.run(theta, seed=0)
                ended = check_experiment(self.scenario, theta, result).end.value
            except Exception as error:  # the user's code can raise anything
                yield Finding(what, False, in_words(located(error)))
                continue
            yield Finding(what, True, f"ended: {ended}")

    def _controller(self) -> Iterator[Finding]:
        if self.scenario.controller is not None:
            made = self.scenario.controller(self.theta.copy())
            missing = [n for n in ("T_s", "move") if not hasattr(made, n)]
            words = f"it has no {' and no '.join(missing)}" if missing else type(made).__name__
            yield Finding("controller", not missing, words)
        if self.scenario.settings is not None:
            settings = self.scenario.settings(self.theta.copy())
            json.dumps(jsonable(settings), allow_nan=False)
            yield Finding("settings", True, f"{len(settings)} for the export")

    def _stored(self) -> Iterator[Finding]:
        content = encode(self._ran())
        same = decode(content) == self._ran()
        yield Finding("study file", same, f"{len(content) / 1000:.0f} kB an experiment, unpacked")


def run(
    source: str,
    isolated: Callable[[Scenario], Scenario],
    *,
    theta: str | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Check a scenario and print the findings; return 1 if anything is wrong, else 0.

    Args:
        source: Source of the scenario.
        isolated: Function that moves its runs into a separate process.
        theta: θ of the trial run as text; None for the middle of the box.
        out: File of the picture; None for the usual one.
        as_json: Whether to print JSON.

    Raises:
        SettingsError: If θ or the file of the picture is invalid.
    """
    try:
        scenario = isolated(load(source))
        tried = middle_of(scenario) if theta is None else None
    except Exception as error:  # raised by the user's file: report it as a finding
        found = [Finding("scenario", False, in_words(located(error)))]
        return _end(source, None, found, None, as_json=as_json)
    if tried is None:
        assert theta is not None
        tried = start_of(theta, scenario)
    checkup = Checkup(scenario, tried)
    picture = picture_at(f"check-{scenario.name}.png" if out is None else out)
    with Console(stderr=True, emoji=False).status("") as status:
        for words, step in checkup.steps():
            status.update(f"{words} …{_FIRST if words == 'running θ' else ''}")
            step()
        status.update("drawing …")
        drawn = picture if _draw(checkup, picture) else None
    return _end(source, checkup, checkup.findings, drawn, as_json=as_json)


def _draw(checkup: Checkup, path: Path) -> bool:
    """Draw the panels of the trial run; return whether there is a picture."""
    experiment = checkup.experiment
    if experiment is None or not len(experiment.t) or checkup.is_rig:
        return False
    # Imported here: plotting takes half a second to import.
    from prefcal_app.report.trajectories import alone
    from prefcal_scenarios.presentation.style import save

    buffer = BytesIO()
    try:
        save(alone(checkup.scenario, experiment), buffer)
        put(path, buffer.getvalue())
    except Exception as error:  # panels are the user's code: they can raise anything
        checkup.findings.append(Finding("picture", False, in_words(located(error))))
        return False
    return True


def _end(
    source: str,
    checkup: Checkup | None,
    findings: list[Finding],
    picture: Path | None,
    *,
    as_json: bool,
) -> int:
    """Print the result; return the exit code."""
    failed = sum(finding.ok is False for finding in findings)
    if as_json:
        content = {
            "ok": not failed,
            "scenario": source,
            "theta": None if checkup is None else checkup.scenario.space.named(checkup.theta),
            "checks": [asdict(finding) for finding in findings],
            "picture": None if picture is None else str(picture),
        }
        print(json.dumps(content), flush=True)
        return int(bool(failed))
    console = Console(emoji=False)
    _print_findings(checkup, findings, console)
    if picture is not None:
        console.print(f"Picture: {picture}", soft_wrap=True, markup=False, highlight=False)
    ran = checkup is not None and (checkup.experiment is not None or checkup.is_live)
    verdict = _verdict(source, failed, sum(f.ok is not None for f in findings), ran=ran)
    console.print(verdict, soft_wrap=True, markup=False, highlight=False)
    return int(bool(failed))


def _print_findings(checkup: Checkup | None, findings: list[Finding], console: Console) -> None:
    """Print the scenario and θ, and a line for each check."""
    if checkup is not None:
        title = Text(printable(checkup.scenario.title), style="bold")
        console.print(title, Text(theta_text(checkup.scenario.space, checkup.theta)), sep="\n")
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold", max_width=28)
    table.add_column(overflow="fold")
    for finding in findings:
        sign, style = _SIGNS[finding.ok]
        lines = "\n".join(map(printable, finding.words.splitlines()))
        words = Text(lines, style="" if finding.ok is not None else "dim")
        table.add_row(Text(sign, style=style), Text(printable(finding.what)), words)
    console.print(table)


def _verdict(source: str, wrong: int, count: int, *, ran: bool) -> str:
    if wrong and not ran:
        return "Nothing else can be checked without a run: fix this and check again."
    if wrong:
        return f"{wrong} of {count} checks failed: fix what is marked ✗ and check again."
    return f"All in order. Start with: {shlex.join(['prefcal', 'calibrate', *words_of(source)])}"


def middle_of(scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the allowed θ nearest to the middle of the box, physical, shape (n,).

    Raises:
        ScenarioError: If the constraints allow none of many random θ.
    """
    space = scenario.space
    lower, upper = space.corners
    middle = (lower + upper) / 2
    if space.allows(space.decode(middle)):
        return space.decode(middle)
    draws = lower + np.random.default_rng(0).random((_DRAWS, len(space))) * (upper - lower)
    ordered = draws[np.argsort(np.sum((draws - middle) ** 2, axis=1))]
    for z in ordered:
        if space.allows(space.decode(z)):
            return space.decode(z)
    names = ", ".join(constraint.name for constraint in space.constraints)
    raise ScenarioError(f"the constraints ({names}) allow none of {_DRAWS} random θ")


def _live(rig: LiveRig, theta: Float[np.ndarray, " n"]) -> Iterator[Finding]:
    """Read a live plant, and yield whether a run could begin; nothing is written."""
    try:
        changes, left = rig.look(theta), rig.left
    except ConnectionLostError as error:
        yield Finding("plant", False, f"the server is not reachable: {error}")
        return
    except LiveError as error:
        yield Finding("plant", False, str(error))
        return
    finally:
        rig.plant.close()
    shown = (f"{c.name} = {quantity(c.old, c.unit)}" for c in changes)
    yield Finding("plant", True, f"it is reachable and has {', '.join(shown)}")
    if left:
        values = ", ".join(f"{name} = {value:g}" for name, value in left.items())
        yield Finding("old values", None, f"the next start restores those of a run: {values}")
    yield Finding("run", None, "this is a live plant: nothing is written to it by a check")


def _channels(channels: Channels) -> Iterator[Finding]:
    for kind in ("x", "u", "y"):
        names = [channel.name for channel in getattr(channels, kind)]
        twice = sorted({name for name in names if names.count(name) > 1})
        units = [c.label for c in getattr(channels, kind)]
        words = f"{twice} more than once: give them different names" if twice else ", ".join(units)
        yield Finding(KINDS[kind], not twice, words or "none")


def _kpi(kpi: KPI, experiment: Experiment) -> Finding:
    text = with_unit(measured(kpi, experiment), kpi.unit)
    met = {True: ", met", False: ", not met", None: ""}[kpi.met_by(experiment)]
    return Finding(f"KPI {kpi.name!r}", True, f"{text}; {_GOALS[kpi.goal]}{met}")


def _made_up(rig: Rig, theta: Float[np.ndarray, " n"]) -> Experiment:
    """Return an experiment of a rig made from an invented record with constant channels."""
    columns = rig.columns
    values = [_plausible(rig, c.name, c.low, c.high) for c in rig.recorded]
    rows = [[f"{t:g}", *(f"{v!r}" for v in values)] for t in range(60)]
    text = columns.template + "\n".join(",".join(row) for row in rows) + "\n"
    try:
        return rig.read(text, theta)
    except RecordError as error:
        raise ScenarioError(f"a made-up record is refused: {error}") from error


def _plausible(rig: Rig, name: str, low: float, high: float) -> float:
    limits: Sequence[float] = rig.ranges.get(name, (low, high))
    finite = [float(v) for v in limits if np.isfinite(v)]
    return sum(finite) / len(finite) if finite else 1.0


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    return bool(np.all(a == b))


def _range_of(knob: Knob) -> str:
    """Return the name and the range of a knob."""
    scale = ", log" if knob.scale == "log10" else ""
    return f"{knob.name} ({number(knob.low)} to {quantity(knob.high, knob.unit)}{scale})"
