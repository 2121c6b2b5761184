"""Run `prefcal check`, one trial run that shows everything a study relies on, and `prefcal scenarios`."""

import json
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.table import Table
from rich.text import Text
from typer import echo

from prefcal_app.report.export import STATE_SETTINGS, jsonable
from prefcal_app.terminal.showing import compile_aloud, say
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channels, End, Experiment, check_returned
from prefcal_env.experiments.kpis import every_tracking_kpi
from prefcal_env.experiments.panels import KINDS, by_maneuver
from prefcal_env.preferences.answer import Answer, Calibrator
from prefcal_env.sources import Run, Source
from prefcal_env.study.fold import decode, encode
from prefcal_env.wording import as_exception, in_words, locate
from prefcal_scenarios.catalog import load
from prefcal_scenarios.described.description import words_of
from prefcal_scenarios.isolated import isolation
from prefcal_scenarios.names import BUILT_IN, CLOSED_LOOPS, is_described, is_own
from prefcal_scenarios.runs import grouped
from prefcal_scenarios.scenario import (
    Scenario,
    check_experiment,
    kpi_problems,
    theta_problems,
    with_found_kpis,
)
from prefcal_scenarios.wording import (
    measured,
    number,
    picture_at,
    printable,
    printable_lines,
    put,
    quantity,
    theta_text,
    with_unit,
)

from .choices import start_of
from .options import CheckOptions
from .studies.files import as_text, completed

# --- Check a scenario with one trial run: everything about it that a study relies on.

