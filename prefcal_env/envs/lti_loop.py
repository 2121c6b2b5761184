"""Linear controllers, and runs of a plant with them or with any other controller."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channels, End, Experiment, KPIs, Measurement, Move
from prefcal_env.experiments.kpis import tracking_kpis
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearPlant, LinearSystem, plant_numbers, system_of

from .closed_loop import rollout
from .plant_env import PlantEnv, dead_times
from .task import Task


@dataclass(frozen=True, eq=False)
class Law:
    """A linear control law: x' = A x + B_r r + B_y y, u = C x + D_r r + D_y y."""

    A: Float[np.ndarray, "n_c n_c"]  # dynamics, shape (n_c, n_c)
    B_r: Float[np.ndarray, "n_c n_y"]  # effect of the references, shape (n_c, n_y)
    B_y: Float[np.ndarray, "n_c n_y"]  # effect of the outputs, shape (n_c, n_y)
    C: Float[np.ndarray, "n_u n_c"]  # inputs of the plant from states, shape (n_u, n_c)
    D_r: Float[np.ndarray, "n_u n_y"]  # inputs of the plant from references, shape (n_u, n_y)
    D_y: Float[np.ndarray, "n_u n_y"]  # inputs of the plant from outputs, shape (n_u, n_y)
    dt: float  # sample time; 0 if it is continuous

    def sampled(self, T_s: float) -> "Law":
        """Return a continuous law for a sampling time, by the trapezoidal (Tustin) rule."""
        if self.dt:
            return self
        one, h = np.eye(len(self.A)), T_s / 2
        inverse = np.linalg.inv(one - h * self.A)
        C = self.C @ inverse
        return Law(
            inverse @ (one + h * self.A),
            2 * h * inverse @ self.B_r,
            2 * h * inverse @ self.B_y,
            C,
            self.D_r + h * C @ self.B_r,
            self.D_y + h * C @ self.B_y,
            T_s,
        )


def law_of(system: LinearSystem, n_y: int, n_u: int, free: Bool[np.ndarray, " n_y"]) -> Law:
    """Return a controller with n_y inputs, the errors r - y, or 2 n_y, first r and then y, as a law.

    `free` says which outputs have no reference; then r = y.

    Raises:
        SettingsError: If the controller has another number of inputs or outputs.
    """
    _, n_in, n_out = system.sizes
    if n_in not in (n_y, 2 * n_y) or n_out != n_u:
        raise SettingsError(
            f"a controller of {n_u} inputs and {n_y} outputs of the plant needs {n_u} outputs, and "
            f"{n_y} inputs (errors r - y) or {2 * n_y} (references r, then outputs y); "
            f"this one has {n_out} outputs and {n_in} inputs"
        )
    B_r, D_r = system.B[:, :n_y].copy(), system.D[:, :n_y].copy()
    B_y, D_y = (-B_r, -D_r) if n_in == n_y else (system.B[:, n_y:].copy(), system.D[:, n_y:].copy())
    B_y[:, free] += B_r[:, free]
    D_y[:, free] += D_r[:, free]
    B_r[:, free] = D_r[:, free] = 0.0
    return Law(system.A, B_r, B_y, system.C, D_r, D_y, system.dt)


class LTIController:
    """A sampled linear control law as a `Controller`. It acts on `Measurement.y`."""

    def __init__(self, law: Law) -> None:
        self._law, self._x = law, np.zeros(len(law.A))

    @property
    def T_s(self) -> float:
        """Sampling time, in the plant's unit of time."""
        return self._law.dt

    def move(self, measurement: Measurement) -> Move:
        """Return the input for the next period, and update the states."""
        law, x, y = self._law, self._x, measurement.y
        r = np.where(np.isnan(measurement.y_ref), 0.0, measurement.y_ref)
        u = law.C @ x + law.D_r @ r + law.D_y @ y
        self._x = law.A @ x + law.B_r @ r + law.B_y @ y
        return Move(u)


