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
    """Yield what PIQP needs; other controllers need them only if a step is not solved."""
    from numba import float64

    from prefcal_env.qp import _kernels

    matrix, vector = float64[:, ::1], float64[::1]
    terms = (matrix, vector, matrix, vector, vector, vector, vector)
    yield Kernel("check of the solution", _kernels.residuals, terms)


def _of_the_mpc() -> Iterator[Kernel]:
    import numba
    from numba import boolean, float64, int64

    from prefcal_env.mpc.kernels import hold, riccati, rows, step
    from prefcal_env.qp import _active_set

    several: Any = numba.types.UniTuple
    mixed: Any = numba.types.Tuple
    cube, matrix, vector, chosen = float64[:, :, ::1], float64[:, ::1], float64[::1], int64[::1]
    equations = mixed((int64, int64, int64, vector, chosen, chosen))
    hard, soft = several(vector, 4), several(vector, 3)
    yield Kernel("discrete model", hold.discretize, (matrix, matrix, vector, float64))
    yield Kernel("triangular factors", riccati.triangularize, (matrix, int64, int64, int64))
    yield Kernel("inputs", rows.inputs, (cube, vector, vector, hard))
    nearest = (matrix, vector, vector, float64, float64, int64)
    yield Kernel("active limits", _active_set.nearest, nearest)
    # Not `in_inputs`, which is as large and hardly ever needed.
    whole = (
        equations, mixed((vector, vector, matrix, matrix)), mixed((cube, cube, matrix) * 2),
        mixed((float64, int64, int64, int64)), several(matrix, 4), hard, soft,
        mixed((boolean, float64, float64, int64)),
    )  # fmt: skip
    yield Kernel("control step", step.decide, whole)


def of_the_filter() -> Iterator[Kernel]:
    """Yield what an MPC with an estimator calls besides."""
    import numba
    from numba import float64, int64

    from prefcal_env.mpc.kernels import filter as _filter

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

    from prefcal_env.plants import CSTR, _dop853

    CSTR().equations  # noqa: B018  # asking for the equations compiles them
    arrays = (float64[::1],) * 5
    hold = (int64, *arrays, float64, boolean)
    yield Kernel("simulation", _dop853.integrate, hold)


def _of_the_road() -> Iterator[Kernel]:
    import numba
    from numba import float64

    from prefcal_env.envs.overtake.road import _kernels
    from prefcal_env.plants.bicycle import compiled_hold

    yield from _of_the_solver()
    cube, matrix, vector = float64[:, :, ::1], float64[:, ::1], float64[::1]
    edges: Any = numba.types.UniTuple(float64, 2)  # type: ignore[no-untyped-call]
    yield Kernel("car", compiled_hold(), (*(float64,) * 6, vector))
    yield Kernel("edge of the road", _kernels.kept, (matrix, edges, float64))
    yield Kernel("contacts", _kernels.surely_apart, (matrix, cube, float64, float64))
    yield Kernel("separation", _kernels.separation, (matrix, matrix))
    yield Kernel("distance", _kernels.distance, (matrix, matrix))
    yield Kernel("distance off the road", _kernels.outside, (matrix, edges))


_KERNELS: dict[str, Callable[[], Iterable[Kernel]]] = {
    "prefcal_env.mpc.controller": _of_the_mpc,
    "prefcal_env.envs.cstr": _of_the_reactor,
    "prefcal_env.envs.overtake.course": _of_the_road,
}
"""Kernels by the module that calls them; kernels come before their callers."""


def compile_ahead(module: str, kernels: Callable[[], Iterable[Kernel]]) -> None:
    """Let `compile_missing` compile `kernels` if `module`, which calls them, is loaded."""
    _KERNELS[module] = kernels
