"""Kernels of the closed loops that are compiled before the first experiment."""

from collections.abc import Iterator
from typing import Any

from prefcal_env.compiling import Kernel, compile_ahead, of_the_filter


def _of_the_laws() -> Iterator[Kernel]:
    import numba
    from numba import float64, int64

    from ._simulate import simulate

    various: Any = numba.types.Tuple
    vector, matrix = float64[::1], float64[:, ::1]
    plant, control = various((int64, vector, int64[::1])), various((int64, matrix, matrix, vector))
    signals, timing = various((matrix,) * 3), various((float64, int64, int64))
    start = various((vector, vector, matrix))
    yield Kernel("closed loop", simulate, (plant, control, signals, timing, start))


def _of_the_mpc() -> Iterator[Kernel]:
    import numba
    from numba import float64, int64

    from . import _equations  # noqa: F401  # importing the equations compiles them
    from ._simulate import advance, hold

    various: Any = numba.types.Tuple
    vector, matrix = float64[::1], float64[:, ::1]
    plant, history = various((int64, vector)), various((matrix, matrix, vector, matrix))
    at = various((int64, int64))
    yield Kernel("plant", advance, (plant, float64, int64, at, history, matrix))
    yield Kernel("predicted states", hold, (int64, *(vector,) * 5, float64))
    yield from of_the_filter()


compile_ahead("prefcal_scenarios.cases.loops.controllers", _of_the_laws)
compile_ahead("prefcal_scenarios.cases.loops.mpc", _of_the_mpc)
