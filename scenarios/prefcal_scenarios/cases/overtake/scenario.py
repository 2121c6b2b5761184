"""Define the overtaking scenario, section IV-B."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake import Course
from prefcal_env.envs.rendering import makes
from prefcal_env.envs.tuning_env import TuningEnv, same_step_vector, sampled_at
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.mpc.computation import Processor
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.cases.overtake.pictures.drawing import animation
from prefcal_scenarios.scenario import Panel, Picture, Scenario, described

from . import wording as words
from .configured import configured
from .controller import SPACE, controller, settings
from .criteria import fast, synthetic
from .kpis import KPIS, compute_kpis
from .target import on_target

PANELS = (
    Panel("lateral position", reference="lateral_reference"),
    Panel(
        "speed", unit="km/h", low=40.0, high=70.0, scale=1 / KMH,
        reference="speed_reference", low_signal="speed_low",
    ),
    Panel("steering angle", unit="°", low=-45.0, high=45.0, scale=180 / np.pi),
)  # fmt: skip
"""Panels over time, in the units of the paper's figures, with references and limits."""
REFERENCES = {"paper, preferences": np.array([0.085, 0.31, 16.0, 0.261, 0.918])}


def run(theta: Float[np.ndarray, " 5"], seed: int = 0, space: KnobSpace = SPACE) -> Experiment:
    """Run one experiment of θ = (T_s [s], ε_c, N_p, log10 q_u11, log10 q_u22), shape (5,).

    It is 15 s of the paper's scene and deterministic; θ is physical, in `space`.

    Raises:
        KnobError: If θ has the wrong shape, is NaN, or is outside the box.
    """
    theta = space.check(theta)
    driver = controller(theta, space=space)
    return rollout(Course(), driver, theta, seed=seed, kpis=compute_kpis)


def _pictures() -> Sequence[Picture]:
    from prefcal_scenarios.cases.overtake.pictures.pictures import PICTURES  # loads the plots

    return PICTURES


def _configured(config: Mapping[str, Any]) -> Scenario:
    return configured(overtake, None, 1, config)


overtake = Scenario(
    name="overtake",
    title="Lane keeping and overtaking",
    space=SPACE.described(words.KNOBS),
    run=run,
    kpis=described(KPIS, words.KPIS),
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": synthetic, "fast-processor": fast},
    controller=controller,
    settings=settings,
    pictures=_pictures,
    scene=animation,
    brief=words.BRIEF,
    configured=_configured,
    on_processor=on_target,
    simulated=True,
)
"""The scenario has no cost, since there is no single score."""


def overtake_on(processor: Processor) -> Scenario:
    """Return the overtaking with criterion (i) judged on `processor`."""
    return on_target(overtake, processor)


@makes(TuningEnv)
def make_tuning_env(
    config: Mapping[str, Any] | None = None,
    *,
    T_s: float | None = None,
    x0: Any = None,
    render_mode: str | None = None,
) -> TuningEnv:
    """Create `prefcal/OvertakeTuning-v0`: one step is one experiment; the reward is always 0.

    `PreferenceReward` with a calibrator of the scenario turns preferences into rewards.

    Args:
        config: Scene, as in `prefcal/Overtake-v0`, and the study's "scenes" and "steering_limit".
        T_s: Fixed sampling time of θ [s], if given.
        x0: Pose (x_f, y_f [m], θ [rad]) at the start of every experiment.
        render_mode: None or "rgb_array".

    Raises:
        SettingsError: If the configuration is no dict or not valid.
    """
    if not isinstance(config, Mapping | None):
        raise SettingsError(f"config must be a dict, got {config!r}")
    changes = dict(config or {}) if x0 is None else dict(config or {}, x0=x0)
    scenario = _configured(changes) if changes else overtake
    return TuningEnv(
        sampled_at(SPACE, T_s), scenario.run, panels=PANELS, title=overtake.title,
        render_mode=render_mode,
    )  # fmt: skip


def make_tuning_vector(num_envs: int = 1, **options: Any) -> gym.vector.VectorEnv:
    """Create several tuning environments as a vector without wasted steps (`same_step_vector`)."""
    return same_step_vector("prefcal/OvertakeTuning-v0", num_envs, **options)
