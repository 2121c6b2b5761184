"""What an agent can learn of a run besides θ, and many runs of one scenario on all cores."""

import pickle
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence, Sized
from contextlib import closing, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial
from importlib.machinery import PathFinder
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol, final

import cloudpickle
import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_integer
from prefcal_env.compiling import Compiling, Kernel, compile_missing, of_compiled_runs
from prefcal_env.envs.closed_loop import compiled_plant
from prefcal_env.errors import KnobError, RunError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import End, Experiment, FrozenMapping, check_returned
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.experiments.panels import MEAN, by_maneuver, named
from prefcal_env.knobs import KnobSpace
from prefcal_env.plants.systems import LinearPlant
from prefcal_env.preferences.answer import Outcome, Reading
from prefcal_env.sources.source import Source, env_of
from prefcal_env.study.fold import decode, encode
from prefcal_env.workers import Pool, Terms, failure, run_all, usable_cores

from .catalog import load
from .own import module_at
from .scenario import KPI, Scenario

# --- What an agent can learn about an experiment besides θ: the scenario's KPIs and generic ones.

INTERRUPTED = "interrupted"  # name of the KPI that is 1 for a run that was stopped or failed, and 0 otherwise
WORST = "worst"  # group of the KPIs that are the worst of all maneuvers


class HasKPIs(Protocol):
    """What remains of any run: an `Experiment`, or what `simulate_many` returns for it."""

    @property
    def end(self) -> End:
        """Why the run ended."""

    @property
    def kpis(self) -> Mapping[str, float]:
        """KPIs by name, in the units of the scenario."""


def outcome(scenario: Scenario, experiment: Experiment) -> Outcome:
    """Return the KPIs of `experiment` by name, lower is better; infinite is the worst value.

    They are the scenario's KPIs with a known direction of improvement. Only if no KPI has a
    direction, generic ones of the trajectory take their place. All are infinite for a run that was
    stopped: a short run would otherwise look good, since it accumulates little error. Those of one
    that was cut short since it could no longer win are unknown.
    """
    if experiment.end is End.CUT_SHORT:
        return Outcome({})
    [known] = _known(scenario, [experiment])
    return Outcome({**known, INTERRUPTED: float(experiment.end.interrupted)})


def has_goals(scenario: Scenario) -> bool:
    """Return whether some KPI of the scenario has a direction of improvement."""
    return any(kpi.goal is not None for kpi in scenario.kpis)


def screened(scenario: Scenario, experiment: HasKPIs) -> Outcome:
    """Return the KPIs by which simulated experiments are screened, those of `outcome`.

    That all are infinite for a run that was stopped keeps agents away from its θ; a run that failed
    has no KPIs at all.

    Args:
        scenario: Scenario of the experiment.
        experiment: Experiment, or what `simulate_many` returns for it.

    Raises:
        ScenarioError: If the scenario has no KPI with a direction, and the trajectory is not kept.
    """
    return all_screened(scenario, [experiment])[0]


def all_screened(scenario: Scenario, experiments: Sequence[HasKPIs]) -> list[Outcome]:
    """Return what `screened` returns for each of many experiments, in order."""
    found = [Outcome({})] * len(experiments)
    rows = [k for k, each in enumerate(experiments) if each.end is not End.FAILED or each.kpis]
    for row, known in zip(rows, _known(scenario, [experiments[k] for k in rows]), strict=True):
        found[row] = Outcome(known)
    return found


def reading(scenario: Scenario) -> Reading:
    """Return how people read the KPIs that `outcome` and `screened` return."""
    kpis = [kpi for kpi in scenario.kpis if kpi.goal is not None]
    ends = {k.name: k.at_least if k.goal == "higher" else k.at_most for k in kpis}
    return Reading(
        {k.name: k.step for k in kpis},
        {k.name: float(k.badness(ends[k.name])) for k in kpis if np.isfinite(ends[k.name])},
        frozenset(k.name for k in kpis if k.goal == "target"),
        {k.name: float(k.badness(k.aim)) for k in kpis if k.aim is not None},
    )


def simulator(scenario: Scenario | str, *, seed: int = 0) -> Callable[[Float[np.ndarray, " n"]], Outcome]:
    """Return a function of a physical θ, shape (n,), that runs it here and returns its KPIs.

    It is the `simulate` of `Screening` and `minimize_by_preference`; its KPIs are `screened`.

    Args:
        scenario: Scenario, or its name as for `load`.
        seed: Seed of every run.

    Raises:
        ScenarioError: If there is no such scenario.
    """
    found = load(scenario) if isinstance(scenario, str) else scenario

    def simulate(theta: Float[np.ndarray, " n"]) -> Outcome:
        return screened(found, check_returned(found.run(theta, seed=seed)))

    simulate.reading = reading(found)  # type: ignore[attr-defined]
    simulate.candidates = found.source.candidates  # type: ignore[attr-defined]
    return simulate


