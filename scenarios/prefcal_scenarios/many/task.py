"""The task of a worker: run one θ, and keep what is wanted. It is sent to the worker once."""

import pickle
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.machinery import PathFinder
from io import BytesIO
from pathlib import Path
from typing import Any, final

import cloudpickle
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import RunError, ScenarioError
from prefcal_env.experiments.experiment import Experiment, returned
from prefcal_env.sources.source import Source
from prefcal_env.study.codec import decode, encode
from prefcal_env.workers import Pool, Terms, failure
from prefcal_scenarios.own.own_file import module_at

from .results import FailedRun, Result, Simulated


@dataclass(frozen=True, slots=True)
class Task:
    """How each θ is run.

    Args:
        source: Source of the scenario.
        seed: Seed of every run.
        trajectories: Whether results are whole experiments.
    """

    source: Source
    seed: int
    trajectories: bool

    def __call__(self, theta: Float[np.ndarray, " n"]) -> Simulated | Experiment:
        """Run θ, physical, shape (n,), and raise whatever the run raises."""
        experiment = returned(self.source.run(theta.copy(), seed=self.seed))
        return experiment if self.trajectories else Simulated.of(experiment)

    def here(self, theta: Float[np.ndarray, " n"]) -> Result:
        """Run θ in this process; an error of the run is a result, too."""
        try:
            return self(theta)
        except BaseException as error:
            return _result(theta, failure(error))

    def pool(self, jobs: int, longest: float, terms: Terms) -> Pool:
        """Return a pool of `jobs` workers whose results are those of `here`.

        Args:
            jobs: Number of workers, 1 or more.
            longest: Largest time limit of an experiment in seconds; infinite for none.
            terms: On what terms the workers run.

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
    task: Task = _Unpickler(BytesIO(content), files).load()

    def run(theta: Float[np.ndarray, " n"]) -> Simulated | bytes:
        found = task(theta)
        return encode(found) if isinstance(found, Experiment) else found

    return run


def _packed(task: Task) -> bytes:
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
        if module in self._files:
            module_at(Path(self._files.pop(module)))
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
