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
    from numba import boolean, float64, int64

    from prefcal_env.mpc import _riccati, _rows, _step

    several: Any = numba.types.UniTuple
    mixed: Any = numba.types.Tuple
    cube, matrix, vector, chosen = float64[:, :, ::1], float64[:, ::1], float64[::1], int64[::1]
    yield Kernel("triangular factors", _riccati.triangularize, (matrix, int64, int64, int64))
    yield Kernel("inputs", _rows.inputs, (cube, vector, vector, several(vector, 4)))
    # Not `in_inputs`, which is as large and hardly ever needed.
    step = (
        mixed((int64, int64, int64, vector, chosen, chosen)),
        mixed((vector, vector, matrix, matrix)),
        mixed((cube, cube, matrix, cube, cube, matrix)),
        mixed((float64, int64, int64, int64)), several(matrix, 4),
        several(vector, 4), several(vector, 3),
    )  # fmt: skip
    solver = mixed((boolean, float64, float64, int64))
    yield Kernel("quadratic program", _step.decide, (*step, solver))


def of_the_filter() -> Iterator[Kernel]:
    """Yield what an MPC with an estimator calls besides."""
    import numba
    from numba import float64, int64

    from prefcal_env.mpc import _filter

    mixed: Any = numba.types.Tuple
    matrix, vector, chosen = float64[:, ::1], float64[::1], int64[::1]
    equations = mixed((int64, int64, int64, vector, chosen, chosen))
    point = (vector, vector, vector)
    yield Kernel("linearized plant", _filter.linearize, (equations, *point, int64))
    ahead = (equations, matrix, vector, vector, matrix, matrix, float64, int64)
    yield Kernel("prediction of the estimator", _filter.carried, ahead)
    update = (equations, *point, matrix, matrix, vector)
    yield Kernel("correction of the estimator", _filter.updated, update)


def _of_the_reactor() -> Iterator[Kernel]:
    from numba import boolean, float64, int64

    # Importing the equations compiles them.
    from prefcal_env.plants import _cstr_kernels, _dop853  # noqa: F401

    arrays = (float64[::1],) * 5
    hold = (int64, *arrays, float64, boolean)
    yield Kernel("simulation", _dop853.integrate, hold)


_KERNELS: dict[str, Callable[[], Iterable[Kernel]]] = {
    "prefcal_env.qp": _of_the_solver,
    "prefcal_env.mpc.controller": _of_the_mpc,
    "prefcal_env.envs.cstr": _of_the_reactor,
}
"""Kernels by the module that calls them; kernels come before their callers."""


def compile_ahead(module: str, kernels: Callable[[], Iterable[Kernel]]) -> None:
    """Let `compile_missing` compile `kernels` if `module`, which calls them, is loaded."""
    _KERNELS[module] = kernels