@dataclass(frozen=True, eq=False)
class Closed:
    """A closed loop: z' = A z + B w, (y, u) = C z + D w with w = (r, d)."""

    A: Float[np.ndarray, "n_z n_z"]
    B: Float[np.ndarray, "n_z n_w"]
    C: Float[np.ndarray, "n_o n_z"]
    D: Float[np.ndarray, "n_o n_w"]

    def run(
        self, z: Float[np.ndarray, " n_z"], w: Float[np.ndarray, "K n_w"], step: float
    ) -> tuple[Float[np.ndarray, "K n_z"], Float[np.ndarray, "K n_o"]]:
        """Return z and (y, u) at K instants, `step` apart, with w held in between: exact."""
        from scipy.linalg import expm  # takes a while to import

        n = len(z)
        full = np.zeros((n + w.shape[1], n + w.shape[1]))
        full[:n, :n], full[:n, n:] = self.A, self.B
        states = np.empty((len(w), n))
        with np.errstate(all="ignore"):
            propagator = expm(full * step)[:n]
            for k in range(len(w)):
                states[k] = z
                z = propagator[:, :n] @ z + propagator[:, n:] @ w[k]
            return states, states @ self.C.T + w @ self.D.T


def closed_loop(plant: LinearPlant, law: Law) -> Closed:
    """Return the closed loop of a continuous plant and a continuous law.

    Raises:
        SettingsError: If both pass a jump on at once, so that no input solves the loop.
    """
    s, n_u, n_c = plant.system, len(plant.inputs), len(law.A)
    n_y, n_x = s.sizes[2], len(s.A)
    B_u, B_d, D_u, D_d = s.B[:, :n_u], s.B[:, n_u:], s.D[:, :n_u], s.D[:, n_u:]
    loop = np.eye(n_u) - law.D_y @ D_u
    if np.linalg.cond(loop) > 1e12:
        raise SettingsError(
            "this loop is algebraic and has no solution: plant and controller both pass a jump on "
            "at once, with a loop gain of 1; give the controller a filter"
        )
    # u = U z + V w
    U = np.linalg.solve(loop, np.hstack([law.D_y @ s.C, law.C]))
    V = np.linalg.solve(loop, np.hstack([law.D_r, law.D_y @ D_d]))
    y_z = np.hstack([s.C, np.zeros((n_y, n_c))]) + D_u @ U
    y_w = np.hstack([np.zeros((n_y, n_y)), D_d]) + D_u @ V
    from_d = np.hstack([np.zeros((n_x, n_y)), B_d])
    from_r = np.hstack([law.B_r, np.zeros((n_c, B_d.shape[1]))])
    A = np.vstack(
        [
            np.hstack([s.A, np.zeros((n_x, n_c))]) + B_u @ U,
            np.hstack([np.zeros((n_c, n_x)), law.A]) + law.B_y @ y_z,
        ]
    )
    B = np.vstack([B_u @ V + from_d, from_r + law.B_y @ y_w])
    return Closed(A, B, np.vstack([y_z, U]), np.vstack([y_w, V]))


Reference = float | Sequence[float] | Mapping[str, float] | np.ndarray | Callable[[float], Any]
_INSTANTS = 501  # instants of a record: as many as of a `PlantEnv` by default


