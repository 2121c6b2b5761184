"""Turn command-line values into scenarios, costs, agents, calibrators and θ."""

import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import inf, isfinite
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

import prefcal_agents
from prefcal_agents.registry import WORDS
from prefcal_agents.transfer import Earlier
from prefcal_app.simulating import twin_of
from prefcal_app.terminal.lines import theta_of
from prefcal_env.errors import KnobError, ScenarioError, SettingsError
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.extensions import BENCHMARK, load_extensions
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Calibrator
from prefcal_env.study import space_of
from prefcal_env.wording import did_you_mean
from prefcal_scenarios import verification
from prefcal_scenarios.catalog import load
from prefcal_scenarios.kpis import outcome
from prefcal_scenarios.names import is_built_in
from prefcal_scenarios.own.own_file import module_at
from prefcal_scenarios.scenario import Scenario, finds_kpis

from .options import SCORE, SIMULATING, SYNTHETIC, Options
from .parameters import kept_by
from .studies.files import EXPERIMENT, existing, numbered, open_described

if TYPE_CHECKING:
    from prefcal_agents.protocol.agent import Agent

Thetas = Sequence[Float[np.ndarray, " n"]]


def with_cost(scenario: Scenario, source: str | None) -> Scenario:
    """Return `scenario` with another cost, lower is better.

    Args:
        scenario: Scenario whose cost is replaced.
        source: PATH:NAME of a function, or the name of a KPI; None leaves the scenario unchanged.

    Raises:
        ScenarioError: If there is no such KPI, the file or the name in it does not exist, or it
            cannot be called.
    """
    if source is None:
        return scenario
    path, _, name = source.rpartition(":")
    if not (path.endswith(".py") and name):
        names = [kpi.name for kpi in scenario.kpis if kpi.goal is not None]
        if source not in names and not finds_kpis(scenario):
            raise ScenarioError(_no_cost(source, names))
        return replace(scenario, cost=partial(_kpi_cost, source, scenario))
    found = getattr(module_at(Path(path)), name, None)
    if not callable(found):
        got = "nothing of that name" if found is None else repr(found)
        raise ScenarioError(f"cost {source!r} must be a function of an experiment, got {got}")
    return replace(scenario, cost=partial(_function_cost, source, found))


def _function_cost(source: str, function: Callable[[Experiment], Any], experiment: Experiment) -> float:
    """Return the cost of `experiment`. Raises ScenarioError if it is not a finite number."""
    value = function(experiment)
    if isinstance(value, bool) or not isinstance(value, Real) or not isfinite(float(value)):
        raise ScenarioError(
            f"cost {source!r} must give a finite number, got {value!r} at θ = "
            f"{experiment.theta.tolist()}. A KPI can be infinite, such as a settling time: "
            "bound it, for example min(kpis['settling_time'], 1e3)"
        )
    return float(value)


def _kpi_cost(name: str, scenario: Scenario, experiment: Experiment) -> float:
    """Return a KPI of `experiment`; infinite if it was stopped.

    Raises:
        ScenarioError: If it ran to its end and has no such KPI.
    """
    if not len(experiment.t) or experiment.end.interrupted:
        return inf  # it may have stopped before the KPI could be measured
    found = outcome(scenario, experiment)
    if name not in found:
        raise ScenarioError(_no_cost(name, found))
    return found[name]


def _no_cost(source: str, names: Iterable[str]) -> str:
    there = ", ".join(map(repr, names)) or "none"
    return (
        f"a cost must be path/to/own.py:NAME or a KPI of the scenario with a good direction "
        f"({there}), got {source!r}.{did_you_mean(source, names)}".rstrip(".")
    )


