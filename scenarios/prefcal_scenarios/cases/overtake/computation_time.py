"""Model t_comp of a car experiment on a given processor: criterion (i) of section IV-B."""

import numpy as np
from jaxtyping import Float

from prefcal_env.envs.overtake.road.rules import Phase
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.mpc.computation import Processor, StepSize
from prefcal_env.plants.bicycle import Bicycle

from .controller import mpc_settings
from .scene import phase_at_control

PAPER_T_COMP = 0.0808
"""Worst t_comp at the paper's optimum [s], section IV-B; T_s is 0.085 s there."""

SERVER_CORE = Processor(
    "one core of a server (x86-64 with AVX-512, 2023)",
    step=7.5e-5, iteration=7.5e-6, building=4.9e8, solving=2.2e10,
)  # fmt: skip
"""Measured by benchmarks/speed/computation.py, compiled by numba and PIQP: the 5 to 95 % quantiles
of the measured steps took 0.9 to 1.15 of the modeled time."""

PAPER_PROCESSOR = SERVER_CORE.slower(268.0, "the paper's MATLAB on a laptop")
"""Slowed down until the paper's optimum takes the paper's time, `PAPER_T_COMP`. The shares of its
parts are not known; they are those of `SERVER_CORE`."""


def t_comp(experiment: Experiment, processor: Processor) -> Float[np.ndarray, " N"]:
    """Return the modeled computation time of each control step [s], shape (N,)."""
    phases = phase_at_control(experiment)
    seconds = np.zeros(len(phases))
    for phase in Phase:
        here = phases == phase
        size = StepSize.of(Bicycle(), mpc_settings(experiment.theta, phase))
        seconds[here] = processor.t_comp(size, experiment.iterations[here])
    return seconds


def overrun(experiment: Experiment, processor: Processor) -> float:
    """Return the share by which the worst t_comp exceeds T_s; 0 if the MPC can run in real time.

    With several runs, the worst counts. The time of an estimator is not modeled.
    """
    worst = max(float(t_comp(e, processor).max()) for e in experiment.runs or (experiment,))
    ratio = worst / float(experiment.theta[0])
    return max(ratio - 1.0, 0.0)