_SIGNS = {True: ("✓", "green"), False: ("✗", "bold red"), None: ("·", "dim")}
_PATIENCE = 30.0  # seconds that runs of one knob at a time may take
_NAMED = 3  # number of KPIs that are named of a reference, the most important ones
_DRAWS = 2000  # number of random θ to try if the constraints exclude the middle of the box
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
    """Checks of one scenario, in order; later checks reuse the trial run."""

    scenario: Scenario
    theta: Float[np.ndarray, " n"]  # θ of the trial run, physical, shape (n,)
    experiment: Experiment | None = None
    in_python: bool = False  # whether a person's Python file states the scenario
    findings: list[Finding] = field(default_factory=list)
    clock: Callable[[], float] = time.perf_counter  # returns the time in seconds
    took: float = 0.0  # duration of the trial run, in seconds

    def check(self, tell: Callable[[str], None]) -> None:
        """Take all steps, each of which adds its findings; `tell` is told what is being done."""
        for words, what, step in (
            ("looking at the knobs", "knobs", self._knobs),
            ("running θ", "run", self._run),
            ("looking at its record", "record", self._record),
            ("looking at the panels", "panels", self._panels),
            ("looking at the KPIs", "KPIs", self._kpis),
            ("computing the cost", "cost", self._cost),
            ("asking the calibrators", "calibrators", self._calibrators),
            ("running θ once more", "same again", self._again),
            ("moving one knob at a time", "knobs alone", self._alone),
            ("running the references", "references", self._references),
            ("making the controller", "controller", self._controller),
            ("storing the experiment", "study file", self._stored),
        ):
            if self.experiment is None and what not in ("knobs", "run"):
                return
            tell(f"{words} …")
            try:
                self.findings += step()
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # a user's code can raise anything
                self.findings.append(Finding(what, False, in_words(as_exception(error, "it"))))

    def _ran(self) -> Experiment:
        assert self.experiment is not None
        return self.experiment

    def _knobs(self) -> Iterator[Finding]:
        space = self.scenario.space
        ranges = [
            f"{knob.name} ({number(knob.low)} to {quantity(knob.high, knob.unit)}"
            f"{', log' if knob.scale == 'log10' else ''})"
            for knob in space
        ]
        yield Finding("knobs", True, f"{len(space)}: {', '.join(ranges)}")
        if self.scenario.brief:
            yield Finding("brief", None, " ".join(self.scenario.brief.split()))
        if not space.allows(self.theta):
            yield Finding("constraints", False, f"θ = {space.named(self.theta)} is not allowed")

    def _run(self) -> Iterator[Finding]:
        start, source = self.clock(), self.scenario.source
        run = source.begin(self.theta.copy(), seed=0)
        result: object = None if run.waits else run.advance()
        if run.waits:  # a live plant waits only once it has been looked at
            self.experiment = source.example(self.theta)
            if self.experiment is None:
                yield from _asked(source, run)
                source.close()
            else:
                yield Finding("run", None, "only you can run this rig: a made-up record is checked")
            return
        took = self.took = self.clock() - start
        experiment = self.experiment = check_returned(result)
        self.scenario = with_found_kpis(self.scenario, experiment)
        bad = experiment.end.interrupted
        words = f"{took:.2g} s, ended: {experiment.end.value}"
        more = ": try a θ that keeps the limits (--theta), or change ranges, limits or the start"
        yield Finding("run", not bad, f"{words}{more if bad else ''}")
        wrong = list(theta_problems(self.scenario.space, self.theta, experiment))
        rounded = not wrong and not np.allclose(experiment.theta, self.theta, rtol=1e-9, atol=0)
        words = f"it ran {experiment.theta.tolist()}: rounded" if rounded else "as requested"
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
        words = f"{len(e.t)} instants over {until}, {len(e.t_control)} steps{held}{variants}"
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
            seen = [float(value) for value in plot.values(e) if np.isfinite(value)]
            if not seen:
                yield Finding(what, False, "it has no finite value")
                continue
            low, high = quantity(min(seen), ""), quantity(max(seen), plot.channel.unit)
            yield Finding(what, True, f"one of the {KINDS[plot.kind]}, from {low} to {high}")

    def _kpis(self) -> Iterator[Finding]:
        e = self._ran()
        for words in kpi_problems(self.scenario, e.kpis):
            yield Finding("KPIs", e.end.interrupted and None, words)
        for kpi in self.scenario.kpis:
            if kpi.unstable(e):
                words = "the loop is not stable with this θ, so it has no such margin"
                yield Finding(f"KPI {kpi.name!r}", None, f"{words}; {_GOALS[kpi.goal]}")
            elif kpi.name in e.kpis:
                text = with_unit(measured(kpi, e), kpi.unit)
                met = {True: ", met", False: ", not met", None: ""}[kpi.met_by(e)]
                yield Finding(f"KPI {kpi.name!r}", True, f"{text}; {_GOALS[kpi.goal]}{met}")
        known = {kpi.name for kpi in self.scenario.kpis} | every_tracking_kpi(e.channels).keys()
        known |= {kpi.name for _, kpi in grouped(self.scenario.shown_kpis, e)}
        spare = sorted(set(e.kpis) - known)
        if spare:
            yield Finding("other KPIs", None, f"returned, but not shown anywhere: {', '.join(spare)}")

    def _cost(self) -> Iterator[Finding]:
        if self.scenario.cost is None:
            yield Finding("cost", None, "none: only people, or calibrators, can compare")
            return
        value = float(self.scenario.cost(self._ran()))
        yield Finding("cost", bool(np.isfinite(value)), f"{value:.4g}")

    def _calibrators(self) -> Iterator[Finding]:
        for name, make in self.scenario.calibrators.items():
            yield _tried(f"calibrator {name!r}", partial(self._twice, make))

    def _twice(self, make: Callable[[int], Calibrator[Experiment]]) -> str:
        given = Answer.of(make(0).prefer(self._ran(), self._ran())).preference
        return f"the same experiment twice: {'abstains' if given is None else given.name.lower()}"

    def _again(self) -> Iterator[Finding]:
        if self.scenario.source.asks:
            return
        first, second = self._ran(), self.scenario.run(self.theta.copy(), seed=0)
        names = [f.name for f in fields(Experiment) if f.name not in ("solve_time", "runs")]
        other = [n for n in names if not _same(getattr(first, n), getattr(second, n))]
        if first == second or (not other and first.runs == second.runs):  # a KPI that is NaN equals nothing
            yield Finding("same again", True, "the same θ and seed give the same experiment")
            return
        where = ", ".join(other) or "runs"
        words = f"the same θ and seed give another experiment: {where} differ"
        yield Finding("same again", False, f"{words}; take randomness from the seed only")

    def _alone(self) -> Iterator[Finding]:
        """Yield the knobs of which neither end of the range, alone, changes anything in the run."""
        space, source, first = self.scenario.space, self.scenario.source, self._ran()
        if source.asks or source.candidates is not None or 2 * len(space) * self.took > _PATIENCE:
            return
        for i, knob in enumerate(space):
            ends = [np.where(np.arange(len(space)) == i, end, self.theta) for end in (knob.low, knob.high)]
            ends = [theta for theta in ends if space.allows(theta) and theta[i] != self.theta[i]]
            try:
                runs = [self.scenario.run(theta, seed=0) for theta in ends]
            except Exception:  # what a person's code raises there is a change, too
                continue
            if runs and all(_same(e.kpis, first.kpis) and _same(e.u, first.u) for e in runs):
                span = f"{number(knob.low)} to {quantity(knob.high, knob.unit)}"
                words = f"no KPI and no input changes over its range, {span}, with the others as they are"
                yield Finding(f"knob {knob.name!r}", None, f"{words}: is it used?")

    def _references(self) -> Iterator[Finding]:
        ends: list[End] = []
        for name, theta in self.scenario.references.items():
            what = f"reference {name!r}"
            if self.scenario.source.asks:
                yield Finding(what, None, "not run: this is a rig")
            else:
                found = _tried(what, partial(self._reference, np.array(theta, dtype=float), ends))
                bad = found.ok and ends[-1].interrupted
                yield replace(found, ok=None) if bad else found
        if ends and all(end.interrupted for end in ends):
            yield Finding("references", False, "each of them is interrupted: none of them works here")

    def _reference(self, theta: Float[np.ndarray, " n"], ends: list[End]) -> str:
        result: object = self.scenario.run(theta, seed=0)
        made = check_experiment(self.scenario, theta, result)
        ends.append(made.end)
        shown = () if made.end.interrupted else self.scenario.shown_kpis
        known = [kpi for kpi in shown if kpi.name in made.kpis][:_NAMED]
        values = (f"{kpi.name} {with_unit(measured(kpi, made), kpi.unit)}" for kpi in known)
        return "; ".join([f"ended: {made.end.value}", *values])

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
        elif self.in_python and not self.scenario.source.asks:
            none = "none, so best.json will hold no controller, and prefcal export cannot write it"
            yield Finding("settings", None, f"{none}: {STATE_SETTINGS}")

    def _stored(self) -> Iterator[Finding]:
        content = encode(self._ran())
        same = decode(content) == self._ran()
        yield Finding("study file", same, f"{len(content) / 1000:.0f} kB an experiment, unpacked")


