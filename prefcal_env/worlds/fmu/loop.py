"""A closed loop in an FMU as a function of θ, in a worker process that may hang or crash."""

import os
import pickle
import shutil
import tempfile
import threading
import time
import weakref
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number
from prefcal_env.errors import KnobError, PlantError, RunError, ScenarioError
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment, KPIs
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.sources.source import Function, Source, Varied
from prefcal_env.sources.varied import CHANGE, Factor, Values
from prefcal_env.tables.recorded import recorded
from prefcal_env.workers import MARK, Terms, Worker

from .model import Names, Variable, grid_of, read_model, referenced, refuse_bomb, shown, tuned
from .simulation import FMUJob, FMUSimulation, Reply

_RUNS = 1_000  # number of runs after which the process is replaced, so that FMUs that leak stay small
_PREFIX = "prefcal-fmu-"


@final
class FMUProcess:
    """A process that simulates an FMU; it starts with the first run and is kept for the next.

    `limit` is the time limit of a run in seconds; infinite for none.
    """

    def __init__(self, job: FMUJob, limit: float) -> None:
        self._given = job, limit
        self._lock = threading.Lock()
        self._started = _Started(job)
        terms = Terms("the simulation", "timeout", threads=None, quiet=True)
        self._worker = Worker(self._started.work, limit, terms)
        self._resets = True  # whether a reset of the FMU may be tried
        weakref.finalize(self, _release, self._worker, self._started)

    @property
    def pid(self) -> int | None:
        """Return the id of the process; None before the first run and after a failed one."""
        return self._worker.pid

    def run(self, theta: list[float]) -> Reply:
        """Simulate θ, one value for each knob of the job. May be called from any thread.

        Raises:
            RunError: If the FMU cannot be started, takes too long, or ends the process.
            PlantError: If the file is no longer there.
        """
        with self._lock:
            started = self._started
            if started.runs == 1 and self._resets and self.pid is not None:
                started.runs += 1
                try:  # whether the process goes on after a reset was tried, whatever came of it
                    self._resets = bool(self._worker.run(None))
                except RunError:
                    self._resets = False
            if started.runs > _RUNS:
                self._worker.release()
            answer: Reply = self._worker.run(theta)
            started.runs += 1
            return answer

    def close(self) -> None:
        """End the process and remove its files; a further run starts anew."""
        with self._lock:
            _release(self._worker, self._started)

    def __reduce__(self) -> tuple[Any, ...]:  # a copy starts a process of its own
        return type(self), self._given


class _Started:
    """What starts each process: the files of the FMU, which are unpacked when they are needed."""

    def __init__(self, job: FMUJob) -> None:
        self._job, self.runs = job, 0  # runs of the present process
        self.owner = os.getpid()  # whose files they are: this may be a fork
        self.home: Path | None = None  # folder of the files, once they are unpacked

    def work(self) -> bytes:
        """Return the work of a new process."""
        if self.home is None or not self.home.exists() or self.owner != os.getpid():
            # Computers tidy their temporary folders, and a study may take weeks.
            self.home = unpack(Path(self._job.path))
        self.owner, self.runs = os.getpid(), 0
        return pickle.dumps((FMUSimulation, (self._job._replace(path=str(self.home / "fmu")),)))


def _release(worker: Worker, started: _Started) -> None:
    """End the process, and remove its files, unless this is a fork of their owner."""
    if started.owner != os.getpid():
        return
    worker.release()
    if started.home is not None:
        shutil.rmtree(started.home, ignore_errors=True)
        started.home = None


def unpack(path: Path) -> Path:
    """Return a new folder, with the contents of the FMU in its folder "fmu".

    Raises:
        PlantError: If it cannot be unpacked, or would fill the disk.
    """
    _remove_leftovers()
    # The worker that this is, if it is one, is ended before it could remove a large folder: its owner does.
    mark = os.environ.get(MARK, "")
    home = Path(tempfile.mkdtemp(prefix=f"{_PREFIX}{os.getpid()}-{mark}-"))
    try:
        with zipfile.ZipFile(path) as content:
            refuse_bomb(content, path)  # it may have changed since it was read
            content.extractall(home / "fmu")
    except BaseException as error:  # Ctrl-C, too
        shutil.rmtree(home, ignore_errors=True)
        if not isinstance(error, OSError | zipfile.BadZipFile):
            raise
        raise PlantError(f"cannot unpack the FMU {str(path)!r}: {error}") from error
    return home


