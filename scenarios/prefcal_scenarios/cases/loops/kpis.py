"""KPIs of a closed loop: a step of the reference, then a disturbance."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_env.experiments.tracking import entered
from prefcal_scenarios.scenario import KPI

_BAND = 0.05
"""Band of the settling time, as a share of the step."""


_TEXTS = {
    "overshoot": ("overshoot of {y}", "%", "How far it goes beyond its target, as a share of the step."),
    "settling_time": (
        "settling time of {y} (within ±5 %)",
        "{time}",
        "Time after which it stays close to its target, until the disturbance.",
    ),
    "error": ("integrated error of {y}", "{unit} {time}", "Integral of the absolute error over the run."),
    "disturbance_peak": (
        "peak error of {y} after the disturbance",
        "{unit}",
        "Largest distance from the target after the disturbance.",
    ),
    "effort": (
        "effort of {u}",
        "{u_unit}",
        "Root mean square distance of the input from its value at the start.",
    ),
    "switches": ("switches of {u}", "", "How often the input changes its stage."),
    "input_noise": (
        "noise in {u}",
        "{u_unit}",
        "How much the input moves in a sampling period of normal length.",
    ),
    "side_effect": (
        "peak of {beside} after the step",
        "{beside_unit}",
        "Largest distance from its value at the start.",
    ),
    "alarm": ("{y} in alarm", "{time}", "Time outside {alarm}."),
}
"""Title, unit and meaning of each KPI by its name."""


def kpi_names(*, staged: bool, beside: bool, alarm: bool) -> tuple[str, ...]:
    """Return the names of a loop's KPIs, in order.

    Args:
        staged: Whether the input has stages.
        beside: Whether there is a state that the step should not move much.
        alarm: Whether there is an alarm.
    """
    there = {"switches": staged, "input_noise": not staged, "side_effect": beside, "alarm": alarm}
    return tuple(name for name in _TEXTS if there.get(name, True))


def kpis_of(
    names: Sequence[str],
    y: Channel,
    u: Channel,
    time_unit: str,
    *,
    beside: Channel | None = None,
    alarm: tuple[float, float] | None = None,
) -> tuple[KPI, ...]:
    """Return the KPIs with these names, all of them better if lower.

    Args:
        names: Names of the KPIs.
        y: Output whose reference steps.
        u: First input.
        time_unit: Unit of time.
        beside: State that the step should not move much; None if there is none.
        alarm: Lowest and highest value of the output without an alarm; None if there is none.
    """
    words = {"y": y.name, "unit": y.unit, "time": time_unit, "u": u.name, "u_unit": u.unit}
    if beside is not None:
        words |= {"beside": beside.name, "beside_unit": beside.unit}
    if alarm is not None:
        words["alarm"] = f"{alarm[0]:.4g} to {alarm[1]:.4g} {y.unit}".rstrip()
    found = []
    for name in names:
        title, unit, about = (text.format(**words).strip() for text in _TEXTS[name])
        resolution = 0.1 if name == "overshoot" else None
        found.append(KPI(name, title, unit, better="lower", about=about, resolution=resolution))
    return tuple(found)


def compute_kpis(
    experiment: Experiment, disturbed_at: float, u0: float, beside: int | None, pace: float = 1.0
) -> dict[str, float]:
    """Return the values of all KPIs, in their units; an infinite time means never.

    With several set points, the largest overshoot counts, and the sum of the settling times.

    Args:
        experiment: Experiment with a step of the first output at its start.
        disturbed_at: Time of the disturbance.
        u0: First input at the start.
        beside: Index of the state that the step should not move much.
        pace: Nominal sampling time divided by that of this experiment. Moves are counted per
            nominal one, so that many small moves are not calmer than a few large ones.
    """
    t, x, u = experiment.t, experiment.x, experiment.u_control[:, 0]
    error, steps = _errors(experiment, disturbed_at)
    first = t < disturbed_at
    moves = np.abs(np.diff(u))
    times = [entered(t[part] - t[part][0], error[part], _BAND * abs(step)) for part, step in steps]
    found = {
        "overshoot": max(_overshoot(error[part], step) for part, step in steps),
        "settling_time": sum(times, start=0.0) if t[-1] >= disturbed_at else np.inf,
        "error": float(np.abs(error[:-1]) @ np.diff(t)),
        "disturbance_peak": float(np.abs(error[~first]).max()) if not first.all() else np.inf,
        "effort": float(np.sqrt(np.mean((u - u0) ** 2))),
        "input_noise": float(moves.mean()) * pace if len(moves) else 0.0,
        "switches": float(np.count_nonzero(moves)),
    }
    if beside is not None:
        found["side_effect"] = float(np.abs(x[first, beside] - x[0, beside]).max())
    return found


def time_outside(experiment: Experiment, low: float, high: float) -> float:
    """Return how long the first output is outside `low` to `high`, in the unit of time."""
    y = experiment.output(0)
    assert y is not None
    outside = (y < low) | (y > high)
    return float(np.diff(experiment.t)[outside[:-1]].sum())


def _errors(
    experiment: Experiment, until: float
) -> tuple[Float[np.ndarray, " K"], list[tuple[slice, float]]]:
    """Return the error of the first output, and the steps of its reference before `until`.

    Each step is the instants up to the next one, and the error that it starts with if the output
    was at the set point before.
    """
    y, t = experiment.output(0), experiment.t
    assert y is not None
    held = np.searchsorted(experiment.t_control, t, side="right") - 1
    target = experiment.y_ref[held, 0]
    error = y - target
    starts = [0, *(np.flatnonzero(np.diff(target)) + 1).tolist()]
    starts = [start for start in starts if t[start] < until]
    ends = [*starts[1:], int(np.count_nonzero(t < until))]
    sizes = [error[0], *(target[start - 1] - target[start] for start in starts[1:])]
    parts = [slice(start, end) for start, end in zip(starts, ends, strict=True)]
    return error, [(part, float(size)) for part, size in zip(parts, sizes, strict=True)]


def _overshoot(error: Float[np.ndarray, " K"], step: float) -> float:
    """Return how far the output goes beyond its target, in % of the step."""
    return 100.0 * max(float((-error / step).max()), 0.0)
