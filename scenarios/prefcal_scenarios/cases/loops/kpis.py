"""KPIs of a closed loop: a step of the reference, then a disturbance."""

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel, Experiment
from prefcal_scenarios.scenario import KPI

_BAND = 0.05
"""Band of the settling time, as a share of the step."""


def kpis_of(
    controlled: Channel, u: Channel, time_unit: str, beside: Channel | None, staged: bool
) -> tuple[KPI, ...]:
    """Return the KPIs of a loop.

    Args:
        controlled: Output whose reference steps.
        u: First input.
        time_unit: Unit of time.
        beside: State that the step should not move much; None if there is none.
        staged: Whether the input has stages.
    """
    y = controlled.name
    calm = KPI("input_noise", f"noise in {u.name}", u.unit, better="lower",
               about="How much the input moves in a sampling period of normal length.")  # fmt: skip
    if staged:
        calm = KPI("switches", f"switches of {u.name}", better="lower",
                   about="How often the input changes its stage.")  # fmt: skip
    found = [
        KPI("overshoot", f"overshoot of {y}", "%", better="lower",
            about="How far it goes beyond its target, as a share of the step."),
        KPI("settling_time", f"settling time of {y} (within ±5 %)", time_unit, better="lower",
            about="Time after which it stays close to its target, until the disturbance."),
        KPI("error", f"integrated error of {y}", f"{controlled.unit} {time_unit}".strip(),
            better="lower", about="Integral of the absolute error over the run."),
        KPI("disturbance_peak", f"peak error of {y} after the disturbance", controlled.unit,
            better="lower", about="Largest distance from the target after the disturbance."),
        KPI("effort", f"effort of {u.name}", u.unit, better="lower",
            about="Root mean square distance of the input from its value at the start."),
        calm,
    ]  # fmt: skip
    if beside is not None:
        found.append(
            KPI(
                "side_effect",
                f"peak of {beside.name} after the step",
                beside.unit,
                better="lower",
                about="Largest distance from its value at the start.",
            )
        )
    return tuple(found)


def compute_kpis(
    experiment: Experiment,
    disturbed_at: float,
    u0: float,
    beside: int | None,
    pace: float = 1.0,
) -> dict[str, float]:
    """Return the values of all KPIs, in their units; an infinite time means never.

    Args:
        experiment: Experiment with a step of the first output at its start.
        disturbed_at: Time of the disturbance.
        u0: First input at the start.
        beside: Index of the state that the step should not move much.
        pace: Nominal sampling time divided by that of this experiment. Moves are counted per
            nominal one, so that many small moves are not calmer than a few large ones.
    """
    t, x, u = experiment.t, experiment.x, experiment.u_control[:, 0]
    y, target = experiment.output(0), float(experiment.y_ref[0, 0])
    assert y is not None
    error = y - target
    first = t < disturbed_at
    moves = np.abs(np.diff(u))
    found = {
        **_of_step(t[first], error[first], reached=bool(t[-1] >= disturbed_at)),
        "error": float(np.abs(error[:-1]) @ np.diff(t)),
        "disturbance_peak": float(np.abs(error[~first]).max()) if not first.all() else np.inf,
        "effort": float(np.sqrt(np.mean((u - u0) ** 2))),
        "input_noise": float(moves.mean()) * pace if len(moves) else 0.0,
        "switches": float(np.count_nonzero(moves)),
    }
    if beside is not None:
        found["side_effect"] = float(np.abs(x[first, beside] - x[0, beside]).max())
    return found


def bounds_so_far(
    experiment: Experiment,
    disturbed_at: float,
    u0: float,
    beside: int | None,
    steps: int,
    pace: float = 1.0,
) -> dict[str, float]:
    """Return lower bounds of the KPIs of a run, from its record so far.

    Means are bounded as if nothing were added in the steps to come.

    Args:
        experiment: Record so far.
        disturbed_at: Time of the disturbance.
        u0: First input at the start.
        beside: Index of the state that the step should not move much.
        steps: Number of control steps of a whole run.
        pace: As for `compute_kpis`.
    """
    t, u = experiment.t, experiment.u_control[:, 0]
    known = compute_kpis(experiment, disturbed_at, u0, beside, pace)
    y = experiment.output(0)
    assert y is not None
    error = y - float(experiment.y_ref[0, 0])
    outside = np.flatnonzero((np.abs(error) > _BAND * abs(error[0])) & (t < disturbed_at))
    known |= {
        "settling_time": float(t[outside[-1]]) if len(outside) else 0.0,
        "disturbance_peak": float(np.abs(error[t >= disturbed_at]).max(initial=0.0)),
        "effort": float(np.sqrt(np.sum((u - u0) ** 2) / steps)),
        "input_noise": float(np.abs(np.diff(u)).sum()) * pace / max(steps - 1, 1),
    }
    return known


def _of_step(
    t: Float[np.ndarray, " K"], error: Float[np.ndarray, " K"], *, reached: bool
) -> dict[str, float]:
    """Return overshoot and settling time; never settled if the disturbance was not `reached`."""
    step = float(error[0])
    outside = np.flatnonzero(np.abs(error) > _BAND * abs(step))
    last = int(outside[-1]) if len(outside) else -1
    settled = reached and last + 1 < len(t)
    return {
        "overshoot": 100.0 * max(float((-error / step).max()), 0.0),
        "settling_time": float(t[last + 1]) if settled else np.inf,
    }
