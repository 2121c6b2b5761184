"""Describe the reactor for the person who compares: the task, its knobs and its KPIs."""

from collections.abc import Mapping

BRIEF = (
    "A stirred-tank reactor is brought from a concentration C_A of 8.56 kgmol/m³ down to 2 "
    "kgmol/m³. A model predictive controller (MPC) does it by moving the coolant temperature T_c. "
    "Each experiment is one simulated run with other controller settings. Prefer the run that you "
    "would rather have on your plant: it reaches its target soon, without swings, with calm "
    "moves of the coolant. A run ends once the reactor has reached its new steady state, so a "
    "curve may end at 16 h; one that never settles lasts 48 h."
)
KNOBS: Mapping[str, str] = {
    "T_s": "Sampling time: how often the controller measures and moves the coolant. A short one "
    "reacts sooner; a long one makes few, coarse moves.",
    "N_p": "Prediction horizon: how many samples the controller looks ahead. A short one is "
    "nearsighted and may never reach the target.",
    "log Q_Δu": "Weight of the coolant's moves, as a power of ten. A low one moves boldly, a "
    "high one gently, and takes longer.",
}
KPIS: Mapping[str, str] = {
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
