"""Equations of a plant that are CasADi functions: quick to evaluate, with exact derivatives.

CasADi itself is never imported here: who has a `Function` has loaded it.
"""

import sys
import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError


def is_function(equation: object) -> bool:
    """Return whether `equation` is a CasADi Function."""
    casadi = sys.modules.get("casadi")
    return casadi is not None and isinstance(equation, casadi.Function)


class CasadiEquation:
    """A CasADi `Function` of (x, u) or (x, u, d) as an equation of a plant.

    Values go through buffers of CasADi, which takes about a microsecond; a call with arrays takes
    tens of them.

    Args:
        function: The function; its first output counts.
        sizes: Numbers of states, inputs and disturbances.

    Raises:
        PlantError: If its inputs have other sizes, or it depends on free variables.
    """

    def __init__(self, function: Any, sizes: tuple[int, int, int]) -> None:
        n_in = function.n_in()
        found = tuple(function.numel_in(i) for i in range(n_in))
        if found not in (sizes, sizes[:2]) or function.n_out() < 1:
            raise PlantError(
                f"CasADi function {function.name()!r} must have the inputs x of {sizes[0]}, u of "
                f"{sizes[1]} and d of {sizes[2]} elements (without d if there is none), got "
                f"{list(found)}"
            )
        if function.has_free():
            raise PlantError(
                f"CasADi function {function.name()!r} has free variables {function.get_free()}: "
                "make them inputs or insert numbers"
            )
        self.function, self.sizes = function, sizes
        self._local = threading.local()

    def __call__(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, " m"]:
        """Return the values at one point, shape (m,)."""
        return self._evaluated("values", (x, u, d))[0].copy()

    def jacobian(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, "m n"]:
        """Return the exact derivatives with respect to (x, u), shape (m, n_x + n_u)."""
        flat = self._evaluated("jacobian", (x, u, d))[0]
        return flat.reshape(sum(self.sizes[:2]), -1).T.copy()  # CasADi stores columns

    def __getstate__(self) -> dict[str, Any]:
        """Leave out buffers, which belong to this process."""
        return {"function": self.function, "sizes": self.sizes}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._local = threading.local()

    def _evaluated(self, kind: str, point: Sequence[Any]) -> list[np.ndarray]:
        """Return the outputs of the function or of its derivative, as views of its buffers."""
        buffers = getattr(self._local, kind, None)
        if buffers is None:
            function = _dense(self.function) if kind == "values" else _derivative(self.function)
            buffers = _Buffers(function)
            setattr(self._local, kind, buffers)
        return buffers.evaluated(point)


class _Buffers:
    """Arrays that a CasADi function reads and writes. One thread at a time may use them."""

    def __init__(self, function: Any) -> None:
        self._buffer, self._evaluate = function.buffer()
        self._function = function
        self._inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
        self._outputs = [np.zeros(function.numel_out(0))]
        for i, array in enumerate(self._inputs):
            self._buffer.set_arg(i, _memory(array))
        self._buffer.set_res(0, _memory(self._outputs[0]))

    def evaluated(self, point: Sequence[Any]) -> list[np.ndarray]:
        for array, values in zip(self._inputs, point, strict=False):  # d may be left out
            array[:] = values
        self._evaluate()
        return self._outputs


def _derivative(function: Any) -> Any:
    """Return a dense function of the same inputs: the derivative by x and u."""
    import casadi

    symbols, values = _column(function)
    jacobian = casadi.densify(casadi.jacobian(values, casadi.vertcat(*symbols[:2])))
    return casadi.Function("derivative", symbols, [jacobian])


def _dense(function: Any) -> Any:
    """Return `function` with dense inputs and its first output dense and in one column."""
    import casadi

    symbols, values = _column(function)
    return casadi.Function(function.name(), symbols, [values])


def _column(function: Any) -> tuple[list[Any], Any]:
    """Return dense symbols for the inputs, and the first output as a dense column of them."""
    import casadi

    symbols = [casadi.MX.sym(f"v{i}", function.numel_in(i)) for i in range(function.n_in())]
    shaped = [casadi.reshape(v, *function.size_in(i)) for i, v in enumerate(symbols)]
    return symbols, casadi.vec(casadi.densify(function.call(shaped)[0]))


def _memory(array: Any) -> memoryview:
    return memoryview(array)