def _known(scenario: Scenario, experiments: Sequence[HasKPIs]) -> list[dict[str, float]]:
    """Return the KPIs that agents learn from, of each experiment; all infinite if it was stopped."""
    if not has_goals(scenario):
        return [_tracked(scenario, experiment) for experiment in experiments]
    kpis = [kpi for kpi in scenario.kpis if kpi.goal is not None]
    # One table, a column for each KPI: NaN is what a run did not measure, which an `Outcome` drops.
    values = [[each.kpis.get(kpi.of or kpi.name, np.nan) for kpi in kpis] for each in experiments]
    table = np.array(values, dtype=float).reshape(len(experiments), len(kpis))
    known = np.stack([kpi.badness(column) for kpi, column in zip(kpis, table.T, strict=True)], axis=1)
    known[[each.end.interrupted for each in experiments]] = np.inf
    return [dict(zip([kpi.name for kpi in kpis], row, strict=True)) for row in known.tolist()]


def _tracked(scenario: Scenario, experiment: HasKPIs) -> dict[str, float]:
    """Return the generic KPIs of an experiment, the worst of all its maneuvers."""
    if not isinstance(experiment, Experiment):
        raise ScenarioError(
            f"scenario {scenario.name!r} has no KPI with a direction, so its trajectories are "
            "needed: simulate_many(..., trajectories=True)"
        )
    worst: dict[str, float] = {}
    for run in by_maneuver(experiment).values():
        for name, value in tracking_kpis(run).items() if len(run.t) else ():
            worst[name] = max(worst.get(name, value), value)
    return dict.fromkeys(worst, np.inf) if experiment.end.interrupted else worst


def grouped(kpis: Sequence[KPI], *experiments: Experiment) -> list[tuple[str, KPI]]:
    """Return the KPIs that some of the experiments have, each with the group that it belongs to.

    Without maneuvers there is one group, "". With maneuvers the groups are "worst" (the KPIs that
    agents learn from), "mean", whose KPIs have no objective, and the name of each maneuver.
    """
    parts = {part: None for e in experiments for part in by_maneuver(e) if part}
    if not parts:
        rows = [("", kpi) for kpi in kpis]
    else:
        rows = [(WORST, kpi) for kpi in kpis]
        rows += [(MEAN, _without_objective(kpi)) for kpi in kpis]
        rows += [(part, replace(k, name=named(k.name, part))) for part in parts for k in kpis]
    return [(part, kpi) for part, kpi in rows if any(kpi.name in e.kpis for e in experiments)]


def _without_objective(kpi: KPI) -> KPI:
    """Return the mean of a KPI; limits apply to each maneuver, not to their mean."""
    better = None if kpi.goal == "target" else kpi.goal
    name = named(kpi.name, MEAN)
    return replace(kpi, name=name, at_most=np.inf, at_least=-np.inf, better=better)


# --- What remains of one experiment of many: its KPIs, or why there are none.


@dataclass(frozen=True, eq=False, slots=True)
class Simulated:
    """An experiment without its trajectories.

    Args:
        theta: Controller parameters that ran, physical, shape (n,).
        end: Why the run ended.
        kpis: Key performance indicators by name; the scenario knows their units.
        solved: Whether the controller's problem was solved in every step.
    """

    theta: Float[np.ndarray, " n"]
    end: End
    kpis: Mapping[str, float]
    solved: bool

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", _frozen(self.theta))
        object.__setattr__(self, "kpis", FrozenMapping(self.kpis))

    def __reduce__(self) -> tuple[Any, ...]:  # unpickled arrays could be written to
        return type(self), (self.theta, self.end, dict(self.kpis), self.solved)

    @classmethod
    def of(cls, experiment: Experiment) -> "Simulated":
        """Return what remains of `experiment`."""
        kpis = {name: float(value) for name, value in experiment.kpis.items()}
        runs = experiment.runs or (experiment,)
        return cls(experiment.theta, experiment.end, kpis, all(bool(r.solved.all()) for r in runs))


