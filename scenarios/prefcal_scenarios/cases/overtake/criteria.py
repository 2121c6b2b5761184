"""Build the calibrator of section IV-B: criteria (i) to (vi), with noticeable differences."""

from collections.abc import Callable
from functools import partial

from prefcal_env.calibrators import Criterion, Lexicographic
from prefcal_env.experiments.experiment import Experiment

from .computation_time import overrun
from .kpis import SHORTEST_DISTANCE


def calibrator(seed: int = 0) -> Lexicographic:
    """Return a calibrator with criteria (i) to (v), in the priority of (vi), whatever the `seed`.

    Deviation: the just noticeable differences, and the order among (ii) to (v), are ours. The
    effect of other differences is in docs/deviations.md.

    Real time comes first: the worst t_comp on the paper's laptop must be below T_s; otherwise the
    smaller excess is better. Next come interruptions (collision, off the road; later is better),
    then distance and road, where only a lack of safety counts; then comfort, speed and steering.

    If a difference is not noticeable, the next criterion decides. So no cost function, not even
    one with a tie band, has these preferences: they can form a cycle (a test shows three such θ).
    """
    return Lexicographic(
        [
            Criterion("(iii) lateral distance too small by [m]", _too_near),
            Criterion("(iii) off the road by [m]", _kpi("off_road")),
            Criterion("(iii) overshoot of y_f [m]", _kpi("overshoot"), 0.05),
            Criterion("(ii) |y_f| in lane keeping [m]", _kpi("lane_deviation"), 0.05),
            Criterion("(iii) largest lateral acceleration [m/s²]", _kpi("lateral_acceleration"), 1.0),
            Criterion("(iii) RMS lateral jerk [m/s³]", _kpi("lateral_jerk_rms"), 1.0),
            Criterion("(iv) RMS error of v [km/h]", _kpi("speed_error"), 0.2),
            Criterion("(iv) total variation of v [km/h]", _kpi("speed_variation"), 1.0),
            Criterion("(v) RMS rate of δ_s [°/s]", _kpi("steering_rate_rms"), 1.0),
            Criterion("(v) largest move of δ_s [°]", _kpi("steering_move"), 0.2),
        ],
        first=[Criterion("(i) worst t_comp above T_s [share]", overrun)],
    )


def _too_near(experiment: Experiment) -> float:
    """Return how much closer than `SHORTEST_DISTANCE` the car passes the obstacle [m]."""
    return max(SHORTEST_DISTANCE - float(experiment.kpis["lateral_distance"]), 0.0)


def _kpi(name: str) -> Callable[[Experiment], float]:
    return partial(_value, name)


def _value(name: str, experiment: Experiment) -> float:
    return float(experiment.kpis[name])
