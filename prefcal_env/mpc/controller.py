"""The linear (time-varying) model predictive controller of eq. MPC, and its settings."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal, Self, get_args

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import is_number, matrix, vector, weights
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Measurement, Move
from prefcal_env.plants.plant import Plant, equations_of
from prefcal_env.plants.systems import LinearPlant
from prefcal_env.qp import QP, PIQPSolver, Tolerances

from . import kernels

Linearization = Literal["point", "trajectory"]
ACTIVE_SET = "active-set"
BACKENDS = (ACTIVE_SET, "piqp")
Matrix = Sequence[Sequence[float]] | np.ndarray
Vector = Sequence[float] | np.ndarray


def _tuple(value: Any) -> Any:
    """Return arrays and lists as nested tuples, which are frozen and compare by value."""
    if isinstance(value, np.ndarray | list | tuple):
        return tuple(_tuple(v) for v in value)
    return float(value) if isinstance(value, np.floating | np.integer) else value


@dataclass(frozen=True)
class MPCSettings:
    """Settings of a linear (time-varying) MPC. Matrices and vectors may be given as arrays.

    Args:
        T_s: Sampling time, in the plant's unit of time.
        N_p: Prediction horizon, steps.
        N_u: Number of free moves, steps; afterwards the input is held. At most N_p.
        Q_y: Weight of y - y_ref, shape (n_y, n_y), positive semidefinite.
        Q_du: Weight of the moves Δu, shape (n_u, n_u), positive semidefinite.
        Q_u: Weight of u - u_ref, shape (n_u, n_u), positive semidefinite; None means zero.
        u_ref: Input reference, shape (n_u,) or (N, n_u), one row for each step; None means zero.
        u_min: Hard lower limits of the inputs, shape (n_u,); None uses the plant's.
        u_max: Hard upper limits of the inputs, shape (n_u,); None uses the plant's.
        du_min: Hard lower limits of the move in one step, shape (n_u,); None for no limit.
        du_max: Hard upper limits of the move in one step, shape (n_u,); None for no limit.
        y_min: Soft lower limits of the outputs, shape (n_y,); None for no limit.
        y_max: Soft upper limits of the outputs, shape (n_y,); None for no limit.
        Q_eps: Weight of the single slack ε >= 0 of the soft limits, above 0.
        softness: Factor on ε by which each output's limits may be violated, shape (n_y,); None is
            1.
        linearization: "point" uses one model, at the present state and input, for the whole
            horizon. "trajectory" uses one along the nominal trajectory of the last plan (eq.
            MPCsys).
        backend: QP solver: "active-set", which is compiled into the step, or "piqp".
        tolerances: Tolerances of the QP solver.

    Raises:
        SettingsError: If a horizon is below 1 or not an integer, N_u is above N_p, the sampling
            time or Q_eps is not positive, a weight is not symmetric positive semidefinite, limits
            are crossed, or an option is unknown.
    """

    T_s: float
    N_p: int
    N_u: int
    Q_y: Matrix
    Q_du: Matrix
    Q_u: Matrix | None = None
    u_ref: Matrix | Vector | None = None
    u_min: Vector | None = None
    u_max: Vector | None = None
    du_min: Vector | None = None
    du_max: Vector | None = None
    y_min: Vector | None = None
    y_max: Vector | None = None
    Q_eps: float = 10.0
    softness: Vector | None = None
    linearization: Linearization = "point"
    backend: str = ACTIVE_SET
    tolerances: Tolerances = field(default_factory=Tolerances)

    def __post_init__(self) -> None:
        # Arrays could be changed behind the frozen settings, and two equal ones would not compare.
        for f in fields(self):
            object.__setattr__(self, f.name, _tuple(getattr(self, f.name)))
        for name in ("T_s", "Q_eps"):
            if not (is_number(getattr(self, name)) and 0 < getattr(self, name) < np.inf):
                raise SettingsError(f"{name} must be positive, got {getattr(self, name)}")
        self._check_horizons()
        for name in ("Q_y", "Q_du", "Q_u"):
            if name != "Q_u" or self.Q_u is not None:
                weights(name, getattr(self, name))
        for what in ("u", "du", "y"):
            low, high = getattr(self, f"{what}_min"), getattr(self, f"{what}_max")
            # Limits of which one is the plant's are compared later, in `_limits`, where the plant is known.
            if None not in (low, high) and not np.all(np.asarray(low) <= np.asarray(high)):
                raise SettingsError(f"{what}_min must not be above {what}_max, got {low}, {high}")
        if self.linearization not in get_args(Linearization):
            raise SettingsError(
                f"linearization must be one of {get_args(Linearization)}, got {self.linearization!r}"
            )
        if not isinstance(self.tolerances, Tolerances):
            raise SettingsError(f"tolerances must be Tolerances, got {self.tolerances!r}")
        if self.backend not in BACKENDS:
            raise SettingsError(f"backend must be one of {BACKENDS}, got {self.backend!r}")

    def named(self) -> dict[str, Any]:
        """Return the settings by name, as `best.json` stores them."""
        return asdict(self)

    def _check_horizons(self) -> None:
        for name in ("N_p", "N_u"):
            value = getattr(self, name)
            if not (is_number(value) and 1 <= value < np.inf and value == int(value)):
                raise SettingsError(f"{name} must be an integer of 1 or more, got {value}")
            object.__setattr__(self, name, int(value))
        if self.N_u > self.N_p:
            raise SettingsError(f"N_u must not be above N_p = {self.N_p}, got {self.N_u}")


def control_horizon(share: float, N_p: int) -> int:
    """Return N_u = max(1, `share` of N_p, rounded half up); the paper does not say how to round."""
    # Not `round`, which rounds halves to even: 0.5 · 25 would be 12, and 0.5 · 27 be 14.
    return max(1, int(np.floor(share * N_p + 0.5)))


@dataclass(frozen=True, slots=True)
class Condensed:
    """The QP of every step of an MPC on a linear plant: the point z nearest to 0 within limits.

    Rows of the inputs come first, then those of the moves after the first, of limited outputs, and of the
    slack. Limits of inputs and moves are absolute; a first move has both.
    """

    base: Float[np.ndarray, " n"]  # x, u and y_ref at which the rows are `offset`
    G: Float[np.ndarray, "m n_z"]  # rows
    offset: Float[np.ndarray, " m"]  # what each row is at `base` and z = 0, of an input less the last one
    slopes: Float[np.ndarray, "m n"]  # how it changes with x, u and y_ref
    low: Float[np.ndarray, " m"]  # lower limits
    high: Float[np.ndarray, " m"]  # upper limits
    du_min: Float[np.ndarray, " n_u"]  # lower limits of a move
    du_max: Float[np.ndarray, " n_u"]  # upper limits of a move


_MEASURED = ("x", "u", "d", "y_ref")


class LinearMPC:
    """The MPC of eq. MPC: linearize, condense to a QP, solve, apply the first input.

    Each step solves for deviations v from the unconstrained optimal feedback (`kernels.riccati`),
    which is eq. MPC in other variables. It weighs the outputs y_1 ... y_Np and the inputs and moves
    0 ... N_p - 1.

    Deviation: eq. MPC weighs y_0 ... y_Np-1; y_0 is already measured, and weighing it has no effect
    (without D). Eq. MPC_constraints limits inputs and moves from k = 1 on, which leaves the one
    that is applied without a limit. It holds the inputs from u_Nu on, so that N_u + 1 moves are
    free, while the minimum is over N_u of them; here N_u are. All measured in docs/deviations.md.

    Deviation: if Q_u + Q_Δu is singular, 1e-10 of the largest weight is added to Q_Δu, since
    eq. MPC may then have no unique minimizer.

    Args:
        plant: Plant that the controller uses as its model.
        settings: Horizons, weights and limits.

    Raises:
        SettingsError: If the shapes of weights or limits do not fit the plant.
    """

    def __init__(self, plant: Plant, settings: MPCSettings) -> None:
        self.plant, self.settings = plant, settings
        n_u, n_y = len(plant.inputs), len(plant.outputs)
        Q_u = weights("Q_u", np.zeros(n_u) if settings.Q_u is None else settings.Q_u, n_u)
        Q_y, Q_du = weights("Q_y", settings.Q_y, n_y), weights("Q_du", settings.Q_du, n_u)
        # Relative to the weights: only their ratios change the minimizer of eq. MPC.
        floor = 1e-10 * max(Q_y.max(), Q_u.max(), Q_du.max())
        if floor <= 0:
            raise SettingsError("Q_y, Q_u and Q_du must not all be zero: there is nothing to weigh")
        if np.linalg.eigvalsh(Q_u + Q_du)[0] < floor:
            Q_du = Q_du + floor * np.eye(n_u)
        self._sizes = len(plant.states), n_u, n_y, len(plant.disturbances)
        self._prepare(_root(Q_y), _root(Q_u), _root(Q_du), _input_reference(settings.u_ref, n_u))
        self._plan: Float[np.ndarray, "N_u n_u"] | None = None
        self._shapes: tuple[Any, ...] = ()

    def _prepare(self, *roots: Float[np.ndarray, "_ _"]) -> None:
        """Arrange what does not change from step to step for the compiled functions."""
        s = self.settings
        hard, (y_min, y_max, give) = _limits(self.plant, s)
        soft = bool(np.isfinite(y_min).any() or np.isfinite(y_max).any())
        self._equations = equations_of(self.plant)
        cube, matrix = np.zeros((0, 0, 0)), np.zeros((0, 0))
        # Empty: then the compiled step linearizes by itself, at the measured point.
        self._at_point = cube, cube, matrix, cube, cube, matrix
        # Without soft limits no output is predicted as a row of the QP, and there is no slack.
        horizons = float(s.T_s), s.N_p, s.N_u, s.N_p if soft else 0
        self._problem = horizons, roots, hard, (y_min, y_max, give)
        stop = s.tolerances
        self._solver = (
            s.backend == ACTIVE_SET,
            float(stop.absolute),
            float(stop.relative),
            stop.max_iterations,
        )
        self._piqp = PIQPSolver(stop)

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self.settings.T_s

    def forget(self) -> None:
        """Drop the last plan, used by linearization "trajectory": the task has changed."""
        self._plan = None

    def move(self, measurement: Measurement) -> Move:
        """Decide the next input; hold the last one if the QP is not solved.

        What the chosen solver does not solve, the other one may: PIQP fails where the limits leave
        so little room that no plan stabilizes the model, since the deviations v are then as large as
        its growth.

        Raises:
            PlantError: If a measurement has the wrong shape or is not finite.
        """
        self._check(measurement)
        data = self._data(measurement)
        # One call from Python a step: each crossing to compiled code packs all arguments anew.
        how, iterations, plan, U, *rows_of_qp = kernels.decide(*data, *self._problem, self._solver)
        self._equations.check()
        if how == kernels.NOT_FINITE:
            raise _not_finite(measurement)
        if how == kernels.OPEN:
            solution = self._piqp.solve(_nearest(*rows_of_qp))
            iterations += solution.iterations
            if solution.solved:
                how, plan = kernels.DECIDED, kernels.inputs(U, solution.z, data[1][1], self._problem[2])
            elif self.settings.backend != ACTIVE_SET:
                how, more, plan, *_ = kernels.decide(*data, *self._problem, (True, *self._solver[1:]))
                iterations += more
        solved = how == kernels.DECIDED
        # A plan that was not applied is no trajectory to linearize along (eq. MPCsys).
        self._plan = plan if solved else None
        return Move(plan[0] if solved else measurement.u, iterations, solved=solved)

    def problem(self, measurement: Measurement) -> QP:
        """Return the QP of one step, in deviations v from the optimal feedback, the slack last."""
        _, _, _, _, *rows_of_qp = kernels.decide(*self._data(measurement), *self._problem, self._solver)
        self._equations.check()
        return _nearest(*rows_of_qp)

    def condensed(self) -> Condensed:
        """Return the QP of every step, as it follows from x, u and y_ref, if the model is linear.

        Raises:
            SettingsError: If it is not, or has measured disturbances, or its soft limits cannot be trusted.
        """
        plant = self._linear()
        n_x, n_u, n_y, _ = self._sizes
        u0, y0 = plant.rest or (np.zeros(n_u), np.zeros(n_y))
        base = np.concatenate([np.zeros(n_x), u0, y0])
        made = [self._rows_at(base + step) for step in (0.0 * base, *np.eye(len(base)))]
        # All but the limits of the inputs is affine: the rows at one point and a unit beyond it say all.
        offset = made[0][1]
        slopes = np.array([each - offset for _, each in made[1:]]).T
        return Condensed(base, made[0][0], offset, slopes, *self._bounds(len(offset)), *self._problem[2][2:])

    def _linear(self) -> LinearPlant:
        """Return the model, if it is linear and the same at every step."""
        if not isinstance(self.plant, LinearPlant) or self.plant.disturbances:
            what = "has measured disturbances" if isinstance(self.plant, LinearPlant) else "is not linear"
            raise SettingsError(
                f"the model of this MPC {what}: only one with a linear plant without them has the same QP at "
                "every step, and can be kept as data or written as code"
            )
        return self.plant

    def _rows_at(
        self, p: Float[np.ndarray, " n"]
    ) -> tuple[Float[np.ndarray, "m n_z"], Float[np.ndarray, " m"]]:
        """Return G, and what each row is without deviations, where p is x, u and y_ref."""
        n_x, n_u, _, _ = self._sizes
        x, u, y_ref = np.split(p, [n_x, n_x + n_u])
        m = Measurement(t=0.0, x=x, u=u, d=np.zeros(0), y_ref=y_ref)
        how, _, _, U, G, _, high = kernels.decide(*self._data(m), *self._problem, self._solver)
        self._equations.check()
        if how == kernels.NOT_TRUSTED:
            raise SettingsError("the QP of this MPC cannot be trusted: its model grows too fast")
        free = U[:, :, -1]
        of_inputs = np.concatenate([free.ravel(), np.diff(free, axis=0).ravel()])
        soft = np.append(-high[len(of_inputs) : -1], 0.0) if len(high) > len(of_inputs) else np.zeros(0)
        return G, np.concatenate([of_inputs, soft])

    def _bounds(self, rows: int) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
        """Return the limits of the rows of inputs, moves and outputs, and of the slack."""
        u_min, u_max, du_min, du_max = self._problem[2]
        N_u = self.settings.N_u
        low = np.concatenate([np.tile(u_min, N_u), np.tile(du_min, N_u - 1)])
        high = np.concatenate([np.tile(u_max, N_u), np.tile(du_max, N_u - 1)])
        soft = rows - len(low)
        if soft:
            low = np.concatenate([low, np.full(soft - 1, -np.inf), [0.0]])
            high = np.concatenate([high, np.zeros(soft - 1), [np.inf]])
        return low, high

    def as_data(self) -> dict[str, Any]:
        """Return model and settings as JSON-able data; None for infinite limits.

        Raises:
            SettingsError: If the model is not linear or has measured disturbances.
        """
        plant = self._linear()
        s, names = plant.system, ("u_min", "u_max", "du_min", "du_max")
        settings = self.settings.named() | dict(zip(names, self._problem[2], strict=True))
        for name in (*names, "y_min", "y_max"):
            if settings[name] is not None:
                settings[name] = [float(v) if np.isfinite(v) else None for v in settings[name]]
        rest = None if plant.rest is None else [part.tolist() for part in plant.rest]
        model = {name: getattr(s, name).tolist() for name in ("A", "B", "C", "D")}
        return {"model": model | {"dt": s.dt, "rest": rest}, "settings": settings}

    @classmethod
    def of_data(cls, data: Mapping[str, Any]) -> Self:
        """Return the MPC that `as_data` describes. Raises SettingsError or KeyError for other data."""
        model, settings = data["model"], dict(data["settings"])
        D = np.array(model["D"], dtype=float)
        if D.ndim != 2:
            raise SettingsError(f"D must be a matrix, a row for each output, got shape {D.shape}")
        n_x, (n_y, n_u) = len(model["A"]), D.shape
        shapes = {"A": (n_x, n_x), "B": (n_x, n_u), "C": (n_y, n_x)}
        A, B, C = (matrix(name, model[name], shape) for name, shape in shapes.items())
        for name, sign in (("min", -np.inf), ("max", np.inf)):
            for what in (f"u_{name}", f"du_{name}", f"y_{name}"):
                if settings.get(what) is not None:
                    settings[what] = [sign if v is None else v for v in settings[what]]
        settings["tolerances"] = Tolerances(**settings["tolerances"])
        plant = LinearPlant((A, B, C, D, model["dt"]) if model["dt"] else (A, B, C, D), rest=model["rest"])
        return cls(plant, MPCSettings(**settings))

    def _check(self, m: Measurement) -> None:
        """Raise PlantError if something has a wrong shape."""
        arrays = m.x, m.u, m.d, m.y_ref
        shapes = tuple(getattr(array, "shape", None) for array in arrays)
        if shapes == self._shapes:  # those of the last step were right
            return
        n_x, n_u, n_y, n_d = self._sizes
        for name, array, n in zip(_MEASURED, arrays, (n_x, n_u, n_d, n_y), strict=True):
            found, previews = np.shape(array), name in ("d", "y_ref")
            previewed = previews and len(found) == 2 and found[0] > 0 and found[1] == n
            if not (isinstance(array, np.ndarray) and (found == (n,) or previewed)):
                raise PlantError(
                    f"measurement: {name} must be an array of shape {(n,)}"
                    f"{', or one row a step' if previews else ''}, got {array!r}"
                )
        self._shapes = shapes

    def _data(self, m: Measurement) -> tuple[Any, ...]:
        """Return the plant, the measurement and the model, if it is made before, for `step`.

        The arrays are copies: a read-only or strided one is another type for numba.
        """
        x, u = _own(m.x), _own(m.u)
        d, y_ref = _own(np.atleast_2d(m.d)), _own(np.atleast_2d(m.y_ref))
        equations, found = self._equations.packed, self._at_point
        if self.settings.linearization == "trajectory":
            X, V = self._nominal(x, u, d)
            T_s = self._problem[0][0]  # a float: for an int numba would compile again
            found = kernels.along_trajectory(equations, x, u, d, X, V, T_s, y_ref.shape[1])
        return equations, (x, u, d, y_ref), found

    def _nominal(
        self, x: Float[np.ndarray, " n_x"], u: Float[np.ndarray, " n_u"], d: Float[np.ndarray, "N n_d"]
    ) -> tuple[Float[np.ndarray, "N_p1 n_x"], Float[np.ndarray, "N_p n_u"]]:
        """Return the states and inputs of the last plan, shifted by one step (eq. MPCsys).

        If the nominal trajectory diverges, the last finite state is kept for the rest of the
        horizon, so that the model stays usable.
        """
        N_p, period = self.settings.N_p, np.array([self.settings.T_s])
        V = np.tile(u, (N_p, 1))
        if self._plan is not None:
            # The last plan began one period ago: its first input has acted, and its last one is held.
            shifted = self._plan[1:]
            V[: len(shifted)], V[len(shifted) :] = shifted, self._plan[-1]
        X = np.tile(x, (N_p + 1, 1))
        for k in range(N_p):
            # Beyond the preview the last known disturbance stays.
            following = self.plant.hold(X[k], V[k], d[min(k, len(d) - 1)], period)[0]
            X[k + 1] = following if np.isfinite(following).all() else X[k]
        return X, V


def _nearest(G: Float[np.ndarray, "m n"], low: np.ndarray, high: np.ndarray) -> QP:
    """Return the QP of the point nearest to the origin with low <= G z <= high."""
    n = G.shape[1]
    return QP(np.eye(n), np.zeros(n), G, low, high)


def _own(values: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    return np.array(values, dtype=float, order="C")


def _not_finite(m: Measurement) -> PlantError:
    arrays = zip(_MEASURED, (m.x, m.u, m.d, m.y_ref), strict=True)
    # The sum of what is measured may overflow although each number is finite.
    name, array = next(((n, a) for n, a in arrays if not np.isfinite(a).all()), ("x", m.x))
    return PlantError(f"measurement: {name} must be finite, got {array}")


def _limits(plant: Plant, s: MPCSettings) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return the limits of inputs and moves, which are hard, and of outputs, which give way.

    That is u_min, u_max, Δu_min and Δu_max; y_min, y_max and how far each output's limits give way
    for the one slack of eq. MPC_constraints: softness / √Q_ε. Infinite for no limit; missing limits
    of inputs are the plant's.
    """

    def limit(name: str, n: int, default: Any) -> Any:
        given = getattr(s, name)
        return vector(name, np.broadcast_to(default, n) if given is None else given, n)

    n_u, n_y = len(plant.inputs), len(plant.outputs)
    u_min = limit("u_min", n_u, [c.low for c in plant.inputs])
    u_max = limit("u_max", n_u, [c.high for c in plant.inputs])
    du_min, du_max = limit("du_min", n_u, -np.inf), limit("du_max", n_u, np.inf)
    softness = limit("softness", n_y, 1.0)
    if np.any(u_min > u_max):
        raise SettingsError(
            f"u_min must not be above u_max (the plant's where none is given), got {u_min}, {u_max}"
        )
    if np.any(du_min > 0) or np.any(du_max < 0):
        raise SettingsError(
            "du_min must not be above 0 and du_max not below 0 (an input may always be held), "
            f"got {du_min}, {du_max}"
        )
    if np.any(softness < 0):
        raise SettingsError(f"softness must be 0 or more, got {softness}")
    # With ε in units of 1/√Q_ε, its weight is 1 as that of all deviations v.
    soft = limit("y_min", n_y, -np.inf), limit("y_max", n_y, np.inf), softness / np.sqrt(s.Q_eps)
    return (u_min, u_max, du_min, du_max), soft


def _root(Q: Float[np.ndarray, "n n"]) -> Float[np.ndarray, "r n"]:
    """Return rows L with LᵀL = Q, as many as the rank of Q."""
    values, vectors = np.linalg.eigh(Q)
    # A weight of 0 is no row: each row of the root costs time in every step.
    kept = values > 1e-14 * max(values.max(), 0.0)
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def _input_reference(value: object, n: int) -> Float[np.ndarray, "k n"]:
    rows = np.zeros((1, n)) if value is None else np.atleast_2d(np.array(value, dtype=float))
    if rows.ndim != 2 or rows.shape[1] != n or not np.all(np.isfinite(rows)):
        raise SettingsError(f"u_ref must be finite, shape ({n},) or (N, {n}), got {value!r}")
    return np.ascontiguousarray(rows)
