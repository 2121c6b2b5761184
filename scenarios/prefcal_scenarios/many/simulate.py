"""Run many experiments of one scenario on all cores."""

from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from contextlib import closing, contextmanager
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_integer
from prefcal_env.errors import KnobError, ScenarioError, SettingsError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.workers import Terms, run_all, usable_cores
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Scenario

from .results import Result
from .task import Task

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
    task = Task(scenario.source, int(options.seed), options.trajectories)
    total = len(thetas) if isinstance(thetas, Sized) else None
    jobs = options.jobs or usable_cores()
    jobs = jobs if total is None else min(jobs, max(total, 1))
    limit = np.inf if options.timeout is None else options.timeout
    here = options.jobs == 1 and options.timeout is None
    checked = _checked(scenario.space, thetas)

    def results() -> Generator[Result, None, None]:
        with _shown(options.progress) as show:
            arrived = taken = 0
            if here:
                for theta in checked:
                    result, arrived = task.here(theta), arrived + 1
                    show(arrived, total)
                    yield result
                return
            pool, done = task.pool(jobs, limit, Terms(allows="timeout")), dict[int, Result]()
            with closing(run_all(pool, checked, ahead)) as arriving:
                for found in filter(None, arriving):
                    arrived += len(found)
                    show(arrived, total)
                    done |= dict(found)
                    while taken in done:
                        yield done.pop(taken)
                        taken += 1

    return results()


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
