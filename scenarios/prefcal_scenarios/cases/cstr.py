"""The reactor of section IV-A: its MPC, its KPIs with the paper's index, and the scenario."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import inf
from typing import Any

import numpy as np
from jaxtyping import Float

from prefcal_env.calibrators import Criterion, LatentCost, Lexicographic
from prefcal_env.envs.canvas import makes
from prefcal_env.envs.closed_loop import ClosedLoop, rollout
from prefcal_env.envs.cstr import BAND, HORIZON, MAX_MOVE, START, TARGET, UNSAFE_TEMPERATURE, cstr_env
from prefcal_env.envs.tuning_env import TuningEnv, same_step_vector, sampled_at
from prefcal_env.experiments.experiment import Controller, End, Experiment
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.mpc import EstimatingMPC, EstimatorSettings, LinearMPC, MPCSettings, control_horizon
from prefcal_env.plants.cstr import CSTR
from prefcal_env.sources.source import Function, Varied
from prefcal_env.sources.varied import within
from prefcal_scenarios.scenario import KPI, Panel, Scenario, described

# --- Describe the reactor for the person who compares: the task, its knobs and its KPIs.

BRIEF = (
    "A stirred-tank reactor is brought from a concentration C_A of 8.56 kgmol/m³ down to 2 "
    "kgmol/m³. A model predictive controller (MPC) does it by moving the coolant temperature T_c. "
    "Each experiment is one simulated run with other controller settings. Prefer the run that you "
    "would rather have on your plant: it reaches its target soon, without swings, with calm "
    "moves of the coolant. A run ends once the reactor has reached its new steady state, so a "
    "curve may end at 16 h; one that never settles lasts 48 h."
)
_KNOB_WORDS: Mapping[str, str] = {
    "T_s": "Sampling time: how often the controller measures and moves the coolant. A short one "
    "reacts sooner; a long one makes few, coarse moves.",
    "N_p": "Prediction horizon: how many samples the controller looks ahead. A short one is "
    "nearsighted and may never reach the target.",
    "log Q_Δu": "Weight of the coolant's moves, as a power of ten. A low one moves boldly, a "
    "high one gently, and takes longer.",
}
_KPI_WORDS: Mapping[str, str] = {
    "settling_time": "When the run ended at its new steady state: C_A within ±3 % of the target "
    "and hardly any change. “Never” if that did not happen within 48 h.",
    "final_concentration": "C_A at the end of the run. The target is 2, within ±3 %.",
    "largest_move": "Largest change of the coolant temperature from one sample to the next; the "
    "controller may use up to 10 K.",
    "mean_square_move": "Mean of the squared coolant moves: small means calm control.",
    "peak_temperature": "Highest temperature in the reactor. Above 400 K a run is stopped as unsafe.",
    "undershoot": "How far C_A fell below its target of 2 on the way.",
    "band_entry": "When C_A entered the ±3 % band around its target for good.",
    "index": "The paper's score: duration, moves and final error in one number, lower is better. "
    "You need not agree with it.",
    "unsolved": "Steps at which the controller found no solution of its optimization problem (a "
    "quadratic program, QP) and held the coolant where it was. 0 is normal.",
}


# --- Define the knobs of the CSTR's MPC, and build the controller of a θ (section IV-A).

SPACE = KnobSpace(
    [Knob("T_s", 0.25, 1.5, "h"), Knob("N_p", 4, 40, integer=True), Knob("log Q_Δu", -5.0, 3.0)]
)
"""The logarithm itself is the knob.

