"""The overtaking as a scenario: section IV-B."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import OvertakeEnv
from prefcal_env.experiment import Channel, Experiment
from prefcal_env.overtaking import MIN_LATERAL_DISTANCE
from prefcal_env.plants.bicycle import KMH, Bicycle
from prefcal_env.rollout import rollout
from prefcal_env.tuning import TuningEnv, same_step_vector
from prefcal_scenarios.overtake.criteria import fast, synthetic
from prefcal_scenarios.overtake.indicators import KPIS, indicators
from prefcal_scenarios.overtake.tuning import SPACE, controller, settings
from prefcal_scenarios.scenario import Panel, Scenario

if TYPE_CHECKING:
    from prefcal_scenarios.report.pictures import Picture

_Y = Bicycle.states[1]
PANELS = (
    Panel("x", Channel(_Y.name, _Y.unit, target=MIN_LATERAL_DISTANCE, symbol="y_f"), index=1),
    Panel(
        "u", Channel("speed", "km/h", low=40.0, high=70.0, symbol="v"), scale=1 / KMH,
        reference="speed_reference",
    ),
    Panel(
        "u", Channel("steering angle", "°", low=-45.0, high=45.0, symbol="δ_s"),
        index=1, scale=180 / np.pi,
    ),
)  # fmt: skip
"""On time, in the units of the paper's figures. The target of y_f is that of overtaking."""
REFERENCES = {"paper, preferences": np.array([0.085, 0.31, 16.0, 0.261, 0.918])}


def run(theta: Float[np.ndarray, " 5"], seed: int = 0) -> Experiment:
    """One experiment of θ = (T_s [s], ε_c, N_p, log10 q_u11, log10 q_u22), shape (5,), physical.

    15 s of the paper's scene; nothing in it is random.

    Raises:
        KnobError: θ of the wrong shape, NaN or outside the box.
    """
    theta = SPACE.check(theta)
    return rollout(OvertakeEnv(), controller(theta), theta, seed=seed, kpis=indicators)


def _pictures() -> "Sequence[Picture]":
    from prefcal_scenarios.overtake.pictures import PICTURES  # loads the plots

    return PICTURES


def _animated(experiment: Experiment) -> dict[str, object]:
    from prefcal_scenarios.overtake.player import scene  # loads the plots

    return scene(experiment)


overtake = Scenario(
    name="overtake",
    title="Lane keeping and overtaking",
    space=SPACE,
    run=run,
    kpis=KPIS,
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": synthetic, "fast-processor": fast},
    controller=controller,
    settings=settings,
    pictures=_pictures,
    scene=_animated,
)
"""No single score exists: there is no cost."""


def make_tuning_env(render_mode: str | None = None) -> TuningEnv:
    """`prefcal/OvertakeTuning-v0`: one step is one experiment; the reward is 0, there is no score.

    `PreferenceReward` with a calibrator of the scenario makes rewards of preferences.
    """
    return TuningEnv(SPACE, run, panels=PANELS, title=overtake.title, render_mode=render_mode)


def make_tuning_vector(num_envs: int = 1, render_mode: str | None = None) -> gym.vector.VectorEnv:
    """Several of them, without wasted steps (see `same_step_vector`)."""
    return same_step_vector("prefcal/OvertakeTuning-v0", num_envs, render_mode=render_mode)
