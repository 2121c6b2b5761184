"""A, B, C and D of any linear system: of SciPy, plain arrays, or an optional world."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float

from prefcal_env.arrays import numbers
from prefcal_env.errors import PlantError
from prefcal_env.optional import WORLDS, world_of

LIBRARIES = " or ".join([*(world.system for world in WORLDS if world.system), "scipy.signal"])
"""What makes linear systems, for messages."""
_FORMS = (
    f"a StateSpace or TransferFunction of {LIBRARIES}, arrays (A, B, C, D) or "
    "(A, B, C, D, dt), polynomials (num, den), a gain, or a list of rows of these"
)


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

    def at(self, s: Any) -> Complex[np.ndarray, "*m n_y n_u"]:
        """Return the transfer function at numbers s, for a discrete system at z = exp(s dt)."""
        point = np.asarray(np.exp(s * self.dt) if self.dt else s)
        resolvent = point[..., None, None] * np.eye(len(self.A)) - self.A
        B = np.broadcast_to(self.B.astype(complex), (*point.shape, *self.B.shape))
        return np.asarray(self.C @ np.linalg.solve(resolvent, B) + self.D)

    def held(self, T: float) -> tuple[Float[np.ndarray, "n_x n_x"], Float[np.ndarray, "n_x n_u"]]:
        """Return A_d and B_d over T with u held; T is a multiple of the sample time if any."""
        if not self.dt:
            return held(self.A, self.B, T)
        n, m, _ = self.sizes
        once = np.block([[self.A, self.B], [np.zeros((m, n)), np.eye(m)]])
        E = np.linalg.matrix_power(once, round(T / self.dt))
        return E[:n, :n], E[:n, n:]

    @property
    def owned(self) -> Bool[np.ndarray, "n_x n_u"]:
        """Return which states each input drives, directly or through other states."""
        linked, reached = self.A != 0, self.B != 0
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
        return LinearSystem(A, B, C, self.D, self.dt, self.inputs, self.outputs)

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
    E = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * T)
    return E[:n, :n], E[:n, n:]


def rates_of(points: Complex[np.ndarray, " n"], dt: float) -> Complex[np.ndarray, " n"]:
    """Return poles or zeros as rates s per unit of time: z counts as ln(z) / dt if dt is not 0."""
    if not dt:
        return points
    return np.log(np.where(np.abs(points) < _FASTEST, _FASTEST, points)) / dt


_FASTEST = 1e-3
"""Magnitude of discrete poles below which they count as this one."""


def system_of(system: Any) -> LinearSystem:
    """Return `system` as matrices.

    Transfer functions are realized entry by entry in controllable canonical form, which is exact
    but has more states than needed if the entries share poles.

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
        return of_arrays([system.A, system.B, system.C, system.D], _time_of(system))
    if hasattr(system, "num") and hasattr(system, "den") and not _is_nested(system.den):
        rows = np.atleast_2d(system.num)  # of scipy: one denominator for all outputs of one input
        return of_fractions([[row] for row in rows], [[system.den]] * len(rows), _time_of(system))
    if hasattr(system, "to_ss"):  # zeros, poles and gain of scipy
        return system_of(system.to_ss())
    if isinstance(system, Sequence) and not isinstance(system, str):
        if _grid(system):
            return _of_grid(system)
        if len(system) == 2:
            return of_fractions([[system[0]]], [[system[1]]])
        if len(system) in (4, 5):
            return of_arrays(system[:4], sample_time(system[4]) if system[4:] else 0.0)
    if isinstance(system, int | float | np.ndarray | np.number) and not isinstance(system, bool):
        return of_arrays([[], [], [], _matrix("a gain", system)], 0.0)
    raise PlantError(f"a linear system must be {_FORMS}, got {type(system).__name__} {system!r:.80}")


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
    grid = [[_canonical(*entry) for entry in zip(*row, strict=True)] for row in rows]
    return _assembled(grid, dt)


def _grid(system: Sequence[Any]) -> bool:
    """Return whether `system` is a list of rows of systems, and not polynomials or matrices."""

    def is_entry(e: Any) -> bool:
        pair = isinstance(e, list | tuple) and len(e) == 2 and np.ndim(e[0]) == np.ndim(e[1]) == 1
        return pair or hasattr(e, "num") or hasattr(e, "A") or hasattr(e, "to_ss")

    rows = [row for row in system if isinstance(row, list | tuple) and len(row)]
    return len(rows) == len(system) > 0 and any(is_entry(e) for row in rows for e in row)


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
    return _assembled(grid, max(steps, default=0.0))


def _assembled(grid: Sequence[Sequence[LinearSystem]], dt: float) -> LinearSystem:
    """Return the matrix of systems of one input and one output, one after the other."""
    n_x = sum(len(entry.A) for row in grid for entry in row)
    n_y, n_u = len(grid), len(grid[0])
    A, B, C = np.zeros((n_x, n_x)), np.zeros((n_x, n_u)), np.zeros((n_y, n_x))
    D, first = np.zeros((n_y, n_u)), 0
    for i, row in enumerate(grid):
        for j, entry in enumerate(row):
            own = slice(first, first + len(entry.A))
            A[own, own], B[own, j], C[i, own] = entry.A, entry.B[:, 0], entry.C[0]
            D[i, j] = entry.D[0, 0]
            first += len(entry.A)
    return LinearSystem(A, B, C, D, dt)


def _canonical(num: Any, den: Any) -> LinearSystem:
    """Return num/den, polynomials with the highest power first, without its sample time."""
    b, a = (np.trim_zeros(np.atleast_1d(_matrix("a polynomial", p)), "f") for p in (num, den))
    if not len(a):
        raise PlantError("a transfer function needs a denominator that is not 0")
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
    return LinearSystem(A, np.eye(n, 1), (b[1:] - b[0] * a[1:])[None], b[:1, None])


def _is_nested(den: Any) -> bool:
    """Return whether a denominator is a list of several, which nothing of SciPy has."""
    rows = list | np.ndarray
    return isinstance(den, rows) and any(isinstance(each, rows) for each in den)


def _time_of(source: Any) -> float:
    return sample_time(getattr(source, "dt", None))


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
