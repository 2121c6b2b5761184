"""The MPC of the loops: from the values of the knobs to a controller."""

from dataclasses import dataclass, field

import numpy as np

from prefcal_env.mpc import EstimatingMPC, EstimatorSettings, MPCSettings
from prefcal_scenarios.cases.loops.controllers import Values
from prefcal_scenarios.cases.loops.course import Course, Driven

from .drive import by_controller
from .model import Model


@dataclass(frozen=True, slots=True)
class MPC:
    """The MPC of `prefcal_env.mpc`, with a Kalman filter that estimates lasting disturbances.

    It minimizes Σ q_i (y_i - r_i)² / s_i² + Q_Δu Δu_j² / m_j² for the model linearized at each
    step, within the limits of the inputs. The estimated disturbances make it free of offset.

    The knobs are N_p (prediction horizon, steps), N_u (control horizon, steps; at most N_p),
    Q_du (weight of the moves), Q_1, Q_2, ... (weights q of the measured states), drift (how much
    the disturbances change in one unit of time, as a share of their scales), and T_s.

    Args:
        scales: Scale s of each measured state.
        moves: Scale m of each input.
        noise: Standard deviation of the noise of each measured state.
        process: Error of the model over one unit of time, for each state.
        on_outputs: Indices of the measured states with a disturbance.
        on_inputs: Indices of the inputs with a disturbance.
        fixed: Values that are not tuned.
    """

    scales: tuple[float, ...]
    moves: tuple[float, ...]
    noise: tuple[float, ...]
    process: tuple[float, ...]
    on_outputs: tuple[int, ...] = ()
    on_inputs: tuple[int, ...] = ()
    fixed: Values = field(default_factory=dict)

    def drive(self, values: Values, course: Course) -> Driven:
        """Return what the controller does with these values of the knobs."""
        return by_controller(self.controller(values, course), course)

    def controller(self, values: Values, course: Course) -> EstimatingMPC:
        """Return the controller, which has a memory: it serves one experiment."""
        values = {**self.fixed, **values}
        weights = [values.get(f"Q_{i}", 0.0) for i in range(1, len(self.scales) + 1)]
        N_p = int(values["N_p"])
        settings = MPCSettings(
            T_s=course.T_s, N_p=N_p, N_u=min(int(values["N_u"]), N_p),
            Q_y=np.diag(np.array(weights) / np.square(self.scales)),
            Q_du=np.diag(values["Q_du"] / np.square(self.moves)),
        )  # fmt: skip
        offsets = [self.scales[i] for i in self.on_outputs] + [
            self.moves[j] for j in self.on_inputs
        ]
        estimator = EstimatorSettings(
            noise=self.noise, process=self.process,
            drift=tuple(values["drift"] * scale for scale in offsets),
            on_outputs=self.on_outputs, on_inputs=self.on_inputs,
        )  # fmt: skip
        return EstimatingMPC(Model(course), settings, estimator)
