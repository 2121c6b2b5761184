"""Run a tuning on varied plants, on all cores; and the perturbed runs of a robust study."""

import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import compress, product, zip_longest
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.arrays import integer
from prefcal_env.controllers.margins import UNSTABLE
from prefcal_env.errors import KnobError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Experiment, check_returned, limiting_input
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Outcome, Reading
from prefcal_env.sources.source import RIG, Source, Varied
from prefcal_env.sources.varied import BEYOND, UNMODELED, Factor, LeftOut, Ranges, Values, draw, within
from prefcal_scenarios.catalog import load
from prefcal_scenarios.isolated import DEFAULT_LIMIT
from prefcal_scenarios.runs import FailedRun, HasKPIs, Progress, processes_kept, simulate_iter, simulate_many
from prefcal_scenarios.scenario import KPI, Scenario, finds_kpis, with_found_kpis

from .nominal import DRAWS, UNKNOWN, Noise, margins_at, noise_of, other_seeds
from .result import RANGE_0, Others, Robustness, Verification, VerifiedRun, breakable, count_kept, problems_of

# --- The perturbed runs of a candidate in a robust study: which there are, and which keep the limits.

_APART = 2**40
"""Distance of the seed of the variations: `verify` draws others, so that it can judge what is found."""
_AGAIN = 20  # plants that are drawn for a perturbed run until one can be held
Theta = Float[np.ndarray, " n"]