@dataclass(frozen=True, eq=False, slots=True)
class FailedRun:
    """A run that produced no experiment. Like an experiment, it has θ, an end and KPIs (none).

    Args:
        theta: Controller parameters, physical, shape (n,).
        why: "raised" if the code raised an error, "died" if its process ended, "late" if it took
            too long.
        words: Message for people that says what happened.
        trace: Traceback of the code; empty if there is none.
    """

    theta: Float[np.ndarray, " n"]
    why: str
    words: str
    trace: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "theta", _frozen(self.theta))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.theta, self.why, self.words, self.trace)

    @property
    def end(self) -> End:
        """Return `End.FAILED`."""
        return End.FAILED

    @property
    def kpis(self) -> Mapping[str, float]:
        """Return no KPIs."""
        return FrozenMapping()

    @property
    def solved(self) -> bool:
        """Return False: no step is known to be solved."""
        return False


Result = Simulated | Experiment | FailedRun
"""What `simulate_many` returns for one θ; an `Experiment` only if trajectories are wanted."""


def _frozen(theta: Any) -> Float[np.ndarray, " n"]:
    copy = np.array(theta, dtype=float)
    copy.setflags(write=False)
    return copy


# --- The task of a worker: run one θ, and keep what is wanted. It is sent to the worker once.


@dataclass(frozen=True, slots=True)
class RunTask:
    """How each θ is run."""

    source: Source  # source of the scenario
    seed: int  # seed of every run
    trajectories: bool  # whether results are whole experiments

    def __call__(self, theta: Float[np.ndarray, " n"]) -> Simulated | Experiment:
        """Run θ, physical, shape (n,), and raise whatever the run raises."""
        experiment = check_returned(self.source.run(theta.copy(), seed=self.seed))
        return experiment if self.trajectories else Simulated.of(experiment)

    def here(self, theta: Float[np.ndarray, " n"]) -> Result:
        """Run θ in this process; an error of the run is a result, too."""
        try:
            return self(theta)
        except BaseException as error:
            return _result(theta, failure(error))

    def pool(self, jobs: int, longest: float, terms: Terms) -> Pool:
        """Return a pool of `jobs` workers whose results are those of `here`.

        Raises:
            ScenarioError: Later, if the run cannot be sent to, or loaded in, another process.
        """
        work = partial(_packed, self)
        return Pool(work, jobs, longest, terms, read=_result, unloadable=_unloadable)


def _result(theta: Float[np.ndarray, " n"], found: Any) -> Result:
    """Return what came of θ, physical, shape (n,), as a result."""
    if isinstance(found, RunError):
        return FailedRun(theta, found.why, str(found), found.trace)
    result: Result = decode(found) if isinstance(found, bytes) else found
    return result


def _unloadable(error: RunError) -> ScenarioError:
    return ScenarioError(
        f"the scenario cannot be loaded in another process: {error}. jobs=1 runs it in this one"
    )


def _run_of(files: dict[str, str], content: bytes) -> Callable[[Any], Any]:
    """Return, in a worker, what runs a θ; an experiment is sent as the bytes of its record."""
    task: RunTask = _Unpickler(BytesIO(content), files).load()

    def run(theta: Float[np.ndarray, " n"]) -> Simulated | bytes:
        found = task(theta)
        return encode(found) if isinstance(found, Experiment) else found

    return run


def _packed(task: RunTask) -> bytes:
    """Return the work of a worker, also if parts of `task` are known only in this process.

    What was made in a notebook or in the main script travels by value. A file that an import
    would not find, such as a user's own scenario, is named, and loaded again.

    Raises:
        ScenarioError: If a part of the run cannot be sent to another process.
    """
    try:
        content = cloudpickle.dumps(task)
    except Exception as error:
        raise ScenarioError(
            f"the run cannot be sent to other processes: {type(error).__name__}: {error}. "
            "jobs=1 runs it in this one"
        ) from error
    return pickle.dumps((_run_of, (dict(_files(content)), content)))


@final
class _Unpickler(pickle.Unpickler):
    """Unpickler that loads the files of modules that an import would not find."""

    def __init__(self, content: BytesIO, files: dict[str, str]) -> None:
        super().__init__(content)
        self._files = files

    def find_class(self, module: str, name: str) -> Any:
        """Return what `module` calls `name`."""
        path = self._files.pop(module, None)
        if path is not None and getattr(sys.modules.get(module), "__file__", None) != path:
            sys.modules.pop(module, None)  # another file of this name, which an earlier run needed
            module_at(Path(path))
        return super().find_class(module, name)


def _files(content: bytes) -> Iterator[tuple[str, str]]:
    """Yield names and files of modules that `content` may need and that an import does not find."""
    for name, module in sys.modules.copy().items():  # other threads import meanwhile
        path = getattr(module, "__file__", None)
        if not path or Path(path).stem != name or name.encode() not in content:
            continue
        spec = PathFinder.find_spec(name)
        if spec is None or spec.origin is None or Path(spec.origin) != Path(path).absolute():
            yield name, str(Path(path).absolute())


