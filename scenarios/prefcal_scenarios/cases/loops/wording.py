"""Describe the loops and their knobs for the person who compares."""

from collections.abc import Mapping, Sequence
from math import isfinite

from prefcal_env.experiments.experiment import Channel

_JUDGE = (
    "Good control reaches the target soon, without overshoot or oscillation, recovers from the "
    "disturbance, and spares the actuator. What counts more is up to you."
)

_KNOBS: Mapping[str, str] = {
    "K": "Gain: a larger one reacts more strongly to errors and to noise.",
    "T_i": "Integral time: a shorter one removes lasting errors sooner, but may oscillate.",
    "T_d": "Derivative time: a longer one brakes more, and amplifies noise.",
    "T_f": "Time constant of the measurement's filter: a longer one passes less noise, but delays.",
    "b": "Share of the target's step that acts at once; a small one starts gently.",
    "T_t": "Time constant of the anti-windup: a shorter one lets go of the limit sooner.",
    "hysteresis": "How far beyond the border of a stage it switches, as a share of a stage.",
    "Q_1": "Weight of the first state's error.",
    "Q_2": "Weight of the second state's error.",
    "Q_3": "Weight of the third state's error.",
    "Q_4": "Weight of the fourth state's error.",
    "Q_z": "Weight of the integrated error: a larger one removes lasting errors sooner.",
    "N_p": "Prediction horizon: how many steps the controller looks ahead.",
    "N_u": "Control horizon: how many of these steps it may move the inputs.",
    "Q_du": "Weight of the moves: a larger one is gentler and slower.",
    "drift": "How fast the estimated disturbances may change: a larger one removes lasting errors "
    "sooner, and passes more noise.",
    "T_s": "Sampling time: how often the controller measures and acts.",
    "every": "Number of samples after which the controller acts: a larger one is calmer and later.",
    "stages": "Number of stages of the input.",
}
_WHERE: Mapping[str, str] = {
    "_outer": "Outer controller. ",
    "_inner": "Inner controller. ",
    "_1": "First controller. ",
    "_2": "Second controller. ",
}


def about_knob(name: str) -> str:
    """Return a sentence that explains the knob called `name`, such as K or T_i_outer."""
    if name in _KNOBS:
        return _KNOBS[name]
    suffix = next(suffix for suffix in _WHERE if name.endswith(suffix))
    return _WHERE[suffix] + _KNOBS[name.removesuffix(suffix)]


def brief_of(brief: str, states: Sequence[Channel]) -> str:
    """Return `brief` with what to judge by, and when an experiment stops as unsafe."""
    bounds = [
        f"{c.name} {c.low:g} to {c.high:g} {c.unit}".rstrip()
        for c in states
        if isfinite(c.low) and isfinite(c.high)
    ]
    stops = " An experiment stops as unsafe outside its limits: " + ", ".join(bounds) + "."
    return f"{brief} {_JUDGE}{stops if bounds else ''}"
