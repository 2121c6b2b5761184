"""Run closed-loop experiments: a controller drives an environment, as a function of θ."""

import time
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ExperimentError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import (
    Channels,
    Controller,
    End,
    Experiment,
    KPIs,
    Measurement,
    Move,
    Record,
)
from prefcal_env.plants.jacobians import U, Y
from prefcal_env.plants.plant import Disturbed
from prefcal_env.sources.source import Function, Source, Varied
from prefcal_env.wording import brief, place_in_code

from .linear_run import linear_run
from .plant_env import PlantEnv
from .task import Task
from .varied_loop import STEP, Moves, VariedLoop, Worn, moves_of


class ClosedLoopEnv(Protocol):
    """The interface that `rollout` needs from an unwrapped environment, such as `PlantEnv`."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode; the option `T_s` is the controller's sampling time."""

    def measurement(self) -> Measurement:
        """Return what a controller knows at this sampling instant."""

    def apply(self, u: Float[np.ndarray, " n_u"]) -> Any:
        """Hold the input `u`, in the plant's units, for one sampling period."""

    @property
    def end(self) -> End | None:
        """Why the episode is over; None while it goes on."""

    def record(self) -> Record:
        """Return the episode so far, with its additional signals."""


def rollout(
    env: gym.Env[Any, Any] | ClosedLoopEnv,
    controller: Controller,
    theta: Float[np.ndarray, " n"],
    *,
    clock: Callable[[], float] = time.perf_counter,
    seed: int = 0,
    kpis: KPIs | None = None,
) -> Experiment:
    """Let `controller` drive `env` until the episode ends, and return the experiment.

    If the controller cannot solve a step, or its input is NaN, the last input is held;
    `Experiment.solved` marks such steps.

    Args:
        env: A `ClosedLoopEnv`, or an environment that is one when unwrapped.
        controller: Controller made from `theta`. Make a new one for each run: it may have a memory.
        theta: Controller parameters, physical, shape (n,), for the record.
        clock: Returns the time in seconds; used only for `Experiment.solve_time`.
        seed: Seed of the episode.
        kpis: Function that returns the key performance indicators of an experiment by name.

    Returns:
        The experiment, even if the run was stopped.

    Raises:
        ExperimentError: If `env` is not a `ClosedLoopEnv`, or `kpis` does not return a mapping.
        SettingsError: If the environment rejects the controller's sampling time, the controller
            has none, or its `move` does not return a `Move`.
        PlantError: If an input has the wrong shape.
    """
    loop: Any = getattr(env, "unwrapped", env)
    missing = [n for n in ("measurement", "apply", "end", "record") if not hasattr(loop, n)]
    if missing:
        raise ExperimentError(f"a rollout needs an environment with {missing}, got {loop!r}")
    # Through the wrappers, which may count or record episodes; the loop itself goes past them.
    env.reset(seed=seed, options={"T_s": _sampling_time(controller)})
    steps = _drive(loop, controller, clock)
    experiment = _experiment(loop.record(), theta, steps)
    return experiment if kpis is None else experiment.with_kpis(kpis)


def _drive(
    loop: ClosedLoopEnv, controller: Controller, clock: Callable[[], float]
) -> list[tuple[int, float, bool]]:
    """Drive `loop` to its end; return iterations, seconds and success of each step."""
    steps: list[tuple[int, float, bool]] = []
    while loop.end is None:
        measurement = loop.measurement()
        # Only the controller's own time: what the plant takes to simulate says nothing of its code.
        start = clock()
        move = controller.move(measurement)
        took = clock() - start
        if not isinstance(move, Move):
            raise SettingsError(
                f"move of controller {type(controller).__name__}{place_in_code(controller.move)} must "
                f"return a prefcal_env.Move, got {brief(move)}: write return Move(u), with u an "
                "array of shape (n_u,)"
            )
        # The plant refuses NaN as a caller's mistake; a controller that failed holds its input instead.
        usable = move.solved and not np.count_nonzero(np.isnan(move.u))
        loop.apply(move.u if usable else measurement.u)
        steps.append((move.iterations, took, usable))
    return steps


def _sampling_time(controller: Controller) -> object:
    T_s: object = getattr(controller, "T_s", None)
    if T_s is None or not callable(getattr(controller, "move", None)):
        raise SettingsError(
            "a controller needs T_s, its sampling time in the plant's unit of time, and "
            f"move(measurement); got {brief(controller)}"
        )
    return T_s


