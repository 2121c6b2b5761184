"""The interface of a plant, its equations, how they are simulated, and how disturbances enter them."""

import ctypes
import threading
import warnings
from abc import ABCMeta
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from jaxtyping import Float, Int

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channel

from .jacobians import D, States, Times, U, X, Y
from .jacobians import Jacobians as Jacobians

if TYPE_CHECKING:
    from .systems import LinearPlant

    _ProtocolType = ABCMeta
else:
    _ProtocolType = type(Protocol)


class _PlantType(_ProtocolType):
    """The type of `Plant`: what it defines belongs to `Plant` itself and not to each plant."""

    @property
    def of(cls) -> "type[LinearPlant]":
        """Class that makes a plant of a linear system: `Plant.of(system, ...)`."""
        from .systems import LinearPlant

        return LinearPlant


class Plant(Protocol, metaclass=_PlantType):
    """A plant ẋ = f(x, u, d), y = g(x, u, d) (eq. mathcalS) with measured disturbances d.

    Units are those of the channels; time is in `time_unit`. All functions are pure. To define
    your own plant, you only need f and g: see `FunctionPlant`. `Plant.of` is `LinearPlant`, which
    makes a plant of a linear system of python-control or SciPy.

    More attributes are optional: `input_delay` and `output_delay`, tuples with the dead time of each input
    and output, which environments apply; `entry_delay`, rows with that from each input to each output, and
    with it `entries(x, u, d)`, what each input, and last anything else, adds to the outputs; `sample_time`,
    of whose multiples the sampling time of a controller must be one; `named_matrices`, A and B whose rows
    are time constants with names; and `scaled(rates, gains, later)`, which returns the plant with faster
    states, larger gains of the inputs and longer dead time, each times as much.
    """

    @property
    def name(self) -> str:
        """Name of the plant, as shown to people."""

    @property
    def time_unit(self) -> str:
        """Unit of time, such as "h" or "s"."""

    @property
    def states(self) -> tuple[Channel, ...]:
        """The n_x states."""

    @property
    def inputs(self) -> tuple[Channel, ...]:
        """The n_u inputs, with the limits of the actuators."""

    @property
    def outputs(self) -> tuple[Channel, ...]:
        """The n_y controlled outputs."""

    @property
    def disturbances(self) -> tuple[Channel, ...]:
        """The n_d measured disturbances; may be empty."""

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`."""

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the controlled outputs."""

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the exact derivatives of f and g at one point."""

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` (increasing, above 0) after x, with u and d held."""


# --- The equations of a plant for compiled kernels: its own compiled ones, or its Python methods.

_NONE = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True)
class Equations:
    """Addresses of C functions `void(x, u, d, p, out)`, see `_dop853`; `p` are the parameters.

    A plant that has compiled equations returns them as its attribute `equations`; then its
    simulation and its MPC never wait for Python.
    """

    f: int  # address of the function that writes ẋ, shape (n_x,)
    g: int  # address of the function that writes y, shape (n_y,); 0 means y = x
    jacobians: int  # address of the function that writes A, B, C and D, row by row
    # The parameters p, which all three get; integers become floats
    parameters: Float[np.ndarray, " _"] = field(default_factory=lambda: np.zeros(0))
    # Indices of the outputs with an added disturbance; these follow in d
    on_outputs: Int[np.ndarray, " n_p"] = field(default_factory=lambda: _NONE)
    # Indices of the inputs with an added disturbance; these are the last of d
    on_inputs: Int[np.ndarray, " n_w"] = field(default_factory=lambda: _NONE)
    callbacks: "Callbacks | None" = None  # what calls Python, if the functions do

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
    """Return equations `(x, u, d, p, out)`, made by `_dop853.equation` or in plain Python.

    They write ẋ; y, where None means y = x; and A, B, C and D, row by row. p are the `parameters`.
    """
    made = [e if hasattr(e, "address") or e is None else _native(e) for e in (f, g, jacobians)]
    rates, outputs, matrices = (0 if e is None else e.address for e in made)
    return Equations(rates, outputs, matrices, parameters)


@cache  # forever: who holds an address does not hold the function
def _native(function: Callable[..., None]) -> Any:
    from ._dop853 import equation  # loads the compiler

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


Method = Callable[[Any, Any, Any], Any]


class Callbacks:
    """The Python methods of a plant, as C functions that compiled kernels can call.

    What a method raises is kept, for each thread on its own, and NaN is written instead; `check`
    raises it.
    """

    def __init__(self, n_x: int, n_u: int, n_d: int) -> None:
        self._sizes = n_x, n_u, n_d
        self._kept = threading.local()
        self._functions: list[Any] = []

    def address(self, method: Method, size: int, plain: Method | None = None) -> int:
        """Return the address of a C function that writes the `size` numbers of `method`.

        If `plain` returns as many in a list, tuple or array, they are taken as they are, without `method`.
        """
        of_x, of_u, of_d, targets = (_Views(n) for n in (*self._sizes, size))
        floats: Any = ctypes.c_double * size

        def checked(x: Any, u: Any, d: Any, out: int) -> None:
            targets[out][:] = method(x.copy(), u.copy(), d.copy())

        def quick(x: Any, u: Any, d: Any, out: int) -> None:
            # Called a hundred thousand times an experiment: arrays of two numbers take longer than most f.
            try:
                values = plain(x.copy(), u.copy(), d.copy())  # type: ignore[misc]
                if type(values) is list or type(values) is tuple:
                    floats.from_address(out)[:] = values
                    return
                if values.shape == (size,) and values.dtype == float:
                    targets[out][:] = values
                    return
            except Exception:  # `method` tells what is wrong, if anything is
                pass
            checked(x, u, d, out)

        write = checked if plain is None else quick

        def called(x: int, u: int, d: int, _: int, out: int) -> None:
            try:
                write(of_x[x], of_u[u], of_d[d], out)
            except BaseException as error:  # C cannot raise; `check` does
                # The first error is the cause of what follows; a mistake comes before an error of the domain.
                kept = getattr(self._kept, "error", None)
                if kept is None or (_is_mistake(error) and not _is_mistake(kept)):
                    self._kept.error = error
                targets[out][:] = np.nan

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
        error = self.forget()
        finite = states is not None and bool(np.isfinite(states).all())
        if error is not None and (_is_mistake(error) or not finite):
            raise error

    def forget(self) -> BaseException | None:
        """Return what a method raised in this thread since the last check, if anything, and forget it."""
        error: BaseException | None = getattr(self._kept, "error", None)
        self._kept.error = None
        return error


class _Views(dict[int | None, Float[np.ndarray, " _"]]):
    """Arrays of `n` numbers by address. Kept, since making such an array takes a microsecond."""

    def __init__(self, n: int) -> None:
        self._n = n

    def __missing__(self, address: int | None) -> Float[np.ndarray, " _"]:
        """Return an array of the numbers at an address."""
        # Solvers keep allocating new arrays: without this the cache would grow without end.
        if len(self) >= 1000:
            self.clear()
        data: Any = (ctypes.c_double * self._n).from_address(address or 0) if self._n else b""
        view = self[address] = np.frombuffer(data, dtype=float)
        return view


def _is_mistake(error: BaseException) -> bool:
    """Return whether an error has nothing to do with the point at which it was raised."""
    return isinstance(error, PlantError) or not isinstance(error, Exception)


_TYPE = ctypes.PYFUNCTYPE(None, *[ctypes.c_void_p] * 5)


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

    f, g = getattr(plant, "plain", (None, None))
    return Equations(
        callbacks.address(plant.f, n_x, f),
        0 if f and not g else callbacks.address(plant.g, n_y, g),
        callbacks.address(matrices, (n_x + n_y) * (n_x + n_u)),
        callbacks=callbacks,
    )


ADDED = "disturbance of "
"""Begin of the names of the disturbances that `Disturbed` adds."""


class Disturbed:
    """A `Plant` with ẋ = f(x, u + w, d), y = g(x, u + w, d) + p.

    (p, w) are measured disturbances and follow d. The limits of the inputs hold for u alone: w is
    what acts beside the actuator. An MPC that uses this plant as its model and an estimate of
    (p, w) needs no shifted references or limits: its y is that of the real plant.

    Args:
        plant: Plant without these disturbances.
        on_outputs: Indices of the outputs with a disturbance p, in the output's unit.
        on_inputs: Indices of the inputs with a disturbance w, in the input's unit.
        inputs: The inputs with other limits; None for those of the plant.

    Raises:
        SettingsError: If an index is not valid or appears twice.
    """

    def __init__(
        self,
        plant: Plant,
        on_outputs: Sequence[int] = (),
        on_inputs: Sequence[int] = (),
        inputs: tuple[Channel, ...] | None = None,
    ) -> None:
        self.plant, self.name, self.time_unit = plant, plant.name, plant.time_unit
        self.on_y = _selection("on_outputs", on_outputs, len(plant.outputs))
        self.on_u = _selection("on_inputs", on_inputs, len(plant.inputs))
        self.inputs = plant.inputs if inputs is None else inputs
        self.states, self.outputs = plant.states, plant.outputs
        chosen = [plant.outputs[i] for i in on_outputs] + [plant.inputs[i] for i in on_inputs]
        self.offsets = tuple(Channel(f"{ADDED}{c.name}", c.unit) for c in chosen)
        self.disturbances = (*plant.disturbances, *self.offsets)
        self._on = np.array(on_outputs, np.int64), np.array(on_inputs, np.int64)
        # What a plant may have beside the attributes of `Plant`; these disturbances have no dead time.
        for name in ("input_delay", "output_delay", "entry_delay", "sample_time", "has_named_states"):
            if hasattr(plant, name):
                setattr(self, name, getattr(plant, name))

    @cached_property
    def equations(self) -> Equations:
        """Equations of the plant with these disturbances, for compiled functions."""
        on_outputs, on_inputs = self._on
        return replace(equations_of(self.plant), on_outputs=on_outputs, on_inputs=on_inputs)

    def __getstate__(self) -> dict[str, Any]:
        # Addresses mean nothing in another process.
        return {name: value for name, value in self.__dict__.items() if name != "equations"}

    def around(self, plant: Plant, inputs: tuple[Channel, ...]) -> "Disturbed":
        """Return the same disturbances of another plant with the same channels, with other limits."""
        on_outputs, on_inputs = (chosen.tolist() for chosen in self._on)
        return Disturbed(plant, on_outputs, on_inputs, inputs)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`."""
        return self.plant.f(x, *self._acting(u, d))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs as they are measured."""
        n_d, n_p = len(self.plant.disturbances), self.on_y.shape[1]
        y = self.plant.g(x, *self._acting(u, d))
        return np.asarray(y + self.on_y @ d[n_d : n_d + n_p]) if n_p else y

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input and its load add to the outputs, if the plant can tell."""
        found: np.ndarray = self.plant.entries(x, *self._acting(u, d))  # type: ignore[attr-defined]
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives with respect to x and u."""
        return self.plant.jacobians(x, *self._acting(u, d))

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`, with all inputs and disturbances held."""
        return self.plant.hold(x, *self._acting(u, d), times)

    def _acting(self, u: U, d: D) -> tuple[Any, Any]:
        """Return the inputs and the disturbances that act on the plant."""
        n_d = len(self.plant.disturbances)
        return u + self.on_u @ d[n_d + self.on_y.shape[1] :], d[:n_d]


