"""Simulate an FMU, θ after θ, in a process of its own."""

import atexit
import ctypes
import os
import shutil
import time
from collections import deque
from contextlib import suppress
from itertools import pairwise
from typing import Any, NamedTuple, final

import numpy as np

from prefcal_env.errors import PlantError

_QUICK = 1.0  # longest run in seconds after which it is tried whether a reset FMU runs in the same way
_C_TYPES: dict[str, dict[str, Any]] = {
    "2": {"Real": ctypes.c_double, "Integer": ctypes.c_int, "Boolean": ctypes.c_int},
    "3": {"Float64": ctypes.c_double, "Float32": ctypes.c_float, "Boolean": ctypes.c_bool}
    | {
        name: getattr(ctypes, f"c_{name.lower()}")
        for name in ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
    },
}
_STATUS = {2: "discarded the step", 3: "returned an error", 4: "returned a fatal error"}


class FMUJob(NamedTuple):
    """What to simulate."""

    path: str  # of the .fmu file; in the process, of the folder with its contents
    knobs: tuple[tuple[str, int], ...]  # type and value reference of each parameter that θ sets
    shown: tuple[tuple[str, int], ...]  # the same of each variable to record
    instants: Any  # start, communication instants and end, in seconds, shape (M,)
    every: int  # every how many communications the variables are recorded; the end always is
    tolerance: float | None  # relative tolerance of the FMU's solver; None for its own


class Reply(NamedTuple):
    """What a run gave."""

    problem: str  # what ended the run before its time; empty if nothing did
    t: Any  # recorded instants, in seconds, shape (K,)
    values: Any  # recorded variables, shape (K, m)
    seconds: float  # duration of the simulation


class _Stop(Exception):
    """The FMU ended the simulation; the message says how."""


class _Reader:
    """Read all variables of one type with one call: their value references and columns in the record."""

    def __init__(self, fmu: Any, version: str, type_: str, references: list[int], columns: list[int]) -> None:
        count = len(references)
        self._fmu, self._get = fmu, getattr(fmu, f"fmi{version}Get{type_}")
        self._references = (ctypes.c_uint32 * count)(*references)
        self._buffer: ctypes.Array[Any] = (_C_TYPES[version][type_] * count)()
        self._view = np.ctypeslib.as_array(self._buffer)
        self._count, self._more = count, () if version == "2" else (count,)
        self._columns = columns

    def read(self, row: Any) -> None:
        """Write the current values into `row` of the record, shape (m,)."""
        instance, places = self._fmu.component, self._references
        self._get(instance, places, self._count, self._buffer, *self._more)
        row[self._columns] = self._view


