"""What came of a verification, as frozen data, and what follows from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import Margins
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.kpis import Result
from prefcal_scenarios.scenario import KPI

from .factor import Factor

CONFIDENCE = 0.95
_QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True, slots=True)
class VerifiedRun:
    """One run of a tuning with other values of the factors.

    Args:
        values: Values that differ from the nominal ones, by factor.
        seed: Seed of the run.
        end: Why it ended.
        kpis: KPIs by name, in their units.
        problems: Which stated limits it did not keep; empty if it kept all.
    """

    values: Mapping[str, float]
    seed: int
    end: End
    kpis: Mapping[str, float]
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Effect:
    """What one factor does alone.

    Args:
        factor: Factor.
        low: Run at its lowest value.
        high: Run at its highest value.
        worst: The worse of both.
        kpi: KPI that gets worst, "" if none gets worse.
        worsening: How much worse, as a share of the KPI's 5 to 95 % range over all runs; infinite
            if a limit is lost.
    """

    factor: Factor
    low: VerifiedRun
    high: VerifiedRun
    worst: VerifiedRun
    kpi: str
    worsening: float


@dataclass(frozen=True)
class Verification:
    """A tuning on plants that are not exactly as modeled.

    Args:
        scenario: Name of the scenario.
        theta: Tuning, physical, shape (n,).
        start: Current tuning, that it is compared with; None if it is not known.
        kpis: KPIs with their objectives.
        factors: What varied, uniformly and independently.
        left_out: What did not, a sentence each.
        planned: Number of random runs that were asked for.
        nominal: Run without variation.
        runs: Random runs, independent of each other.
        alone: Runs with the lowest and the highest value of each factor, in pairs.
        before: Random runs of `start`, with the values and seeds of `runs`.
        nominal_before: Run of `start` without variation.
        margins: Margins of the tuning on the nominal plant, or why there are none.
        margins_before: Those of `start`.
        seed: Seed of the verification.
    """

    scenario: str
    theta: Float[np.ndarray, " n"]
    start: Float[np.ndarray, " n"] | None
    kpis: tuple[KPI, ...]
    factors: tuple[Factor, ...]
    left_out: tuple[str, ...]
    planned: int
    seed: int
    nominal: VerifiedRun
    runs: tuple[VerifiedRun, ...] = ()
    alone: tuple[VerifiedRun, ...] = ()
    before: tuple[VerifiedRun, ...] = ()
    nominal_before: VerifiedRun | None = None
    margins: Margins | str = "no margins"
    margins_before: Margins | str = "no margins"
    confidence: float = field(default=CONFIDENCE)

    def with_runs(self, made: Sequence[VerifiedRun]) -> "Verification":
        """Return this with its runs: random ones, those of one factor alone, and those of `start`."""
        alone = self.planned + 2 * len(self.factors)
        parts = made[: self.planned], made[self.planned : alone], made[alone:]
        runs, one, before = map(tuple, parts)
        return replace(self, runs=runs, alone=one, before=before)

    @property
    def complete(self) -> bool:
        """Return whether all random runs of the tuning are there."""
        return len(self.runs) == self.planned

    @property
    def failed(self) -> tuple[VerifiedRun, ...]:
        """Return the random runs that did not keep the stated limits."""
        return tuple(run for run in self.runs if run.problems)

    @property
    def share(self) -> float:
        """Return the share of the random runs that kept them; NaN without any."""
        return 1 - len(self.failed) / len(self.runs) if self.runs else np.nan

    @property
    def bound(self) -> float:
        """Return what the probability of not keeping them is below, with `confidence`."""
        return most_probable(len(self.failed), len(self.runs), self.confidence)

    @property
    def statement(self) -> str:
        """Return how sure it is that the tuning holds, in a sentence."""
        count, failed = len(self.runs), len(self.failed)
        if not count:
            return "Nothing is verified: no run was completed."
        kept = f"{count - failed} of {count} runs keep the stated limits"
        early = "" if self.complete else f" (stopped early, {self.planned} were planned)"
        sure = f"below {_percent(self.bound)} with {100 * self.confidence:g} % confidence"
        return f"{kept}{early}: for plants within these ranges, the probability that one does not is {sure}."

    @property
    def limits(self) -> str:
        """Return what the stated limits are, in a sentence."""
        aims = [kpi.title for kpi in self.kpis if kpi.met(0.0) is not None]
        stated = f"the objectives of {', '.join(aims)}" if aims else "no KPI has an objective"
        never = f" Infinite nominally, which counts in no run: {', '.join(self.never)}." if self.never else ""
        return f"Stated limits: a safe end, {stated}, and nothing infinite that is finite nominally.{never}"

    @property
    def never(self) -> tuple[str, ...]:
        """Return the titles of the KPIs that are infinite even on the nominal plant."""
        kpis = (kpi for kpi in self.kpis if kpi.goal is not None)
        return tuple(kpi.title for kpi in kpis if np.isinf(self.nominal.kpis.get(kpi.name, 0.0)))

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Return what each factor does alone, the one that hurts most first."""
        pairs = zip(self.factors, self.alone[::2], self.alone[1::2], strict=False)
        found = [self._effect(factor, low, high) for factor, low, high in pairs]
        return tuple(sorted(found, key=lambda effect: -effect.worsening))

    def worst(self, count: int = 3) -> tuple[VerifiedRun, ...]:
        """Return the worst random runs: by limits that they lose, then by their worst KPI."""

        def badness(run: VerifiedRun) -> tuple[bool, int, float]:
            return run.end.interrupted, len(run.problems), self._worsening(run)[0]

        return tuple(sorted(self.runs, key=badness, reverse=True)[:count])

    def quantiles(self, kpi: str, *, before: bool = False) -> tuple[float, float, float]:
        """Return the 5 % quantile, the median and the 95 % quantile of a KPI; NaN without values.

        Args:
            kpi: Name of the KPI.
            before: Whether of the current tuning instead of this one.
        """
        runs = self.before if before else self.runs
        values = [float(run.kpis[kpi]) for run in runs if kpi in run.kpis]
        if not values:
            return (np.nan,) * 3
        low, middle, high = np.quantile(values, _QUANTILES, method="nearest").tolist()
        return low, middle, high

    def _effect(self, factor: Factor, low: VerifiedRun, high: VerifiedRun) -> Effect:
        (down, name), (up, other) = self._worsening(low), self._worsening(high)
        down = np.inf if set(low.problems) - set(self.nominal.problems) else down
        up = np.inf if set(high.problems) - set(self.nominal.problems) else up
        if up > down:
            return Effect(factor, low, high, high, other, up)
        return Effect(factor, low, high, low, name, down)

    def _worsening(self, run: VerifiedRun) -> tuple[float, str]:
        """Return by how much a KPI is worse than nominally, as a share of its range, and which one."""
        found = [(0.0, "")]
        for kpi in self.kpis:
            if kpi.goal is None or kpi.name not in run.kpis or kpi.name not in self.nominal.kpis:
                continue
            here, there = kpi.badness(run.kpis[kpi.name]), kpi.badness(self.nominal.kpis[kpi.name])
            if here > there:
                low, _, high = self.quantiles(kpi.name)
                span = max(abs(high - low), 1e-9 * abs(there), 1e-300)
                found.append((float((here - there) / span) if np.isfinite(span) else 0.0, kpi.name))
        return max(found)