def make_agent(options: Options, scenario: Scenario, start: Thetas = ()) -> "Agent":
    """Return the agent that the options select; it starts with the physical θ in `start`.

    Raises:
        SettingsError: If the agent is unknown, rejects its settings, or does not take an option.
        KnobError: If a θ in `start` is outside the space.
    """
    _raise_first(_agent_problems(options, scenario))
    extra: dict[str, Any] = {}
    if options.agent in SIMULATING:
        extra["n_simulated"] = options.simulate
    if options.agent == "glisp":
        extra["settings"] = prefcal_agents.GLISpSettings(
            questions_per_experiment=options.questions_per_experiment, kpis=options.outcomes
        )
    if start:
        extra["start"] = start
    agent: Agent = WORDS[options.agent].load()(
        scenario.space, n_init=options.n_init, n_max=options.n_max, seed=options.seed, **extra
    )
    return agent


def check_agent_takes(options: Options) -> None:
    """Raise SettingsError if an option was set that the agent does not take."""
    _raise_first(_not_taken(options))


def _raise_first(problems: Iterator[str]) -> None:
    problem = next(problems, None)
    if problem is not None:
        raise SettingsError(problem)


def _agent_problems(options: Options, scenario: Scenario) -> Iterator[str]:
    """Yield what does not fit the agent; each line may rely on those above being in order."""
    if options.agent not in WORDS:
        hint = did_you_mean(options.agent, WORDS)
        known = ", ".join(WORDS)
        yield f"--agent must be one of {known}, got {options.agent!r}.{hint}".rstrip(".")
    yield from _not_taken(options)
    if options.cost is not None and options.calibrator not in (SCORE, SYNTHETIC):
        yield (
            "--cost is what the calibrator synthetic and the agent glis go by: add --calibrator "
            f"synthetic, or --agent glis; got --calibrator {options.calibrator}"
        )
    if options.agent in SIMULATING:
        yield from _simulating_problems(options, scenario)
    if WORDS[options.agent].by_value:
        yield from _score_problems(options, scenario)


def _not_taken(options: Options) -> Iterator[str]:
    for name, (parameter, kept) in kept_by(Options).items():
        if kept.agents and options.agent not in kept.agents and options.changed(name):
            yield (
                f"only the agent {' or '.join(kept.agents)} takes {parameter.flag}, not "
                f"{options.agent!r}: leave it out, or choose --agent {kept.agents[0]}"
            )


def _simulating_problems(options: Options, scenario: Scenario) -> Iterator[str]:
    agent, name = f"--agent {options.agent}", f"scenario {scenario.name!r}"
    if options.simulate < 1:
        yield f"{agent} needs simulations: leave --simulate 0 out, or choose --agent glisp"
    if options.n_init > 1:
        yield f"{agent} has no initial experiments: leave --n-init out"
    model = scenario if options.twin is None else load(options.twin)
    if options.twin is not None:
        twin_of(scenario, model)
    elif scenario.source.asks:
        yield (
            f"{name} is a rig, and nothing runs on it unseen: leave --simulate and {agent} out, "
            "or give a model of it with --twin"
        )
    elif not scenario.simulated:
        yield (
            f"{name} does not let experiments run unseen: leave --simulate and {agent} out, or, "
            "if it is your own and a run is a quick simulation, state "
            "Scenario(..., simulated=True)"
        )
    if options.robust:
        verification.cases.subject_of(model.source.elsewhere.here, model.space)


def _score_problems(options: Options, scenario: Scenario) -> Iterator[str]:
    if scenario.cost is None:
        yield (
            f"agent {options.agent!r} learns from a score, and scenario {scenario.name!r} has "
            "none: choose another agent, or give a score with --cost, the name of a KPI or "
            "own.py:NAME"
        )
    if options.calibrator != SCORE:
        yield (
            f"agent {options.agent!r} learns from the scenario's score and needs no answers: "
            f"leave --calibrator out, got {options.calibrator!r}"
        )


def make_calibrator(options: Options, scenario: Scenario) -> Calibrator[Experiment] | None:
    """Return the scenario's calibrator that the options select; None if the agent gets scores.

    Raises:
        SettingsError: If the calibrator is unknown.
    """
    if WORDS[options.agent].by_value:
        return None
    from prefcal_env.calibrators import LatentCost

    calibrators = dict(scenario.calibrators)
    if scenario.cost is not None and (options.cost is not None or not calibrators):
        cost = scenario.cost
        calibrators[SYNTHETIC] = lambda seed: LatentCost(cost, seed=seed)
    if options.calibrator not in calibrators and is_built_in(options.scenario):
        load_extensions()  # which have people for our closed loops
        calibrators.update(load(options.scenario).calibrators)
    if options.calibrator not in calibrators:
        raise SettingsError(_unknown(options.calibrator, scenario, sorted(calibrators)))
    return calibrators[options.calibrator](options.seed)


