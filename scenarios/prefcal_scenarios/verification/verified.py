"""What a verification leaves beside its best.json, as plain data for people and programs."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from prefcal_env.controllers.margins import UNCONSTRAINED, UNSTABLE, Margins
from prefcal_env.disk import digest_of, write_durably
from prefcal_env.errors import ScenarioError
from prefcal_env.plain import from_plain, to_plain
from prefcal_scenarios.presentation.wording import labeled, limits_text, number, quantity
from prefcal_scenarios.scenario import KPI, Scenario

from .factor import Factor
from .result import Effect, Robustness, Verification, VerifiedRun

EFFECTS = 4
"""Number of factors that people are shown, those that hurt most."""
FILE, BEST = "verification.json", "best.json"
"""Names of the files of a verification and of its tuning, in one folder."""
_NAMED = 6
"""Number of values of a run that are named."""


@dataclass(frozen=True, slots=True)
class WorstRun:
    """One of the worst random runs.

    Args:
        words: Which stated limits it loses, or that it is within them.
        values: Values that differ from the nominal ones, by name, the one that moved most within its
            range first.
        seed: Seed of the run.
        verdict: "acceptable" or "not acceptable"; "" if nobody was asked.
        units: Units of the values by name, those that have one.
    """

    words: str
    values: dict[str, float]
    seed: int
    verdict: str = ""
    units: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, run: VerifiedRun, factors: Sequence[Factor]) -> "WorstRun":
        """Return one of the worst runs, with the factors that varied."""

        def moved(f: Factor) -> float:
            return abs(run.values[f.name] - f.nominal) / max(f.high - f.nominal, f.nominal - f.low)

        values = {f.name: run.values[f.name] for f in sorted(factors, key=moved, reverse=True)}
        words = run.words if run.problems else f"most different from nominal, {run.words}"
        return cls(words, values, run.seed, units={f.name: f.unit for f in factors if f.unit})

    @property
    def text(self) -> str:
        """Return the values that moved most, with three significant digits and units."""
        shown = list(self.values.items())[:_NAMED]
        words = [f"{n} {quantity(float(f'{v:.3g}'), self.units.get(n, ''))}" for n, v in shown]
        others = len(self.values) - len(shown)
        return ", ".join(words) + (f" and {others} other{'s' if others > 1 else ''}" if others else "")


@dataclass(frozen=True, slots=True)
class Verified:
    """What a verification says. Texts are as people read them; "–" is unknown.

    Args:
        statement: How sure it is that the limits are kept, in a sentence.
        limits_kept: What the stated limits are, in a sentence.
        share: Share of the runs that kept them; None without any.
        bound: What the probability of not keeping them is below, with 95 % confidence.
        runs: Number of random runs.
        planned: Number that was asked for.
        baseline: What the tuning is compared with, such as "current tuning"; "" if that is unknown.
        kpis: A row for each KPI: title with unit, objective, nominal value, 5 % and 95 % quantile,
            then the same three of the baseline, if it is known.
        margins: A row for each margin: name with unit, value, then that of the baseline, likewise.
            Empty if there are none.
        basis: What the margins hold for, or why there are none, in a sentence.
        effects: What each factor does alone, the one that hurts most first, a text each.
        worst: The worst random runs, the worst first.
        varied: What varied, with ranges and units, a text each.
        left_out: What did not, a sentence each.
        scenario: Name of the scenario.
        version: Version of prefcal.
        best: SHA-256 of the best.json, in hexadecimal digits.
    """

    statement: str
    limits_kept: str
    share: float | None
    bound: float
    runs: int
    planned: int
    baseline: str
    kpis: tuple[tuple[str, ...], ...]
    margins: tuple[tuple[str, ...], ...]
    basis: str
    effects: tuple[str, ...]
    worst: tuple[WorstRun, ...]
    varied: tuple[str, ...]
    left_out: tuple[str, ...]
    scenario: str
    version: str
    best: str

    @classmethod
    def of(
        cls, found: Verification, scenario: Scenario, baseline: str, version: str, best: str
    ) -> "Verified":
        """Return what a verification of a scenario's tuning says; see the class for the others."""
        both = [found.tuning, *([found.before] if found.before else [])]
        margins, basis = margins_said([each.margins for each in both], found.tuning.time_unit)
        left = bool(baseline and found.runs) and found.before is None
        alone = f" Stopped before the {baseline} ran on these plants." if left else ""
        return cls(
            statement=found.statement + alone,
            limits_kept=found.limits,
            share=found.share if found.runs else None,
            bound=found.bound,
            runs=len(found.runs),
            planned=found.planned,
            baseline=baseline if found.before else "",
            kpis=tuple(_kpi_row(kpi, both) for kpi in found.kpis),
            margins=margins,
            basis=basis,
            effects=tuple(map(_effect, found.effects)),
            worst=tuple(WorstRun.of(run, found.factors) for run in found.worst()),
            varied=tuple(f"{f.name} {_range(f)}" for f in found.factors),
            left_out=(*found.left_out, *(f"{name} changes no KPI here" for name in found.idle)),
            scenario=found.scenario,
            version=version,
            best=best,
        )

    @property
    def kpi_columns(self) -> tuple[str, ...]:
        """Return the headings of the rows of `kpis`."""
        before = (f"{self.baseline}, nominal", "5 %", "95 %") if self.baseline else ()
        return "KPI", "objective", "nominal", "5 %", "95 %", *before

    @property
    def margin_columns(self) -> tuple[str, ...]:
        """Return the headings of the rows of `margins`."""
        return "margin", "result", *((self.baseline,) if self.baseline else ())

    @classmethod
    def read(cls, folder: str | Path) -> "Verified | None":
        """Return what was verified of the best.json in a folder; None if nothing, or of another one.

        Raises:
            ScenarioError: If the file is there, but cannot be read.
        """
        path, tuning = Path(folder) / FILE, Path(folder) / BEST
        if not (path.is_file() and tuning.is_file()):
            return None
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise ScenarioError(f"cannot read {str(path)!r}: {error}") from error
        found = from_plain(content, cls, ScenarioError, repr(str(path)))
        return found if found.best == digest_of(tuning) else None

    def write(self, folder: str | Path) -> None:
        """Write the file, durably. Raises OSError."""
        text = json.dumps(to_plain(self), indent=2, ensure_ascii=False, allow_nan=False)
        write_durably(Path(folder) / FILE, f"{text}\n".encode())