Deviation: base 10; the paper states no base. With base 10 the lowest index lies where the paper's
GLIS found it, with base e it does not (docs/deviations.md).
"""


def mpc_settings(theta: Float[np.ndarray, " 3"], space: KnobSpace = SPACE) -> MPCSettings:
    """Return the MPC settings at θ = (T_s [h], N_p, log10 Q_Δu); the paper fixes all others.

    Only C_A is tracked (Q_y = diag(0, 1)), N_u = N_p/3 rounded half up, T_c in [284, 310] K with
    moves of at most 10 K; no limits on outputs.

    Raises:
        KnobError: If θ has the wrong shape, is NaN, or is outside the box.
    """
    T_s, N_p, log_Q_du = (float(v) for v in space.check(theta))
    limits = CSTR.inputs[0]
    return MPCSettings(
        T_s=T_s,
        N_p=int(N_p),
        N_u=control_horizon(1 / 3, int(N_p)),
        Q_y=[[0.0, 0.0], [0.0, 1.0]],
        Q_u=[[0.0]],
        Q_du=[[10.0**log_Q_du]],
        u_min=[limits.low],
        u_max=[limits.high],
        du_min=[-MAX_MOVE],
        du_max=[MAX_MOVE],
    )


ESTIMATOR = EstimatorSettings(noise=(0.3, 0.03), process=(0.1, 0.01), drift=(0.1, 0.01), on_outputs=(0, 1))
"""Beyond the paper: for T and C_A measured with 0.3 K and 0.03 kgmol/m³ of noise, offset-free."""


def controller(
    theta: Float[np.ndarray, " 3"], estimator: EstimatorSettings | None = None, space: KnobSpace = SPACE
) -> Controller:
    """Create an MPC tuned by θ = (T_s [h], N_p, log10 Q_Δu), shape (3,), physical.

    The paper uses no estimator; `ESTIMATOR` is one.
    """
    tuned = mpc_settings(theta, space)
    return LinearMPC(CSTR(), tuned) if estimator is None else EstimatingMPC(CSTR(), tuned, estimator)


def settings(theta: Float[np.ndarray, " 3"], space: KnobSpace = SPACE) -> dict[str, Any]:
    """Return the MPC settings at θ as plain data."""
    return mpc_settings(theta, space).named()


# --- Compute the KPIs of a CSTR experiment, and the paper's performance index.

_INTERRUPTED = 1000.0
_, _T_C_START = CSTR().steady_state_at_concentration(START)

KPIS = (
    KPI("settling_time", "time to steady state t_f", "h", at_most=HORIZON, resolution=0.01),
    KPI("final_concentration", "final C_A", "kgmol/m³", TARGET + BAND, TARGET - BAND),
    KPI("largest_move", "largest move |ΔT_c|", "K", better="lower", resolution=0.01),
    KPI("mean_square_move", "mean square move", "K²", better="lower", resolution=0.01),
    KPI("peak_temperature", "peak reactor T", "K", better="lower", resolution=0.1),
    KPI("undershoot", "peak undershoot of C_A", "kgmol/m³", better="lower", resolution=0.001),
    KPI("band_entry", "settling time (within ±3 %)", "h", better="lower", resolution=0.01),
    KPI("index", "performance index"),
    KPI("unsolved", "unsolved QPs", at_most=0.0),
)
"""KPIs, most important first. An infinite time means never.

`settling_time` is the paper's t_f, not the usual settling time: the end of the first step at which
C_A is inside the ±3 % band and C_A, T and T_c hardly change any more. `band_entry` is the usual
settling time: the time after which C_A stays within the band.
"""


def compute_kpis(experiment: Experiment) -> dict[str, float]:
    """Return the values of `KPIS`, in their units."""
    moves = _moves(experiment)
    C_A = experiment.x[:, 1]
    return {
        "settling_time": experiment.duration if experiment.end is End.SETTLED else inf,
        "final_concentration": float(C_A[-1]),
        "largest_move": float(np.abs(moves).max()),
        "mean_square_move": float(np.mean(moves**2)),
        "peak_temperature": float(experiment.x[:, 0].max()),
        "undershoot": float(max(TARGET - C_A.min(), 0.0)),
        "band_entry": _band_entry(experiment),
        "index": performance_index(experiment),
        "unsolved": float(np.sum(~experiment.solved)),
    }


def performance_index(experiment: Experiment) -> float:
    """Return eq. perf_index: duration, moves and final error, each relative to an accepted value.

    t_f is when the experiment settled, or else 48 h. The first move starts from the initial steady
    state. Deviation (the paper states no value): an interrupted experiment costs 1000 plus the
    share of the 48 h that it did not reach, so the longer of two is better.
    """
    if experiment.end.interrupted:
        return _INTERRUPTED + max(1.0 - experiment.duration / HORIZON, 0.0)
    t_f = experiment.duration if experiment.end is End.SETTLED else HORIZON
    final = abs(float(experiment.x[-1, 1]) - TARGET)
    return t_f / HORIZON + float(np.mean(_moves(experiment) ** 2)) / MAX_MOVE + final / BAND


def _moves(experiment: Experiment) -> np.ndarray:
    """Return ΔT_c of the N_T steps, K, shape (N_T,)."""
    return np.diff(np.concatenate([_T_C_START, experiment.u_control[:, 0]]))


def _band_entry(experiment: Experiment) -> float:
    """Return the first recorded time after which C_A stays within the band, h; inf if never."""
    outside = np.flatnonzero(np.abs(experiment.x[:, 1] - TARGET) > BAND)
    if len(outside) == 0:
        return 0.0
    last = int(outside[-1])
    return inf if last == len(experiment.t) - 1 else float(experiment.t[last + 1])


# --- Define the CSTR scenario: the steady-state switch of section IV-A.

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


def varied(space: KnobSpace = SPACE) -> Varied:
    """Return what varies of the reactor, for θ in `space`.

    1 % of E changes the rate by a factor of e^0.16 to e^0.19 (E / (R T) is 16 to 19), so E varies by 1 %; the
    gas constant does not vary.
    """
    found = ClosedLoop(cstr_env(), partial(controller, space=space), compute_kpis).varied()
    factors = within(found.factors, {"activation energy": 0.01, "gas constant": 0.0})
    return replace(found, factors=tuple(replace(each, stated=False) for each in factors))


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
    space=SPACE.described(_KNOB_WORDS),
    run=Function(run, varied),
    cost=performance_index,
    kpis=described(KPIS, _KPI_WORDS),
    panels=PANELS,
    references=REFERENCES,
    calibrators={"synthetic": synthetic, "lexicographic": lexicographic},
    controller=controller,
    settings=settings,
    brief=BRIEF,
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