@final
class FMUSimulation:
    """One instance of an FMU that is used again and again.

    A reset FMU should run as a new one does. If the first run was quick, a request without θ finds
    that out: if the same θ then gives the same record, the instance is reset between runs.
    Otherwise each run gets a new instance.

    Raises:
        PlantError: If the FMU cannot be started.
    """

    def __init__(self, job: FMUJob) -> None:
        import fmpy
        from fmpy.simulation import instantiate_fmu

        self._job, self._parent = job, os.getppid()
        self._said: deque[str] = deque(maxlen=1)
        try:
            self._description = fmpy.read_model_description(job.path, validate=False)
            self.version = self._description.fmiVersion[0]
            self._fmu: Any = instantiate_fmu(
                job.path, self._description, "CoSimulation", logger=self._hear, require_functions=False
            )
        except Exception as error:  # whatever FMPy raises
            words = " ".join(str(error).split())
            raise PlantError(f"the FMU cannot be started: {words}") from error
        self._used = self._resettable = False
        self._first: tuple[list[float], Reply] | None = None
        groups: dict[str, tuple[list[int], list[int]]] = {}
        for column, (type_, reference) in enumerate(job.shown):
            references, columns = groups.setdefault(self._named(type_), ([], []))
            references.append(reference)
            columns.append(column)
        self._readers = [_Reader(self._fmu, self.version, t, *g) for t, g in groups.items()]
        atexit.register(self.close)

    def __call__(self, theta: list[float] | None) -> "Reply | bool":
        """Simulate θ, one value for each knob; without θ, return whether a reset can be tried."""
        with suppress(OSError):
            os.ftruncate(2, 0)  # what it printed during earlier runs
            os.lseek(2, 0, os.SEEK_SET)
        return self.try_reset() if theta is None else self.run(theta)

    def run(self, theta: list[float]) -> Reply:
        """Simulate θ, one value for each knob of the job."""
        self._said.clear()
        begun = time.perf_counter()
        rows: list[Any] = []
        try:
            self._renew()
            self._begin(theta)
            self._simulate(rows)
            problem = ""
        except Exception as error:  # whatever FMPy raises
            problem = self._told(error)
            self._resettable = self._resettable and isinstance(error, _Stop)
        taken = time.perf_counter() - begun
        t = np.array([row[0] for row in rows])
        values = np.array([row[1] for row in rows]).reshape(len(rows), len(self._job.shown))
        answer = Reply(problem, t, values, taken)
        self._first = self._first or (theta, answer)
        return answer

    def try_reset(self) -> bool:
        """Find out whether a reset FMU repeats the first run; False if there was none."""
        if self._first is None:
            return False
        theta, answer = self._first
        if not answer.problem and answer.seconds <= _QUICK:
            self._resettable = True
            again = self.run(theta)
            self._resettable = not again.problem and np.array_equal(
                again.values, answer.values, equal_nan=True
            )
        return True

    def close(self) -> None:
        """Let the FMU release what it holds; if prefcal is gone, remove the files."""
        if self._fmu.component:
            free = getattr(self._fmu, f"fmi{self.version}FreeInstance")
            free(self._fmu.component)
            self._fmu.component = None
        if os.getppid() != self._parent:
            shutil.rmtree(os.path.dirname(self._job.path), ignore_errors=True)

    def _renew(self) -> None:
        """Return to the state of a new instance."""
        if not self._used:
            self._used = True
        elif self._resettable:
            self._fmu.reset()
        else:
            self.close()  # without FMPy's freeInstance, which unloads the library, too
            if self.version == "2":
                self._fmu.instantiate(callbacks=self._fmu.callbacks)
            else:
                self._fmu.instantiate(logMessage=self._hear)

    def _begin(self, theta: list[float]) -> None:
        fmu, job = self._fmu, self._job
        times = {"startTime": float(job.instants[0]), "stopTime": float(job.instants[-1])}
        if self.version == "2":
            fmu.setupExperiment(tolerance=job.tolerance, **times)
        for (type_, reference), value in zip(job.knobs, theta, strict=True):
            name = self._named(type_)
            real = name in ("Real", "Float64", "Float32")
            getattr(fmu, f"set{name}")([reference], [value if real else round(value)])
        if self.version == "2":
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(tolerance=job.tolerance, **times)
        fmu.exitInitializationMode()

    def _simulate(self, rows: list[Any]) -> None:
        """Step through all instants, and append time and values to `rows` meanwhile."""
        instants = self._job.instants.tolist()
        last, every = len(instants) - 1, self._job.every
        rows.append(self._row(instants[0]))
        for number, (now, then) in enumerate(pairwise(instants), 1):
            self._step(now, then - now)
            if not number % every or number == last:
                rows.append(self._row(then))
        with suppress(Exception):  # the record is complete
            self._fmu.terminate()

    def _row(self, now: float) -> tuple[float, Any]:
        row = np.empty(len(self._job.shown))
        for reader in self._readers:
            reader.read(row)
        return now, row

    def _step(self, now: float, step: float) -> None:
        try:
            done = self._fmu.doStep(now, step)
        except Exception as error:
            status = getattr(error, "status", None)
            if status == 2 and self.version == "2" and self._wants_end():
                raise _Stop(f"the FMU ended the simulation after t = {now:g} s") from error
            what = _STATUS.get(status, str(error)) if isinstance(status, int) else str(error)
            raise RuntimeError(f"the FMU {what} after t = {now:g} s") from error
        if self.version == "3" and done[1]:
            raise _Stop(f"the FMU ended the simulation after t = {now:g} s")

    def _wants_end(self) -> bool:
        try:
            return bool(self._fmu.getBooleanStatus(3))  # it wants to end the simulation
        except Exception:  # not every FMU can tell
            return False

    def _named(self, type_: str) -> str:
        """Return the type as the functions of this version of FMI name it."""
        whole = "Integer" if self.version == "2" else "Int64"
        return whole if type_ == "Enumeration" else type_

    def _told(self, error: Exception) -> str:
        status = getattr(error, "status", None)
        words = " ".join(str(error).split())
        if status is not None:
            words = f"the FMU {_STATUS.get(status, 'failed')} while it was initialized"
        return f"{words}: {self._said[0]}" if self._said else words

    def _hear(self, *message: Any) -> None:
        """Keep the latest message of the FMU; its last argument is the text."""
        text = message[-1]
        words = text.decode(errors="replace") if isinstance(text, bytes) else str(text or "")
        if words.strip():
            self._said.append(" ".join(words.split())[-300:])