def _remove_leftovers() -> None:
    """Remove old folders of ours whose process was killed before it could remove them."""
    if os.name != "posix":
        return
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*-*"):
        with suppress(OSError, ValueError):
            found = folder.lstat()
            # A day: the process of a container can look as if it were gone.
            mine = found.st_uid == os.getuid() and time.time() - found.st_mtime > 24 * 3600.0
            if mine and not _runs(int(folder.name.removeprefix(_PREFIX).partition("-")[0])):
                shutil.rmtree(folder, ignore_errors=True)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@final
class FMULoop:
    """A closed loop in an FMU that includes the controller (FMI 2 or 3, co-simulation).

    θ holds start values of parameters. The FMU runs in a process of its own, which starts with the
    first run and is kept for the next ones. A run that hangs or crashes is an experiment with
    `End.FAILED` and no record; `problem` then says what happened. One that the FMU ends before its
    time, with an error or on purpose, or whose outputs become infinite or NaN, is an experiment up
    to there with `End.UNSAFE`. A loop can be pickled; the copy starts a process of its own.

    Args:
        path: The .fmu file.
        knobs: Knobs named as the parameters, or a mapping from parameters to knobs with other
            names. Units and descriptions that a knob lacks are those of the FMU. Its unit may be
            any that converts into the parameter's; display units are those that the FMU defines.
        outputs: Variables shown as outputs, or a mapping from shown names to variables. They have
            the FMU's unit, or one to convert to: "T [degC]".
        inputs: Variables shown as control signals, or such a mapping.
        reference: Maps shown outputs to their reference: a number in the output's unit, or the
            name of a variable of the FMU.
        stop_time: End of the simulation in seconds; None for that of the FMU.
        output_interval: Time between recorded instants in seconds; None for the step that the FMU
            declares, or a multiple of it if that records more than 2,000 instants.
        timeout: Time limit of a run in seconds of real time; infinite for none.
        kpis: Function that returns the KPIs of an experiment by name; None for no KPIs.

    Attributes:
        model: Model description of the FMU.
        parameters: Names of the parameters of the knobs, in their order.
        space: Space of the knobs, with units of the FMU.
        channels: Names, units, limits and targets of what is shown.
        problem: What ended the latest run before its time; empty if nothing did.
        seconds: Duration of the latest simulation that gave a record; None before the first one.

    Raises:
        PlantError: If the FMU cannot be used here, or a variable, a time or a reference is wrong.
        KnobError: If a knob does not fit its parameter.
        MissingExtraError: If the extra `fmu` is not installed.
    """

    signals: tuple[str, ...] = ()
    """Additional signals of the experiments: none."""

    def __init__(
        self,
        path: Path | str,
        knobs: Mapping[str, Knob] | Sequence[Knob],
        outputs: Names,
        inputs: Names = (),
        reference: Mapping[str, float | str] | None = None,
        stop_time: float | None = None,
        *,
        output_interval: float | None = None,
        timeout: float = 60.0,
        kpis: KPIs | None = tracking_kpis,
    ) -> None:
        self.model, self.kpis = read_model(path), kpis
        self.problem = ""
        self.seconds: float | None = None
        if not (is_number(timeout) and timeout > 0):
            raise PlantError(f"timeout must be above 0 s, got {timeout!r}")
        found = tuned(self.model, knobs)
        self.parameters, self.space = tuple(found), KnobSpace(list(found.values()))
        self._shows = outputs, inputs, reference, stop_time
        self._takes = output_interval, timeout
        self._parameters = [self.model.variable(f"{n} [{k.unit}]") for n, k in found.items()]
        self._outputs, self._inputs = shown(self.model, outputs, inputs)
        self._numbers, self._variables = referenced(self.model, self._outputs, reference)
        u = tuple(Channel(n, v.unit, v.low, v.high) for n, v in self._inputs.items())
        y = tuple(Channel(n, v.unit, v.low, v.high, self._numbers.get(n)) for n, v in self._outputs.items())
        self.channels = Channels((), u, y)
        shows = self._outputs, self._inputs, self._variables
        self._recorded = [variable for group in shows for variable in group.values()]
        knobs_, shown_ = (
            tuple((v.type, v.reference) for v in each) for each in (self._parameters, self._recorded)
        )
        instants, every = grid_of(self.model, stop_time, output_interval)
        job = FMUJob(str(self.model.path), knobs_, shown_, instants, every, self.model.tolerance)
        self._process = FMUProcess(job, timeout)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Simulate θ, physical, shape (n,). An FMU has no seed: `seed` changes nothing.

        Raises:
            KnobError: If θ has the wrong shape or leaves the limits of the FMU.
            PlantError: If the FMU is no longer there.
        """
        try:
            return self.attempt(theta)
        except RunError as error:
            self.problem = str(error)
            return Experiment.blank(np.asarray(theta, dtype=float), self.channels, End.FAILED)

    def attempt(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Simulate θ like a call, but raise RunError if the FMU hangs, crashes, or leaves no record."""
        theta = self._checked(theta)
        pairs = zip(self._parameters, theta, strict=True)
        try:
            answer = self._process.run([self._stored(*pair) for pair in pairs])
        except RunError as error:
            hint = " (if only some θ do, narrow the ranges of the knobs)"
            raise RunError(f"{error}{hint if error.why == 'died' else ''}", error.why) from error
        finite = np.isfinite(answer.values).all(axis=1)
        count = len(finite) if finite.all() else int(np.argmin(finite))
        self.problem, self.seconds = answer.problem, answer.seconds
        if count < len(finite) and not self.problem:
            self.problem = f"a variable is infinite or NaN at t = {answer.t[count]:g} s"
        if not count:
            raise RunError(self.problem, "raised")
        return self._experiment(theta, answer, count)

    def with_knobs(self, more: Sequence[Knob]) -> "FMULoop":
        """Return the same loop with more knobs behind its own, named as parameters of the FMU."""
        knobs = dict(zip(self.parameters, self.space, strict=True)) | {knob.name: knob for knob in more}
        interval, timeout = self._takes
        return FMULoop(
            self.model.path, knobs, *self._shows, output_interval=interval, timeout=timeout, kpis=self.kpis
        )

    def varied(self) -> Varied:
        """Return the real parameters of the FMU that are no knobs, within its limits.

        Raises:
            ScenarioError: If it has none.
        """
        free = [v for v in self.model.parameters if v.name not in self.parameters and not v.whole]
        usual = [(v, Factor.around(v.name, "parameter", CHANGE, v.start, v.unit)) for v in free if v.start]
        factors = tuple(
            replace(f, low=max(f.low, v.low), high=min(f.high, v.high), possible=(v.low, v.high))
            for v, f in usual
        )
        if not factors:
            raise ScenarioError(
                "its FMU has no other real parameters with a value: export those of the plant"
            )
        wider = self.with_knobs([Knob(f.name, f.low, f.high, f.unit) for f in factors])
        said = [("sensors, actuators and the task", "they are in the FMU, whose parameters vary")]
        if fixed := ", ".join(v.name for v in free if not v.start):
            said += [(f"further parameters ({fixed})", "the FMU gives them no value, or 0")]
        return Varied(factors, tuple(said), partial(wider._with_parameters, factors))

    def _with_parameters(self, factors: Sequence[Factor], values: Values) -> Source:
        return Function(partial(self._attempt, [values.get(f.name, f.nominal) for f in factors]))

    def _attempt(self, more: list[float], theta: Any, seed: int = 0) -> Experiment:
        """Return the experiment of θ, shape (n,), with values of the knobs behind it."""
        return replace(self.attempt(np.array([*theta, *more])), theta=theta)

    def close(self) -> None:
        """End the process and remove its files now rather than at exit; a further run restarts."""
        self._process.close()

    @property
    def pid(self) -> int | None:
        """Return the id of the process of the FMU; None while there is none."""
        return self._process.pid

    def _checked(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        theta = np.asarray(theta, dtype=float)
        if theta.shape != (len(self.space),) or not np.isfinite(theta).all():
            raise KnobError(f"θ must be {len(self.space)} finite numbers, got {theta}")
        for knob, variable, value in zip(self.space, self._parameters, theta, strict=True):
            if not variable.low <= value <= variable.high:
                raise KnobError(f"{knob.name} must lie in {variable.limits}, got {value:g}")
        return theta

    def _stored(self, variable: Variable, value: float) -> float:
        """Return the value of a knob in the FMU's unit; rounding takes it beyond no limit."""
        own = self.model.variables[variable.name]
        return float(np.clip(variable.scale.back(value), own.low, own.high))

    def _experiment(self, theta: Float[np.ndarray, " n"], answer: Reply, count: int) -> Experiment:
        n_y, n_u = len(self._outputs), len(self._inputs)
        pairs = zip(self._recorded, answer.values[:count].T, strict=True)
        columns = [variable.scale.to(column) for variable, column in pairs]
        outputs = dict(zip(self._outputs, columns, strict=False))
        inputs = dict(zip(self._inputs, columns[n_y:], strict=False))
        curves = dict(zip(self._variables, columns[n_y + n_u :], strict=True))
        channels = (*self.channels.y, *self.channels.u)
        return recorded(
            theta,
            answer.t[:count],
            outputs,
            inputs,
            {**self._numbers, **curves},
            units={c.name: c.unit for c in channels},
            limits={c.name: (c.low, c.high) for c in channels},
            end=End.UNSAFE if self.problem else End.TIME_UP,
            kpis=self.kpis,
        )
