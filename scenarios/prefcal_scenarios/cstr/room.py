"""The CSTR as a scenario: the steady-state switch of section IV-A."""

from functools import partial

import gymnasium as gym
import numpy as np
from jaxtyping import Float

from prefcal_env.calibrators import Criterion, LatentCost, Lexicographic
from prefcal_env.envs.cstr import BAND, TARGET, UNSAFE_TEMPERATURE, cstr_env
from prefcal_env.experiment import Channel, Experiment
from prefcal_env.plants import CSTR
from prefcal_env.rollout import rollout
from prefcal_env.tuning import TuningEnv, same_step_vector
from prefcal_scenarios.cstr.indicators import KPIS, indicators, performance_index
from prefcal_scenarios.cstr.tuning import SPACE, controller, settings
from prefcal_scenarios.scenario import Panel, Scenario

_T, _C_A = CSTR.states
PANELS = (
    Panel("x", Channel(_C_A.name, _C_A.unit, target=TARGET, band=BAND, symbol="C_A"), index=1),
    Panel("u", CSTR.inputs[0]),
    Panel("x", Channel(_T.name, _T.unit, high=UNSAFE_TEMPERATURE, symbol="T"), index=0),
)
REFERENCES = {
    "paper, preferences": np.array([0.31, 26.0, -1.79]),
    "paper, automated": np.array([0.25, 26.0, -0.91]),
}


def run(theta: Float[np.ndarray, " 3"], seed: int = 0) -> Experiment:
    """One experiment of θ = (T_s [h], N_p, log10 Q_Δu), shape (3,), physical.

    From the steady state with C_A = 8.56; nothing in it is random.

    Raises:
        KnobError: θ of the wrong shape, NaN or outside the box.
    """
    theta = SPACE.check(theta)
    return rollout(cstr_env(), controller(theta), theta, seed=seed, kpis=indicators)


def synthetic(seed: int = 0) -> LatentCost:
    """Prefers the lower performance index; sure of himself, so `seed` changes nothing."""
    return LatentCost(performance_index, seed=seed)


def lexicographic(seed: int = 0) -> Lexicographic:
    """The paper's guidelines in order: target met, then sooner, then with calmer moves.

    Differences that nobody would see on the plots are ties. Deterministic, whatever the `seed`.
    """
    return Lexicographic(
        [
            Criterion("target missed by", _missed_by, 0.01),
            Criterion("settling time [h]", partial(_kpi, "settling_time"), 0.5),
            Criterion(
                "mean square move [K²]", partial(_kpi, "mean_square_move"), just_noticeable=0.05
            ),
            Criterion("undershoot [kgmol/m³]", partial(_kpi, "undershoot"), 0.02),
        ]
    )


def _missed_by(experiment: Experiment) -> float:
    """Distance of the final C_A from the band around the target, kgmol/m³."""
    return max(abs(float(experiment.x[-1, 1]) - TARGET) - BAND, 0.0)


def _kpi(name: str, experiment: Experiment) -> float:
    return float(experiment.kpis[name])


cstr = Scenario(
    name="cstr",
    title="CSTR steady-state switch",
    space=SPACE,
    run=run,
    cost=performance_index,
    kpis=KPIS,
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": synthetic, "lexicographic": lexicographic},
    controller=controller,
    settings=settings,
)


def make_tuning_env(render_mode: str | None = None) -> TuningEnv:
    """`prefcal/CSTRTuning-v0`: one step is one experiment; reward = -(eq. perf_index)."""
    return TuningEnv(
        SPACE, run, score=performance_index, panels=PANELS, title=cstr.title,
        render_mode=render_mode,
    )  # fmt: skip


def make_tuning_vector(num_envs: int = 1, render_mode: str | None = None) -> gym.vector.VectorEnv:
    """Several of them, without wasted steps (see `same_step_vector`)."""
    return same_step_vector("prefcal/CSTRTuning-v0", num_envs, render_mode=render_mode)
