"""A run of a plant with a linear controller, or with any other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.experiment import Channels, End, Experiment, KPIs
from prefcal_env.experiments.rollout import rollout
from prefcal_env.experiments.tracking import tracking_kpis
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.plant import Plant
from prefcal_env.plants.systems import LinearPlant, system_of
from prefcal_env.plants.systems.linear import numbers

from .dead_time import dead_times
from .lti_controller import Law, LTIController, closed_loop, law_of
from .plant_env import PlantEnv
from .task import Task

Reference = float | Sequence[float] | Mapping[str, float] | np.ndarray | Callable[[float], Any]
_INSTANTS = 501
"""Instants of a record: as many as of a `PlantEnv` by default."""
_SAMPLES = 1000
"""Samples of a run in which a continuous controller has to be sampled."""


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
        self.space = _space(knobs)
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
                return self._finished(self._exact(theta, law))
            controller = LTIController(law.sampled(self._sampling_time()))
        found = rollout(self._env, controller, theta, seed=seed)
        return self._finished(replace(found, x=found.x[:, : len(self.channels.x)], channels=self.channels))

    def _finished(self, experiment: Experiment) -> Experiment:
        return experiment.with_kpis(self.kpis)

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

    def _sampling_time(self) -> float:
        own = self._T_s or float(getattr(self.plant, "sample_time", 0.0))
        return own or self._env.task.horizon / _SAMPLES

    def _is_exact(self, law: Law) -> bool:
        plant = self.plant
        limits = [limit for c in plant.inputs for limit in (c.low, c.high)]
        return (
            isinstance(plant, LinearPlant)
            and not (law.dt or plant.sample_time or self._T_s or np.isfinite(limits).any())
            and not dead_times(plant).any()
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
        return numbers(what, value, n)
    except PlantError as error:
        raise SettingsError(str(error)) from error


def _space(knobs: Sequence[Knob] | KnobSpace) -> KnobSpace | None:
    if isinstance(knobs, KnobSpace):
        return knobs
    return KnobSpace(list(knobs)) if knobs else None
