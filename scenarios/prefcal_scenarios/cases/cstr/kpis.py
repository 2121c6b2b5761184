"""Compute the KPIs of a CSTR experiment, and the paper's performance index."""

from math import inf

import numpy as np

from prefcal_env.envs.cstr import BAND, HORIZON, MAX_MOVE, START, TARGET
from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.plants import CSTR
from prefcal_scenarios.scenario import KPI

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