def _selection(name: str, chosen: Sequence[int], n: int) -> Float[np.ndarray, "n k"]:
    if len(set(chosen)) < len(chosen) or not set(chosen) <= set(range(n)):
        raise SettingsError(f"{name} must be different indices below {n}, got {tuple(chosen)}")
    return np.eye(n)[:, list(chosen)]


def integrate(equations: Equations, x: X, u: U, d: D, times: Times, max_step: float = np.inf) -> States:
    """Return the states at `times` after `x` at time 0, with `u` and `d` held, shape (K, n_x).

    Once a state blows up, it is NaN. The error of a step is below 1e-10 of each state or 1e-12;
    other instants change a state by no more than that. Stiff equations are left to an implicit
    method if the explicit one would need more than a thousand steps. Where equations jump again and
    again, as with dry friction, a thousandth of the interval is the smallest step; also for the
    rest of an interval that would take more than 100,000 steps.
    """
    explicit = _dop853().integrate
    # Copies: a read-only array is another type, for which numba compiles again.
    arrays = tuple(np.array(v, dtype=float) for v in (x, u, d, equations.parameters, times))
    # Explicit first: most plants are not stiff, and it is compiled.
    states, stiff = explicit(equations.f, *arrays, max_step, False)
    if stiff:
        states = _implicit(max_step, equations.f, *arrays)
    if states is None:
        # Both failed, as where f jumps again and again: the explicit one goes on although it is stiff, and
        # takes steps of a thousandth where it meets jumps.
        states, _ = explicit(equations.f, *arrays, max_step, True)
    return np.asarray(states)


