"""Judge the computation times of the overtaking on another processor."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.worst_case import worst_of
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.mpc.computation import Processor
from prefcal_scenarios.scenario import Scenario

from .controller import SPACE
from .criteria import on_processor
from .kpis import HIGHER_IS_BETTER, compute_kpis


def on_target(scenario: Scenario, processor: Processor) -> Scenario:
    """Return `scenario`, an overtaking, with criterion (i) judged on `processor`.

    Its KPIs of t_comp and its only synthetic calibrator use `processor`.
    """
    return replace(
        scenario,
        run=partial(_run, scenario.run, processor),
        calibrators={"synthetic": partial(on_processor, processor)},
    )


def _run(
    run: Callable[..., Experiment],
    processor: Processor,
    theta: Float[np.ndarray, " 5"],
    seed: int = 0,
    space: KnobSpace = SPACE,
) -> Experiment:
    return _judged(run(theta, seed=seed, space=space), processor)


def _judged(experiment: Experiment, processor: Processor) -> Experiment:
    """Return the experiment with KPIs for `processor`; with several runs, the worst counts."""
    if experiment.runs:
        return worst_of([_judged(run, processor) for run in experiment.runs], HIGHER_IS_BETTER)
    return replace(experiment, kpis=compute_kpis(experiment, processor))