class LTILoop:
    """A `run` that lets the controller of θ track a step of the reference.

    If plant and controller are linear and continuous, and inputs have neither limits nor dead time,
    the closed loop is computed as such, exactly. Otherwise the loop is simulated: the input is held
    between samples and saturates at its limits. A continuous controller is then sampled with `T_s`
    by the trapezoidal (Tustin) rule, as a computer would run it.

    A run ends as unsafe once an output is `runaway` times as far away as its largest reference.

    Args:
        plant: Plant, such as `Plant.of(...)`, or what `Plant.of` takes. A run starts at its `x0`,
            with its `u0` as the last input; at 0 if it has none.
        controller: Function of a physical θ, shape (n,), that returns a linear system (whatever
            `Plant.of` takes, or a gain), or any controller with `T_s` and `move`. The system's
            inputs are the errors r - y or, with twice as many, the references and then the outputs;
            its outputs are the inputs of the plant.
        horizon: Duration, in the plant's unit of time.
        reference: Reference of the outputs from time 0 on: one number for all, an array of shape
            (n_y,) with NaN for an output without one, a mapping from names of outputs to numbers,
            or a function of time that returns an array.
        knobs: Knobs of θ, which make `space`.
        d: Measured disturbances of the plant, shape (n_d,), or a function of time; default 0.
        T_s: Sampling time of a continuous controller where it is sampled; by default that of a
            discrete plant, else 1/1000 of the horizon. Giving it makes any run a simulation.
        noise: Standard deviation of the noise of each measured output, shape (n_y,), for simulated
            runs; None for none.
        bands: Accepted distance from the reference by name of output, for settling and drawing.
        kpis: Function that returns the KPIs of an experiment by name.
        runaway: Factor of the largest reference beyond which a run stops as unsafe.

    Raises:
        PlantError: If `plant` is no plant and no linear system.
        SettingsError: If an argument does not fit the plant.
    """

    signals: tuple[str, ...] = ()

    def __init__(
        self,
        plant: Any,
        controller: Callable[[Float[np.ndarray, " n"]], Any],
        *,
        horizon: float,
        reference: Reference = 1.0,
        knobs: Sequence[Knob] | KnobSpace = (),
        d: Any = None,
        T_s: float | None = None,
        noise: Sequence[float] | float | None = None,
        bands: Mapping[str, float] | None = None,
        kpis: KPIs = tracking_kpis,
        runaway: float = 100.0,
    ) -> None:
        self.plant: Plant = plant if hasattr(plant, "hold") else Plant.of(plant)
        if not callable(controller) or hasattr(controller, "move"):
            raise SettingsError(
                f"controller must be a function of θ that returns a controller, got {controller!r}"
            )
        self.space = knobs if isinstance(knobs, KnobSpace) else KnobSpace(list(knobs)) if knobs else None
        if T_s is not None and not (isinstance(T_s, Real) and 0 < T_s < np.inf):
            raise SettingsError(f"T_s must be above 0 {self.plant.time_unit}, got {T_s!r}")
        self.kpis, self._controller, self._T_s = kpis, controller, T_s
        self._env = PlantEnv(self.plant, self._task(horizon, reference, d, noise, bands, runaway))
        named = getattr(self.plant, "has_named_states", True)
        states = self._env.channels.x if named else ()
        self.channels: Channels = replace(self._env.channels, x=states)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run a physical θ, shape (n,); the seed draws the noise, if there is any.

        Raises:
            PlantError: If the controller is improper or no linear system.
            SettingsError: If the controller does not fit the plant.
        """
        controller = self._controller(np.asarray(theta, dtype=float))
        if not hasattr(controller, "move"):
            free = np.isnan(self._env.task.reference(0.0))
            sizes = len(self.plant.outputs), len(self.plant.inputs)
            law = law_of(system_of(controller), *sizes, free)
            if self._is_exact(law):
                return self._exact(theta, law).with_kpis(self.kpis)
            own = self._T_s or float(getattr(self.plant, "sample_time", 0.0))
            controller = LTIController(law.sampled(own or self._env.task.horizon / 1000))
        found = rollout(self._env, controller, theta, seed=seed)
        shown = replace(found, x=found.x[:, : len(self.channels.x)], channels=self.channels)
        return shown.with_kpis(self.kpis)

    def _task(
        self,
        horizon: float,
        reference: Reference,
        d: Any,
        noise: Any,
        bands: Mapping[str, float] | None,
        runaway: float,
    ) -> Task:
        plant, n_y = self.plant, len(self.plant.outputs)
        x0, u0 = getattr(plant, "x0", None), getattr(plant, "u0", None)
        x0 = np.zeros(len(plant.states)) if x0 is None else np.asarray(x0)
        u0 = np.zeros(len(plant.inputs)) if u0 is None else np.asarray(u0)
        load = d if callable(d) else _numbers("d", 0.0 if d is None else d, len(plant.disturbances))
        y_ref = self._reference(reference)
        d0 = np.asarray(load(0.0) if callable(load) else load, dtype=float)
        times = np.linspace(0.0, horizon, _INSTANTS).tolist()
        largest = [y_ref(t) for t in times] if callable(y_ref) else [y_ref]
        reach = np.nanmax(np.abs(np.array([*largest, plant.g(x0, u0, d0)])), axis=0)
        farthest = runaway * np.where(reach > 0, reach, 1.0)

        def unsafe(x: Float[np.ndarray, " n_x"]) -> bool:
            return bool(np.any(np.abs(plant.g(x, u0, d0)) > farthest))

        return Task(
            x0=x0,
            u0=u0,
            y_ref=y_ref,
            d=load,
            horizon=horizon,
            unsafe=unsafe,
            noise=None if noise is None else _numbers("noise", noise, n_y),
            bands={self._output(name): band for name, band in (bands or {}).items()},
        )

    def _reference(self, given: Reference) -> Any:
        n_y = len(self.plant.outputs)
        if callable(given):
            return given
        if isinstance(given, Mapping):
            found = np.full(n_y, np.nan)
            for name, value in given.items():
                found[self._output(name)] = value
            return found
        array = np.asarray(given, dtype=float)
        if array.shape not in ((), (n_y,)):
            raise SettingsError(
                f"reference must be one number or {n_y}, got shape {array.shape}: the outputs are "
                f"{[c.name for c in self.plant.outputs]}"
            )
        return np.broadcast_to(array, n_y)

    def _output(self, name: str) -> int:
        names = [c.name for c in self.plant.outputs]
        if name not in names:
            raise SettingsError(f"there is no output {name!r}; the outputs are {names}")
        return names.index(name)

    def _is_exact(self, law: Law) -> bool:
        plant = self.plant
        limits = [limit for c in plant.inputs for limit in (c.low, c.high)]
        return (
            isinstance(plant, LinearPlant)
            and not (law.dt or plant.sample_time or self._T_s or np.isfinite(limits).any())
            and not (plant.rest or dead_times(plant).any())
            and self._env.task.noise is None
        )

    def _exact(self, theta: Float[np.ndarray, " n"], law: Law) -> Experiment:
        """Return the run of the closed loop, whose references and disturbances are held a step."""
        assert isinstance(self.plant, LinearPlant)
        task, n_y = self._env.task, len(self.plant.outputs)
        t = np.linspace(0.0, task.horizon, _INSTANTS)
        r = np.array([task.reference(s) for s in t.tolist()])
        d = np.array([task.disturbance(s) for s in t.tolist()])
        w = np.hstack([np.nan_to_num(r), d.reshape(len(t), -1)])
        z = np.concatenate([task.x0, np.zeros(len(law.A))])
        states, found = closed_loop(self.plant, law).run(z, w, float(t[1]))
        x = states[:, : len(task.x0)]
        finite = np.isfinite(found).all(axis=1) & np.isfinite(states).all(axis=1)
        kept = len(t) if finite.all() else max(int(np.argmin(finite)), 2)
        unsafe = task.first_unsafe(x[:kept])
        kept, stopped = (kept, kept < len(t)) if unsafe is None else (max(unsafe + 1, 2), True)
        y, u = np.split(found[:kept], [n_y], axis=1)
        steps = kept - 1
        return Experiment(
            theta=np.array(theta, dtype=float),
            t=t[:kept],
            x=x[:kept, : len(self.channels.x)],
            u=u,
            t_control=t[:steps],
            u_control=u[:steps],
            y_ref=r[:steps],
            iterations=np.zeros(steps, dtype=int),
            solve_time=np.zeros(steps),
            solved=np.ones(steps, dtype=bool),
            channels=self.channels,
            end=End.UNSAFE if stopped else End.TIME_UP,
            y=y,
        )


def _numbers(what: str, value: Any, n: int) -> Float[np.ndarray, " n"]:
    """Return a number or `n` of them, shape (n,)."""
    try:
        return plant_numbers(what, value, n)
    except PlantError as error:
        raise SettingsError(str(error)) from error
