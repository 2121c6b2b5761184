"""Kernels of the closed loops that are compiled before the first experiment."""

from collections.abc import Iterator

from prefcal_env.compiling import Kernel, compile_ahead


def _of_the_laws() -> Iterator[Kernel]:
    from numba import float64, int64
    from numba.types import Tuple, UniTuple

    from ._simulate import simulate

    vector, matrix = float64[::1], float64[:, ::1]
    plant, control = Tuple((int64, vector, int64[::1])), Tuple((int64, matrix))
    signals, timing = UniTuple(matrix, 3), Tuple((float64, int64, int64))
    start = Tuple((vector, vector, matrix))
    yield Kernel("closed loop", simulate, (plant, control, signals, timing, start))


def _of_the_mpc() -> Iterator[Kernel]:
    from numba import float64, int64
    from numba.types import Tuple, UniTuple

    from ._simulate import advance, hold, rhs, slopes

    vector, matrix = float64[::1], float64[:, ::1]
    plant, history = Tuple((int64, vector)), Tuple((matrix, matrix, vector, matrix))
    at = UniTuple(int64, 2)
    yield Kernel("plant", advance, (plant, float64, int64, at, history, matrix))
    model = (int64, vector, vector, vector, vector)
    yield Kernel("predicted states", hold, (*model, vector, float64))
    yield Kernel("model", rhs, model)
    yield Kernel("linearized model", slopes, model)


compile_ahead("prefcal_scenarios.cases.loops.controllers", _of_the_laws)
compile_ahead("prefcal_scenarios.cases.loops.mpc.drive", _of_the_mpc)