# --- Keep processes from one call to the next: to start them takes as long as many runs.


class _Kept:
    """Processes that the next call of `simulate_many` or `simulate_iter` takes."""

    def __init__(self) -> None:
        self._idle: Pool | None = None

    def take(self, task: RunTask, jobs: int, limit: float, terms: Terms) -> Pool:
        """Return a pool that runs `task`, in the processes of the last one if they have this time limit."""
        idle = self._idle
        if idle is None or idle.limit != limit:
            return task.pool(jobs, limit, terms)
        self._idle = None  # who calls meanwhile gets another one
        try:
            idle.renew(partial(_packed, task), jobs)
        except BaseException:  # it cannot be sent, or Ctrl-C
            idle.close()
            raise
        return idle

    def give(self, pool: Pool | None) -> None:
        """Keep a pool that has run all it was given, and end the one before it."""
        idle, self._idle = self._idle, pool
        if idle is not None:
            idle.close(gently=True)


_KEPT: ContextVar[_Kept | None] = ContextVar("_KEPT", default=None)


@contextmanager
def processes_kept() -> Iterator[None]:
    """Keep the processes of `simulate_many` and `simulate_iter` for later calls within, in this thread.

    Those of a call that fails, is interrupted or is not exhausted end, as they do without.
    """
    if _KEPT.get() is not None:
        yield
        return
    kept = _Kept()
    token = _KEPT.set(kept)
    try:
        yield
    finally:
        _KEPT.reset(token)
        kept.give(None)


# --- Compile what runs a scenario, which takes many seconds once on a machine.


def compile_runs(scenario: Scenario, report: Callable[[Compiling], None]) -> None:
    """Compile what runs a scenario, unless numba's cache already holds it; see `compile_missing`."""
    compile_missing(report, _kernels(scenario))


def _kernels(scenario: Scenario) -> list[Kernel]:
    """Return what runs a closed loop whose controller, in the middle of the ranges, is made of our PIDs."""
    source, space = scenario.source, scenario.space
    try:
        controller = source.controller and source.controller(space.decode(np.mean(space.corners, axis=0)))
        plant = compiled_plant(env_of(source), controller)
    except Exception:  # people's own code can raise anything; the run says what
        return []
    return [] if plant is None else [*of_compiled_runs(linear=isinstance(plant, LinearPlant))]


# --- Run many experiments of one scenario on all cores.

_AHEAD, _AHEAD_WHOLE = 10_000, 200
"""Number of results that may be waiting for an earlier one: without and with trajectories."""

Progress = Callable[[int, int | None], None]
"""Function of the number of results that have arrived and of all, None if that is unknown."""


def simulate_many(
    scenario: Scenario | str,
    thetas: Float[np.ndarray, "N n"],
    *,
    jobs: int | None = None,
    seed: int = 0,
    timeout: float | None = None,
    progress: Progress | bool = False,
    trajectories: bool = False,
) -> list[Result]:
    """Run every θ, and return the results in the same order.

    They equal those of `scenario.run(theta, seed)`, one by one. A run that raises an error, takes
    too long or kills its process is a `FailedRun` in its place.

    Args:
        scenario: Scenario, or its name as for `load`. It may be made anywhere, also in a notebook.
        thetas: θ to run, physical, shape (N, n).
        jobs: Number of processes; by default one for each core that this process may use. With 1
            and no time limit, θ runs in this process, which then ends if a run crashes.
        seed: Seed of every run.
        timeout: Time limit of each experiment in seconds; None for no limit.
        progress: True for a bar on standard error, or a function of the number of results that
            have arrived and of all.
        trajectories: Whether results are whole experiments. Otherwise they are `Simulated`, with
            θ, end and KPIs, and the trajectories never leave their process.

    Raises:
        ScenarioError: If there is no such scenario, or other processes cannot load it.
        KnobError: If a θ does not fit the scenario's space; the message names its row.
        SettingsError: If `jobs`, `seed` or `timeout` is not valid.
    """
    options = _Options(jobs, seed, timeout, progress, trajectories)
    found = _loaded(scenario)
    rows = list(_checked(found.space, _matrix(thetas, len(found.space))))
    return list(_results(found, rows, options, ahead=len(rows)))


