"""Between a study file and an agent: the configuration, and waking the agent up from a state."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from prefcal_agents import AgentState, Earlier, restore
from prefcal_agents.protocol.agent import Agent
from prefcal_env.errors import SettingsError, StudyError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.study import State, space_of
from prefcal_env.study import knobs_as_dicts as knobs_as_dicts
from prefcal_scenarios.scenario import Scenario, with_ranges


def constraint_names(space: KnobSpace) -> list[str]:
    """What a study remembers of the constraints: they are code, which the scenario brings."""
    return [constraint.name for constraint in space.constraints]


def agent_as_dict(agent: Agent) -> dict[str, Any]:
    """Return an agent's settings as plain data, without what it has learned."""
    return agent.state.configuration()


QUESTIONS = "questions_per_experiment"
"""Name of the agent's setting."""


def questions_of(configuration: Mapping[str, Any]) -> int:
    """Return the most comparisons per experiment that the agent of a study asks.

    Raises:
        StudyError: it is no whole number.
    """
    settings = configuration["agent"].get("settings")
    most = settings.get(QUESTIONS, 1) if isinstance(settings, Mapping) else 1
    if type(most) is not int:
        raise StudyError(f"{QUESTIONS} of a study must be a whole number, got {most!r}")
    return most


def check_space(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    """Refuse a study of other knobs or constraints than the scenario has today.

    Raises:
        StudyError: they differ.
    """
    _check_constraints(configuration, space)
    then, now = configuration["knobs"], knobs_as_dicts(space)
    if then == now:
        return
    then = then if isinstance(then, list) else []
    changed = [knob["name"] for knob in then if knob not in now]
    changed += [knob["name"] for knob in now if knob not in then]
    raise StudyError(
        f"the study was made with other knobs than the scenario has now: {sorted(set(changed))} "
        "differ in name, range, unit or scale (`prefcal studies respace` takes them over)"
    )


def _check_constraints(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    # Studies from before there were constraints have none.
    then, now = configuration.get("constraints", []), constraint_names(space)
    if not isinstance(then, list) or {str(name) for name in then} != set(now):
        raise StudyError(
            f"the study was made with the constraints {then} on the knobs, the scenario has {now} "
            "now: a study keeps those that it was begun with"
        )


def as_studied(scenario: Scenario, state: State) -> Scenario:
    """`scenario` with the space of the study, where that was changed since it was begun.

    Raises:
        StudyError: the scenario has other knobs now than when the study's were changed.
    """
    configuration = state.configuration
    if "respaced" not in configuration:
        return scenario
    check_space({**configuration, "knobs": configuration.get("scenario_knobs")}, scenario.space)
    space = with_constraints(space_of(configuration), scenario.space)
    about = {knob.name: knob.about for knob in scenario.space if knob.name in space.names}
    return with_ranges(scenario, space.described(about))


def with_constraints(space: KnobSpace, scenario: KnobSpace) -> KnobSpace:
    """`space` with the constraints of the scenario's: they are code, which no study holds."""
    return KnobSpace(
        space.knobs, scenario.constraints, within=dict(zip(space.names, space.within, strict=True))
    )


def agent_of(state: State, space: KnobSpace) -> Agent:
    """The agent of a study, with the identical next query.

    Raises:
        StudyError: a study of other knobs.
        SettingsError: an agent that this version does not know.
    """
    check_space(state.configuration, space)
    return restore(space, agent_state(state))


def agent_state(state: State) -> AgentState:
    """Return the state of the agent of a study. Raises SettingsError if it is none."""
    configured = AgentState.of(state.configuration["agent"], state.history)
    return replace(configured, n_max=state.n_max)


def earlier_of(state: State) -> Earlier:
    """Return the best that a study has found, for another one to start from.

    Raises:
        SettingsError: it has no answered experiment.
        StudyError: its knobs cannot be read.
    """
    best = state.history.incumbent
    if best is None:
        raise SettingsError("the earlier study has no answered experiment yet")
    return Earlier(space_of(state.configuration).knobs, state.history.samples[best].theta)