def _kpi_row(kpi: KPI, tunings: list[Robustness]) -> tuple[str, ...]:
    cells = [labeled(kpi.title, kpi.unit), limits_text(kpi)]
    for each in tunings:
        values = (each.nominal.kpis.get(kpi.name), *each.quantiles(kpi.name))
        cells += [number(None if value is None else kpi.read(value)) for value in values]
    return tuple(cells)


def margins_said(found: Sequence[Margins | str], time_unit: str) -> tuple[tuple[tuple[str, ...], ...], str]:
    """Return `margins` and `basis` of `Verified`, given margins of the tuning and perhaps of the baseline."""
    first = found[0]
    if isinstance(first, str):
        return (), first
    stable = "; this loop is NOT STABLE" if first == UNSTABLE else ""
    return tuple(_margin_rows(found, time_unit)), f"margins of {UNCONSTRAINED}{stable}"


def _margin_rows(found: Sequence[Margins | str], time_unit: str) -> Iterator[tuple[str, ...]]:
    """Yield a row for each margin; a gain margin has a second number if the gain must not fall by more."""
    for name, read in (
        ("gain margin [dB]", _gain_margin),
        ("phase margin [°]", lambda m: number(m.phase)),
        (labeled("delay margin", time_unit), lambda m: number(m.delay)),
        ("largest sensitivity M_s", lambda m: number(m.M_s)),
        ("disk margin", lambda m: number(m.disk)),
    ):
        yield name, *(read(m) if isinstance(m, Margins) else number(None) for m in found)


def _gain_margin(m: Margins) -> str:
    down = f", {number(20 * np.log10(m.gain_reduction))}" if 0 < m.gain_reduction < 1 else ""
    return number(20 * np.log10(m.gain)) + down


def _range(factor: Factor) -> str:
    return f"{number(factor.low)} to {quantity(factor.high, factor.unit)}"


def _effect(each: Effect) -> str:
    name = f"{each.factor.name} ({_range(each.factor)})"
    if np.isinf(each.worsening):
        return f"{name}: {'; '.join(each.run.problems)}"
    if not each.kpi:
        return f"{name}: no KPI gets worse"
    return f"{name}: {each.kpi} by {100 * each.worsening:.0f} % of its range in all runs"
