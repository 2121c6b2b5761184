"""Compile the kernels one by one, so that the user sees progress while they wait.

numba compiles a function when it is first called, and `prefcal_env.jit` keeps the result. A wheel
cannot ship compiled code: it is valid only for one kind of processor. A module that calls kernels
names them with `compile_ahead`, so only those are compiled that the loaded modules use.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
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
    found = tuple(kernels())
    if not found:
        return
    from numba.core import event  # takes half a second, so import it only when needed

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
    """Yield the kernels of all loaded modules."""
    for module, each in _KERNELS.items():
        if module in sys.modules:
            yield from each()


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

    from prefcal_env.mpc import _hold, _plan, _riccati

    cube, matrix, vector = float64[:, :, ::1], float64[:, ::1], float64[::1]
    model = (cube, cube, matrix)
    several: Any = numba.types.UniTuple
    roots, limits = several(matrix, 3), (vector,) * 4
    yield Kernel("discrete model", _hold.discretize, (matrix, matrix, vector, float64))
    corner = (matrix, int64, int64, int64)
    yield Kernel("triangular factors", _riccati.triangularize, corner)
    yield Kernel("limits", _plan.input_rows, (cube, vector, *limits))
    every = (*model, cube, cube, matrix, roots, matrix, int64, int64, vector, several(vector, 4))
    yield Kernel("optimal feedback", _plan.condense, every)
    yield Kernel("inputs", _plan.inputs, (cube, vector, vector, vector, vector))


def _of_the_reactor() -> Iterator[Kernel]:
    from numba import float64

    from prefcal_env.plants import _cstr_kernels

    vector = float64[::1]
    hold = (vector, vector, vector, vector, float64)
    yield Kernel("reactor", _cstr_kernels.hold, hold)


_KERNELS: dict[str, Callable[[], Iterable[Kernel]]] = {
    "prefcal_env.mpc.controller": _of_the_mpc,
    "prefcal_env.qp": _of_the_solver,
    "prefcal_env.envs.cstr": _of_the_reactor,
}
"""Kernels by the module that calls them; kernels come before their callers."""


def compile_ahead(module: str, kernels: Callable[[], Iterable[Kernel]]) -> None:
    """Let `compile_missing` compile `kernels` if `module`, which calls them, is loaded."""
    _KERNELS[module] = kernels
