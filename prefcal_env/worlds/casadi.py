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
from prefcal_env.plants.jacobians import ExactEquation


def is_function(equation: object) -> bool:
    """Return whether `equation` is a CasADi Function."""
    casadi = sys.modules.get("casadi")
    return casadi is not None and isinstance(equation, casadi.Function)


def equation(function: Any, sizes: tuple[int, int, int]) -> Any:
    """Return a CasADi `Function` as an equation; else `function`. Raises as `CasadiEquation` does."""
    return CasadiEquation(function, sizes) if is_function(function) else function


class CasadiEquation(ExactEquation):
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
                f"{sizes[1]} and d of {sizes[2]} elements (without d if there is none), got {list(found)}"
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
        return self._evaluate("values", (x, u, d)).copy()

    def jacobian(self, x: Any, u: Any, d: Any) -> Float[np.ndarray, "m n"]:
        """Return the exact derivatives with respect to (x, u), shape (m, n_x + n_u)."""
        flat = self._evaluate("jacobian", (x, u, d))
        return flat.reshape(sum(self.sizes[:2]), -1).T.copy()  # CasADi stores columns

    def __getstate__(self) -> dict[str, Any]:
        """Leave out buffers, which belong to this process."""
        return {"function": self.function, "sizes": self.sizes}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._local = threading.local()

    def _evaluate(self, kind: str, point: Sequence[Any]) -> np.ndarray:
        """Return the output of the function or of its derivative, which the next call overwrites.

        Each thread has buffers of its own, which CasADi reads and writes.
        """
        kept = getattr(self._local, kind, None)
        if kept is None:
            kept = _buffers(_dense(self.function, derived=kind == "jacobian"))
            setattr(self._local, kind, kept)
        inputs, output, evaluate, _ = kept
        for array, values in zip(inputs, point, strict=False):  # d may be left out
            array[:] = values
        evaluate()
        found: np.ndarray = output
        return found


def _buffers(function: Any) -> tuple[list[np.ndarray], np.ndarray, Any, Any]:
    """Return arrays for the inputs and the output, what evaluates them, and what owns all that."""
    buffer, evaluate = function.buffer()
    inputs = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
    output: np.ndarray = np.zeros(function.numel_out(0))
    for i, array in enumerate(inputs):
        buffer.set_arg(i, memoryview(array))  # type: ignore[arg-type]
    buffer.set_res(0, memoryview(output))  # type: ignore[arg-type]
    return inputs, output, evaluate, (buffer, function)


def _dense(function: Any, *, derived: bool) -> Any:
    """Return a dense function of dense inputs: the first output as a column, or its derivative."""
    import casadi

    symbols = [casadi.MX.sym(f"v{i}", function.numel_in(i)) for i in range(function.n_in())]
    shaped = [casadi.reshape(v, *function.size_in(i)) for i, v in enumerate(symbols)]
    values = casadi.vec(casadi.densify(function.call(shaped)[0]))
    if derived:  # by x and u
        values = casadi.densify(casadi.jacobian(values, casadi.vertcat(*symbols[:2])))
    return casadi.Function("dense", symbols, [values])
