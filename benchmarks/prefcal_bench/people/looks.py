"""What people see in the curves of an experiment, though no KPI says it."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment

LOOKS = (
    "seen_outside_quick_band",
    "seen_outside_slow_band",
    "seen_below",
    "seen_above",
    "seen_swings",
    "seen_unrest_at_the_end",
    "seen_turns_of_the_input",
    "seen_largest_step_of_the_input",
)
"""What is seen, in the order of `looks_of`; lower is better everywhere.

The time outside a band around a curve drawn by hand, quick or slow; the area on the near and on
the far side of the target; how often the output swings through the target; how much it moves at
the end; and how often the input turns, and its largest step.
"""
_OF_THE_OUTPUT = 6
_QUICK, _SLOW = 0.04, 0.12  # time constants of the curves drawn by hand, as shares of the experiment
_BAND, _SWING = 0.1, 0.03  # half widths of the bands, as shares of the largest change that is wanted
_END = 0.15
_TURN = 0.02  # smallest move of the input that is seen as a turn, as a share of its range


def looks_of(experiment: Experiment) -> Float[np.ndarray, " f"]:
    """Return the values of `LOOKS`, infinite where there is no output, target or input to see."""
    return np.array([*_of_the_output(experiment), *_of_the_input(experiment)])


def _of_the_output(experiment: Experiment) -> list[float]:
    y = experiment.output(0) if experiment.channels.y else None
    reference = _reference(experiment)
    if y is None or reference is None or not np.isfinite(reference).all():
        return [np.inf] * _OF_THE_OUTPUT
    t, dt = experiment.t, np.diff(experiment.t)
    wanted = np.concatenate([reference, y[:1]])
    span = float(np.ptp(wanted)) or float(np.abs(wanted).max()) or 1.0
    bands = [
        float(dt[np.abs(y - _drawn(t, reference, float(y[0]), share))[:-1] > _BAND * span].sum())
        for share in (_QUICK, _SLOW)
    ]
    beyond = (y - reference) * (np.sign(reference[0] - y[0]) or 1.0)
    areas = [float(np.maximum(side, 0.0)[:-1] @ dt) for side in (-beyond, beyond)]
    sides = np.sign(beyond[np.abs(beyond) > _SWING * span])
    end = y[t >= t[-1] - _END * (t[-1] - t[0])]
    return [*bands, *areas, float(np.count_nonzero(np.diff(sides))), float(end.std())]


def _reference(experiment: Experiment) -> Float[np.ndarray, " K"] | None:
    """Return the target of the first output at every instant; None if there is none."""
    if len(experiment.t) < 2 or experiment.y_ref.size == 0:
        return None
    held = np.searchsorted(experiment.t_control, experiment.t, side="right") - 1
    return np.asarray(experiment.y_ref[np.clip(held, 0, len(experiment.y_ref) - 1), 0])


def _drawn(
    t: Float[np.ndarray, " K"], reference: Float[np.ndarray, " K"], start: float, share: float
) -> Float[np.ndarray, " K"]:
    """Return a curve from `start` that approaches each target with a lag of first order."""
    lag, drawn, here = share * float(t[-1] - t[0]), np.empty(len(t)), start
    changes = [0, *(np.flatnonzero(np.diff(reference)) + 1).tolist(), len(t)]
    for first, last in pairwise(changes):
        target = reference[first]
        drawn[first:last] = target + (here - target) * np.exp(-(t[first:last] - t[first]) / lag)
        ahead = t[min(last, len(t) - 1)] - t[first]
        here = float(target + (here - target) * np.exp(-ahead / lag))
    return drawn


def _of_the_input(experiment: Experiment) -> list[float]:
    if len(experiment.u_control) < 2 or not experiment.channels.u:
        return [np.inf, np.inf]
    u, channel = experiment.u_control[:, 0], experiment.channels.u[0]
    whole = channel.high - channel.low
    seen = _TURN * (whole if np.isfinite(whole) else float(np.ptp(u)))
    moves = np.diff(u)
    turns = np.count_nonzero(np.diff(np.sign(moves[np.abs(moves) > seen])))
    return [float(turns), float(np.abs(moves).max())]
