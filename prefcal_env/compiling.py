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
    """A function to compile."""

    title: str  # its purpose in a few words
    function: Any  # as wrapped by numba
    types: Any  # of its arguments


def _kernel(title: str, function: Any, signature: str) -> Kernel:
    """Return a kernel whose signature has the types of numba, and these words for some."""
    words = {"vector": "f8[::1]", "matrix": "f8[:,::1]", "cube": "f8[:,:,::1]"}
    signature = signature.replace("equations", "Tuple((i8, i8, i8, vector, i8[::1], i8[::1]))")
    for word, meaning in words.items():
        signature = signature.replace(word, meaning)
    return Kernel(title, function, f"({signature},)")


def compile_missing(report: Callable[[Compiling], None], also: Iterable[Kernel] = ()) -> None:
    """Compile the kernels of all loaded modules, and others, unless numba's cache already holds them.

    `report` is called with each part as its compilation begins; never if nothing is missing.
    """
    found = (*kernels(), *also)
    if not found:
        return
    from numba.core import event, sigutils  # takes half a second, so import it only when needed

    typed: Any = sigutils.normalize_signature
    for k, kernel in enumerate(found):
        now = Compiling(k + 1, len(found), kernel.title)
        # numba would keep it under the words for these types, where no call in another process looks for it.
        types, _ = typed(kernel.types)
        with event.install_listener("numba:compile", _once(partial(report, now))):
            kernel.function.compile(types)


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


def _of_the_mpc() -> Iterator[Kernel]:
    from .mpc.kernels import decide, discretize, inputs, triangularize
    from .qp import _active_set

    yield _kernel("discrete model", discretize, "matrix, matrix, vector, f8")
    yield _kernel("triangular factors", triangularize, "matrix, i8, i8, i8")
    yield _kernel("inputs", inputs, "cube, vector, vector, UniTuple(vector, 4)")
    yield _kernel("active limits", _active_set.nearest, "matrix, vector, vector, f8, f8, i8")
    yield _kernel(
        "control step",
        decide,
        "equations, Tuple((vector, vector, matrix, matrix)), "
        "Tuple((cube, cube, matrix, cube, cube, matrix)), Tuple((f8, i8, i8, i8)), "
        "UniTuple(matrix, 4), UniTuple(vector, 4), UniTuple(vector, 3), Tuple((b1, f8, f8, i8))",
    )


def of_the_filter() -> Iterator[Kernel]:
    """Yield what an MPC with an estimator calls besides."""
    from .mpc.kernels import carried, linearize, updated

    point = "equations, vector, vector, vector"
    yield _kernel("linearized plant", linearize, f"{point}, i8")
    ahead = "equations, matrix, vector, vector, matrix, matrix, f8, i8"
    yield _kernel("prediction of the estimator", carried, ahead)
    yield _kernel("correction of the estimator", updated, f"{point}, matrix, matrix, vector")


def _of_the_reactor() -> Iterator[Kernel]:
    from .plants import CSTR, _dop853

    CSTR().equations  # noqa: B018  # asking for the equations compiles them
    hold = "i8, vector, vector, vector, vector, vector, f8, b1"
    yield _kernel("simulation", _dop853.integrate, hold)


def _of_the_road() -> Iterator[Kernel]:
    from .envs.overtake import scene
    from .plants.bicycle import compiled_hold
    from .qp import _active_set

    # What PIQP needs; other controllers need it only if a step is not solved.
    arguments = "matrix, vector, matrix, vector, vector, vector, vector"
    yield _kernel("check of the solution", _active_set.residuals, arguments)
    yield _kernel("car", compiled_hold(), "f8, f8, f8, f8, f8, f8, vector")
    yield _kernel("edge of the road", scene.kept, "matrix, UniTuple(f8, 2), f8")
    yield _kernel("contacts", scene.surely_apart, "matrix, cube")
    yield _kernel("separation", scene.separations, "matrix, matrix")
    yield _kernel("distance", scene.distances, "matrix, matrix")
    yield _kernel("distance off the road", scene.outsides, "matrix, UniTuple(f8, 2)")


def of_compiled_runs(*, linear: bool) -> Iterator[Kernel]:
    """Yield what runs a plant that PIDs control: a linear one, or one of equations."""
    from .envs._compiled_run import run

    numbers, room = "i8[::1]", "Tuple((vector, matrix, matrix, i8[::1], i8[::1]))"
    matrices = f"Tuple((Tuple((matrix, f8, f8)), Tuple(({numbers}, cube, {numbers})), matrix, matrix))"
    plant = f"{matrices}, none" if linear else "none, Tuple((i8, i8, f8, f8, vector, i8))"
    yield _kernel(
        "closed loop",
        run,
        f"Tuple(({plant}, matrix, Tuple((matrix, vector, vector)))), "
        "Tuple((vector, f8)), UniTuple(matrix, 2), "
        "Tuple((vector, vector, vector, b1)), UniTuple(vector, 3), Tuple((f8, UniTuple(f8, 3))), "
        "Tuple((matrix, i8[:,::1], matrix)), UniTuple(vector, 4), "
        f"Tuple((Tuple((vector, matrix, {numbers})), {room})), "
        f"Tuple((vector, matrix, matrix, {numbers}, matrix, b1[::1], matrix))",
    )


_KERNELS: dict[str, Callable[[], Iterable[Kernel]]] = {
    "prefcal_env.mpc.controller": _of_the_mpc,
    "prefcal_env.envs.cstr": _of_the_reactor,
    "prefcal_env.envs.overtake.course": _of_the_road,
}
"""Kernels by the module that calls them; kernels come before their callers."""


def compile_ahead(module: str, kernels: Callable[[], Iterable[Kernel]]) -> None:
    """Let `compile_missing` compile `kernels` if `module`, which calls them, is loaded."""
    _KERNELS[module] = kernels
