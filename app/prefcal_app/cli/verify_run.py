"""Run `prefcal verify`: vary the plant of a tuning, and print what came of it."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from prefcal_app.report.export import Tuning, jsonable, tuning_of
from prefcal_app.terminal.showing import say
from prefcal_env.controllers.margins import Margins
from prefcal_env.errors import SettingsError
from prefcal_scenarios.described.words import listed
from prefcal_scenarios.presentation.wording import labeled, limits_text, number, printable, quantity
from prefcal_scenarios.verification import Verification, verify
from prefcal_scenarios.verification.result import Effect, VerifiedRun

from .studies.files import as_text

if TYPE_CHECKING:
    from .commands import VerifyOptions

_EFFECTS, _WORST = 4, 3


def run(options: "VerifyOptions") -> int:
    """Verify the tuning; return the exit code.

    Raises:
        PrefcalError: If the file or an option does not fit, or nothing of the scenario can vary.
    """
    tuning = tuning_of(options.best)
    found = verify(
        tuning.scenario,
        tuning.theta,
        options.runs,
        start=tuning.before,
        seed=options.seed,
        ranges=dict(_range(text) for text in options.range),
        vary=listed([options.only]) or None,
        jobs=options.jobs,
        timeout=options.run_timeout,
        progress=not options.json,
    )
    if options.json:
        print(as_text(jsonable(as_dict(found))), flush=True)
    else:
        show(found, tuning, Console(emoji=False))
    return 0


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


def as_dict(found: Verification) -> dict[str, Any]:
    """Return a verification as plain data: what is shown, and every run."""
    plain = {
        name: getattr(found, name)
        for name in ("scenario", "theta", "start", "planned", "seed", "complete", "share", "bound")
    }
    runs = {name: [_plain(r) for r in getattr(found, name)] for name in ("runs", "alone", "before")}
    margins = {
        name: each if isinstance(each, str) else asdict(each)
        for name in ("margins", "margins_before")
        for each in [getattr(found, name)]
    }
    effects = [
        {"factor": e.factor.name, "worsening": e.worsening, "kpi": e.kpi, "problems": e.worst.problems}
        for e in found.effects
    ]
    more = {
        "statement": found.statement,
        "confidence": found.confidence,
        "factors": [asdict(factor) for factor in found.factors],
        "not varied": found.left_out,
        "nominal": _plain(found.nominal),
        "effects": effects,
        "worst": [_plain(each) for each in found.worst(_WORST)],
    }
    return plain | more | margins | runs


def _plain(each: VerifiedRun) -> dict[str, Any]:
    return {
        "values": dict(each.values),
        "seed": each.seed,
        "end": each.end.value,
        "kpis": dict(each.kpis),
        "problems": each.problems,
    }


def show(found: Verification, tuning: Tuning, console: Console) -> None:
    """Print a verification in a terminal."""
    say(console, found.statement, found.limits)
    if found.nominal.problems:
        say(console, f"On the nominal plant, too: {'; '.join(found.nominal.problems)}.")
    columns = ["", "objective", "nominal", "5 % to 95 %"]
    if found.before:
        columns += [f"{tuning.baseline}, nominal", "5 % to 95 %"]
    console.print(_table(columns, _rows(found)))
    for line in _lines(found):
        say(console, line)


def _rows(found: Verification) -> Iterator[list[str]]:
    """Yield a row for each KPI, then the margins."""
    for kpi in found.kpis:
        row = [labeled(kpi.title, kpi.unit), limits_text(kpi)]
        runs = [(found.nominal, False)]
        if found.nominal_before is not None and found.before:
            runs.append((found.nominal_before, True))
        for nominal, before in runs:
            low, _, high = found.quantiles(kpi.name, before=before)
            value = nominal.kpis.get(kpi.name)
            ends = (number(kpi.read(end)) for end in (low, high))
            row += [number(None if value is None else kpi.read(value)), " to ".join(ends)]
        yield row
    both = [found.margins, *([found.margins_before] if found.before else [])]
    if isinstance(found.margins, Margins):
        for name in ("gain margin [dB]", "phase margin [°]", "delay margin", "M_s", "disk margin"):
            cells = [_margin(name, m) if isinstance(m, Margins) else "–" for m in both]
            yield [name, "", *(cell for each in cells for cell in (each, ""))]


def _margin(name: str, m: Margins) -> str:
    """Return a margin as text; a gain margin with the one for a falling gain, if there is one."""
    if name.startswith("gain"):
        down = f", {number(20 * np.log10(m.gain_reduction))}" if 0 < m.gain_reduction < 1 else ""
        return number(20 * np.log10(m.gain)) + down
    return number({"phase": m.phase, "delay": m.delay, "M_s": m.M_s, "disk": m.disk}[name.split()[0]])


def _lines(found: Verification) -> Iterator[str]:
    """Yield what hurts most, the worst runs, and what was not varied."""
    if isinstance(found.margins, Margins):
        stable = "" if found.margins.stable else "; this loop is NOT STABLE there"
        yield f"Margins: {found.margins.basis}{stable}."
    else:
        yield f"{found.margins[:1].upper()}{found.margins[1:]}."
    if found.effects:  # they come after all random runs, and an interruption may end before
        yield "What hurts most, one at a time:"
    yield from (f"  {_effect(each)}" for each in found.effects[:_EFFECTS])
    yield f"Worst runs, of seed {found.seed}:"
    for each in found.worst(_WORST):
        values = ", ".join(f"{name} {number(value)}" for name, value in each.values.items())
        yield f"  {'; '.join(each.problems) or 'within the limits'}: {values}"
    varied = ", ".join(f"{f.name} {number(f.low)} to {quantity(f.high, f.unit)}" for f in found.factors)
    yield f"Varied: {varied}."
    yield from (f"{text[:1].upper()}{text[1:]}." for text in found.left_out)


def _effect(each: Effect) -> str:
    ends = f"{number(each.factor.low)} to {quantity(each.factor.high, each.factor.unit)}"
    if np.isinf(each.worsening):
        return f"{each.factor.name} ({ends}): {'; '.join(each.worst.problems)}"
    if not each.kpi:
        return f"{each.factor.name} ({ends}): no KPI gets worse"
    return f"{each.factor.name} ({ends}): {each.kpi} by {100 * each.worsening:.0f} % of its range in all runs"


def _table(columns: Sequence[str], rows: Iterator[list[str]]) -> Table:
    table = Table(*columns, box=None, header_style="bold")
    for row in rows:
        table.add_row(*map(printable, row))
    return table
