"""The equations of a plant for compiled kernels: its own compiled ones, or its Python methods."""

import ctypes
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import PlantError

from .jacobians import D, Jacobians, U, X
from .plant import Plant

_NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Equations:
    """Addresses of C functions `void(x, u, d, p, out)`, see `_calls`; `p` are the parameters.

    A plant that has compiled equations returns them as its attribute `equations`; then its
    simulation and its MPC never wait for Python.

    Args:
        f: Address of the function that writes ẋ, shape (n_x,).
        g: Address of the function that writes y, shape (n_y,); 0 means y = x.
        jacobians: Address of the function that writes A, B, C and D, row by row.
        parameters: The parameters p, which all three get; integers become floats.
        on_outputs: Indices of the outputs with an added disturbance; these follow in d.
        on_inputs: Indices of the inputs with an added disturbance; these are the last of d.
        callbacks: What calls Python, if the functions do.
    """

    f: int
    g: int
    jacobians: int
    parameters: Float[np.ndarray, " _"] = field(default_factory=lambda: np.zeros(0))
    on_outputs: Int[np.ndarray, " n_p"] = field(default_factory=lambda: _NONE)
    on_inputs: Int[np.ndarray, " n_w"] = field(default_factory=lambda: _NONE)
    callbacks: "Callbacks | None" = None

    def __post_init__(self) -> None:
        # A copy: kernels are compiled for writable arrays of floats.
        parameters = np.array(self.parameters, dtype=float, order="C")
        object.__setattr__(self, "parameters", parameters)

    def __reduce__(self) -> str | tuple[Any, ...]:
        """Refuse to be pickled or copied deeply."""
        raise TypeError(
            "compiled equations cannot be pickled: they hold addresses, which mean nothing in "
            "another process; pickle the plant, which makes them again"
        )

    @property
    def packed(self) -> tuple[Any, ...]:
        """The equations as an argument of compiled functions."""
        return self.f, self.g, self.jacobians, self.parameters, self.on_outputs, self.on_inputs

    def check(self) -> None:
        """Raise what a Python method raised since the last check."""
        if self.callbacks is not None:
            self.callbacks.check()


def compiled(f: Any, g: Any, jacobians: Any, parameters: Float[np.ndarray, " _"]) -> Equations:
    """Return equations `(x, u, d, p, out)`, made by `_calls.equation` or in plain Python.

    Args:
        f: Function that writes ẋ.
        g: Function that writes y; None means y = x.
        jacobians: Function that writes A, B, C and D, row by row.
        parameters: The parameters p.
    """
    made = [e if hasattr(e, "address") or e is None else _native(e) for e in (f, g, jacobians)]
    rates, outputs, matrices = (0 if e is None else e.address for e in made)
    return Equations(rates, outputs, matrices, parameters)


@cache  # forever: who holds an address does not hold the function
def _native(function: Callable[..., None]) -> Any:
    from ._calls import equation  # loads the compiler

    return equation()(function)


def rates_of(f: Callable[..., None], p: tuple[float, ...], x: X, u: U, d: D) -> X:
    """Return ẋ by an equation in plain Python that `compiled` takes."""
    out = np.empty(len(x))
    f(x.tolist(), u.tolist(), d.tolist(), p, out)
    return out


def matrices_of(jacobians: Callable[..., None], p: tuple[float, ...], x: X, u: U, d: D) -> Jacobians:
    """Return A, B, C and D of a plant with y = x, likewise."""
    n, m = len(x), len(u)
    out = np.empty(2 * n * (n + m))
    jacobians(x.tolist(), u.tolist(), d.tolist(), p, out)
    A, B, C, D = np.split(out, np.cumsum([n * n, n * m, n * n]))
    return Jacobians(*(part.reshape(n, -1) for part in (A, B, C, D)))


class Callbacks:
    """The Python methods of a plant, as C functions that compiled kernels can call.

    What a method raises is kept, for each thread on its own, and NaN is written instead; `check`
    raises it.
    """

    def __init__(self, n_x: int, n_u: int, n_d: int) -> None:
        self._sizes = n_x, n_u, n_d
        self._kept = threading.local()
        self._functions: list[Any] = []
        self._views = _Views()

    def address(self, method: Callable[[Any, Any, Any], Any], size: int) -> int:
        """Return the address of a C function that writes the `size` numbers of `method`."""
        n_x, n_u, n_d = self._sizes
        views = self._views  # called ten thousand times an experiment

        def called(x: int, u: int, d: int, _: int, out: int) -> None:
            target = views[out, size]
            try:
                x_, u_, d_ = views[x, n_x].copy(), views[u, n_u].copy(), views[d, n_d].copy()
                target[:] = method(x_, u_, d_)
            except BaseException as error:  # C cannot raise; `check` does
                kept = getattr(self._kept, "error", None)
                if kept is None or (_is_mistake(error) and not _is_mistake(kept)):
                    self._kept.error = error
                target[:] = np.nan

        function = _TYPE(called)
        self._functions.append(function)  # it lives as long as these callbacks
        return ctypes.cast(function, ctypes.c_void_p).value or 0

    def check(self, states: Float[np.ndarray, "K n_x"] | None = None) -> None:
        """Raise what a method raised in this thread since the last check.

        Args:
            states: Result of a simulation. If it is finite, only a PlantError and what is no
                Exception, as KeyboardInterrupt, are raised: steps that are too long may leave the
                domain of f, and are repeated with a shorter one.
        """
        error = getattr(self._kept, "error", None)
        if error is None:
            return
        self._kept.error = None
        finite = states is not None and bool(np.isfinite(states).all())
        if _is_mistake(error) or not finite:
            raise error


class _Views(dict[tuple[int | None, int], Float[np.ndarray, " _"]]):
    """Arrays by address and length. Kept, since making such an array takes a microsecond."""

    def __missing__(self, key: tuple[int | None, int]) -> Float[np.ndarray, " _"]:
        """Return an array of the numbers at an address."""
        if len(self) >= _MOST_VIEWS:
            self.clear()
        address, n = key
        data: Any = (ctypes.c_double * n).from_address(address or 0) if n else b""
        view = self[key] = np.frombuffer(data, dtype=float)
        return view


def _is_mistake(error: BaseException) -> bool:
    """Return whether an error has nothing to do with the point at which it was raised."""
    return isinstance(error, PlantError) or not isinstance(error, Exception)


_TYPE = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 5)
_MOST_VIEWS = 1000


def equations_of(plant: Plant) -> Equations:
    """Return the compiled equations of `plant`, or its Python methods as such."""
    compiled: Equations | None = getattr(plant, "equations", None)
    if compiled is not None:
        return compiled
    n_x, n_u, n_y = len(plant.states), len(plant.inputs), len(plant.outputs)
    callbacks = Callbacks(n_x, n_u, len(plant.disturbances))

    def matrices(x: Any, u: Any, d: Any) -> Float[np.ndarray, " n"]:
        J = plant.jacobians(x, u, d)
        return np.concatenate([J.A.ravel(), J.B.ravel(), J.C.ravel(), J.D.ravel()])

    return Equations(
        callbacks.address(plant.f, n_x),
        callbacks.address(plant.g, n_y),
        callbacks.address(matrices, (n_x + n_y) * (n_x + n_u)),
        callbacks=callbacks,
    )