def run(typed: Mapping[str, Any]) -> int:
    """Check a scenario as typed and print the findings; return 1 if anything is wrong, else 0."""
    options, source = CheckOptions(**typed), completed(typed)["scenario"]
    with isolation(source, options.run_timeout) as isolated:
        try:
            scenario = isolated(load(source))
            middle = middle_of(scenario) if options.theta is None else None
        except Exception as error:  # raised by the user's file: report it as a finding
            return _end(source, None, [_failed("scenario", error)], None, as_json=options.json)
        theta = start_of(options.theta or "", scenario) if middle is None else middle
        checkup = Checkup(scenario, theta, in_python=is_own(source) and not is_described(source))
        picture = picture_at(options.out or f"check-{scenario.name}.png")
        messages = Console(stderr=True, emoji=False)
        compile_aloud(scenario, messages)
        with messages.status("") as status:
            checkup.check(status.update)
            status.update("drawing …")
            drawn = _draw(checkup, picture)
        return _end(source, checkup, checkup.findings, drawn, as_json=options.json)


def _failed(what: str, error: Exception) -> Finding:
    """Return what an error of the user's code says, and the line that raised it."""
    return Finding(what, False, in_words(locate(error)))


def _tried(what: str, check: Callable[[], str]) -> Finding:
    """Return what the user's code gives, in words; it can raise anything."""
    try:
        return Finding(what, True, check())
    except Exception as error:
        return _failed(what, error)


def _draw(checkup: Checkup, path: Path) -> Path | None:
    """Draw the panels of the trial run; return the picture, if there is one."""
    experiment = checkup.experiment
    if experiment is None or not len(experiment.t) or checkup.scenario.source.asks:
        return None
    # Imported here: plotting takes half a second to import.
    from prefcal_app.report.pictures import alone
    from prefcal_scenarios.style import png

    try:
        put(path, png(alone(checkup.scenario, experiment)))
    except Exception as error:  # panels are the user's code
        checkup.findings.append(_failed("picture", error))
        return None
    return path