@cache
def _dop853() -> Any:
    from . import _dop853  # imported here: load the compiler only when needed

    return _dop853


class _TooManyError(Exception):
    """The implicit method needs too many evaluations."""


def _implicit(
    max_step: float, f: int, x: X, u: U, d: D, p: Float[np.ndarray, " p"], times: Times
) -> States | None:
    """Return the states at `times` from backward differentiation, or None if it fails."""
    from scipy.integrate import solve_ivp  # takes half a second to import

    own = _dop853()
    call, fixed, evaluations = _TYPE(f), [a.ctypes.data for a in (u, d, p)], 0

    def rate(_: float, x: X) -> X:
        nonlocal evaluations
        evaluations += 1
        # Where f jumps again and again, its steps become ever shorter, and it would not end.
        if evaluations > 10_000:
            raise _TooManyError
        # A copy: the solver's array need not be contiguous, which C takes for granted.
        point, out = np.array(x, dtype=float), np.empty(len(x))
        call(point.ctypes.data, *fixed, out.ctypes.data)
        return out

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # failure is told by `success`
            tolerances = {"rtol": own.RELATIVE, "atol": own.ABSOLUTE}
            found = solve_ivp(rate, (0.0, times[-1]), x, "LSODA", times, max_step=max_step, **tolerances)
    except _TooManyError:
        return None
    return np.ascontiguousarray(found.y.T) if found.success else None
