"""The overtaking scenario of section IV-B, and its words."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import add
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.canvas import makes
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.overtake import Course, OvertakeOptions
from prefcal_env.envs.tuning_env import TuningEnv, same_step_vector, sampled_at
from prefcal_env.errors import SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.knobs import KnobSpace
from prefcal_env.plants.bicycle import KMH
from prefcal_env.sources.source import Function, Varied
from prefcal_env.sources.varied import CHANGE, LEAST, Factor, Values
from prefcal_scenarios.scenario import Panel, Picture, Scenario, described

from .controller import PAPER, SPACE, STEERING_LIMITS, Fixed, controller, settings
from .kpis import KPIS, calibrator, compute_kpis

# --- Describe the overtaking for the person who compares: the task, its knobs and its KPIs.

BRIEF = (
    "A car keeps its lane at 50 km/h, comes up behind a slower one, overtakes it on the left and "
    "returns to its lane, all within 15 s. A model predictive controller (MPC) sets speed and "
    "steering. Each experiment is one simulated drive with other controller settings. Prefer the "
    "drive that you would rather sit in: safe distance beside the other car, no sharp steering, "
    "little swinging before and after, and a controller that is done within its sampling time."
)
_KNOB_WORDS: Mapping[str, str] = {
    "T_s": "Sampling time: how often the controller measures and steers. A short one reacts "
    "sooner, but leaves less time to compute.",
    "ε_c": "Share of the prediction horizon in which the controller plans free moves; after that "
    "it holds them. A larger share plans in more detail and takes longer to compute.",
    "N_p": "Prediction horizon: how many samples the controller looks ahead.",
    "log q_u11": "Weight of changes of speed, as a power of ten. High keeps the speed steady.",
    "log q_u22": "Weight of changes of the steering angle, as a power of ten. High steers gently, "
    "low steers sharply.",
}
_KPI_WORDS: Mapping[str, str] = {
    "t_comp_ratio": "Longest computation of one control step as a share of the sampling time. "
    "Above 1 the controller is too slow to run in real time.",
    "lateral_distance": "Smallest sideways distance between the center lines of the two cars "
    "while they are side by side. The reference is 3 m.",
    "path_peak": "Largest distance from the center of the car's lane; the target while passing is 3 m.",
    "t_comp_worst": "Longest computation of one control step, modeled for one processor.",
    "t_comp_99": "Computation time that 99 % of the steps stay below, modeled in the same way.",
    "collision": "Whether the car touched the other one (1) or not (0).",
    "off_road": "How far the car's body left the road.",
    "clearance": "Smallest gap between the bodies of the two cars, in any direction.",
    "overtaking_time": "From the decision to overtake until the decision to return to the lane.",
    "overshoot": "How far the car swung beyond the target of 3 m while passing.",
    "lane_deviation": "Largest distance from the center of the lane while keeping it.",
    "lane_yaw": "Largest angle between the car and its lane while keeping it.",
    "lateral_acceleration": "Largest sideways acceleration. Passengers notice 2 m/s², and above "
    "about 8 m/s² tires slide.",
    "lateral_acceleration_rms": "Typical sideways acceleration: root of the mean square.",
    "lateral_jerk": "Largest change of the sideways acceleration: jolts that passengers feel.",
    "lateral_jerk_rms": "Typical change of the sideways acceleration: root of the mean square.",
    "speed_error": "Typical difference between speed and the wanted speed.",
    "speed_variation": "Sum of all changes of speed, up and down: small is smooth.",
    "steering": "Largest steering angle.",
    "steering_move": "Largest change of the steering angle from one step to the next.",
    "steering_rate": "Largest speed of the steering.",
    "steering_rate_rms": "Typical speed of the steering: root of the mean square.",
    "unsolved": "Steps at which the controller found no solution of its optimization problem (a "
    "quadratic program, QP) and held speed and steering. 0 is normal.",
}


# --- Define the overtaking scenario, section IV-B.

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


def _source(fixed: Fixed = PAPER, options: OvertakeOptions | None = None) -> Function:
    return Function(partial(run, fixed=fixed, options=options), partial(_varied, fixed, options))


def _varied(fixed: Fixed, options: OvertakeOptions | None, space: KnobSpace = SPACE) -> Varied:
    """Return the car's wheelbase, which the MPC does not know, and where it starts."""
    scene = options or OvertakeOptions()
    factors = (
        Factor.around("wheelbase", "parameter", CHANGE, scene.wheelbase, "m", (LEAST, np.inf)),
        Factor("distance at the start", "task", 0.0, -5.0, 5.0, "m"),
        Factor("start beside the center line", "task", 0.0, -0.3, 0.3, "m"),
        Factor("heading at the start", "task", 0.0, -0.03, 0.03, "rad"),
    )
    said = (
        ("sensors and actuators of the car", "they are ideal here"),
        ("obstacle", "it drives as in the paper"),
    )
    drive = partial(run, fixed=fixed, space=space)
    return Varied(factors, said, partial(_in_scene, drive, scene, factors))


def _in_scene(
    drive: Callable[..., Experiment], scene: OvertakeOptions, factors: Sequence[Factor], values: Values
) -> Function:
    wheelbase, *start = (values.get(factor.name, factor.nominal) for factor in factors)
    x, y, heading = map(add, scene.x0, start)
    return Function(partial(drive, options=replace(scene, x0=(x, y, heading), wheelbase=wheelbase)))


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
        run=_source(fixed, OvertakeOptions.of(scene)),
        controller=partial(controller, fixed=fixed),
        settings=partial(settings, fixed=fixed),
        brief=f"{BRIEF} Road and traffic are those of a configuration.",
    )


overtake = Scenario(
    name="overtake",
    title="Lane keeping and overtaking",
    space=SPACE.described(_KNOB_WORDS),
    run=_source(),
    kpis=described(KPIS, _KPI_WORDS),
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": calibrator},
    controller=controller,
    settings=settings,
    pictures=_pictures,
    brief=BRIEF,
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
