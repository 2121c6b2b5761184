"""Define the CSTR scenario: the steady-state switch of section IV-A."""

from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.calibrators import Criterion, LatentCost, Lexicographic
from prefcal_env.envs.canvas import makes
from prefcal_env.envs.cstr import BAND, TARGET, UNSAFE_TEMPERATURE, cstr_env
from prefcal_env.envs.tuning_env import TuningEnv, same_step_vector, sampled_at
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.plants.cstr import CSTR
from prefcal_scenarios.scenario import Panel, Scenario, described

from . import wording as words
from .controller import SPACE, controller, settings
from .kpis import KPIS, compute_kpis, performance_index

PANELS = (
    Panel("concentration", target=TARGET, band=BAND),
    Panel("coolant temperature"),
    Panel("temperature", high=UNSAFE_TEMPERATURE),
)
REFERENCES = {
    "paper, preferences": np.array([0.31, 26.0, -1.79]),
    "paper, automated": np.array([0.25, 26.0, -0.91]),
}


def run(
    theta: Float[np.ndarray, " 3"], seed: int = 0, space: KnobSpace = SPACE, **options: Any
) -> Experiment:
    """Run one experiment of θ = (T_s [h], N_p, log10 Q_Δu), shape (3,), physical, in `space`.

    It starts at the steady state with C_A = 8.56 and is deterministic. Options are those of
    `cstr_env`.

    Raises:
        KnobError: If θ has the wrong shape, is NaN, or is outside the box.
    """
    theta = space.check(theta)
    loop = cstr_env(**options)
    return rollout(loop, controller(theta, space=space), theta, seed=seed, kpis=compute_kpis)


def synthetic(seed: int = 0) -> LatentCost:
    """Return a calibrator that prefers the lower performance index, whatever the `seed`."""
    return LatentCost(performance_index, seed=seed)


def lexicographic(seed: int = 0) -> Lexicographic:
    """Return a calibrator with the paper's guidelines in order: target, speed, calm moves.

    Differences that are invisible in the plots are ties. Deterministic, whatever the `seed`.
    """
    return Lexicographic(
        [
            Criterion("target missed by", _missed_by, 0.01),
            Criterion("time to steady state t_f [h]", partial(_kpi, "settling_time"), 0.5),
            Criterion("mean square move [K²]", partial(_kpi, "mean_square_move"), just_noticeable=0.05),
            Criterion("undershoot [kgmol/m³]", partial(_kpi, "undershoot"), 0.02),
        ]
    )


def _missed_by(experiment: Experiment) -> float:
    """Return the distance of the final C_A from the band around the target, kgmol/m³."""
    return max(abs(float(experiment.x[-1, 1]) - TARGET) - BAND, 0.0)


def _kpi(name: str, experiment: Experiment) -> float:
    return float(experiment.kpis[name])


cstr = Scenario(
    name="cstr",
    title="CSTR steady-state switch",
    space=SPACE.described(words.KNOBS),
    run=run,
    cost=performance_index,
    kpis=described(KPIS, words.KPIS),
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": synthetic, "lexicographic": lexicographic},
    controller=controller,
    settings=settings,
    brief=words.BRIEF,
    simulated=True,
)


@makes(TuningEnv)
def make_tuning_env(
    *,
    T_s: float | None = None,
    x0: Any = None,
    max_move: float | None = None,
    plant: CSTR | None = None,
    render_mode: str | None = None,
) -> TuningEnv:
    """Create `prefcal/CSTRTuning-v0`: one step is one experiment; reward = -(eq. perf_index).

    Args:
        T_s: Fixed sampling time of θ [h], if given.
        x0: Initial state of every experiment, see `cstr_env`.
        max_move: Largest move of the input, see `cstr_env`.
        plant: Plant of every experiment, see `cstr_env`; the MPC keeps its own model.
        render_mode: None or "rgb_array".
    """
    options = {"x0": x0, "max_move": max_move, "plant": plant}
    cstr_env(**options)  # fail on wrong options now, not in the first experiment
    return TuningEnv(
        sampled_at(SPACE, T_s),
        partial(run, **options),
        score=performance_index,
        panels=PANELS,
        title=cstr.title,
        render_mode=render_mode,
    )


make_tuning_vector = partial(same_step_vector, "prefcal/CSTRTuning-v0")
"""Create several tuning environments as a vector without wasted steps (`same_step_vector`)."""
