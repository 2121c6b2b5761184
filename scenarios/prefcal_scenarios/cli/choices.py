"""From the words of the command line to agents and calibrators."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiment import Experiment
from prefcal_env.preference import Calibrator
from prefcal_env.rig import Rig
from prefcal_scenarios.cli.options import BY_VALUE, SCORE, Options
from prefcal_scenarios.scenario import Scenario

if TYPE_CHECKING:
    from prefcal_agents.restore import AnyAgent

Thetas = Sequence[Float[np.ndarray, " n"]]

AGENTS = {"glisp": "GLISp", "glis": "GLIS", "random": "RandomSearch", "lhs": "LatinHypercube"}
"""Word to class in `prefcal_agents`."""


def make_agent(options: Options, scenario: Scenario, start: Thetas = ()) -> "AnyAgent":
    """The agent of the options, which begins with the physical θ in `start`.

    Raises:
        SettingsError: an unknown agent, settings that it refuses, or options for another one.
        KnobError: a θ to begin with that is outside the space.
    """
    if options.agent not in AGENTS:
        raise SettingsError(f"agent must be one of {sorted(AGENTS)}, got {options.agent!r}")
    if options.delta is not None and options.agent != "glisp":
        raise SettingsError(f"only the agent glisp takes a delta, not {options.agent!r}")
    if not options.outcomes and options.agent != "glisp":
        raise SettingsError(
            f"only the agent glisp learns from outcomes: leave --no-outcomes out for "
            f"{options.agent!r}"
        )
    if options.questions_per_experiment != 1 and options.agent != "glisp":
        raise SettingsError(
            f"only the agent glisp asks more questions per experiment, not {options.agent!r}"
        )
    if options.cost is not None and options.agent not in BY_VALUE:
        raise SettingsError(
            f"only an agent that is told scores ({', '.join(BY_VALUE)}) takes a cost, "
            f"not {options.agent!r}"
        )
    if options.agent in BY_VALUE:
        _check_score(options, scenario)
    import prefcal_agents

    extra: dict[str, Any] = {} if options.delta is None else {"delta": options.delta}
    settings = _settings(options)
    if settings:
        extra["settings"] = prefcal_agents.GLISpSettings(**settings)
    if start:
        extra["start"] = start
    make = getattr(prefcal_agents, AGENTS[options.agent])
    agent: AnyAgent = make(
        scenario.space, n_init=options.n_init, n_max=options.n_max, seed=options.seed, **extra
    )
    return agent


def _settings(options: Options) -> dict[str, Any]:
    """Those of GLISp that the options name, beside δ."""
    given: dict[str, Any] = {}
    if not options.outcomes:
        given["outcome_scales"] = (0.0,)
    if options.questions_per_experiment != 1:
        given["questions_per_experiment"] = options.questions_per_experiment
    return given


def _unknown(calibrator: str, scenario: Scenario, known: list[str]) -> str:
    """What is said of a calibrator that the scenario does not have."""
    if isinstance(scenario.run, Rig):
        return (
            f"scenario {scenario.name!r} is a rig that only a person can run: its calibrator is "
            f"human, got {calibrator!r}"
        )
    hint = "" if known else " (give it a cost, or calibrators, to calibrate it unattended)"
    return (
        f"calibrator must be one of {sorted(['human', *known])} for scenario {scenario.name!r}"
        f"{hint}, got {calibrator!r}"
    )


def make_calibrator(options: Options, scenario: Scenario) -> Calibrator[Experiment] | None:
    """The calibrator of the options, one of the scenario's; None where scores are told.

    Raises:
        SettingsError: unknown, or it does not take the tie band or the answer noise.
    """
    if options.agent in BY_VALUE:
        return None
    from prefcal_env.calibrators import LatentCost, Thurstone

    calibrators = dict(scenario.calibrators)
    if not calibrators and scenario.cost is not None:
        cost = scenario.cost
        calibrators["synthetic"] = lambda seed: LatentCost(cost, seed=seed)
    if options.calibrator not in calibrators:
        raise SettingsError(_unknown(options.calibrator, scenario, sorted(calibrators)))
    calibrator = calibrators[options.calibrator](options.seed)
    if options.tie_band is None and options.answer_noise is None:
        return calibrator
    if not isinstance(calibrator, LatentCost):
        raise SettingsError(
            f"calibrator {options.calibrator!r} takes no tie band and no answer noise: "
            "it has no cost in mind"
        )
    if options.tie_band is not None:
        calibrator = replace(calibrator, tie_band=options.tie_band)
    if options.answer_noise is not None:
        sure = options.answer_noise == 0
        calibrator = replace(calibrator, noise=None if sure else Thurstone(options.answer_noise))
    return calibrator


def _check_score(options: Options, scenario: Scenario) -> None:
    """Refuse what does not go with an agent that is told scores."""
    if scenario.cost is None:
        raise SettingsError(
            f"agent {options.agent!r} learns from a score, and scenario {scenario.name!r} has "
            "none: take another agent, or give the scenario a cost, or one out of a file (--cost)"
        )
    if options.calibrator != SCORE:
        raise SettingsError(
            f"agent {options.agent!r} learns from the scenario's score and asks nobody: "
            f"leave the calibrator out, got {options.calibrator!r}"
        )
    if options.tie_band is not None or options.answer_noise is not None:
        raise SettingsError(
            f"agent {options.agent!r} is told exact scores: it takes no tie band and no answer "
            "noise"
        )
