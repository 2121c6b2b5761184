"""A short study of the toy scenario, for tests of whatever comes after a study."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from prefcal_agents import GLISp, RandomSearch
from prefcal_app.report import StudyRecord
from prefcal_env.preferences.answer import calibrate
from prefcal_scenarios.catalog import load
from prefcal_scenarios.scenario import Scenario

TOY_FILE = Path(__file__).parent / "scenarios" / "toy_scenario.py"
TOY = f"{TOY_FILE}:toy"


def toy_scenario(name: str = "toy") -> Scenario:
    """One of the scenarios of the toy file."""
    return load(f"{TOY_FILE}:{name}")


@cache
def toy_record(name: str = "toy", *, n_max: int = 8, stop_after: int = 99, learn: bool = True) -> StudyRecord:
    """A study of the toy, perhaps stopped after some experiments."""
    scenario = toy_scenario(name)
    make: Any = GLISp if learn else RandomSearch
    agent = make(scenario.space, n_init=4, n_max=n_max, seed=1)
    comparisons = []
    if stop_after:
        for comparison in calibrate(agent, scenario.run, scenario.calibrators["synthetic"](0)):
            comparisons.append(comparison)
            if len(comparisons) == stop_after:
                break
    return StudyRecord(
        scenario=scenario,
        source=f"{TOY_FILE}:{name}",
        comparisons=tuple(comparisons),
        held=agent.state.history.incumbents(),
        references={k: scenario.run(np.array(v)) for k, v in scenario.references.items()},
        settings={"agent": "glisp", "seed": 1},
        n_init=4,
        n_max=n_max,
        command="prefcal calibrate toy --seed 1",
        surrogate=agent.surrogate if learn and len(comparisons) > 1 else None,
    )


PID_SETTINGS = {"controller": "PID", "K_p": 2.0, "T_i": 10.0, "T_d": 3.0}
PID_SETTINGS |= {"N": 10.0, "b": 1.0, "c": 0.0, "T_s": 0.5}
"""Settings of a PID, as a scenario says them of a θ."""