def _experiment(record: Record, theta: object, steps: list[tuple[int, float, bool]]) -> Experiment:
    # An episode has a step at least: no task ends at its start.
    iterations, solve_time, solved = zip(*steps, strict=True)
    return Experiment(
        theta=np.array(theta, dtype=float),
        iterations=np.array(iterations),
        solve_time=np.array(solve_time),
        solved=solved,
        **{field.name: getattr(record, field.name) for field in fields(record)},
    )


EnvSource = gym.Env[Any, Any] | str | Callable[[], gym.Env[Any, Any]]
ControllerFactory = Callable[[Float[np.ndarray, " n"]], Controller]


class ClosedLoop:
    """A `Run` that lets the controller of θ drive a plant environment until the episode ends.

    A linear plant that PIDs control runs compiled (see `linear_run`): then `env` runs no episode.

    Args:
        env: Plant environment, its id, or a function that makes it.
        controller: Function that makes a new controller from a physical θ, shape (n,).
        kpis: Function that returns the key performance indicators of an experiment by name. If they
            depend on plant and task, it has `around(env)`, which returns those of another environment,
            and `targets`, the index and the reference of each output that steps.

    Raises:
        SettingsError: If `env` or `controller` is none of these.
    """

    def __init__(self, env: EnvSource, controller: ControllerFactory, kpis: KPIs | None = None) -> None:
        made = gym.make(env) if isinstance(env, str) else env
        # An environment that can be called is still an environment.
        if callable(made) and not isinstance(made, gym.Env):
            made = made()
        if not isinstance(made, gym.Env):
            raise SettingsError(f"env must be an environment, an id or a factory, got {env!r}")
        if not callable(controller):
            raise SettingsError(f"controller must be a function of θ, got {controller!r}")
        self._env, self.controller, self.kpis = made, controller, kpis

    @property
    def env(self) -> gym.Env[Any, Any]:
        """Environment that the controllers drive, without its wrappers."""
        return self._env.unwrapped

    @property
    def channels(self) -> Channels | None:
        """Channels of the experiments; None if the environment does not define them."""
        # Somebody else's environment may have an attribute of this name that is something else.
        found = getattr(self.env, "channels", None)
        return found if isinstance(found, Channels) else None

    @property
    def signals(self) -> tuple[str, ...] | None:
        """Keys of the experiments' signals; None if the environment does not define them."""
        return getattr(self.env, "signals", None)

    def __call__(self, theta: Float[np.ndarray, " n"], seed: int = 0) -> Experiment:
        """Run a physical θ, shape (n,)."""
        controller = self.controller(theta)
        found = linear_run(self._env, controller, seed)
        if found is None:
            return rollout(self._env, controller, theta, seed=seed, kpis=self.kpis)
        record, solved = found
        experiment = _experiment(record, theta, [(0, 0.0, usable) for usable in solved.tolist()])
        return experiment if self.kpis is None else experiment.with_kpis(self.kpis)

    def varied(self) -> Varied:
        """Return what varies in the loop. Raises ScenarioError if its environment is no `PlantEnv`."""
        env = self.env
        if not isinstance(env, PlantEnv):
            raise ScenarioError(
                "only the loop of a PlantEnv can be varied, since it says its plant and task: "
                f"make its environment one, got {type(env).__name__}"
            )
        plant, task = env.plant, env.task
        # Only KPIs that can be measured around another step let the step vary.
        targets = getattr(self.kpis, "targets", ()) if hasattr(self.kpis, "around") else ()
        moves = moves_of(plant, task, plant.outputs, targets) if targets else Moves()
        said = () if targets else ((STEP, "the KPIs cannot be measured around another step"),)
        jitters = not getattr(plant, "sample_time", 0.0)
        loop = VariedLoop(plant, task, self._built, self.controller, jitters=jitters, moves=moves)
        return loop.varied(*said)

    def _built(self, plant: Disturbed, task: Task, grain: Y, play: U) -> Source:
        def worn(theta: Float[np.ndarray, " n"]) -> Controller:
            return Worn(self.controller(theta), grain, play, plant.inputs)

        env, around = PlantEnv(plant, task), getattr(self.kpis, "around", None)
        kpis = self.kpis if around is None else around(env)
        outputs = list(env.channels.y)
        # A picture of the run draws its own targets; other KPIs may call something else so.
        for i, target in getattr(kpis, "targets", ()) if around else ():
            outputs[i] = replace(outputs[i], target=target)
        env.channels = replace(env.channels, y=tuple(outputs))
        return Function(ClosedLoop(env, worn if grain.any() or play.any() else self.controller, kpis))
