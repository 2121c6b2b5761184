"""Compile the kernels one by one, so that the user sees progress while they wait.

numba compiles a function when it is first called and keeps the result beside the source file, or,
if that folder is not writable, in the user's cache folder. A wheel cannot ship compiled code: it
is valid only for one processor and one file, including the file's date.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any


@dataclass(frozen=True, slots=True)
class Compiling:
    """Progress of the compilation: part number `part`, from 1, of `parts`, called `title`."""

    part: int
    parts: int
    title: str

    @property
    def words(self) -> str:
        """Message for people."""
        return (
            f"Compiling the solver, part {self.part} of {self.parts} ({self.title}): "
            "only this once on this machine"
        )


@dataclass(frozen=True, slots=True)
class Kernel:
    """A function to compile.

    Args:
        title: Its purpose in a few words.
        function: The function as wrapped by numba.
        types: Types of its arguments.
    """

    title: str
    function: Any
    types: tuple[Any, ...]


def compile_missing(report: Callable[[Compiling], None]) -> None:
    """Compile the kernels of all loaded modules, unless numba's cache already holds them.

    `report` is called with each part as its compilation begins; never if nothing is missing.
    """
    if not _loaded("prefcal_env.qp"):
        return
    from numba.core import event  # takes half a second, so import it only when needed

    found = tuple(kernels())
    for k, kernel in enumerate(found):
        now = Compiling(k + 1, len(found), kernel.title)
        with event.install_listener("numba:compile", _once(partial(report, now))):
            kernel.function.compile(kernel.types)


def _once(report: Callable[[], None]) -> Any:
    """Return a numba listener that calls `report` once, when the first compilation begins."""
    from numba.core import event

    class Once(event.Listener):
        begun = False

        def on_start(self, event: Any) -> None:
            """React to the first event only; other compilations begin inside it."""
            if not self.begun:
                self.begun = True
                report()

        def on_end(self, event: Any) -> None:
            """Ignore the end of a compilation."""

    return Once()


def kernels() -> Iterator[Kernel]:
    """Yield the kernels of all loaded modules; kernels come before their callers."""
    if _loaded("prefcal_env.mpc.controller"):
        yield from _of_the_mpc()
    if _loaded("prefcal_env.qp"):
        yield from _of_the_solver()
    if _loaded("prefcal_env.envs.cstr"):
        yield from _of_the_reactor()


def _loaded(module: str) -> bool:
    return module in sys.modules


def _of_the_solver() -> Iterator[Kernel]:
    from numba import float64

    from prefcal_env.qp import _kernels

    matrix, vector = float64[:, ::1], float64[::1]
    yield Kernel("check of the limits", _kernels.check_rows, (matrix, vector, vector))
    terms = (matrix, vector, matrix, vector, vector, vector, vector)
    yield Kernel("check of the solution", _kernels.residuals, terms)


def _of_the_mpc() -> Iterator[Kernel]:
    import numba
    from numba import boolean, float64, int64

    from . import _plan, _riccati, _rows, _step

    several: Any = numba.types.UniTuple
    mixed: Any = numba.types.Tuple
    cube, matrix, vector, chosen = float64[:, :, ::1], float64[:, ::1], float64[::1], int64[::1]
    model = (cube, cube, matrix)
    yield Kernel("triangular factors", _riccati.triangularize, (matrix, int64, int64, int64))
    whole = (*model, cube, cube, matrix, several(matrix, 3), matrix, int64)
    yield Kernel("optimal feedback", _riccati.backward, whole)
    yield Kernel("prediction", _plan.forward, (*model, cube, int64))
    step = (
        mixed((int64, int64, int64, vector, chosen, chosen)),
        mixed((vector, vector, matrix, matrix)), several(matrix, 2),
        mixed((float64, int64, int64, int64)), several(matrix, 4),
        several(vector, 4), several(vector, 3),
    )  # fmt: skip
    solver = mixed((boolean, float64, float64, int64))
    yield Kernel("quadratic program", _step.decide, (*step, solver))
    yield Kernel("second quadratic program", _step.in_inputs, step)
    yield Kernel("inputs", _rows.inputs, (cube, vector, vector, several(vector, 4)))


def _of_the_reactor() -> Iterator[Kernel]:
    from numba import boolean, float64, int64

    # Importing the equations compiles them.
    from prefcal_env.plants import _cstr_kernels, _dop853  # noqa: F401

    arrays = (float64[::1],) * 5
    hold = (int64, *arrays, float64, boolean)
    yield Kernel("simulation", _dop853.integrate, hold)
