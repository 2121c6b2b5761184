"""Linear plants, and A, B, C and D of any linear system."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from math import isfinite
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float

from prefcal_env.arrays import numbers
from prefcal_env.errors import PlantError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.optional import WORLDS, world_of

from .jacobians import D, Jacobians, States, Times, U, X, Y

LIBRARIES = " or ".join([*(world.system for world in WORLDS if world.system), "scipy.signal"])
"""What makes linear systems, for messages."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """A linear system: x' = A x + B u, or x_k+1 = A x_k + B u_k if `dt` is above 0; y = C x + D u.

    Args:
        A: Dynamics, shape (n_x, n_x); n_x may be 0.
        B: Effect of the inputs, shape (n_x, n_u).
        C: Outputs from states, shape (n_y, n_x).
        D: Outputs from inputs, shape (n_y, n_u).
        dt: Sample time in the system's unit of time; 0 if it is continuous.
        inputs: Names of the inputs; () if they have none.
        outputs: Names of the outputs; () if they have none.
        states: Names of the states; () if they have none.
        cleaned: What was left out of transfer functions, a sentence each.

    Raises:
        PlantError: If shapes do not fit each other, a number is not finite, or dt is negative.
    """

    A: Float[np.ndarray, "n_x n_x"]
    B: Float[np.ndarray, "n_x n_u"]
    C: Float[np.ndarray, "n_y n_x"]
    D: Float[np.ndarray, "n_y n_u"]
    dt: float = 0.0
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    cleaned: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n_y, n_u = np.shape(self.D)
        n_x = len(self.A)
        shapes = {"A": (n_x, n_x), "B": (n_x, n_u), "C": (n_y, n_x)}
        for name in "ABCD":
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != shapes.get(name, array.shape):
                raise PlantError(
                    f"{name} must have shape {shapes[name]} for {n_x} states and D of shape "
                    f"{(n_y, n_u)}, got {array.shape}"
                )
            if not np.isfinite(array).all():
                raise PlantError(f"{name} must be finite, got {array.tolist()}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if not 0 <= self.dt < np.inf:
            raise PlantError(f"the sample time dt must be 0 or more and finite, got {self.dt}")

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Return the numbers of states, inputs and outputs."""
        return len(self.A), self.D.shape[1], self.D.shape[0]

    @property
    def rates(self) -> Complex[np.ndarray, " n_x"]:
        """Return the poles as rates s per unit of time; a discrete pole z counts as ln(z) / dt.

        Discrete poles at 0 have no rate: they count as faster than any that matters.
        """
        poles = (np.linalg.eigvals(self.A) if len(self.A) else np.zeros(0)).astype(complex)
        return rates_of(poles, self.dt)

    def behind(self, lag: float) -> "LinearSystem":
        """Return the system whose inputs follow what is asked for with a lag, unless it is 0.

        A discrete system is returned as it is: between its samples it sees nothing.
        """
        if not lag or self.dt:
            return self
        n, n_u, n_y = self.sizes
        A = np.block([[self.A, self.B], [np.zeros((n_u, n)), -np.eye(n_u) / lag]])
        B = np.vstack([np.zeros((n, n_u)), np.eye(n_u) / lag])
        return LinearSystem(A, B, np.hstack([self.C, self.D]), np.zeros((n_y, n_u)))

    def at(self, s: Any) -> Complex[np.ndarray, "*m n_y n_u"]:
        """Return the transfer function at numbers s, for a discrete system at z = exp(s dt)."""
        point = np.asarray(np.exp(s * self.dt) if self.dt else s)
        resolvent = point[..., None, None] * np.eye(len(self.A)) - self.A
        # One solve for all frequencies: an inverse would lose digits near a pole.
        B = np.broadcast_to(self.B.astype(complex), (*point.shape, *self.B.shape))
        return np.asarray(self.C @ np.linalg.solve(resolvent, B) + self.D)

    def held(self, T: float) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, "n_x n_u"]]:
        """Return A_d and B_d over T with u held; T is a multiple of the sample time if any."""
        if not self.dt:
            return held(self.A, self.B, T)
        n, m, _ = self.sizes
        once = np.block([[self.A, self.B], [np.zeros((m, n)), np.eye(m)]])
        # With the input as a state that stays, one power gives A_d and B_d.
        E = np.linalg.matrix_power(once, round(T / self.dt))
        return E[:n, :n], E[:n, n:]

    @property
    def owned(self) -> Bool[np.ndarray, "n_x n_u"]:
        """Return which states each input drives, directly or through other states."""
        linked, reached = self.A != 0, self.B != 0
        # As many rounds as states: no chain of states is longer.
        for _ in self.A:
            reached = reached | (linked.astype(int) @ reached > 0)
        return np.asarray(reached)

    def separated(self) -> "LinearSystem":
        """Return the same system with states of its own for each input; states lose their names."""
        if (self.owned.sum(axis=1) <= 1).all():
            return self
        m = self.D.shape[1]
        B = np.vstack([np.where(np.arange(m) == j, self.B, 0.0) for j in range(m)])
        A, C = np.kron(np.eye(m), self.A), np.tile(self.C, m)
        return LinearSystem(A, B, C, self.D, self.dt, self.inputs, self.outputs, cleaned=self.cleaned)

    def part(self, outputs: Sequence[int], inputs: Sequence[int]) -> "LinearSystem":
        """Return the system from some inputs to some outputs, with all states."""
        rows, columns = list(outputs), list(inputs)
        D = self.D[np.ix_(rows, columns)]
        return LinearSystem(self.A, self.B[:, columns], self.C[rows], D, self.dt)


