"""`prefcal/CSTR-v0`: the reactor of section IV-A as an environment."""

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.arrays import plant_vector
from prefcal_env.errors import SettingsError
from prefcal_env.plants.cstr import CSTR, FEED

from .canvas import makes
from .plant_env import PlantEnv
from .task import Period, Task

START = 8.56  # C_A of the steady state at which every experiment starts, kgmol/m³
TARGET = 2.0  # desired C_A, kgmol/m³
BAND = 0.03 * TARGET  # accepted distance from `TARGET` (AR% of eq. perf_index), kgmol/m³
HORIZON = 48.0  # duration of an experiment, two days (t_f,max of eq. perf_index), h
MAX_MOVE = 10.0  # largest change of T_c from one step to the next (T_c,max), K; controllers must respect it
UNSAFE_TEMPERATURE = 400.0
"""Temperature above which the experiment is stopped, K; reasonable runs peak at 383 K."""
SETTLED_RATES = (0.04, 0.004, 0.04)
"""Rates of T, C_A and T_c below which the plant is settled: K/h, kgmol/(m³ h), K/h."""


def unsafe(x: Float[np.ndarray, "2 ..."]) -> Any:
    """Return whether the reactor is hotter than `UNSAFE_TEMPERATURE`, in one state or in each."""
    return x[0] > UNSAFE_TEMPERATURE


def settled(step: Period) -> bool:
    """Return whether C_A is inside the band and nothing changes between the last two samples.

    Source: "the steady-state condition is reached", section IV-A, which gives no rule.
    Deviation: the rates in `SETTLED_RATES` are ours, and they matter: if they are twice as large,
    the lowest index is elsewhere (docs/deviations.md). A run that never leaves its start is outside
    the band: not settled.
    """
    (T_before, C_A_before), (T, C_A) = step.x[0].tolist(), step.x[-1].tolist()
    # So written, NaN is not settled.
    if not abs(C_A - TARGET) <= BAND:
        return False
    changes = T - T_before, C_A - C_A_before, float(step.u[0] - step.u_before[0])
    return all(abs(c) / step.T_s < rate for c, rate in zip(changes, SETTLED_RATES, strict=True))


def stage_cost(step: Period) -> float:
    """Return the cost rate of tracking and moves, 1/h.

    It is ((C_A - 2)/6.56)², averaged over the step, + 0.1 |ΔT_c|/(10 K T_s). The first term is 1
    at the start and 0 at the target. The second adds up to 0.1 for every 10 K of travel of T_c,
    however many steps it takes, so totals do not depend on T_s.
    """
    error = ((step.x[:, 1] - TARGET) / (START - TARGET)) ** 2
    # A run that was unsafe at once has a period of a single instant.
    tracking = np.trapezoid(error, step.t) / step.duration if step.duration > 0 else error[0]
    move = abs(step.u[0] - step.u_before[0]) / (MAX_MOVE * step.T_s)
    return float(tracking + 0.1 * move)


@lru_cache(maxsize=8)
def cstr_task(plant: CSTR | None = None) -> Task:
    """Return the task: from the steady state with C_A = 8.56 to C_A = 2 kgmol/m³ within 48 h.

    The feed is constant. The reference of T is its value at the target; it is neither tracked nor
    observed. The rate limit of 10 K per step is a rule for controllers (it counts steps, while an
    actuator counts hours), so the plant does not enforce it.
    """
    plant = plant or CSTR()
    x0, u0 = plant.steady_state_at_concentration(START)
    # The reactor's own, so that one with other parameters has another T at the target.
    target, _ = plant.steady_state_at_concentration(TARGET)
    return Task(
        x0=x0,
        u0=u0,
        y_ref=target,
        d=FEED,
        horizon=HORIZON,
        T_s=0.25,
        T_s_range=(0.01, 6.0),
        dense_step=0.05,
        tracked=(1,),
        bands={1: BAND},
        # T, C_A, last T_c, reference of C_A, T_f, C_Af
        observed=np.array([(280, 400), (0, 10), (284, 310), (0, 10), (280, 320), (5, 15)]),
        unsafe=unsafe,
        vectorized=True,
        settled=settled,
        stage_cost=stage_cost,
        unsafe_cost=10.0,  # the stage cost of reasonable states is below 2
    )


@makes(PlantEnv)
def cstr_env(
    *,
    T_s: float | None = None,
    x0: Any = None,
    max_move: float | None = None,
    plant: CSTR | None = None,
    render_mode: str | None = None,
) -> PlantEnv:
    """Make `prefcal/CSTR-v0`: the reactor, controlled by its coolant temperature.

    The action is T_c; the observation is (T, C_A, last T_c, reference, T_f, C_Af). The episode
    ends as unsafe above 400 K, at the first sample at or after 48 h, or when `settled`. The reward
    is minus `stage_cost` times T_s.

    Args:
        T_s: Default sampling time [h], which `reset` may override; None means 0.25 h.
        x0: Initial (T [K], C_A [kgmol/m³]), shape (2,); None is the steady state with C_A = 8.56.
        max_move: Largest change of T_c in one step that the environment applies, K (the paper's
            controllers keep to 10); None for no limit.
        plant: Reactor, for example with other parameters.
        render_mode: None or "rgb_array".

    Raises:
        SettingsError: If the sampling time is out of range, or `max_move` or `plant` is none.
        PlantError: If `x0` has the wrong shape or is not finite.
    """
    if not isinstance(plant, CSTR | None):
        raise SettingsError(f"plant must be a CSTR or None, got {plant!r}")
    plant = plant or CSTR()
    task = cstr_task(plant)
    if T_s is not None:
        task = replace(task, T_s=T_s)
    if x0 is not None:
        task = replace(task, x0=plant_vector(x0, 2, "initial state x0"))
    if max_move is not None:
        # The task is cached for all reactors alike: it is replaced, never changed.
        task = replace(task, max_move=np.array([max_move]))
    # A subclass may measure something else.
    return PlantEnv(plant, task, render_mode, outputs_are_states=type(plant).g is CSTR.g)
