"""A scenario made of nothing but a plant: its PID is tuned, everything else is found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.decentralized import Decentralized
from prefcal_env.controllers.pid import PID
from prefcal_env.controllers.sampled import sampled
from prefcal_env.knobs.knob import Knob
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.scenario import Scenario

from .pid.design import Design, design
from .pid.knobs import space_of, theta_of
from .pid.kpis import PIDSensitivity
from .pid.steps import plant_of, scenario_of_steps
from .pid.tuning import N, tuned_pids


def pid_scenario(
    plant: Plant,
    *,
    knobs: Sequence[Knob] = (),
    reference: Mapping[str, float] | None = None,
    horizon: float | None = None,
    title: str = "",
    brief: str = "",
) -> Scenario:
    """Make the scenario of tuning a PID for `plant`: all that is not given is found.

    Found are a steady state to start from, the step of the reference, the sampling time, the
    duration, a load on the input in the second half, and ranges around a robust tuning that hold
    those of Skogestad and of Ziegler and Nichols where these rules apply. With several outputs,
    each gets a PID of its own, paired by the relative gain array; the references step one after
    the other.

    The knobs are K_p (without its sign), T_i, T_d and the set-point weight b; with several loops
    they are called K_p_1, T_i_1 and so on.

    Source: see `prefcal_env.controllers.rules` and `own.pid.design.pairs_of`.

    Args:
        plant: Plant, or a linear system that `Plant.of` takes.
        knobs: Knobs that replace those of the same name.
        reference: Reference after the step by output, in its unit; None for the channels' targets,
            or what a fifth of the input's range achieves. Only these outputs are controlled.
        horizon: Duration of an experiment, in the plant's unit of time; None to find it.
        title: Title for headings.
        brief: Description of the task for the person who compares.

    Raises:
        ScenarioError: If there is no steady state, a name does not exist, or no PID stabilizes the
            plant.
        PlantError: If `plant` is neither a plant nor a linear system.
    """
    plant = plant_of(plant, horizon)
    found = design(plant, tuned_pids, reference, horizon)
    space = space_of(found, plant.outputs, plant.time_unit, knobs)
    rows = [loop.output for loop in found.loops]
    columns = [loop.input for loop in found.loops]
    delay = found.delay[np.ix_(rows, columns)]
    model = sampled(found.J.part(rows, columns), found.T_s, delay)
    return scenario_of_steps(
        plant, found, MakePID(found), space, PIDSensitivity(found, model, N), name="pid",
        title=title or f"PID of {plant.name}", references=_references(found, space), brief=brief,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class MakePID:
    """Function of θ that makes the PID, or one for each loop."""

    design: Design

    def __call__(self, theta: Float[np.ndarray, " n"]) -> PID | Decentralized:
        """Return the controller for a physical θ, shape (n,)."""
        rows = np.reshape(np.asarray(theta, dtype=float), (-1, 4)).tolist()
        pids = []
        for (K_p, T_i, T_d, b), loop, tuned in zip(
            rows, self.design.loops, self.design.tunings, strict=True
        ):
            sign, c = float(np.sign(tuned.center.K_p)), loop.channel
            pids.append(
                PID(
                    sign * K_p, T_i, T_d, T_s=self.design.T_s, N=N, b=b, low=c.low, high=c.high,
                    output=loop.output, input=loop.input,
                )
            )  # fmt: skip
        return pids[0] if len(pids) == 1 else Decentralized(pids)


def _references(found: Design, space: Any) -> dict[str, Float[np.ndarray, " n"]]:
    """Return tunings by name: the robust one, and rules that apply to every loop."""
    named = {"robust": [tuned.center for tuned in found.tunings]}
    for name in found.tunings[0].known:
        if all(name in tuned.known for tuned in found.tunings):
            named[name] = [tuned.known[name] for tuned in found.tunings]
    return {name: theta_of(space, tunings) for name, tunings in named.items()}