def held(
    A: Float[np.ndarray, "n n"], B: Float[np.ndarray, "n n_u"], T: float
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n_u"]]:
    """Return A_d and B_d of ẋ = A x + B u over T with u held, by the matrix exponential."""
    from scipy.linalg import expm  # takes a while to import

    n, m = B.shape
    # Exact also where A is singular, where A⁻¹ (A_d - 1) B is not defined.
    E = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * T)
    return E[:n, :n], E[:n, n:]


def rates_of(points: Complex[np.ndarray, " n"], dt: float) -> Complex[np.ndarray, " n"]:
    """Return poles or zeros as rates s per unit of time: z counts as ln(z) / dt if dt is not 0."""
    if not dt:
        return points
    return np.log(np.where(np.abs(points) < 1e-3, 1e-3, points)) / dt  # smaller ones count as 1e-3


def system_of(system: Any) -> LinearSystem:
    """Return `system` as matrices.

    Transfer functions are realized entry by entry in controllable canonical form, which is exact
    but has more states than needed if the entries share poles. Before that, rounding and common
    factors are left out, see `_clean`; matrices stay as they are.

    Args:
        system: StateSpace or TransferFunction of python-control or scipy.signal (continuous or
            discrete, `lti` and `dlti` included), arrays (A, B, C, D) or (A, B, C, D, dt),
            polynomials (num, den) with the highest power first, a gain: a number or an array of
            shape (n_y, n_u), or a list of rows of these, each of one input and one output.

    Raises:
        PlantError: If `system` is nothing of this, its sample time is not stated, shapes do not
            fit, or a transfer function is improper.
    """
    if isinstance(system, LinearSystem):
        return system
    inner = getattr(system, "system", None)
    if isinstance(inner, LinearSystem):  # a plant made of one
        return inner
    world = world_of(system)
    if world is not None and world.system:
        made: LinearSystem = world.inside("prefcal_env").linear_system(system)
        return made
    if hasattr(system, "A") and hasattr(system, "D"):
        dt = sample_time(getattr(system, "dt", None))
        return of_arrays([system.A, system.B, system.C, system.D], dt)
    den = getattr(system, "den", None)
    # Nothing of SciPy has several denominators.
    lists = (list, np.ndarray)
    nested = isinstance(den, lists) and any(isinstance(each, lists) for each in den)
    if hasattr(system, "num") and hasattr(system, "den") and not nested:
        rows = np.atleast_2d(system.num)  # of scipy: one denominator for all outputs of one input
        dt = sample_time(getattr(system, "dt", None))
        return of_fractions([[row] for row in rows], [[system.den]] * len(rows), dt)
    if hasattr(system, "to_ss"):  # zeros, poles and gain of scipy
        shared = np.isin(system.zeros, system.poles).any()
        return system_of(system.to_tf() if shared else system.to_ss())
    if isinstance(system, Sequence) and not isinstance(system, str):
        if _grid(system):
            _check_rows(system)
            return _of_grid(system)
        if len(system) == 2:
            return of_fractions([[system[0]]], [[system[1]]])
        if len(system) in (4, 5):
            return of_arrays(system[:4], sample_time(system[4]) if system[4:] else 0.0)
    if isinstance(system, int | float | np.ndarray | np.number) and not isinstance(system, bool):
        return of_arrays([[], [], [], _matrix("a gain", system)], 0.0)
    raise PlantError(
        f"a linear system must be a StateSpace or TransferFunction of {LIBRARIES}, arrays (A, B, C, D) or "
        "(A, B, C, D, dt), polynomials (num, den), a gain, or a list of rows of these, "
        f"got {type(system).__name__} {system!r:.80}"
    )


