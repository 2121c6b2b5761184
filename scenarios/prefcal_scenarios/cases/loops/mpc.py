"""The MPC of the loops: from the knobs to the controller, with the loop's plant as its model."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from prefcal_env.compiling import Kernel, compile_ahead, of_the_filter
from prefcal_env.envs.task import Task
from prefcal_env.mpc import EstimatingMPC, EstimatorSettings, MPCSettings

from .loop import KnobValues
from .plants import CompiledPlant, advance, compile_equations, hold


@dataclass(frozen=True, slots=True)
class TunedMPC:
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
    fixed: KnobValues = field(default_factory=dict)

    def make(self, values: KnobValues, plant: CompiledPlant, task: Task, T_s: float) -> EstimatingMPC:
        """Return the controller, which has a memory: it serves one experiment.

        Its model is the plant without dead time, whose disturbance stays at its value at the start:
        what the controller does not know, its estimator finds out.
        """
        values = {**self.fixed, **values}
        weights = [values.get(f"Q_{i}", 0.0) for i in range(1, len(self.scales) + 1)]
        N_p = int(values["N_p"])
        settings = MPCSettings(
            T_s=T_s,
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
        return EstimatingMPC(plant, settings, estimator)


def _kernels() -> Iterator[Kernel]:
    vector, matrix = "f8[::1]", "f8[:,::1]"
    history, timing = f"Tuple(({matrix}, {matrix}, {vector}, {matrix}, {vector}))", "Tuple((f8, i8, f8))"
    yield Kernel("plant", advance, f"(Tuple((i8, {vector})), {timing}, UniTuple(i8, 2), {history}, {matrix})")
    yield Kernel("predicted states", hold, f"(i8, {', '.join([vector] * 5)}, f8)")
    compile_equations()
    yield from of_the_filter()


compile_ahead(__name__, _kernels)
