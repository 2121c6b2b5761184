"""The task of a worker: run one θ, and keep what is wanted. It is sent to the worker once."""

import pickle
import sys
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.machinery import PathFinder
from io import BytesIO
from pathlib import Path
from typing import Any, final

import cloudpickle
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError
from prefcal_scenarios.own.checks import returned
from prefcal_scenarios.own.own_file import module_at
from prefcal_scenarios.own.own_line import as_exception, in_words
from prefcal_scenarios.scenario import Run

from .results import FailedRun, Result, Simulated


@dataclass(frozen=True, slots=True)
class Task:
    """How each θ is run.

    Args:
        run: Run of the scenario.
        seed: Seed of every run.
        trajectories: Whether results are whole experiments.
    """

    run: Run
    seed: int
    trajectories: bool

    def __call__(self, theta: Float[np.ndarray, " n"]) -> Result:
        """Run θ, physical, shape (n,); an error of the run is a result, too.

        KeyboardInterrupt is raised again: it may be Ctrl-C.
        """
        try:
            experiment = returned(self.run(theta.copy(), seed=self.seed))
            return experiment if self.trajectories else Simulated.of(experiment)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            return failed(theta, error)


def failed(theta: Float[np.ndarray, " n"], error: BaseException) -> FailedRun:
    """Return the result of a run of θ that raised `error`."""
    trace = "".join(traceback.format_exception(error))
    return FailedRun(theta, "raised", in_words(as_exception(error)), trace)


def packed(task: Task) -> bytes:
    """Return `task` as bytes, also if parts of it are known only in this process.

    What was made in a notebook or in the main script travels by value. A file that an import
    would not find, such as a user's own scenario, is named, and loaded again by `unpacked`.

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
    return pickle.dumps((dict(_files(content)), content))


def unpacked(content: bytes) -> Task:
    """Return the task that `packed` packed; its files run in this process."""
    files, task = pickle.loads(content)
    found: Task = _Unpickler(BytesIO(task), files).load()
    return found


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