def of_arrays(arrays: Sequence[Any], dt: float) -> LinearSystem:
    """Return the system of A, B, C and D, some of which may be vectors; 0 as `dt` is continuous.

    Raises:
        PlantError: If shapes do not fit, or a number is not finite.
    """
    A, B, C, D = (_matrix(name, value) for name, value in zip("ABCD", arrays, strict=True))
    if A.size == 0:
        D = np.atleast_2d(D)
        A, B, C = np.zeros((0, 0)), np.zeros((0, D.shape[1])), np.zeros((len(D), 0))
    else:  # vectors of one input or one output, as scipy accepts them
        B = B.reshape(len(A), -1) if B.ndim < 2 else B
        C = C.reshape(-1, len(A)) if C.ndim < 2 else C
        zero = D.size == 1 and D.item() == 0
        D = np.full((len(C), B.shape[1]), 0.0) if zero else np.atleast_2d(D)
    if A.ndim != 2 or B.ndim != 2 or C.ndim != 2 or D.ndim != 2:
        raise PlantError(f"A, B, C and D must be matrices, got {[np.shape(v) for v in arrays]}")
    return LinearSystem(A, B, C, D, dt)


def of_fractions(num: list[list[Any]], den: list[list[Any]], dt: float = 0.0) -> LinearSystem:
    """Realize each entry in controllable canonical form, one after the other.

    Raises:
        PlantError: If one is improper, or a denominator is 0.
    """
    rows = zip(num, den, strict=True)
    grid = [[_canonical(*entry, dt) for entry in zip(*row, strict=True)] for row in rows]
    return _assemble(grid, dt)


def _grid(system: Sequence[Any]) -> bool:
    """Return whether `system` is a list of rows of systems, and not polynomials or matrices."""

    def is_entry(e: Any) -> bool:
        pair = isinstance(e, list | tuple) and len(e) == 2 and np.ndim(e[0]) == np.ndim(e[1]) == 1
        return pair or hasattr(e, "num") or hasattr(e, "A") or hasattr(e, "to_ss")

    rows = [row for row in system if isinstance(row, list | tuple) and len(row)]
    return len(rows) == len(system) > 0 and any(is_entry(e) for row in rows for e in row)


def _check_rows(system: Sequence[Any]) -> None:
    """Refuse what is a list of rows here, but the numerators and denominators of a matrix elsewhere."""
    plain = (isinstance(entry, list) and len(entry) == 2 for row in system for entry in row)
    if isinstance(system, tuple) and len(system) == 2 and all(plain):
        raise PlantError(
            "a tuple of two lists of rows can be read in two ways: give rows of transfer functions as "
            "[[(num, den), (num, den)], [(num, den), (num, den)]]"
        )


def _of_grid(rows: Sequence[Sequence[Any]]) -> LinearSystem:
    grid = [[system_of(entry) for entry in row] for row in rows]
    sizes = [[(entry.D.shape, entry.dt) for entry in row] for row in grid]
    steps = {entry.dt for row in grid for entry in row if len(entry.A)}
    single = all(entry.D.shape == (1, 1) for row in grid for entry in row)
    if not single or len({len(row) for row in grid}) > 1 or len(steps) > 1:
        raise PlantError(
            "rows of transfer functions must have the same length and sample time, and each entry "
            f"one input and one output, got (shape, dt) {sizes}"
        )
    return _assemble(grid, max(steps, default=0.0))


def _assemble(grid: Sequence[Sequence[LinearSystem]], dt: float) -> LinearSystem:
    """Return the matrix of systems of one input and one output, one after the other."""
    n_x = sum(len(entry.A) for row in grid for entry in row)
    n_y, n_u = len(grid), len(grid[0])
    A, B, C = np.zeros((n_x, n_x)), np.zeros((n_x, n_u)), np.zeros((n_y, n_x))
    D, first = np.zeros((n_y, n_u)), 0
    cleaned = dict.fromkeys(words for row in grid for entry in row for words in entry.cleaned)
    for i, row in enumerate(grid):
        for j, entry in enumerate(row):
            own = slice(first, first + len(entry.A))
            A[own, own], B[own, j], C[i, own] = entry.A, entry.B[:, 0], entry.C[0]
            D[i, j] = entry.D[0, 0]
            first += len(entry.A)
    return LinearSystem(A, B, C, D, dt, cleaned=tuple(cleaned))


