"""Run a tuning on varied plants, on all cores."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import integer
from prefcal_env.errors import KnobError, SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.sources.source import Source
from prefcal_scenarios.catalog import load
from prefcal_scenarios.many.results import FailedRun, Result
from prefcal_scenarios.many.simulate import Progress, simulate_iter
from prefcal_scenarios.own.checks import returned
from prefcal_scenarios.scenario import Scenario

from .factor import Factor, Ranges, chosen, drawn
from .result import Verification, VerifiedRun, problems_of
from .robustness import robustness
from .subject import Subject, named, subject_of, varied

RUNS = 299
"""Runs that, if all are good, show with 95 % confidence that less than 1 % are not."""
_QUICK = 2.0
"""Seconds of simulation that are not worth starting other processes."""


@dataclass(frozen=True, slots=True)
class _Case:
    """One run: of the tuning or the current one, with values of some factors, and its seed."""

    which: int
    values: dict[str, float]
    seed: int


def verify(
    scenario: Scenario | str | Source,
    theta: Float[np.ndarray, " n"],
    runs: int = RUNS,
    *,
    start: Float[np.ndarray, " n"] | None = None,
    seed: int = 0,
    ranges: Ranges | None = None,
    vary: Collection[str] | None = None,
    jobs: int | None = None,
    timeout: float | None = None,
    progress: Progress | bool = False,
    clock: Callable[[], float] = time.perf_counter,
) -> Verification:
    """Run a tuning with plant, sensors, actuators and task varied, each uniformly within its range.

    What can be varied is found from the scenario: parameters, dead time, noise and resolution of
    sensors, range and backlash of actuators, loads, the step. A controller stays as it is designed
    for the nominal plant. Results do not depend on the number of processes. Ctrl-C ends the runs;
    those that are done are kept.

    Args:
        scenario: Scenario, its name as for `load`, or a source.
        theta: Tuning, physical, shape (n,).
        runs: Number of random runs.
        start: Current tuning, shape (n,), whose KPIs are shown beside; None to leave it out.
        seed: Seed of the variations and of the runs.
        ranges: Relative changes by name or kind of factor, such as {"parameter": 0.2, "dead time":
            (0.0, 0.2)}; 0 leaves a factor out. See `Factor`.
        vary: Names or kinds of the factors to vary; None for all.
        jobs: Number of processes; None for all cores, or this process if all runs are quick.
        timeout: Time limit of each run in seconds; None for no limit.
        progress: As for `simulate_many`.
        clock: Returns the time in seconds, for how quick a run is.

    Raises:
        ScenarioError: If there is no such scenario, or nothing of it can be varied; the message says
            what to add.
        KnobError: If θ does not fit the scenario.
        SettingsError: If an argument is not valid, or all ranges are 0.
    """
    integer("runs", runs, low=1, error=SettingsError)
    integer("seed", seed, low=0, error=SettingsError)
    found = _scenario(scenario, theta)
    thetas = [found.space.check(np.asarray(each, dtype=float)) for each in (theta, start) if each is not None]
    subject = subject_of(found)
    factors = chosen(subject.factors, ranges, vary)
    if not factors:
        raise SettingsError("nothing varies: all ranges are 0, or none of the chosen kinds is there")
    without = _without_runs(found, subject, thetas, factors, (runs, seed))
    cases = tuple(_cases(without.factors, len(thetas), runs, seed))
    if jobs is None and timeout is None and _seconds(found, thetas[0], clock) * len(cases) <= _QUICK:
        jobs = 1
    done = _done(Variations(found.source, subject, tuple(thetas), cases), jobs, timeout, progress)
    pairs = zip(cases, done, strict=False)
    return without.with_runs([_run(found, without, case, result) for case, result in pairs])


def _without_runs(
    found: Scenario,
    subject: Subject,
    thetas: Sequence[Float[np.ndarray, " n"]],
    factors: tuple[Factor, ...],
    planned: tuple[int, int],
) -> Verification:
    """Return a verification with its nominal runs and margins; `planned` holds runs and seed."""
    runs, seed = planned
    nominals = [_nominal(found, each, seed) for each in thetas]
    factors, unfair = _fair(found, subject, factors, thetas[0], nominals[0])
    margins = [robustness(found, subject, each) for each in thetas]
    return Verification(
        scenario=found.name,
        theta=thetas[0],
        start=thetas[1] if len(thetas) > 1 else None,
        kpis=found.kpis,
        factors=factors,
        left_out=(*subject.left_out, *unfair),
        planned=runs,
        seed=seed,
        nominal=nominals[0],
        nominal_before=nominals[1] if len(thetas) > 1 else None,
        margins=margins[0],
        margins_before=margins[1] if len(thetas) > 1 else "no margins",
    )


def _seconds(scenario: Scenario, theta: Float[np.ndarray, " n"], clock: Callable[[], float]) -> float:
    """Return how long a run takes that is not the first one, which may compile something."""
    before = clock()
    scenario.run(theta.copy())
    return clock() - before


def replay(scenario: Scenario | str | Source, verification: Verification, run: VerifiedRun) -> Experiment:
    """Return the whole experiment of a run of a verification of this scenario, to look at."""
    found = _scenario(scenario, verification.theta)
    changed = varied(found.source, subject_of(found).at(run.values))
    return returned(changed.run(verification.theta.copy(), seed=run.seed))


class Variations(Source):
    """A source whose θ is the number of a case: so the pool runs them as it runs any θ.

    Args:
        source: Source of the scenario.
        subject: What of it varies.
        thetas: Tunings.
        cases: Which tuning, values and seed each number stands for.
    """

    def __init__(
        self,
        source: Source,
        subject: Subject,
        thetas: Sequence[Float[np.ndarray, " n"]],
        cases: Sequence[_Case],
    ) -> None:
        self._source, self._subject, self._thetas, self.cases = source, subject, thetas, cases

    def run(self, theta: Float[np.ndarray, " 1"], seed: int = 0) -> Experiment:
        """Run the case with this number, shape (1,)."""
        case = self.cases[int(theta[0])]
        changed = varied(self._source, self._subject.at(case.values))
        made: Experiment = returned(changed.run(self._thetas[case.which].copy(), seed=case.seed))
        return replace(made, theta=theta)


def _scenario(given: Any, theta: Float[np.ndarray, " n"]) -> Scenario:
    if isinstance(given, str):
        return load(given)
    if isinstance(given, Scenario):
        return given
    values = np.asarray(theta, dtype=float)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise KnobError(f"theta must be finite numbers of shape (n,), got {theta!r}")
    knobs = [Knob(f"theta_{i + 1}", v - 1.0, v + 1.0) for i, v in enumerate(values.tolist())]
    return Scenario("source", "A source", KnobSpace(knobs), given)


def _run(scenario: Scenario, of: Verification, case: _Case, result: Result) -> VerifiedRun:
    """Return what remains of a run; of one without an experiment, what its code said."""
    nominal = of.nominal_before if case.which else of.nominal
    problems = problems_of(scenario.kpis, result, nominal)
    if isinstance(result, FailedRun):
        problems = (f"the run failed: {result.words}",)
    return VerifiedRun(case.values, case.seed, result.end, result.kpis, problems)


def _nominal(scenario: Scenario, theta: Float[np.ndarray, " n"], seed: int) -> VerifiedRun:
    made = returned(scenario.run(theta.copy(), seed=seed))
    return VerifiedRun({}, seed, made.end, made.kpis, problems_of(scenario.kpis, made, None))


def _fair(
    scenario: Scenario,
    subject: Subject,
    factors: tuple[Factor, ...],
    theta: Float[np.ndarray, " n"],
    nominal: VerifiedRun,
) -> tuple[tuple[Factor, ...], tuple[str, ...]]:
    """Return the factors without those of two values that the nominal plant cannot stand either.

    A room that only cools by itself settles late after a step down, whatever its controller.
    """
    kept, said = list[Factor](), list[str]()
    for factor in factors:
        if factor.ends:
            changed = varied(scenario.source, subject.at({factor.name: factor.low}))
            made = returned(changed.run(theta.copy(), seed=nominal.seed))
            if problems := set(problems_of(scenario.kpis, made, nominal)) - set(nominal.problems):
                why = "; ".join(sorted(problems))
                said.append(f"{factor.name} is not varied: turned, the nominal plant fails, too ({why})")
                continue
        kept.append(factor)
    return tuple(kept), tuple(said)


def _cases(factors: tuple[Factor, ...], tunings: int, runs: int, seed: int) -> Iterator[_Case]:
    """Yield random runs of the tuning, then each factor alone, then the random runs of the other."""
    rows = [dict(named(factors, drawn(factors, seed, k))) for k in range(runs)]
    seeds = [int(np.random.default_rng([seed, k, 1]).integers(2**31)) for k in range(runs)]
    yield from (_Case(0, row, each) for row, each in zip(rows, seeds, strict=True))
    for factor in factors:
        yield from (_Case(0, {factor.name: value}, seed) for value in (factor.low, factor.high))
    for which in range(1, tunings):
        yield from (_Case(which, row, each) for row, each in zip(rows, seeds, strict=True))


def _done(
    source: Variations, jobs: int | None, timeout: float | None, progress: Progress | bool
) -> list[Result]:
    """Return the results in order, as many as there are before Ctrl-C."""
    count = len(source.cases)
    space = KnobSpace([Knob("case", 0, max(count - 1, 1), integer=True)])
    numbers = [np.array([float(k)]) for k in range(count)]
    scenario, done = Scenario("verification", "Verification", space, source, kpis=()), list[Result]()
    runs = simulate_iter(scenario, numbers, jobs=jobs, timeout=timeout, progress=progress)
    with closing(runs), suppress(KeyboardInterrupt):
        for result in runs:
            done.append(result)
    return done