def _end(
    source: str, checkup: Checkup | None, findings: Sequence[Finding], picture: Path | None, *, as_json: bool
) -> int:
    """Print the result; return the exit code."""
    wrong = sum(finding.ok is False for finding in findings)
    if as_json:
        content = {
            "ok": not wrong,
            "scenario": source,
            "theta": None if checkup is None else checkup.scenario.space.named(checkup.theta),
            "checks": [asdict(finding) for finding in findings],
            "picture": None if picture is None else str(picture),
        }
        print(as_text(content), flush=True)
        return int(bool(wrong))
    console = Console(emoji=False)
    if checkup is not None:
        console.print(Text(printable(checkup.scenario.title), style="bold"))
        console.print(Text(theta_text(checkup.scenario.space, checkup.theta)))
    console.print(_table(findings))
    if picture is not None:
        say(console, f"Picture: {picture}")
    ran = checkup is not None and (
        checkup.experiment is not None or checkup.scenario.source.asks == "confirm"
    )
    if wrong and not ran:
        say(console, "Nothing else can be checked without a run: fix this and check again.")
    elif wrong:
        count = sum(finding.ok is not None for finding in findings)
        say(console, f"{wrong} of {count} checks failed: fix what is marked ✗ and check again.")
    else:
        words = shlex.join(["prefcal", "calibrate", *words_of(source)])
        say(console, f"All in order. Start with: {words}")
    return int(bool(wrong))


def _table(findings: Sequence[Finding]) -> Table:
    """Return a line for each check."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold", max_width=28)
    table.add_column(overflow="fold")
    for finding in findings:
        sign, style = _SIGNS[finding.ok]
        words = Text(printable_lines(finding.words), style="" if finding.ok is not None else "dim")
        table.add_row(Text(sign, style=style), Text(printable(finding.what)), words)
    return table


def middle_of(scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the allowed θ nearest to the middle of the box, physical, shape (n,)."""
    space = scenario.space
    lower, upper = space.corners
    middle = (lower + upper) / 2
    draws = lower + np.random.default_rng(0).random((_DRAWS, len(space))) * (upper - lower)
    ordered = draws[np.argsort(np.sum((draws - middle) ** 2, axis=1))]
    for z in (middle, *ordered):
        if space.allows(space.decode(z)):
            return space.decode(z)
    names = ", ".join(constraint.name for constraint in space.constraints)
    raise ScenarioError(f"the constraints ({names}) allow none of {_DRAWS} random θ")


def _asked(source: Source, run: Run) -> Iterator[Finding]:
    """Yield whether a run on a plant could begin; nothing is written."""
    if source.asks == "record":
        yield Finding("run", None, "only a person can run it, so nothing else is checked")
        return
    if run.changes is None:
        yield Finding("plant", False, run.problem)
        return
    known = [c for c in run.changes if not np.isnan(c.old)]
    shown = (f"{each.name} = {quantity(each.old, each.unit)}" for each in known)
    has = f"it is reachable and has {', '.join(shown)}" if known else "it does not say what it has now"
    yield Finding("plant", True, has)
    if left := source.left:
        values = ", ".join(f"{name} = {value:g}" for name, value in left.items())
        yield Finding("old values", None, f"the next start restores those of a run: {values}")
    yield Finding("run", None, "this is a live plant: nothing is written to it by a check")


def _channels(channels: Channels) -> Iterator[Finding]:
    for kind in ("x", "u", "y"):
        names = [channel.name for channel in getattr(channels, kind)]
        twice = sorted({name for name in names if names.count(name) > 1})
        labels = ", ".join(channel.label for channel in getattr(channels, kind))
        words = f"{twice} more than once: give them different names" if twice else labels
        yield Finding(KINDS[kind], not twice, words or "none")


def _same(a: object, b: object) -> bool:
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_same(np.array(a[name]), np.array(b[name])) for name in a)
    return bool(np.all(a == b))


# --- Run `prefcal scenarios`: the scenarios that have a name, and what one of them is about.


def describe(name: str) -> None:
    """Print the task, the knobs and the KPIs of a scenario. Raises ScenarioError if there is none."""
    from prefcal_app.terminal.showing import show_scenario  # takes half a second to import

    show_scenario(load(name))


def print_all() -> None:
    """Print the scenarios that `prefcal calibrate` knows by name."""
    cases = [known for known in BUILT_IN if known not in CLOSED_LOOPS]
    width = max(map(len, cases)) + 2
    for known in cases:
        scenario = load(known)
        echo(f"{known:<{width}}{scenario.title}; knobs {', '.join(scenario.space.names)}")
    echo(f"Closed loops: {', '.join(CLOSED_LOOPS)} (`prefcal scenarios servo` describes one)")
    echo("Random closed loops: loop-1, loop-2, ... (any seed)")
    echo("Your own: path/to/own.py:name, where name is a prefcal_scenarios.Scenario.")