_TINY = 1e-12  # share of a polynomial, near the poles, that is the rounding of an earlier calculation
_SHARED = 1e-9  # the same for a numerator at a pole: the pole is one of its zeros
_MARGINAL = 1e-6  # distance of a pole from the limit of stability, relative to its size, that is none


def _clean(num: Any, den: Any, dt: float) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return num and den without rounding and common factors, and what was left out.

    Rounding are leading coefficients that contribute less than 1e-12 of the polynomial where s is as
    large as the poles (z = 1), and last ones that do so at all poles but those that they make: these
    integrate.

    Raises:
        PlantError: If the denominator is 0, or an unstable pole cancels.
    """
    b, a = (np.trim_zeros(np.atleast_1d(_matrix("a polynomial", p)), "f") for p in (num, den))
    if not len(a):
        raise PlantError("a transfer function needs a denominator that is not 0")
    if not len(b):
        return b, np.ones(1), ()  # it has no states
    sizes = np.abs(np.roots(a))
    sizes = sizes[sizes > 0]
    # The unit of time is chosen so that the poles that matter are near 1.
    usual = float(sizes[np.argmin(np.abs(np.log(sizes)))]) if len(sizes) and not dt else 1.0
    first = [int(np.argmax(terms > _TINY * terms.max())) for terms in (_terms(b, usual), _terms(a, usual))]
    b, a = b[first[0] :], a[first[1] :]
    last = 0 if dt else _last(a)
    said = (
        ["coefficients that are rounding, below 1e-12 of their polynomial"]
        if any(first) or a[len(a) - last :].any()
        else []
    )
    a = np.append(a[: len(a) - last], np.zeros(last))
    b, a, common = _without_common(b, a, usual, dt)
    return b, a, tuple(f"Left out of a transfer function: {words}." for words in [*said, *common])


def _last(a: np.ndarray) -> int:
    """Return how many of the last coefficients are rounding or 0; without them, so many poles are at 0."""
    sizes = np.append(np.sort(np.abs(np.roots(a))), 1.0)
    for count in range(len(a) - 1, 0, -1):
        terms = _terms(a, float(sizes[count]))
        if (terms[-count:] <= _TINY * terms.max()).all():
            return count
    return 0


def _without_common(
    b: np.ndarray, a: np.ndarray, usual: float, dt: float
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return b and a without common factors whose poles integrate or oscillate for ever, and these.

    As a function, a transfer function has no such factor: that of g s/s comes from calculating, and
    no controller could stabilize the state that it would get. A stable one does no harm and stays.
    An unstable one is refused: if it is real, the plant runs away, whatever its output shows.
    """
    poles, zeros, said = np.roots(a).tolist(), np.roots(b), list[str]()
    for pole in list(poles):
        size = max(abs(pole), usual)
        beyond = (abs(pole) - 1.0 if dt else pole.real) / size
        near = np.flatnonzero(np.abs(zeros - pole) <= _MARGINAL * size)
        zero = abs(np.polyval(b, pole)) <= _SHARED * _terms(b, size).sum()
        if beyond < -_MARGINAL or not zero or not len(near):
            continue
        at = f"{'z' if dt else 's'} = {complex(pole):.4g}".replace("+0j", "")
        if beyond > _MARGINAL:
            raise PlantError(
                f"a transfer function has an unstable pole at {at} that a zero cancels, so that no "
                "controller can stabilize it: leave both out if they only come from calculating, as in g*h/h"
            )
        poles.remove(pole)
        zeros = np.delete(zeros, near[np.argmin(np.abs(zeros[near] - pole))])
        said.append(f"a common factor, whose pole and zero at {at} cancel")
    if said:
        b, a = b[0] * np.real(np.poly(zeros)), a[0] * np.real(np.poly(poles))
    return np.atleast_1d(b), np.atleast_1d(a), said


def _terms(polynomial: np.ndarray, size: float) -> np.ndarray:
    """Return the magnitude of each term of a polynomial at a magnitude of s or z."""
    return np.asarray(np.abs(polynomial) * size ** np.arange(len(polynomial) - 1, -1, -1.0))


