"""Compile the kernels one by one, so that somebody who waits sees how far it is.

numba compiles a function when it is first called, and keeps the result beside the file, or, where
that may not be written to, in the user's cache folder. A wheel cannot bring it along: it is only
good for the processor that made it, and for the very file, its date included.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any


@dataclass(frozen=True, slots=True)
class Compiling:
    """What is being compiled now: part number `part`, from 1, of `parts`, called `title`."""

    part: int
    parts: int
    title: str

    @property
    def words(self) -> str:
        """For people."""
        return (
            f"Compiling the solver, part {self.part} of {self.parts} ({self.title}): "
            "only this once on this machine"
        )


@dataclass(frozen=True, slots=True)
class Kernel:
    """A function to compile.

    Args:
        title: What it does, in a few words.
        function: As numba wrapped it.
        types: Of its arguments.
    """

    title: str
    function: Any
    types: tuple[Any, ...]


def compile_missing(told: Callable[[Compiling], None]) -> None:
    """Compile what the modules that are loaded need, unless an earlier run has left it.

    `told` hears of each part as its compilation begins, and of nothing where nothing is missing.
    """
    if not _loaded("prefcal_env.qp"):
        return
    from numba.core import event  # half a second, for those who need it

    found = tuple(kernels())
    for k, kernel in enumerate(found):
        now = Compiling(k + 1, len(found), kernel.title)
        with event.install_listener("numba:compile", _once(partial(told, now))):
            kernel.function.compile(kernel.types)


def _once(told: Callable[[], None]) -> Any:
    """Return a listener of numba that calls `told` when a compilation begins, the first time."""
    from numba.core import event

    class Once(event.Listener):
        begun = False

        def on_start(self, event: Any) -> None:
            """Hear that one begins; others begin inside it."""
            if not self.begun:
                self.begun = True
                told()

        def on_end(self, event: Any) -> None:
            """Hear that one has ended."""

    return Once()


def kernels() -> Iterator[Kernel]:
    """The kernels of the modules that are loaded, those first that others call."""
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
    from numba import float64, int64

    from . import _hold, _plan, _riccati

    cube, matrix, vector = float64[:, :, ::1], float64[:, ::1], float64[::1]
    model = (cube, cube, matrix)
    several: Any = numba.types.UniTuple
    roots, limits = several(matrix, 3), (vector,) * 4
    yield Kernel("discrete model", _hold.discretise, (matrix, matrix, vector, float64))
    corner = (matrix, int64, int64, int64)
    yield Kernel("triangular factors", _riccati.triangularise, corner)
    whole = (*model, cube, cube, matrix, roots, matrix, int64)
    yield Kernel("optimal feedback", _riccati.backward, whole)
    yield Kernel("prediction", _plan.forward, (*model, cube, int64))
    yield Kernel("limits", _plan.input_rows, (cube, vector, *limits))
    every = (*whole, int64, vector, several(vector, 4))
    yield Kernel("quadratic program", _plan.condense, every)
    yield Kernel("inputs", _plan.inputs, (cube, vector, vector, vector, vector))


def _of_the_reactor() -> Iterator[Kernel]:
    from numba import float64

    from prefcal_env.plants import _cstr_kernels

    vector = float64[::1]
    hold = (vector, vector, vector, vector, float64)
    yield Kernel("reactor", _cstr_kernels.hold, hold)