def problems_of(kpis: Sequence[KPI], result: Result, nominal: Result | VerifiedRun | None) -> tuple[str, ...]:
    """Return which stated limits a run does not keep, in words.

    A run must not be interrupted, must meet each objective of a KPI, and must reach what the
    nominal run reaches: a KPI must not be infinite where it is finite nominally.
    """
    if result.end.interrupted:
        return (f"the run ended early: {result.end.value}",)
    found = []
    for kpi in kpis:
        value = result.kpis.get(kpi.name)
        reached = nominal is not None and np.isfinite(nominal.kpis.get(kpi.name, np.inf))
        if value is not None and kpi.met(float(value)) is False:
            found.append(f"{kpi.title} misses its objective")
        elif value is not None and reached and kpi.goal is not None and np.isinf(value):
            found.append(f"{kpi.title} is infinite")
    return tuple(found)


def most_probable(failed: int, count: int, confidence: float = CONFIDENCE) -> float:
    """Return the upper limit of a probability of which `failed` of `count` independent runs are seen.

    Source: Clopper, Pearson (1934), The use of confidence or fiducial limits illustrated in the
    case of the binomial, Biometrika 26; one-sided.
    """
    if failed >= count:
        return 1.0
    from scipy.stats import beta

    return float(beta.ppf(confidence, failed + 1, count - failed))


def _percent(share: float) -> str:
    """Return a share in percent, rounded up to two digits, so that what is below it stays below."""
    percent = 100 * share
    size = 10.0 ** (np.floor(np.log10(percent)) - 1)
    return f"{np.ceil(percent / size - 1e-9) * size:.3g} %"