class Perturbed(Source):
    """A source whose θ may end with the number of a perturbed run, 1 or more: other plant, other noise.

    Without one, θ runs as it does in the scenario.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self._space, self._seed, self._kpis = scenario.space, seed, scenario.kpis
        self._source = scenario.source.elsewhere  # in a worker, that of the user's file
        self._cases: dict[int, tuple[Source, int]] = {}

    def run(self, theta: Theta, seed: int = 0) -> Experiment:
        """Run θ, physical, shape (n,), or a perturbed run of it, shape (n + 1,)."""
        n = len(self._space)
        if len(theta) == n:
            return self._source.run(theta, seed=seed)
        changed, noise = self._case(int(theta[n]))
        return replace(check_returned(changed.run(theta[:n].copy(), seed=noise)), theta=theta)

    def _case(self, k: int) -> tuple[Source, int]:
        """Return the source of run k and the seed of its noise; candidates share them."""
        if k not in self._cases:
            factors, _ = robustly(self._varied.factors, self._kpis)
            seed = self._seed + _APART
            noise = int(np.random.default_rng([seed, k, 1]).integers(2**31))
            # What no tuning can hold would fail each: another plant takes its place.
            drawn = [draw(factors, seed + _APART * again, k) for again in range(_AGAIN)]
            unheld = self._varied.unheld or (lambda _: None)
            values = next((each for each in drawn if unheld(each) is None), drawn[0])
            self._cases[k] = self._varied.at(values), noise
        return self._cases[k]

    @cached_property
    def _varied(self) -> Varied:
        return self._source.here.varied()


def robustly(factors: Sequence[Factor], kpis: Sequence[KPI]) -> tuple[tuple[Factor, ...], tuple[Factor, ...]]:
    """Return which factors a robust study varies, and which others `verify` varies.

    Where limits are stated that a run can break, these are all but what is turned around, which not every
    plant can do. Where none is stated, each run would have to settle with the worst noise, and a study would
    end at less than half of the worth: docs/research/verification.md.
    """
    limited = bool(breakable(kpis))
    left = [f.ends if limited else f.kind in BEYOND for f in factors]
    own, others = (tuple(compress(factors, [each is one for each in left])) for one in (False, True))
    return own, others


def which_keep(
    many: Callable[[Sequence[Theta]], Sequence[Outcome]],
    reading: Reading,
    thetas: Sequence[Theta],
    runs: range,
    *,
    margins: Collection[str] = (),
) -> Bool[np.ndarray, "m r"]:
    """Return which perturbed runs of each θ keep the limits, shape (m, r).

    A run keeps them that ends safely, meets the objectives that the nominal run meets, and reaches
    what that reaches: no KPI is infinite that is finite nominally.

    Args:
        many: Function that returns the `screened` KPIs of each θ of a `Perturbed`.
        reading: How people read them.
        thetas: Physical θ, each of shape (n,).
        runs: Numbers of the runs, from 1 on.
        margins: Names of KPIs that are margins, whose limits are those of the nominal loop alone.
    """
    nominal, count = many(thetas), len(runs)
    made = many([np.append(theta, k) for theta in thetas for k in runs])
    parts = (made[row * count : (row + 1) * count] for row in range(len(thetas)))
    kept = [
        ~_lose(reading, own, part, margins).any(axis=1) & _is_finite(own, margins)
        for own, part in zip(nominal, parts, strict=True)
    ]
    return np.array(kept, dtype=np.bool_).reshape(len(thetas), count)


def count_losses(
    many: Callable[[Sequence[Theta]], Sequence[Outcome]],
    reading: Reading,
    theta: Theta,
    runs: range,
    *,
    margins: Collection[str] = (),
) -> dict[str, int]:
    """Return in how many perturbed runs of a θ, physical, shape (n,), each KPI is lost, by its name.

    A run without any finite KPI, as one has that ends early, counts as "" alone. For the arguments see
    `which_keep`.
    """
    (nominal,), made = many([theta]), many([np.append(theta, k) for k in runs])
    finite = [_is_finite(run, margins) for run in made]
    lost = _lose(reading, nominal, list(compress(made, finite)), margins).sum(axis=0).tolist()
    counts = {"": len(made) - sum(finite), **dict(zip(_judged(nominal, margins), lost, strict=True))}
    return {name: count for name, count in counts.items() if count}


def _is_finite(run: Outcome, margins: Collection[str]) -> bool:
    """Return whether any KPI of a run that is no margin is finite: none is if it ended early, or failed."""
    return any(np.isfinite(run[name]) for name in _judged(run, margins))


def _judged(nominal: Outcome, margins: Collection[str]) -> list[str]:
    """Return the names of the KPIs that perturbed runs can lose."""
    return [name for name in nominal if name not in margins]


def _lose(
    reading: Reading, nominal: Outcome, runs: Sequence[Outcome], margins: Collection[str]
) -> Bool[np.ndarray, "r k"]:
    """Return which of the KPIs of `_judged` each run loses that the nominal one has, shape (r, k)."""
    names = _judged(nominal, margins)
    rows = [[run.get(name, nominal[name]) if run else np.inf for name in names] for run in runs]
    values = reading.table(names, np.array([[nominal[name] for name in names], *rows]))
    lost = values > [reading.limits.get(name, np.finfo(float).max) for name in names]
    return np.asarray(lost[1:] & ~lost[0])


# --- Run a tuning on varied plants, on all cores.

RUNS = 299
"""Runs that, if all are good, show with 95 % confidence that less than 1 % are not."""
RIVALS = 60
"""Other tunings: if none of them holds, less than 5 % of all do, with 95 % confidence. So many runs that fail
are tried with the task as stated before all are."""
_AROUND, _STEPS = 20, 5
"""Other tunings of a search near the verified one, or near the best of others; and most of these searches."""
_HELPS = 0.01  # share of the runs that a search must gain for another one to follow
_TURNED = 10  # random tunings that say whether the nominal plant can do a turned step or load at all
_HANGS = 3.0  # times the longest other wait, after which a run that is stopped counts as not ended
_QUICK = 2.0  # seconds of simulation that are not worth starting other processes


@processes_kept()
def verify(
    scenario: Scenario | str | Source,
    theta: Float[np.ndarray, " n"],
    runs: int = RUNS,
    *,
    start: Float[np.ndarray, " n"] | None = None,
    seed: int = 0,
    noise: int | None = None,
    ranges: Ranges | None = None,
    jobs: int | None = None,
    timeout: float | None = None,
    progress: Progress | bool = False,
    clock: Callable[[], float] = time.perf_counter,
) -> Verification:
    """Run a tuning with plant, sensors, actuators and task varied, each uniformly within its range.

    What can be varied is found from the scenario. A controller stays as it is designed for the
    nominal plant. Results do not depend on the number of processes. Ctrl-C ends the runs; those
    that are done are kept, and one that was waited for much longer than the others has failed.

    Args:
        scenario: Scenario, its name as for `load`, or a source.
        theta: Tuning, physical, shape (n,).
        runs: Number of random runs.
        start: Current tuning, shape (n,), whose KPIs are shown beside; None to leave it out.
        seed: Seed of the variations and of the runs.
        noise: Seed of the runs without variation, and of those of one factor alone; None for `seed`. With
            that of the study, they read as they did there.
        ranges: Relative changes by name or kind of factor, such as {"parameter": 0.2, "dead time":
            (0.0, 0.2)}; 0 leaves a factor out. See `Ranges`.
        jobs: Number of processes; None for all cores, or this process if all runs are quick.
        timeout: Time limit of each run in seconds; None for an hour in other processes. With one, no run
            happens in this process, so that none can end it.
        progress: As for `simulate_many`; the number of all runs grows where some fail, since more follow.
        clock: Returns the time in seconds, for how quick a run is.

    Raises:
        ScenarioError: If there is no such scenario, nothing of it can be varied, or, with a time limit,
            a nominal run fails; the message says why, or what to add.
        KnobError: If θ does not fit the scenario.
        SettingsError: If an argument is not valid, or all ranges are 0.
    """
    noise = seed if noise is None else noise
    for name, value, low in (("runs", runs, 1), ("seed", seed, 0), ("noise", noise, 0)):
        integer(name, value, low=low, error=SettingsError)
    found = _scenario(scenario, theta)
    thetas = [found.space.check(np.asarray(each, dtype=float)) for each in (theta, start) if each is not None]
    found, known = _with_kpis(found, thetas[0], noise, timeout), _varied(found)
    varying, fixed = _within(known.factors, ranges or {})
    tunings, factors, unfair = _nominally(found, known, thetas, varying, noise, timeout)
    cases = tuple(_cases(factors, len(tunings), runs, seed, noise, sensed := noise_of(found.source)))
    if jobs is None and timeout is None and _seconds(found, thetas[0], clock) * len(cases) <= _QUICK:
        jobs = 1
    limit = timeout if timeout is not None or jobs == 1 else DEFAULT_LIMIT  # a varied plant may never end
    many = partial(_done, jobs=jobs, timeout=limit, progress=_count_on(progress), clock=clock)
    at = Variations(lambda v: known.at(v) if v else found.source, thetas, cases, noted=True)
    made = [_run(found, tunings[0].nominal, c, each) for c, each in zip(cases, many(at), strict=False)]
    alone, again = runs + 2 * len(factors), runs * len(tunings) + 2 * len(factors)
    tunings, apart = _apart(known, tunings, made[:runs], made[alone:again])
    tunings = [replace(t, draws=tuple(made[again + k * DRAWS :][:DRAWS])) for k, t in enumerate(tunings)]
    before = next((each for each in tunings[1:] if each.runs), None)
    left_out = (*known.left_out, *fixed, *unfair, *UNMODELED)
    each = tuple(_noted(known, r) if r.problems else r for r in made[runs:alone])
    inputs = known.loop.plant.inputs if known.loop else ()
    verified = Verification(found.name, found.kpis, factors, left_out, runs, tunings[0], before, each)
    less = _narrower(known.factors, varying)
    verified = replace(verified, unheld=apart, inputs=inputs, seed=seed, narrower=less, noise=sensed)
    return _look_further(_Trials(found, known, verified, many)) if len(made) == len(cases) else verified


def _narrower(known: tuple[Factor, ...], varying: tuple[Factor, ...]) -> tuple[str, ...]:
    """Return the names of the factors that vary within less than they usually do."""
    spans = {f.name: f.high - f.low for f in varying}
    return tuple(f.name for f in known if spans.get(f.name, np.inf) < f.high - f.low)


def _apart(
    known: Varied, tunings: list[Robustness], *runs: list[VerifiedRun]
) -> tuple[list[Robustness], tuple[VerifiedRun, ...]]:
    """Return tunings with those of their runs that count, and the runs of the first that do not.

    Plants that no input within its range can hold say nothing of a tuning: they stand apart whether it
    holds there or not, so that what counts is chosen by the plant alone.
    """
    noted = [_noted(known, run) for run in runs[0]]
    lost = {k for k, run in enumerate(noted) if run.unheld}
    counted = [tuple(run for k, run in enumerate(made) if k not in lost) for made in runs]
    held = [replace(t, runs=made) for t, made in zip(tunings, counted, strict=False)]
    return held, tuple(run for run in noted if run.unheld)


def _noted(known: Varied, run: VerifiedRun) -> VerifiedRun:
    """Return a run that says where no input can hold its plant."""
    with suppress(Exception):  # people's own plants can raise anything where they never are
        return replace(run, unheld=known.unheld(run.values) if known.unheld else None)
    return run


def _within(known: tuple[Factor, ...], ranges: Ranges) -> tuple[tuple[Factor, ...], list[LeftOut]]:
    """Return what varies with these ranges, and what somebody left out by a range of 0.

    Raises:
        SettingsError: If a range is not valid, or all are 0.
    """
    factors = within(known, ranges)
    if not factors:
        raise SettingsError("nothing varies: all ranges are 0")
    names = {factor.name for factor in factors}
    return factors, [(f.name, RANGE_0) for f in known if f.name not in names]


def unvaried(scenario: Scenario, theta: Float[np.ndarray, " n"], made: HasKPIs) -> Verification:
    """Return what can be said of a run of a rig or a live plant: whether it kept the stated limits."""
    problems = problems_of(scenario.kpis, made, None)
    tuning = Robustness(theta, VerifiedRun({}, 0, made.end, made.kpis, problems), UNKNOWN)
    return Verification(scenario.name, scenario.kpis, (), (("the plant", RIG),), 0, tuning, None, ())


def replay(scenario: Scenario | str | Source, theta: Float[np.ndarray, " n"], run: VerifiedRun) -> Experiment:
    """Return the whole experiment of a run of a verification of θ, physical, shape (n,), to look at."""
    return replays(_scenario(scenario, theta), theta, [run])[0]


def replays(
    scenario: Scenario,
    theta: Float[np.ndarray, " n"],
    runs: Sequence[VerifiedRun],
    timeout: float | None = None,
) -> list[Experiment]:
    """Return the experiments of several runs, as `replay` does; with a time limit, from another process.

    Raises:
        ScenarioError: If one fails there.
    """
    cases = [_Case(0, dict(run.values), run.seed) for run in runs]
    return _experiments(Variations(_varied(scenario).at, [np.array(theta, dtype=float)], cases), timeout)


@dataclass(frozen=True, slots=True)
class _Case:
    """One run: of the tuning (0) or the current one (1), with values of some factors, and its seed."""

    which: int
    values: dict[str, float]
    seed: int


_LIMITED = "limited by: "
"""Begin of the KPI that tells, by its name, which input limits a run."""


class Variations(Source):
    """A source whose θ is the number of a case: so the pool runs them as it runs any θ.

    If `noted`, one more KPI says which input limits the run; `_run` takes it out.
    """

    def __init__(
        self,
        at: Callable[[Values], Source],
        thetas: Sequence[Float[np.ndarray, " n"]],
        cases: Sequence[_Case],
        *,
        noted: bool = False,
    ) -> None:
        self._at, self._thetas, self.cases, self._noted = at, thetas, cases, noted

    def run(self, theta: Float[np.ndarray, " 1"], seed: int = 0) -> Experiment:
        """Run the case with this number, shape (1,)."""
        case = self.cases[int(theta[0])]
        made = check_returned(self._at(case.values).run(self._thetas[case.which].copy(), seed=case.seed))
        # Of many runs, only KPIs come back from other processes.
        return made.with_kpis({**made.kpis, _LIMITED + limiting_input(made): 1.0}) if self._noted else made


_Many = Callable[[Variations], list[HasKPIs]]
"""Function that returns the results of all cases, or of fewer after Ctrl-C."""


def _scenario(given: Any, theta: Float[np.ndarray, " n"]) -> Scenario:
    if isinstance(given, Scenario | str):
        return load(given) if isinstance(given, str) else given
    values = np.asarray(theta, dtype=float)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise KnobError(f"theta must be finite numbers of shape (n,), got {theta!r}")
    knobs = [Knob(f"theta_{i + 1}", v - 1.0, v + 1.0) for i, v in enumerate(values.tolist())]
    return Scenario("source", "A source", KnobSpace(knobs), given)


def _with_kpis(
    scenario: Scenario, theta: Float[np.ndarray, " n"], seed: int, timeout: float | None
) -> Scenario:
    """Return the scenario with KPIs, which are found in a run if it states none."""
    if not finds_kpis(scenario):
        return scenario
    (made,) = _experiments(_as_it_is(scenario, [theta], seed), timeout)
    return with_found_kpis(scenario, made)


def _varied(scenario: Scenario) -> Varied:
    """Return what of a scenario can vary, with its name in an error."""
    try:
        return scenario.source.varied()
    except ScenarioError as error:
        raise ScenarioError(f"scenario {scenario.name!r} cannot be verified: {error}") from error


def _as_it_is(scenario: Scenario, thetas: list[Float[np.ndarray, " n"]], seed: int) -> Variations:
    """Return the runs of tunings without variation."""
    return Variations(lambda _: scenario.source, thetas, [_Case(k, {}, seed) for k in range(len(thetas))])


def _experiments(varied: Variations, timeout: float | None) -> list[Experiment]:
    """Return the experiments of all cases; with a time limit, another process runs them.

    Raises:
        ScenarioError: If one fails there.
    """
    scenario, numbers = _numbered(varied)
    if timeout is None:
        return [varied.run(number) for number in numbers]
    made = simulate_many(scenario, np.array(numbers), jobs=1, timeout=timeout, trajectories=True)
    for each in made:
        if isinstance(each, FailedRun):
            raise ScenarioError(f"a run without variation, or one that is looked at, failed: {each.words}")
    return [check_returned(each) for each in made]


def _nominally(
    scenario: Scenario,
    known: Varied,
    thetas: list[Float[np.ndarray, " n"]],
    factors: tuple[Factor, ...],
    seed: int,
    timeout: float | None,
) -> tuple[list[Robustness], tuple[Factor, ...], list[LeftOut]]:
    """Return how tunings do without variation, with their margins, and the factors that vary, or do not."""
    # All in one process: to start another one takes longer than most runs.
    turned = [factor for factor in factors if factor.ends]
    cases = [_Case(k, {}, seed) for k in range(len(thetas))]
    cases += [_Case(k, {f.name: f.low}, seed) for f in turned for k in range(len(thetas))]
    made = _experiments(Variations(lambda v: known.at(v) if v else scenario.source, thetas, cases), timeout)
    own, tunings = made[: len(thetas)], list[Robustness]()
    for theta, each in zip(thetas, own, strict=True):
        problems = problems_of(scenario.kpis, each, None)
        run = VerifiedRun({}, seed, each.end, each.kpis, problems, limiting_input(each))
        tunings.append(Robustness(theta, run, margins_at(known, theta), time_unit=each.channels.time_unit))
    said = dict[str, str]()
    for k, factor in enumerate(turned, start=1):
        there = made[k * len(thetas) : (k + 1) * len(thetas)]
        if all(problems_of(scenario.kpis, each, own[0]) for each in there):
            said[factor.name] = _lost_by_all(scenario, known, factor, own, there, timeout)
    said = {name: lost for name, lost in said.items() if lost}
    return tunings, tuple(factor for factor in factors if factor.name not in said), list(said.items())


def _lost(scenario: Scenario, own: Sequence[HasKPIs], there: Sequence[HasKPIs]) -> set[str]:
    """Return what all tunings miss turned, given their runs nominally and turned, but not all nominally.

    Who ends early shows nothing of what a plant can do.
    """
    judged = partial(problems_of, scenario.kpis, nominal=own[0])
    whole = [each for each in there if not each.end.interrupted] or there
    kept = [judged(each) for each in own if not each.end.interrupted]
    missed = set.intersection(*(set(judged(each)) for each in whole))
    return {each for each in missed if any(each not in problems for problems in kept)}


def _lost_by_all(
    scenario: Scenario,
    known: Varied,
    factor: Factor,
    own: Sequence[HasKPIs],
    there: Sequence[HasKPIs],
    timeout: float | None,
) -> str:
    """Return why a factor of two values does not vary: no other tuning keeps what is lost; "" if one does.

    A room that only cools by itself settles late after a step down, whatever its controller. What varies
    must follow from that alone: a tuning is no excuse for its own failures.
    """
    z = np.random.default_rng([0, _APART]).random((RIVALS, len(scenario.space)))
    drawn = scenario.space.decode_all(z)
    others = [*scenario.references.values(), *drawn[scenario.space.allows(drawn)][:_TURNED]]
    cases = [_Case(k, values, 0) for values in ({}, {factor.name: factor.low}) for k in range(len(others))]
    made = list[HasKPIs]()
    if others:
        at = Variations(lambda v: known.at(v) if v else scenario.source, others, cases)
        numbered, numbers = _numbered(at)
        made += simulate_many(numbered, np.array(numbers), jobs=1, timeout=timeout)
    lost = _lost(scenario, [*own, *made[: len(others)]], [*there, *made[len(others) :]])
    tried = len(own) + len(others)
    words = f"turned, the nominal plant fails with each of {tried} tunings ({'; '.join(sorted(lost))})"
    return words if lost else ""


def _seconds(scenario: Scenario, theta: Float[np.ndarray, " n"], clock: Callable[[], float]) -> float:
    """Return how long a run takes that is not the first one, which may compile something."""
    before = clock()
    scenario.run(theta.copy())
    return clock() - before


def _cases(
    factors: tuple[Factor, ...], tunings: int, runs: int, seed: int, noise: int, sensed: Noise | None
) -> Iterator[_Case]:
    """Yield random runs of the tuning, each factor alone, the random runs of the other, then other draws."""
    rows = [draw(factors, seed, k) for k in range(runs)]
    seeds = [int(np.random.default_rng([seed, k, 1]).integers(2**31)) for k in range(runs)]
    yield from (_Case(0, row, each) for row, each in zip(rows, seeds, strict=True))
    for factor in factors:
        yield from (_Case(0, {factor.name: value}, noise) for value in (factor.low, factor.high))
    for which in range(1, tunings):
        yield from (_Case(which, row, each) for row, each in zip(rows, seeds, strict=True))
    if sensed is not None:
        again = product(range(tunings), other_seeds(noise))
        yield from (_Case(which, dict(sensed.values), other) for which, other in again)


def _done(
    source: Variations,
    jobs: int | None,
    timeout: float | None,
    progress: Progress | bool,
    clock: Callable[[], float],
) -> list[HasKPIs]:
    """Return the results in order, as many as there are before Ctrl-C.

    People stop what hangs. So the run that all others wait for is the last result, a failed one, if
    they waited for it much longer than for any other: without it, only what ends would be counted.
    """
    (scenario, numbers), done, waits = _numbered(source), list[HasKPIs](), list[float]()
    runs, since = simulate_iter(scenario, numbers, jobs=jobs, timeout=timeout, progress=progress), clock()
    try:
        with closing(runs):
            for result in runs:
                done.append(result)
                waits.append(clock() - since)
                since = clock()
    except KeyboardInterrupt:
        waited = clock() - since
        usual = max(waits[1:] or waits, default=np.inf)  # other processes start before the first one
        if len(done) < len(numbers) and waited > max(_HANGS * usual, 1.0):
            words = f"it had not ended after {waited:.0f} s, when the runs were stopped"
            done.append(FailedRun(numbers[len(done)], "late", words))
    return done


def _count_on(progress: Progress | bool) -> Progress | bool:
    """Return a function that counts the runs of all batches, which `progress` would count anew each."""
    if isinstance(progress, bool):
        return progress
    done = batch = arrived_before = 0

    def tell(arrived: int, total: int | None) -> None:
        nonlocal done, batch, arrived_before
        if arrived <= arrived_before:  # another batch has begun
            done += batch
        arrived_before, batch = arrived, total or 0
        progress(done + arrived, done + batch)

    return tell


def _numbered(varied: Variations) -> tuple[Scenario, list[Float[np.ndarray, " 1"]]]:
    """Return a scenario whose θ are the numbers of cases, and these."""
    count = len(varied.cases)
    space = KnobSpace([Knob("case", 0, max(count - 1, 1), integer=True)])
    numbers = [np.array([float(k)]) for k in range(count)]
    return Scenario("verification", "Verification", space, varied, kpis=()), numbers


def _run(scenario: Scenario, nominal: VerifiedRun, case: _Case, result: HasKPIs) -> VerifiedRun:
    """Return what remains of a run; of one without an experiment, what its code said.

    The tuning before is judged by what the new one reaches nominally: one that never settles would hold.
    """
    problems = problems_of(scenario.kpis, result, nominal)
    if isinstance(result, FailedRun):
        problems = (f"the run failed: {result.words}",)
    kpis = {name: value for name, value in result.kpis.items() if not name.startswith(_LIMITED)}
    limiting = "".join(name.removeprefix(_LIMITED) for name in result.kpis if name not in kpis)
    return VerifiedRun(case.values, case.seed, result.end, kpis, problems, limiting)


# --- Where some run fails: the task as stated, and other tunings on the same plants.


@dataclass(frozen=True)
class _Trials:
    """Runs on the plants that a tuning met."""

    scenario: Scenario
    known: Varied
    verified: Verification
    many: _Many
    made: dict[tuple[bytes, int, tuple[tuple[str, float], ...]], VerifiedRun] = field(default_factory=dict)

    def on(self, tunings: Sequence[Robustness], plants: Sequence[VerifiedRun]) -> list[Robustness]:
        """Return tunings with their runs on the plants of some runs.

        Raises:
            KeyboardInterrupt: If Ctrl-C ended them; those that are done are in `made`.
        """
        places = [(run.seed, tuple(run.values.items())) for run in plants]
        rows = [[(t.theta.tobytes(), *place) for place in places] for t in tunings]
        new = [(k, *pair) for k, row in enumerate(rows) for pair in zip(row, plants, strict=True)]
        new = [each for each in new if each[1] not in self.made]
        cases = [_Case(k, dict(run.values), run.seed) for k, _, run in new]
        at = Variations(self.known.at, [t.theta for t in tunings], cases, noted=True)
        done = self.many(at) if cases else []
        for (_, key, _), case, result in zip(new, cases, done, strict=False):
            self.made[key] = _run(self.scenario, self.verified.tuning.nominal, case, result)
        if len(done) < len(cases):
            raise KeyboardInterrupt
        pairs = zip(tunings, rows, strict=True)
        return [replace(t, runs=tuple(self.made[key] for key in row)) for t, row in pairs]

    def nominally(self, thetas: Sequence[Theta]) -> list[Robustness]:
        """Return how tunings, physical, each of shape (n,), do without variation."""
        nominal = self.verified.tuning.nominal
        made = self.on([Robustness(theta, nominal, UNKNOWN) for theta in thetas], [nominal])
        return [replace(t, nominal=t.runs[0], runs=()) for t in made]

    def able(self, tunings: Sequence[Robustness]) -> list[Robustness]:
        """Return the tunings that do nominally what is asked, the nearest to the verified one first."""
        kept = [t for t in tunings if not t.nominal.problems]
        if not self.verified.misses_margin:
            kept = [t for t in kept if not replace(self.verified, tuning=t).misses_margin]
        encode = self.scenario.space.encode
        own = encode(self.verified.tuning.theta)
        return sorted(kept, key=lambda t: float(np.linalg.norm(encode(t.theta) - own)))

    def best(self, tunings: Sequence[Robustness], plants: int, count: int) -> list[Robustness]:
        """Return those tunings that keep the limits on most plants, by some of them, the best first.

        Of these, half make the verified tuning fail, which tell tunings apart: so each counts for as many as
        there are of its kind.
        """
        good = [run for run in self.verified.runs if not run.problems]
        telling = [run for pair in zip_longest(self.verified.failed, good) for run in pair if run]
        made = self.on(tunings, telling[:plants]) if tunings else []
        return sorted(made, key=lambda t: -self.estimate(t))[:count]

    def estimate(self, tuning: Robustness) -> float:
        """Return on how many of all plants a tuning holds, by those that it ran on."""
        failed = {run.seed for run in self.verified.failed}
        kinds = [[run for run in tuning.runs if (run.seed in failed) is one] for one in (True, False)]
        sizes = len(failed), len(self.verified.runs) - len(failed)
        pairs = zip(kinds, sizes, strict=True)
        return sum(size * count_kept(runs) / len(runs) for runs, size in pairs if runs)

    def until_now(self) -> Others:
        """Return how the other tunings fare as far as they ran: the best is one that met most plants."""
        own = self.verified.tuning
        plants = [(run.seed, tuple(run.values.items())) for run in (own.nominal, *own.runs)]
        others = dict.fromkeys(theta for theta, *_ in self.made if theta != own.theta.tobytes())
        rows = [(theta, [self.made.get((theta, *place)) for place in plants]) for theta in others]
        tried = [
            Robustness(
                np.frombuffer(theta), nominal, UNKNOWN, tuple(filter(None, runs)), time_unit=own.time_unit
            )
            for theta, (nominal, *runs) in rows
            if nominal
        ]
        able = self.able(tried)
        met = (t for t in able if t.runs)
        best = max(met, key=lambda t: (len(t.runs), self.estimate(t)), default=None)
        return Others(len(tried), len(able), best)

    def near(self, theta: Theta, spread: float, generator: np.random.Generator) -> list[Theta]:
        """Return tunings near a physical θ, shape (n,), with a standard deviation in the unit cube."""
        space, (lower, upper) = self.scenario.space, self.scenario.space.corners
        drawn = generator.standard_normal((_AROUND, len(space)))
        return self.allowed(np.clip(space.encode(theta) + spread * drawn, lower, upper))

    def allowed(self, z: Float[np.ndarray, "m n"]) -> list[Theta]:
        """Return the physical tunings of points of the unit cube, those that the constraints allow."""
        thetas = self.scenario.space.proposals(z)[1]
        return list(thetas[self.scenario.space.allows(thetas)])


def _look_further(trials: _Trials) -> Verification:
    """Return a verification with what the task as stated and other tunings do, if some run fails."""
    verified = trials.verified
    # Where the tuning before holds in all runs, it is advised, and no other is looked for.
    searches = bool(verified.failed) and trials.scenario.simulated and not verified.before_holds
    try:
        verified = replace(verified, as_stated=_as_stated(trials) if verified.failed else ())
        if searches:
            verified = replace(verified, others=_try_others(trials))
    except KeyboardInterrupt:
        verified = replace(verified, stopped=trials.until_now() if searches else None)
    return verified


def _as_stated(trials: _Trials) -> tuple[VerifiedRun, ...]:
    """Return random runs again with the task as stated; none where there is nothing to excuse.

    Random runs that failed, the first of them, run on the same plants, with the same noise. So who fails
    there fails at what nobody stated. If all of these hold, the others run there, too. Where the tuning does
    not even hold nominally, nothing is excused by that.
    """
    verified, made = trials.verified, list[VerifiedRun]()
    own, names = verified.tuning, {f.name for f in verified.unstated}
    if not names or own.nominal.problems:
        return ()
    good = [run for run in verified.runs if not run.problems]
    for runs in (verified.failed[:RIVALS], (*verified.failed[RIVALS:], *good)):
        plants = [
            replace(run, values={n: v for n, v in run.values.items() if n not in names}) for run in runs
        ]
        made += trials.on([own], plants)[0].runs
        if any(run.problems for run in made):
            break
    return tuple(made)


def _try_others(trials: _Trials) -> Others:
    """Return how other tunings fare on the plants that the tuning met.

    Few plants tell most of them from the best: so each round runs fewer tunings on more plants, and three
    on all of them. Source: Jamieson, Talwalkar (2016), Non-stochastic best arm identification and
    hyperparameter optimization, AISTATS; successive halving.
    """
    own, space = trials.verified.tuning, trials.scenario.space
    generator = np.random.default_rng([trials.verified.seed, _APART])
    drawn = trials.allowed(space.scaled(generator.random((RIVALS, len(space)))))
    named = trials.scenario.references.values()
    tried = trials.nominally([*drawn, *named, *trials.near(own.theta, 0.15, generator)])
    left = trials.best(trials.best(trials.able(tried), 6, 8), 24, 3)
    for step in range(_STEPS):
        # Where none does nominally what is asked, towards those limits that are missed by least.
        nearest = min([own, *tried], key=lambda t: trials.verified.beyond(t.nominal))
        center = (left[0] if left else nearest).theta
        around = trials.nominally(trials.near(center, 0.08, generator))
        tried, able = [*tried, *around], trials.able(around)
        held = max([count_kept(own.runs), *map(trials.estimate, left[:1])])
        left = sorted(
            [*left, *trials.best(trials.best(able, 6, 6), 24, 3)], key=lambda t: -trials.estimate(t)
        )
        # It goes on while that helps, or while nothing is better than what is verified.
        if left and step and count_kept(own.runs) < trials.estimate(left[0]) <= held + _HELPS * len(own.runs):
            break
    last = trials.best(trials.best(left[:9], RIVALS, 3), len(own.runs), 3)
    stable = ((t, margins_at(trials.known, t.theta)) for t in last)
    best = next((replace(t, margins=m) for t, m in stable if m != UNSTABLE), None)
    if best:
        (best,) = trials.on([best], trials.verified.runs)  # in the order of the verified runs
    return Others(len(tried), len(trials.able(tried)), best)
