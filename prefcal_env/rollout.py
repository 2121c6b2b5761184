"""One closed-loop experiment: an environment, a controller, and what they leave behind."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.control import Controller, Measurement
from prefcal_env.envs.trajectory import Record
from prefcal_env.errors import ExperimentError
from prefcal_env.experiment import End, Experiment

KPIs = Callable[[Experiment], Mapping[str, float]]


class ClosedLoopEnv(Protocol):
    """What the unwrapped environment must offer; `PlantEnv` does.

    `reset(seed=..., options={"T_s": ...})` starts an episode with the controller's sampling time.
    """

    def measurement(self) -> Measurement:
        """What a controller knows at this sampling instant."""

    def apply(self, u: Float[np.ndarray, " n_u"]) -> Any:
        """Hold the input `u`, in the plant's units, for one sampling period."""

    @property
    def end(self) -> End | None:
        """Why the episode is over; None while it goes on."""

    def record(self) -> Record:
        """The episode so far, and its further signals."""


def rollout(
    env: gym.Env[Any, Any],
    controller: Controller,
    theta: Float[np.ndarray, " n"],
    *,
    clock: Callable[[], float] = time.perf_counter,
    seed: int = 0,
    kpis: KPIs | None = None,
) -> Experiment:
    """Let `controller` drive `env` until the episode ends.

    A step that the controller could not solve, or whose input is NaN, holds the last input; it
    is marked in `Experiment.solved`.

    Args:
        env: Its unwrapped environment is a `ClosedLoopEnv`.
        controller: Made from `theta`; fresh, since it may have a memory.
        theta: Controller parameters, physical, shape (n,), for the record.
        clock: Seconds; only `Experiment.solve_time` sees it.
        seed: Of the episode.
        kpis: Key performance indicators of the experiment by name.

    Returns:
        The experiment, also of a run that was stopped.

    Raises:
        ExperimentError: `env` is no `ClosedLoopEnv`.
        SettingsError: the environment does not accept the controller's sampling time.
        PlantError: an input of the wrong shape.
    """
    loop: Any = env.unwrapped
    missing = [n for n in ("measurement", "apply", "end", "record") if not hasattr(loop, n)]
    if missing:
        raise ExperimentError(f"a rollout needs an environment with {missing}, got {loop!r}")
    env.reset(seed=seed, options={"T_s": controller.T_s})
    steps: list[tuple[int, float, bool]] = []
    while loop.end is None:
        measurement = loop.measurement()
        start = clock()
        move = controller.move(measurement)
        took = clock() - start
        usable = move.solved and not np.any(np.isnan(move.u))
        loop.apply(move.u if usable else measurement.u)
        steps.append((move.iterations, took, usable))
    experiment = _experiment(loop.record(), theta, steps)
    return experiment if kpis is None else replace(experiment, kpis=kpis(experiment))


def _experiment(record: Record, theta: object, steps: list[tuple[int, float, bool]]) -> Experiment:
    assert record.end is not None
    iterations, solve_time, solved = zip(*steps, strict=True)
    return Experiment(
        theta=np.array(theta, dtype=float),
        t=record.t, x=record.x, u=record.u,
        t_control=record.t_control, u_control=record.u_control, y_ref=record.y_ref,
        iterations=np.array(iterations), solve_time=np.array(solve_time), solved=solved,
        channels=record.channels, end=record.end, signals=record.signals,
    )  # fmt: skip
