"""A small scenario with three knobs and analytic runs: fast, and with every case in it."""

import time
from typing import Any

import numpy as np

from prefcal_env.calibrators import LatentCost
from prefcal_env.experiments.experiment import Channel, Channels, End, Experiment, Measurement, Move
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_scenarios.scenario import KPI, Panel, Scenario

LEVEL = Channel("level <h>", "m", target=2.0, band=0.06, symbol="h")
VALVE = Channel("valve", "%", low=0.0, high=10.0, symbol="v_1")
CHANNELS = Channels(x=(LEVEL,), u=(VALVE,), y=(LEVEL,), time_unit="h")
SPACE = KnobSpace(
    [
        Knob("T_s", 0.25, 1.5, "h"),
        Knob("N_p", 4, 40, integer=True),
        Knob("gain", 0.01, 100.0, "m/%", scale="log10"),
    ]
)


def run(theta: Any, seed: int = 0) -> Experiment:
    """A damped oscillation; the best is (0.4, 20, 1); unsafe for gains above 50."""
    T_s, N_p, gain = SPACE.check(theta)
    damping = 0.15 + 0.6 * np.exp(-((np.log10(gain)) ** 2) - ((N_p - 20) / 15) ** 2)
    end = 12.0 if gain > 50 else 48.0
    t_control = np.arange(0.0, end, T_s)
    t = np.unique(np.concatenate([np.linspace(0, end, 241), t_control]))
    level = 2 + 6.5 * np.exp(-damping * t) * np.cos(0.5 * T_s * t)
    decided = 5 + 4 * np.exp(-damping * t_control) * np.cos(0.5 * T_s * t_control)
    held = decided[np.searchsorted(t_control, t, side="right") - 1]
    n = len(t_control)
    outside = np.flatnonzero(np.abs(level - 2) > LEVEL.band)
    settled = t[outside[-1]] if len(outside) else 0.0
    return Experiment(
        theta=theta,
        t=t,
        x=level[:, None],
        u=held[:, None],
        t_control=t_control,
        u_control=decided[:, None],
        y_ref=np.full((n, 1), 2.0),
        iterations=np.full(n, 5),
        solve_time=np.zeros(n),
        solved=np.ones(n, dtype=bool),
        channels=CHANNELS,
        end=End.UNSAFE if gain > 50 else End.TIME_UP,
        kpis={"t_f": settled, "final": level[-1], "largest": np.inf if gain > 50 else 1.0},
    )


def slow_run(theta: Any, seed: int = 0) -> Experiment:
    """As `run`, but it takes its time."""
    time.sleep(0.05)
    return run(theta, seed)


def cost(experiment: Experiment) -> float:
    """Settling time and sampling time; 1000 and more where it was unsafe."""
    if experiment.end.interrupted:
        return 1000.75
    return experiment.kpis["t_f"] / 48 + 0.3 * (experiment.theta[0] - 0.4) ** 2


class Judge:
    """Prefers the lower cost, less than the tie band is a tie; abstains now and then."""

    def __init__(self, seed: int, tie_band: float = 0.002) -> None:
        self._tie_band = tie_band

    def prefer(self, challenger: Experiment, incumbent: Experiment) -> int | None:
        difference = cost(challenger) - cost(incumbent)
        if challenger.end.interrupted and challenger.theta[1] > 30:
            return None
        return 0 if abs(difference) < self._tie_band else int(np.sign(difference))


class Proportional:
    """The toy's controller."""

    def __init__(self, theta: Any) -> None:
        self.T_s, self._gain = float(theta[0]), float(theta[2])

    def move(self, measurement: Measurement) -> Move:
        return Move(self._gain * (measurement.y_ref - measurement.x))


def settings(theta: Any) -> dict[str, Any]:
    """What the controller is made of."""
    return {"T_s": float(theta[0]), "gain": float(theta[2]), "limits": (0.0, np.inf)}


_PARTS: dict[str, Any] = {
    "name": "toy",
    "title": "Toy <level> & valve",
    "space": SPACE,
    "cost": cost,
    "kpis": (
        KPI("t_f", "settling time t_f", "h", at_most=20.0),
        KPI("final", "final level", "m", at_least=1.94, at_most=2.06),
        KPI("largest", "largest move", "%"),
    ),
    "panels": (Panel("level <h>"), Panel("valve")),
    "references": {"paper": np.array([0.31, 26, 0.5]), "automated": np.array([0.25, 26, 1.0])},
    "calibrators": {"synthetic": Judge, "latent": lambda seed: LatentCost(cost, seed=seed)},
    "controller": Proportional,
    "settings": settings,
}
toy = Scenario(run=run, **_PARTS)
slow = Scenario(run=slow_run, **_PARTS)
plain = Scenario("plain", "Plain", SPACE, run, calibrators={"synthetic": Judge})
"""Nothing but what a scenario must have."""
not_a_scenario = 3
