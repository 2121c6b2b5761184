"""The MPC of the loops: the loop's plant as its model, and from the knobs to the controller."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Channel
from prefcal_env.mpc import EstimatingMPC, EstimatorSettings, MPCSettings
from prefcal_env.plants.equations import Equations
from prefcal_env.plants.jacobians import D, Jacobians, States, Times, U, X, Y

from ._simulate import hold, rhs, slopes
from .controllers import Values
from .course import Course, Trace, by_controller
from .plants import packed


class LoopModel:
    """A `prefcal_env` plant: the loop's plant, undisturbed, with its measured states as outputs.

    The disturbance stays at its value at the start, and the dead time is left out: what the
    controller does not know, its estimator finds out.

    Args:
        course: Loop and its sampling; it determines plant, measured states and limits.
    """

    def __init__(self, course: Course) -> None:
        self.name, self.time_unit = "model", ""
        self.states = tuple(Channel(f"state {i}") for i in range(len(course.x0)))
        self.inputs = tuple(
            Channel(f"input {i}", low=low, high=high) for i, (low, high) in enumerate(course.limits)
        )
        self.outputs = tuple(self.states[i] for i in course.measured)
        self.disturbances: tuple[Channel, ...] = ()
        self._course, self._plant = course, packed(course.plant)
        self._C = np.eye(len(course.x0))[course.measured]

    @property
    def equations(self) -> Equations:
        """Return the compiled equations."""
        from ._equations import equations_of  # compiles them, the first time

        return equations_of(self._course)

    def f(self, x: X, u: U, d: D) -> X:
        """Return the state derivative."""
        return np.asarray(rhs(*self._plant, *self._at(x, u)))

    def g(self, x: X, u: U, d: D) -> Y:
        """Return the measured states."""
        return np.asarray(self._C @ x)

    def jacobians(self, x: X, u: U, d: D) -> Jacobians:
        """Return the derivatives of f, by central differences, and of g."""
        A, B = slopes(*self._plant, *self._at(x, u))
        return Jacobians(A, B, self._C, np.zeros((len(self.outputs), len(self.inputs))))

    def hold(self, x: X, u: U, d: D, times: Times) -> States:
        """Return the states at `times`, with the inputs held."""
        return np.asarray(hold(*self._plant, *self._at(x, u), times, self._course.step))

    def _at(self, x: X, u: U) -> tuple[X, U, Float[np.ndarray, " n"]]:
        """Return copies, and d: numba compiles again for read-only arrays, another type."""
        return np.array(x, dtype=float), np.array(u, dtype=float), self._course.disturbance[0]


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

    def drive(self, values: Values, course: Course) -> Trace:
        """Return what the controller does with these values of the knobs."""
        return by_controller(self.controller(values, course), course)

    def controller(self, values: Values, course: Course) -> EstimatingMPC:
        """Return the controller, which has a memory: it serves one experiment."""
        values = {**self.fixed, **values}
        weights = [values.get(f"Q_{i}", 0.0) for i in range(1, len(self.scales) + 1)]
        N_p = int(values["N_p"])
        settings = MPCSettings(
            T_s=course.T_s,
            N_p=N_p,
            N_u=min(int(values["N_u"]), N_p),
            Q_y=np.diag(np.array(weights) / np.square(self.scales)),
            Q_du=np.diag(values["Q_du"] / np.square(self.moves)),
        )
        offsets = [self.scales[i] for i in self.on_outputs] + [self.moves[j] for j in self.on_inputs]
        estimator = EstimatorSettings(
            noise=self.noise,
            process=self.process,
            drift=tuple(values["drift"] * scale for scale in offsets),
            on_outputs=self.on_outputs,
            on_inputs=self.on_inputs,
        )
        return EstimatingMPC(LoopModel(course), settings, estimator)