def simulate_iter(
    scenario: Scenario | str,
    thetas: Iterable[Float[np.ndarray, " n"]],
    *,
    jobs: int | None = None,
    seed: int = 0,
    timeout: float | None = None,
    progress: Progress | bool = False,
    trajectories: bool = False,
) -> Generator[Result, None, None]:
    """Run every θ, and yield the results in the same order: for more than memory can hold.

    Arguments and errors are those of `simulate_many`, but `thetas` can be any iterable of θ,
    each of shape (n,). It is read, and its θ are checked, as the results are taken. Closing the
    iterator ends the runs.
    """
    options = _Options(jobs, seed, timeout, progress, trajectories)
    found = _loaded(scenario)
    ahead = _AHEAD_WHOLE if trajectories else _AHEAD
    return _results(found, thetas, options, ahead)


@dataclass(frozen=True, slots=True)
class _Options:
    """Options of `simulate_many`."""

    jobs: int | None
    seed: int
    timeout: float | None
    progress: Progress | bool
    trajectories: bool

    def __post_init__(self) -> None:
        jobs, seed, timeout = self.jobs, self.seed, self.timeout
        if jobs is not None and not is_integer(jobs, 1):
            raise SettingsError(f"jobs must be an integer, 1 or more, or None, got {jobs!r}")
        if not is_integer(seed):
            raise SettingsError(f"seed must be an integer, got {seed!r}")
        number = isinstance(timeout, int | float | np.number) and not isinstance(timeout, bool)
        if timeout is not None and not (number and timeout > 0):
            raise SettingsError(f"timeout must be above 0 s, or None, got {timeout!r}")


def _results(
    scenario: Scenario, thetas: Iterable[Float[np.ndarray, " n"]], options: _Options, ahead: int
) -> Generator[Result, None, None]:
    """Yield the results of all `thetas` in order, of which `ahead` may wait for an earlier one."""
    task = RunTask(scenario.source, int(options.seed), options.trajectories)
    total = len(thetas) if isinstance(thetas, Sized) else None
    jobs = options.jobs or usable_cores()
    jobs = jobs if total is None else min(jobs, max(total, 1))
    limit = np.inf if options.timeout is None else options.timeout
    here = options.jobs == 1 and options.timeout is None
    checked, arrived, taken = _checked(scenario.space, thetas), 0, 0
    with _shown(options.progress) as show:
        if here:
            for theta in checked:
                result, arrived = task.here(theta), arrived + 1
                show(arrived, total)
                yield result
            return
        kept, terms, done = _KEPT.get(), Terms(allows="timeout"), dict[int, Result]()
        pool = kept.take(task, jobs, limit, terms) if kept else task.pool(jobs, limit, terms)
        with closing(run_all(pool, checked, ahead, keep=kept is not None)) as arriving:
            for found in filter(None, arriving):
                arrived += len(found)
                show(arrived, total)
                done |= dict(found)
                while taken in done:
                    yield done.pop(taken)
                    taken += 1
        if kept:
            kept.give(pool)


def _loaded(scenario: Scenario | str) -> Scenario:
    found = load(scenario) if isinstance(scenario, str) else scenario
    if not isinstance(found, Scenario):
        raise ScenarioError(f"scenario must be a Scenario or its name, got {scenario!r}")
    return found


def _matrix(thetas: Float[np.ndarray, "N n"], knobs: int) -> Float[np.ndarray, "N n"]:
    try:
        matrix = np.array(thetas, dtype=float)
    except (TypeError, ValueError) as error:
        raise KnobError(f"thetas must be numbers of shape (N, {knobs}): {error}") from error
    if matrix.ndim != 2:
        raise KnobError(f"thetas must have shape (N, {knobs}), got {matrix.shape}")
    return matrix


def _checked(
    space: KnobSpace, thetas: Iterable[Float[np.ndarray, " n"]]
) -> Iterator[Float[np.ndarray, " n"]]:
    """Yield each θ if it fits the space."""
    for row, theta in enumerate(thetas):
        try:
            yield space.check(theta)
        except KnobError as error:
            raise KnobError(f"row {row} of thetas: {error}") from error


@contextmanager
def _shown(progress: Progress | bool) -> Iterator[Progress]:
    """Yield the function that is told about progress; for True, it draws a bar on standard error."""
    if progress is not True:
        yield progress or (lambda arrived, total: None)
        return
    from rich import progress as bar
    from rich.console import Console

    kinds = (bar.BarColumn, bar.MofNCompleteColumn, bar.TimeElapsedColumn, bar.TimeRemainingColumn)
    with bar.Progress(*(kind() for kind in kinds), console=Console(stderr=True)) as display:
        task = display.add_task("experiments", total=None)
        yield lambda arrived, total: display.update(task, completed=arrived, total=total)