def _canonical(num: Any, den: Any, dt: float = 0.0) -> LinearSystem:
    """Return num/den, polynomials with the highest power first, without its sample time."""
    b, a, cleaned = _clean(num, den, dt)
    if len(b) > len(a):
        raise PlantError(
            f"a transfer function must be proper, got degree {len(b) - 1} over {len(a) - 1}: add "
            "a filter, such as T_d*s/(T_f*s + 1) for a derivative T_d*s"
        )
    n = len(a) - 1
    b = np.concatenate([np.zeros(n + 1 - len(b)), b]) / a[0]
    a = a / a[0]
    A = np.eye(n, k=-1)
    if n:
        A[0] = -a[1:]
    return LinearSystem(A, np.eye(n, 1), (b[1:] - b[0] * a[1:])[None], b[:1, None], cleaned=cleaned)


def sample_time(dt: Any) -> float:
    """Return a sample time as a number; 0 for None, which is continuous.

    Raises:
        PlantError: If it is True, which is discrete without a stated time.
    """
    if dt is None:
        return 0.0
    if isinstance(dt, bool) or not isinstance(dt, int | float | np.number):
        raise PlantError(
            f"a discrete system must state its sample time dt in the unit of time, got dt={dt!r}"
        )
    return float(dt)


def _matrix(name: str, value: Any) -> np.ndarray:
    real = isinstance(value, np.ndarray) and value.dtype.kind == "c" and not value.imag.any()
    return numbers(value.real if real else value, name, PlantError)


Named = str | Channel | Sequence[str | Channel]  # one name or channel, or one for each signal
Numbers = float | Sequence[float] | np.ndarray
Delay = Numbers | Sequence[Sequence[float]]
"""One dead time, one for each input, or a row for each output with one for each input."""


DEAD_TIMES = ("input_delay", "output_delay", "entry_delay")  # attributes of a plant that hold its dead times


def scale_times(times: Any, factor: float, step: float = 0.0) -> Any:
    """Return dead times, or rows of them, times a factor; multiples of `step` if it is not 0."""
    if isinstance(times, tuple | list):
        return tuple(scale_times(each, factor, step) for each in times)
    return step * round(factor * times / step) if step else factor * times


@dataclass(frozen=True, slots=True, eq=False)
class Ensemble:
    """Plants that explain a record about as well, of which one is that of a study."""

    systems: tuple[tuple[LinearSystem, float], ...]  # each with its dead time, all with as many states
    best: int  # number of the study's one
    record: str  # name of the record
    told: str  # what it leaves open, for people
    noise: float = 0.0  # standard deviation of the noise in its output
    guessed: bool = False  # whether nobody stated the limits of its input
    moved: float = 0.0  # largest move of its input in the record; 0 if it is not known


