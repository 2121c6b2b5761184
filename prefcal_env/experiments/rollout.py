"""One closed-loop experiment: an environment, a controller, and what they leave behind."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ExperimentError, SettingsError

from .control import Controller, Measurement, Move
from .experiment import End, Experiment
from .trajectory import Record

KPIs = Callable[[Experiment], Mapping[str, float]]


class ClosedLoopEnv(Protocol):
    """What an environment, unwrapped, must offer; `PlantEnv` does, and `Course`, which is none."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode; the option `T_s` is the controller's sampling time."""

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
    env: gym.Env[Any, Any] | ClosedLoopEnv,
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
        env: A `ClosedLoopEnv`, or an environment that is one when unwrapped.
        controller: Made from `theta`; fresh, since it may have a memory.
        theta: Controller parameters, physical, shape (n,), for the record.
        clock: Seconds; only `Experiment.solve_time` sees it.
        seed: Of the episode.
        kpis: Key performance indicators of the experiment by name.

    Returns:
        The experiment, also of a run that was stopped.

    Raises:
        ExperimentError: `env` is no `ClosedLoopEnv`, or `kpis` returns no mapping.
        SettingsError: the environment does not accept the controller's sampling time, the
            controller has none, or its `move` returns no `Move`.
        PlantError: an input of the wrong shape.
    """
    loop: Any = getattr(env, "unwrapped", env)
    missing = [n for n in ("measurement", "apply", "end", "record") if not hasattr(loop, n)]
    if missing:
        raise ExperimentError(f"a rollout needs an environment with {missing}, got {loop!r}")
    env.reset(seed=seed, options={"T_s": _sampling_time(controller)})
    steps: list[tuple[int, float, bool]] = []
    while loop.end is None:
        measurement = loop.measurement()
        start = clock()
        move = controller.move(measurement)
        took = clock() - start
        if not isinstance(move, Move):
            raise SettingsError(
                f"move of controller {type(controller).__name__}{_place(controller.move)} must "
                f"return a prefcal_env.Move, got {_what(move)}: write return Move(u), with u an "
                "array of shape (n_u,)"
            )
        usable = move.solved and not np.any(np.isnan(move.u))
        loop.apply(move.u if usable else measurement.u)
        steps.append((move.iterations, took, usable))
    experiment = _experiment(loop.record(), theta, steps)
    return experiment if kpis is None else replace(experiment, kpis=computed(kpis, experiment))


def computed(kpis: KPIs, experiment: Experiment) -> Mapping[str, float]:
    """Return `kpis(experiment)`. Raises ExperimentError if that is no mapping."""
    found: object = kpis(experiment)
    if not isinstance(found, Mapping):
        forgotten = ": is a return missing?" if found is None else ""
        raise ExperimentError(
            f"{getattr(kpis, '__name__', 'kpis')}{_place(kpis)} must return a mapping of KPI names "
            f"to numbers, got {_what(found)}{forgotten}"
        )
    return found


def _sampling_time(controller: Controller) -> object:
    T_s: object = getattr(controller, "T_s", None)
    if T_s is None or not callable(getattr(controller, "move", None)):
        raise SettingsError(
            "a controller needs T_s, its sampling time in the plant's unit of time, and "
            f"move(measurement); got {_what(controller)}"
        )
    return T_s


def _place(function: object) -> str:
    """Where a function is written, " (own.py:12)"; nothing of one that Python does not tell."""
    code = getattr(function, "__code__", None)
    return "" if code is None else f" ({Path(code.co_filename).name}:{code.co_firstlineno})"


def _what(value: object) -> str:
    return "None" if value is None else f"{type(value).__name__} {value!r:.60}"


def _experiment(record: Record, theta: object, steps: list[tuple[int, float, bool]]) -> Experiment:
    assert record.end is not None
    iterations, solve_time, solved = zip(*steps, strict=True)
    return Experiment(
        theta=np.array(theta, dtype=float),
        t=record.t, x=record.x, u=record.u,
        t_control=record.t_control, u_control=record.u_control, y_ref=record.y_ref,
        iterations=np.array(iterations), solve_time=np.array(solve_time), solved=solved,
        channels=record.channels, end=record.end, signals=record.signals, y=record.y,
    )  # fmt: skip
