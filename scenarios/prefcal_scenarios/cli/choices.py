"""From the words of the command line to agents and calibrators."""

from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_env.experiment import Experiment
from prefcal_env.preference import Calibrator
from prefcal_env.rig import Rig
from prefcal_scenarios.cli.options import BY_VALUE, SCORE, Options
from prefcal_scenarios.nearest import did_you_mean
from prefcal_scenarios.scenario import Scenario

if TYPE_CHECKING:
    from prefcal_agents.restore import AnyAgent

Thetas = Sequence[Float[np.ndarray, " n"]]

AGENTS = {
    "glisp": "GLISp", "glisp-paper": "GLISp.paper", "glis": "GLIS", "random": "RandomSearch",
    "lhs": "LatinHypercube",
}  # fmt: skip
"""Word to class, or to another way to make one, in `prefcal_agents`."""


def make_agent(options: Options, scenario: Scenario, start: Thetas = ()) -> "AnyAgent":
    """The agent of the options, which begins with the physical θ in `start`.

    Raises:
        SettingsError: an unknown agent, settings that it refuses, or options for another one.
        KnobError: a θ to begin with that is outside the space.
    """
    if options.agent not in AGENTS:
        hint = did_you_mean(options.agent, AGENTS)
        raise SettingsError(
            f"--agent must be one of {', '.join(AGENTS)}, got {options.agent!r}.{hint}".rstrip(".")
        )
    if options.delta is not None and options.agent != "glisp":
        raise SettingsError(f"only the agent glisp takes --delta, not {options.agent!r}")
    if not options.outcomes and options.agent != "glisp":
        raise SettingsError(
            f"only the agent glisp learns from KPIs: leave --no-outcomes out for {options.agent!r}"
        )
    check_questions(options)
    if options.cost is not None and options.agent not in BY_VALUE:
        raise SettingsError(
            f"only an agent that learns from scores ({', '.join(BY_VALUE)}) takes --cost, "
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
    make = attrgetter(AGENTS[options.agent])(prefcal_agents)
    agent: AnyAgent = make(
        scenario.space, n_init=options.n_init, n_max=options.n_max, seed=options.seed, **extra
    )
    return agent


def check_questions(options: Options) -> None:
    """Raise SettingsError if more than one question is asked of an agent that asks one."""
    if options.questions_per_experiment != 1 and options.agent != "glisp":
        raise SettingsError(
            f"only the agent glisp takes --questions-per-experiment above 1, not {options.agent!r}"
        )


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
    names = sorted(["human", *known])
    return (
        f"--calibrator must be one of {', '.join(names)} for scenario {scenario.name!r}"
        f"{hint}, got {calibrator!r}.{did_you_mean(calibrator, names)}"
    ).rstrip(".")


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
            f"calibrator {options.calibrator!r} takes neither --tie-band nor --answer-noise: "
            "it does not compare costs"
        )
    if options.tie_band is not None:
        calibrator = replace(calibrator, tie_band=options.tie_band)
    if options.answer_noise is not None:
        sure = options.answer_noise == 0
        calibrator = replace(calibrator, noise=None if sure else Thurstone(options.answer_noise))
    return calibrator


def follows_cost(options: Options, scenario: Scenario) -> bool:
    """Whether the answers follow the scenario's cost; a person has never chosen it.

    So it does with scores, a cost of the user's own (`--cost`), a calibrator called "synthetic",
    and any that has a latent cost in mind.
    """
    from prefcal_env.calibrators import LatentCost

    if scenario.cost is None:
        return False
    if options.calibrator in (SCORE, "synthetic") or options.cost is not None:
        return True
    made = scenario.calibrators.get(options.calibrator)
    return made is not None and isinstance(made(options.seed), LatentCost)


def _check_score(options: Options, scenario: Scenario) -> None:
    """Refuse what does not go with an agent that is told scores."""
    if scenario.cost is None:
        raise SettingsError(
            f"agent {options.agent!r} learns from a score, and scenario {scenario.name!r} has "
            "none: take another agent, or give one with --cost own.py:NAME"
        )
    if options.calibrator != SCORE:
        raise SettingsError(
            f"agent {options.agent!r} learns from the scenario's score and asks nobody: "
            f"leave --calibrator out, got {options.calibrator!r}"
        )
    if options.tie_band is not None or options.answer_noise is not None:
        raise SettingsError(
            f"agent {options.agent!r} is told exact scores: it takes neither --tie-band nor "
            "--answer-noise"
        )