class LinearPlant:
    """A `Plant` made of a linear system, continuous or discrete, with any number of signals.

    Between two instants its states follow from a matrix exponential, so they are exact. A discrete
    plant keeps its states until its next sample. Dead time of any length is exact, too, but not
    part of x: environments (`PlantEnv`, `LTILoop`) delay the inputs by `input_delay`, the outputs
    by `output_delay`, and what each input adds to each output (`entries`) by `entry_delay`. A
    controller that uses the plant as its model, such as `LinearMPC`, sees it without dead time.

    All values are deviations from the operating point, unless the model says otherwise, or `rest` does.

    Args:
        system: StateSpace or TransferFunction of python-control or scipy.signal (`lti`,
            `dlti`), arrays (A, B, C, D) or (A, B, C, D, dt), polynomials (num, den), or a list
            of rows of these. Improper transfer functions are refused.
        states: Names or `Channel`s of the states, in their order.
        inputs: Names or `Channel`s of the inputs; limits of a `Channel` are those of the
            actuator. Without them, the names that python-control knows, else u or u1, u2, ...
        outputs: Names or `Channel`s of the outputs, likewise.
        disturbances: Names or `Channel`s of measured disturbances: the last inputs of `system`
            are these instead of inputs.
        delay: Dead time between input and plant, in `time_unit`: one number, one for each
            input, or a matrix of shape (n_y, n_u) with that from each input to each output. If
            the plant is discrete, multiples of its sample time. A matrix gives each input
            states of its own.
        output_delay: Dead time between plant and output, likewise.
        x0: State at the start of experiments, shape (n_x,) or one number; by default 0. Where a
            matrix of dead times copies states, one for each copy.
        u0: Input before the start of experiments, shape (n_u,) or one number; by default that of `rest`,
            or 0.
        rest: Inputs and outputs at which it rests with all states 0, shapes (n_u,) and (n_y,) or a number
            each: then signals have their absolute values. By default 0.
        name: Name of the plant, as shown to people.
        time_unit: Unit of time of `system`.

    Raises:
        PlantError: If `system` is no such system or is improper, or an argument does not fit.
    """

    sample: Ensemble | None = None
    """What else the plant may be, if it was identified."""

    def __init__(
        self,
        system: Any,
        *,
        states: Named | None = None,
        inputs: Named | None = None,
        outputs: Named | None = None,
        disturbances: Named = (),
        delay: Delay = 0.0,
        output_delay: Numbers = 0.0,
        x0: Numbers | None = None,
        u0: Numbers | None = None,
        rest: tuple[Numbers, Numbers] | None = None,
        name: str = "plant",
        time_unit: str = "s",
    ) -> None:
        own = system_of(system)
        n_all, n_y = own.sizes[1:]
        n_d = len(_listed(disturbances))
        if n_all <= n_d or n_y == 0:
            raise PlantError(f"a plant needs an input and an output, got D of shape {(n_y, n_all)}")
        shared, entries = _split_delay(delay, n_y, n_all - n_d)
        # A dead time of one entry delays only what this input does: so its states must be its own.
        made = own.separated() if entries.any() else own
        n_x, names = len(made.A), made.inputs or None
        self.system, self.name, self.time_unit = made, name, time_unit
        self.has_named_states = states is not None or bool(made.states)
        self.states = _channels("states", states, made.states or None, n_x, "x")
        split = (names[: n_all - n_d], names[n_all - n_d :]) if names else (None, None)
        self.inputs = _channels("inputs", inputs, split[0], n_all - n_d, "u")
        self.outputs = _channels("outputs", outputs, made.outputs or None, n_y, "y")
        self.disturbances = _channels("disturbances", disturbances, split[1], n_d, "d")
        self.x0 = _start(0.0 if x0 is None else x0, len(own.A), n_x)
        self.u0, self.rest = self._resting(u0, rest)
        self.input_delay = self._delays("delay", shared, len(self.inputs))
        self.output_delay = self._delays("output_delay", output_delay, n_y)
        late = self._delays("delay", entries.ravel(), entries.size)
        self.entry_delay = tuple(map(tuple, np.reshape(late, entries.shape).tolist()))
        self._kept: dict[float, np.ndarray] = {}
        self._direct = bool(made.D.any())

    @property
    def sample_time(self) -> float:
        """Sample time of a discrete plant, in `time_unit`; 0 if the plant is continuous."""
        return self.system.dt

    @property
    def named_matrices(self) -> tuple[np.ndarray, np.ndarray] | None:
        """A and B with a row for each time constant: none if it is discrete; None if states have no names."""
        rows = 0 if self.sample_time else len(self.states)
        return (self.system.A[:rows], self.system.B[:rows]) if self.has_named_states else None

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative, per `time_unit`.

        Raises:
            PlantError: If the plant is discrete and no continuous one has the same samples.
        """
        A, B = self._rates
        return np.asarray(A @ x + B @ self.acting(u, d))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the outputs, without dead time."""
        y = self.system.C @ x
        if self._direct:
            y = y + self.system.D @ self.acting(u, d)
        return np.asarray(y + self.rest[1] if self.rest else y)

    def acting(self, u: U, d: D) -> Float[np.ndarray, " n"]:
        """Return what B and D multiply: the inputs, from those at rest on, and the disturbances."""
        return np.concatenate([u - self.rest[0] if self.rest else u, d])

    def entries(self, x: X, u: U, d: D) -> Float[np.ndarray, "n_y n"]:
        """Return what each input adds to the outputs, and last what no input does, n = n_u + 1."""
        n_u, C, D = len(self.inputs), self.system.C, self.system.D
        found = np.zeros((len(self.outputs), n_u + 1))
        found[:, :n_u] = C @ (x[:, None] * self._owned) + D[:, :n_u] * self.acting(u, d)[:n_u]
        # What is left: the states that no input drives, the disturbances, and the outputs at rest.
        found[:, n_u] = self.g(x, u, d) - found[:, :n_u].sum(axis=1)
        return found

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return A, B, C and D. Raises PlantError as `f` does."""
        A, B = self._rates
        n_u = len(self.inputs)
        return Jacobians(A, B[:, :n_u].copy(), self.system.C, self.system.D[:, :n_u].copy())

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times` after x, with u and d held; NaN once they overflow."""
        start, n_x = np.concatenate([x, self.acting(u, d)]), len(self.states)
        states = np.empty((len(times), n_x))
        with np.errstate(all="ignore"):
            for k, t in enumerate(np.asarray(times).tolist()):
                states[k] = self._propagator(t) @ start
            whole = isfinite(states.sum())  # if not, the sum alone may have overflowed
        if not whole:
            states[~np.isfinite(states).all(axis=1)] = np.nan
        return states

    def scaled(
        self, rates: Float[np.ndarray, " n_x"], gains: Float[np.ndarray, " n_u"], later: float
    ) -> "LinearPlant":
        """Return the same plant with faster states (1 if it is discrete), larger gains and later signals."""
        made, system, rows = copy(self), self.system, rates[:, None]
        acting = np.append(gains, np.ones(len(self.disturbances)))
        made.system = replace(system, A=system.A * rows, B=system.B * rows * acting, D=system.D * acting)
        for name in DEAD_TIMES:
            setattr(made, name, scale_times(getattr(self, name), later, self.sample_time))
        made._kept = {}
        made.__dict__.pop("_rates", None)
        return made

    def among(self, sample: Ensemble) -> "LinearPlant":
        """Return the same plant as one of a sample."""
        made = copy(self)
        made.sample = sample
        return made.another(sample.best)

    def another(self, k: int) -> "LinearPlant":
        """Return number `k` of the sample that this plant is one of."""
        assert self.sample is not None
        made, (made_of, late) = copy(self), self.sample.systems[k]
        made.system, made.input_delay, made._kept = made_of, (late,), {}
        for name in ("_rates", "_owned"):
            made.__dict__.pop(name, None)
        return made

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is quickly computed again."""
        return self.__dict__ | {"_kept": {}}

    def _propagator(self, t: float) -> Float[np.ndarray, "n_x n"]:
        """Return the matrix that maps (x, u, d) to the state after `t`.

        Rounding `t` to 13 digits is part of the result, so that no result depends on what was
        computed before; it moves an instant by less than a trillionth.
        """
        dt = self.system.dt
        key = float(np.floor(t / dt + 1e-6)) if dt else float(f"{t:.13g}")
        found = self._kept.get(key)
        if found is None:
            if len(self._kept) >= 4096:
                self._kept.clear()
            found = self._kept[key] = np.hstack(self.system.held(key * dt if dt else key))
        return found

    @cached_property
    def _owned(self) -> Float[np.ndarray, "n_x n_u"]:
        """1 for the states that an input drives, else 0."""
        return self.system.owned[:, : len(self.inputs)].astype(float)

    @cached_property
    def _rates(self) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, "n_x n_u"]]:
        """A and B of ẋ, for a discrete plant those of the continuous one with the same samples."""
        if not self.system.dt:
            return self.system.A, self.system.B
        from scipy.linalg import logm

        n_x, n_u, _ = self.system.sizes
        # The logarithm of such a pole is complex or infinite: no real ẋ has these samples.
        values = np.linalg.eigvals(self.system.A)
        if n_x and np.any((np.abs(values.imag) < 1e-12) & (values.real < 1e-12)):
            raise PlantError(
                f"discrete plant {self.name!r} has a pole at 0 or on the negative axis, so it has "
                "no ẋ = f(x, u): use a controller that needs no continuous model"
            )
        once = np.block([[self.system.A, self.system.B], [np.zeros((n_u, n_x)), np.eye(n_u)]])
        rates = np.real(logm(once)) / self.system.dt
        return rates[:n_x, :n_x], rates[:n_x, n_x:]

    def _resting(
        self, u0: Numbers | None, rest: tuple[Numbers, Numbers] | None
    ) -> tuple[U, tuple[U, Y] | None]:
        """Return the input before the start, and inputs and outputs at rest."""
        n_u, n_y = len(self.inputs), len(self.outputs)
        if rest is None:
            return plant_numbers("u0", 0.0 if u0 is None else u0, n_u), None
        at = plant_numbers("u of rest", rest[0], n_u), plant_numbers("y of rest", rest[1], n_y)
        return plant_numbers("u0", at[0] if u0 is None else u0, n_u), at

    def _delays(self, what: str, value: Numbers, n: int) -> tuple[float, ...]:
        found = plant_numbers(what, value, n)
        if np.any(found < 0):
            raise PlantError(f"{what} must be 0 {self.time_unit} or more, got {found.tolist()}")
        dt = self.system.dt
        if dt and np.any(np.abs(found / dt - np.round(found / dt)) > 1e-6):
            raise PlantError(
                f"{what} of a discrete plant must be a multiple of its sample time {dt:g} "
                f"{self.time_unit}, got {found.tolist()}"
            )
        return tuple(found.tolist())


def local_system(plant: Any, x: X, u: U, d: D) -> LinearSystem:
    """Return the linear system from inputs to outputs that a plant is near a point, no dead time.

    It is discrete if the plant is a discrete `LinearPlant`, so that poles at 0 and on the negative
    axis, which no continuous system has, are kept.

    Raises:
        PlantError: If a derivative is not finite.
    """
    if isinstance(plant, LinearPlant):
        return plant.system.part(range(len(plant.outputs)), range(len(plant.inputs)))
    J = plant.jacobians(x, u, d)
    return LinearSystem(J.A, J.B, J.C, J.D)


def motion(plant: Any, x: X, u: U, d: D) -> tuple[X, Float[np.ndarray, "n_x n_x"]]:
    """Return how fast the states change, per unit of time, and the derivative of that by x.

    For a discrete `LinearPlant` this is the change over a sample, by its sample time.
    """
    if isinstance(plant, LinearPlant) and plant.sample_time:
        dt, A = plant.sample_time, plant.system.A
        after = A @ x + plant.system.B @ plant.acting(u, d)
        return np.asarray(after - x) / dt, np.asarray(A - np.eye(len(A))) / dt
    return np.asarray(plant.f(x, u, d)), np.asarray(plant.jacobians(x, u, d).A)


def _split_delay(delay: Any, n_y: int, n_u: int) -> tuple[Any, Float[np.ndarray, "rows n_u"]]:
    """Return the dead time of the inputs, and what is left for each entry, without rows if 0."""
    none = np.zeros((0, n_u))
    if np.ndim(delay) != 2:
        return delay, none
    if np.shape(delay) != (n_y, n_u):
        raise PlantError(
            f"a matrix of dead times must have a row for each of {n_y} outputs and a column for "
            f"each of {n_u} inputs, got shape {np.shape(delay)}"
        )
    matrix = plant_numbers("delay", np.ravel(delay), n_y * n_u).reshape(n_y, n_u)
    # What is common to all outputs can be at the input, where it costs no copy of the states.
    shared = matrix.min(axis=0)
    return shared, (matrix - shared if (matrix > shared).any() else none)


def _listed(named: Named | None) -> list[str | Channel]:
    return [named] if isinstance(named, str | Channel) else list(() if named is None else named)


def _channels(
    what: str, given: Named | None, names: Sequence[str] | None, n: int, symbol: str
) -> tuple[Channel, ...]:
    """Return one channel for each of `n` signals, by what is given, their names, or numbers."""
    numbered = [symbol] if n == 1 else [f"{symbol}{i + 1}" for i in range(n)]
    found = _listed(given) or list(names or numbered)
    if len(found) != n:
        raise PlantError(f"{what}: expected {n} names or channels, got {len(found)}: {found}")
    strangers = [f for f in found if not isinstance(f, str | Channel)]
    if strangers:
        raise PlantError(f"{what} must be names or Channels, got {strangers[0]!r}")
    channels = tuple(f if isinstance(f, Channel) else Channel(f) for f in found)
    twice = {c.name for c in channels if [o.name for o in channels].count(c.name) > 1}
    if twice:
        raise PlantError(f"{what} must have different names, got {sorted(twice)} more than once")
    return tuple(replace(c) for c in channels)


def _start(x0: Numbers, before: int, n: int) -> X:
    """Return the start, shape (n,), of a system that had `before` states until it was copied.

    Raises:
        PlantError: If a number would start each copy, which together would start elsewhere.
    """
    if n > before and np.ndim(x0) == 0 and x0 != 0:
        raise PlantError(
            f"x0 must be 0 or {n} numbers, got {x0!r:.80}: the matrix of dead times gives each "
            f"input its own copy of the {before} states"
        )
    return plant_numbers("x0", x0, n)


def plant_numbers(what: str, value: Any, n: int) -> Float[np.ndarray, " n"]:
    """Return a number or `n` of them, shape (n,). Raises PlantError if they are anything else."""
    array = numbers(value, what, PlantError)
    if array.ndim == 0:
        array = np.full(n, float(array))
    if array.shape != (n,) or not np.isfinite(array).all():
        raise PlantError(f"{what} must be a finite number or {n} of them, got {value!r:.80}")
    return array
