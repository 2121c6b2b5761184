"""Define the overtaking scenario, section IV-B."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.canvas import makes
from prefcal_env.envs.overtake import Course, OvertakeOptions
from prefcal_env.envs.tuning_env import TuningEnv, same_step_vector, sampled_at
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.bicycle import KMH
from prefcal_scenarios.scenario import Panel, Picture, Scenario, described

from . import wording as words
from .controller import PAPER, SPACE, STEERING_LIMITS, Fixed, controller, settings
from .criteria import calibrator
from .kpis import KPIS, compute_kpis

PANELS = (
    Panel("lateral position", reference="lateral_reference"),
    Panel(
        "speed",
        unit="km/h",
        low=40.0,
        high=70.0,
        scale=1 / KMH,
        reference="speed_reference",
        low_signal="speed_low",
    ),
    Panel("steering angle", unit="°", low=-45.0, high=45.0, scale=180 / np.pi),
)
"""Panels over time, in the units of the paper's figures, with references and limits."""
REFERENCES = {"paper, preferences": np.array([0.085, 0.31, 16.0, 0.261, 0.918])}


def run(
    theta: Float[np.ndarray, " 5"],
    seed: int = 0,
    fixed: Fixed = PAPER,
    options: OvertakeOptions | None = None,
    space: KnobSpace = SPACE,
) -> Experiment:
    """Run one experiment of θ = (T_s [s], ε_c, N_p, log10 q_u11, log10 q_u22), shape (5,).

    It is 15 s of the paper's scene, or that of `options`; θ is physical, in `space`. The seed
    determines the drivers, if there are any.

    Raises:
        KnobError: If θ has the wrong shape, is NaN, or is outside the box.
    """
    theta = space.check(theta)
    driver = controller(theta, fixed, space)
    return rollout(Course(options), driver, theta, seed=seed, kpis=compute_kpis)


def _pictures() -> Sequence[Picture]:
    from .picture import PICTURE  # loads the plots

    return (PICTURE,)


def _configured(config: Mapping[str, Any]) -> Scenario:
    """Return the overtaking with the scene of `OvertakeOptions.of`, and a "steering_limit".

    Raises:
        SettingsError: If a key is unknown or a value has the wrong type.
    """
    scene = dict(config)
    limit = scene.pop("steering_limit", "per second")
    if limit not in STEERING_LIMITS:
        raise SettingsError(f"steering_limit must be one of {sorted(STEERING_LIMITS)}, got {limit!r}")
    fixed = STEERING_LIMITS[limit]
    return replace(
        overtake,
        run=partial(run, fixed=fixed, options=OvertakeOptions.of(scene)),
        controller=partial(controller, fixed=fixed),
        settings=partial(settings, fixed=fixed),
        brief=words.CONFIGURED,
    )


overtake = Scenario(
    name="overtake",
    title="Lane keeping and overtaking",
    space=SPACE.described(words.KNOBS),
    run=run,
    kpis=described(KPIS, words.KPIS),
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": calibrator},
    controller=controller,
    settings=settings,
    pictures=_pictures,
    brief=words.BRIEF,
    configured=_configured,
    simulated=True,
)
"""The scenario has no cost, since there is no single score."""


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
        config: Scene, as in `prefcal/Overtake-v0`, and the study's "steering_limit".
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
        sampled_at(SPACE, T_s), scenario.run, panels=PANELS, title=overtake.title, render_mode=render_mode
    )


make_tuning_vector = partial(same_step_vector, "prefcal/OvertakeTuning-v0")
"""Create several tuning environments as a vector without wasted steps (`same_step_vector`)."""
