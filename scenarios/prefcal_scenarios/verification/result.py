"""What came of a verification, as frozen data, and what follows from it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.special import betaincinv

from prefcal_env.controllers.margins import Margins
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.kpis import Result
from prefcal_scenarios.scenario import KPI

from .factor import Factor

CONFIDENCE = 0.95


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

    @property
    def words(self) -> str:
        """Return the problems as text, for people."""
        return "; ".join(self.problems) or "within the limits"


@dataclass(frozen=True, slots=True)
class Robustness:
    """How one tuning fares.

    Args:
        theta: Tuning, physical, shape (n,).
        nominal: Run without variation.
        margins: Margins on the nominal plant, or why there are none.
        runs: Random runs, independent of each other.
        time_unit: Unit of the delay margin.
    """

    theta: Float[np.ndarray, " n"]
    nominal: VerifiedRun
    margins: Margins | str
    runs: tuple[VerifiedRun, ...] = ()
    time_unit: str = ""

    def quantiles(self, kpi: str) -> tuple[float, float]:
        """Return the 5 and 95 % quantile of the KPI of this name; NaN without values."""
        values = [float(run.kpis[kpi]) for run in self.runs if kpi in run.kpis]
        low, high = np.quantile(values or [np.nan], (0.05, 0.95), method="nearest").tolist()
        return low, high


@dataclass(frozen=True, slots=True)
class Effect:
    """What one factor does alone.

    Args:
        factor: Factor.
        run: Run at its lowest or at its highest value, the worse of both.
        kpi: Title of the KPI that gets worst, "" if none gets worse.
        worsening: How much worse, as a share of the KPI's 5 to 95 % range over all runs; infinite
            if a limit is lost.
    """

    factor: Factor
    run: VerifiedRun
    kpi: str
    worsening: float


@dataclass(frozen=True)
class Verification:
    """A tuning on plants that are not exactly as modeled.

    Args:
        scenario: Name of the scenario.
        kpis: KPIs with their objectives.
        factors: What varied, uniformly and independently.
        left_out: What did not, a sentence each.
        planned: Number of random runs that were asked for.
        tuning: How the tuning fares.
        before: How the current tuning does on the same plants; None if it is not known.
        alone: Runs of the tuning with the lowest and the highest value of each factor, in pairs.
    """

    scenario: str
    kpis: tuple[KPI, ...]
    factors: tuple[Factor, ...]
    left_out: tuple[str, ...]
    planned: int
    tuning: Robustness
    before: Robustness | None
    alone: tuple[VerifiedRun, ...]

    @property
    def runs(self) -> tuple[VerifiedRun, ...]:
        """Return the random runs of the tuning."""
        return self.tuning.runs

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
        """Return what the probability of not keeping them is below, with 95 % confidence."""
        return most_probable(len(self.failed), len(self.runs))

    @property
    def statement(self) -> str:
        """Return how sure it is that the tuning holds, in a sentence."""
        count = len(self.runs)
        if not count:
            return f"Not verified: {'no run was completed' if self.planned else 'nothing can be varied'}."
        never = f" Not counted, since infinite nominally, too: {', '.join(self.never)}." if self.never else ""
        early = "" if count == self.planned else f" (stopped early, {self.planned} were planned)"
        if len(self.failed) == count:
            return f"No run of {count} keeps the stated limits{early}.{never}"
        # Rounded up to two digits, so that what is below it stays below.
        digits = 1 - int(np.floor(np.log10(100 * self.bound)))
        percent = np.ceil(100 * self.bound * 10.0**digits - 1e-9) / 10.0**digits
        return (
            f"{count - len(self.failed)} of {count} runs keep the stated limits{early}: for plants within "
            f"these ranges, the probability that one does not is below {percent:.3g} % with "
            f"{100 * CONFIDENCE:g} % confidence.{never}"
        )

    @property
    def limits(self) -> str:
        """Return what the stated limits are, in a sentence."""
        aims = [kpi.title for kpi in self.kpis if kpi.met(0.0) is not None]
        stated = f"the objectives of {', '.join(aims)}" if aims else "no KPI has an objective"
        return (
            f"Stated limits: a safe end, {stated}, and nothing infinite that is finite nominally. "
            f"The nominal run: {self.tuning.nominal.words}."
        )

    @property
    def never(self) -> tuple[str, ...]:
        """Return the titles of the KPIs that are infinite even on the nominal plant."""
        kpis = (kpi for kpi in self.kpis if kpi.goal is not None)
        return tuple(kpi.title for kpi in kpis if np.isinf(self.tuning.nominal.kpis.get(kpi.name, 0.0)))

    @property
    def idle(self) -> tuple[str, ...]:
        """Return the names of the factors that change no KPI at either end, such as one nobody measures."""
        pairs = zip(self.factors, self.alone[::2], self.alone[1::2], strict=False)
        nominal = self.tuning.nominal.kpis
        return tuple(f.name for f, *both in pairs if all(run.kpis == nominal for run in both))

    @cached_property
    def effects(self) -> tuple[Effect, ...]:
        """Return what each factor does alone, the one that hurts most first."""
        pairs = zip(self.factors, self.alone[::2], self.alone[1::2], strict=False)
        both = [(self._effect(factor, low), self._effect(factor, high)) for factor, low, high in pairs]
        worse = [max(pair, key=lambda effect: effect.worsening) for pair in both]
        return tuple(sorted(worse, key=lambda effect: -effect.worsening))

    def worst(self, count: int = 3) -> tuple[VerifiedRun, ...]:
        """Return the worst random runs: by limits that they lose, then by their worst KPI."""

        def badness(run: VerifiedRun) -> tuple[bool, int, float]:
            return run.end.interrupted, len(run.problems), self._worsening(run)[0]

        return tuple(sorted(self.runs, key=badness, reverse=True)[:count])

    def _effect(self, factor: Factor, run: VerifiedRun) -> Effect:
        worsening, kpi = self._worsening(run)
        lost = set(run.problems) - set(self.tuning.nominal.problems)
        return Effect(factor, run, kpi, np.inf if lost else worsening)

    def _worsening(self, run: VerifiedRun) -> tuple[float, str]:
        """Return by how much a KPI is worse than nominally, as a share of its range, and which one."""
        found, nominal = [(0.0, "")], self.tuning.nominal
        for kpi in self.kpis:
            if kpi.goal is None or kpi.name not in run.kpis or kpi.name not in nominal.kpis:
                continue
            here, there = (float(kpi.badness(each.kpis[kpi.name])) for each in (run, nominal))
            if here > there:
                low, high = self.tuning.quantiles(kpi.name)
                span = max(abs(high - low), 1e-9 * abs(there), 1e-300)
                found.append(((here - there) / span if np.isfinite(span) else 0.0, kpi.title))
        return max(found)


def problems_of(kpis: Sequence[KPI], result: Result, nominal: Result | None) -> tuple[str, ...]:
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


def most_probable(failed: int, count: int) -> float:
    """Return the upper limit, with 95 % confidence, of a probability seen `failed` of `count` times.

    Source: Clopper, Pearson (1934), The use of confidence or fiducial limits illustrated in the
    case of the binomial, Biometrika 26; one-sided.
    """
    if failed >= count:
        return 1.0
    return float(betaincinv(failed + 1, count - failed, CONFIDENCE))