def _unknown(calibrator: str, scenario: Scenario, known: list[str]) -> str:
    """Return the error message for a calibrator that the scenario does not have."""
    name = f"scenario {scenario.name!r}"
    if scenario.source.asks:
        return f"{name} is a rig that only a person can run: its calibrator is human, got {calibrator!r}"
    if not known:
        kpi = next((kpi.name for kpi in scenario.kpis if kpi.goal is not None), "")
        such_as = f"--cost {shlex.quote(kpi)}" if kpi else "--cost NAME; `prefcal check` lists them"
        more = f". The benchmark has simulated people: {BENCHMARK}" if is_built_in(scenario.name) else ""
        return (
            f"{name} has no cost, so only people can compare: leave --calibrator {calibrator} out, "
            f"or say what to go by: a KPI ({such_as}), or a function in own.py with "
            f"--cost own.py:NAME{more}"
        )
    names = sorted(["human", *known])
    return (
        f"--calibrator must be one of {', '.join(names)} for {name}, "
        f"got {calibrator!r}.{did_you_mean(calibrator, names)}"
    ).rstrip(".")


def follows_cost(options: Options, scenario: Scenario) -> bool:
    """Return whether the answers follow the scenario's cost, which no person chose.

    This is the case for scores, for a user's own cost (`--cost`), for a calibrator called
    "synthetic", and for any calibrator that compares by a latent cost.
    """
    from prefcal_env.calibrators import LatentCost

    if scenario.cost is None:
        return False
    if options.calibrator in (SCORE, SYNTHETIC) or options.cost is not None:
        return True
    made = scenario.calibrators.get(options.calibrator)
    return made is not None and isinstance(made(options.seed), LatentCost)


def start_of(text: str, scenario: Scenario) -> Float[np.ndarray, " n"]:
    """Return the physical θ that `text` describes, shape (n,).

    The text is `knob=value, ...` for every knob in any order, the name of one of the scenario's
    references, or an experiment of a study, as MINE:3 or MINE:best.

    Raises:
        SettingsError: If a reference, knob or experiment is unknown, a knob is missing, a value is
            not a number, or the constraints refuse the θ of a study.
        KnobError: If a value is outside its knob's range, or the study has other knobs.
        StudyError: If there is no such study.
    """
    if "=" in text:
        return theta_of(text, scenario.space)
    if text not in scenario.references and (study := EXPERIMENT.fullmatch(text)) is not None:
        return _theta_of_study(study[1], study[2], scenario.space)
    if text not in scenario.references:
        known = sorted(scenario.references)
        raise SettingsError(
            f"--start must be KNOB=VALUE, ..., one of the references {known} of scenario "
            f"{scenario.name!r}, or STUDY:best, got {text!r}.{did_you_mean(text, known)}".rstrip(".")
        )
    return np.array(scenario.references[text], dtype=float)


def _theta_of_study(name: str, which: str, space: KnobSpace) -> Float[np.ndarray, " n"]:
    """Return the θ of an experiment of another study in `space`, shape (n,); see `Earlier`."""
    with open_described(existing(name)) as file:
        state = file.state
    theta = state.history.samples[numbered(name, which, state)].theta
    earlier = Earlier(space_of(state.configuration).knobs, theta)
    missing = earlier.missing(space, {})
    if missing:
        raise KnobError(f"study {name!r} has no knobs {missing}: give every knob, as KNOB=VALUE, ...")
    start = earlier.start(space)
    if start is None:
        raise SettingsError(f"the constraints refuse the θ of {name}:{which}: give one as KNOB=VALUE, ...")
    return np.array(start)
