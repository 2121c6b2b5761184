"""The stability margins of a scenario's tuning, where its loop is known."""

from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.margins import Margins, margins, margins_at
from prefcal_env.errors import PlantError, SettingsError
from prefcal_env.experiments.control import Controller, Measurement, Move
from prefcal_env.jit import kernel
from prefcal_scenarios.cases.loops._laws import MEMORY, decide
from prefcal_scenarios.cases.loops.controllers import Gains
from prefcal_scenarios.cases.loops.loop import Loop
from prefcal_scenarios.scenario import Scenario

from .loops import LoopSubject
from .plants import PlantSubject
from .subject import Subject


@kernel()
def _act(law, gains, reference, y, memory, T_s, u):  # type: ignore[no-untyped-def]
    """Write the inputs that a compiled law decides to `u`."""
    decide(law, gains, reference, y, memory, T_s, u)


class LawController:
    """A compiled law as a `Controller`.

    Args:
        gains: Law and its gains.
        T_s: Sampling time, in the plant's unit of time.
    """

    def __init__(self, gains: Gains, T_s: float) -> None:
        self._gains, self.T_s = gains, T_s
        self._memory = np.zeros((len(gains.rows), MEMORY))

    def move(self, measurement: Measurement) -> Move:
        """Decide the inputs from the measured outputs."""
        u, y = np.array(measurement.u, dtype=float), np.array(measurement.y, dtype=float)
        r = np.array(measurement.y_ref, dtype=float)
        _act(self._gains.law, np.array(self._gains.rows), r, y, self._memory, float(self.T_s), u)
        return Move(u)


def robustness(scenario: Scenario, subject: Subject, theta: Float[np.ndarray, " n"]) -> Margins | str:
    """Return the margins of a physical θ, shape (n,), where its experiments start, or why not.

    Args:
        scenario: Scenario.
        subject: What of it varies, which knows the loop.
        theta: Tuning.
    """
    try:
        if isinstance(subject, PlantSubject):
            return margins_at(subject.loop, theta)
        if isinstance(subject, LoopSubject):
            return _of_loop(subject.loop, theta)
    except (SettingsError, PlantError) as error:
        return f"no margins: {error}"
    return f"no margins: no plant of scenario {scenario.name!r} is known that could be linearized"


def _of_loop(loop: Loop, theta: Float[np.ndarray, " n"]) -> Margins | str:
    """Return the margins of a loop that comes with prefcal."""
    plant, task, values = loop.plant, loop.task, dict(zip(loop.space.names, theta.tolist(), strict=True))
    if loop.staged:
        return "no margins: an input in stages has no linear law"
    T_s = values.get("T_s", task.T_s) * values.get("every", 1.0)
    T_s = max(round(T_s / plant.max_step), 1) * plant.max_step
    make = partial(_controller, loop, values, T_s)
    d = task.disturbance(0.0)
    return margins(plant, make, task.x0, task.u0, d)


def _controller(loop: Loop, values: dict[str, float], T_s: float) -> Controller:
    made = loop.controller.make(values, loop.plant, loop.task, T_s)
    return LawController(made, T_s) if isinstance(made, Gains) else made
