"""Translate between a study file and an agent, and restore the agent from a state."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

from prefcal_agents import restore
from prefcal_agents.history.agent_state import AgentState
from prefcal_agents.history.lessons import Memory, judged
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_agents.protocol.agent import Agent
from prefcal_agents.registry import CLASSES
from prefcal_agents.screening.agent import Screening
from prefcal_app.simulating import Simulator, simulates
from prefcal_env.errors import StudyError
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.study import State, space_of
from prefcal_env.study import knobs_as_dicts as knobs_as_dicts
from prefcal_scenarios.scenario import Scenario, with_ranges

from .experiments import ExperimentStore


def constraint_names(space: KnobSpace) -> list[str]:
    """Return the names of the constraints, which the study stores; the code is the scenario's."""
    return [constraint.name for constraint in space.constraints]


def agent_as_dict(agent: Agent) -> dict[str, Any]:
    """Return an agent's settings as plain data, without what it has learned."""
    return agent.configuration


QUESTIONS = "questions_per_experiment"
"""Name of the agent's setting for comparisons per experiment."""


def questions_of(configuration: Mapping[str, Any]) -> int:
    """Return the maximum number of comparisons per experiment of a study's agent.

    Raises:
        StudyError: If it is not a whole number.
    """
    settings = configuration["agent"].get("settings")
    most = settings.get(QUESTIONS, 1) if isinstance(settings, Mapping) else 1
    if type(most) is not int:
        raise StudyError(f"{QUESTIONS} of a study must be a whole number, got {most!r}")
    return most


def check_space(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    """Check that a study has the scenario's present knobs and constraints.

    Raises:
        StudyError: If they differ.
    """
    _check_constraints(configuration, space)
    then, now = configuration["knobs"], knobs_as_dicts(space)
    if then == now:
        return
    then = then if isinstance(then, list) else []
    changed = [knob["name"] for knob in then if knob not in now]
    changed += [knob["name"] for knob in now if knob not in then]
    raise StudyError(
        f"the scenario's knobs have changed since the study was started: {sorted(set(changed))} "
        "differ in name, range, unit or scale (`prefcal studies respace` updates the study)"
    )


def _check_constraints(configuration: Mapping[str, Any], space: KnobSpace) -> None:
    # Studies from before there were constraints have none.
    then, now = configuration.get("constraints", []), constraint_names(space)
    if not isinstance(then, list) or {str(name) for name in then} != set(now):
        raise StudyError(
            f"the scenario's constraints have changed since the study was started: expected {then}, got {now}"
        )


def as_studied(scenario: Scenario, state: State) -> Scenario:
    """Return `scenario` with the space of the study, if that was changed after the start.

    Raises:
        StudyError: If the scenario's knobs have changed since the study's were changed.
    """
    configuration = state.configuration
    if "respaced" not in configuration:
        return scenario
    check_space({**configuration, "knobs": configuration.get("scenario_knobs")}, scenario.space)
    space = with_constraints(space_of(configuration), scenario.space)
    about = {knob.name: knob.about for knob in scenario.space if knob.name in space.names}
    return with_ranges(scenario, space.described(about))


def with_constraints(space: KnobSpace, scenario: KnobSpace) -> KnobSpace:
    """Return `space` with the scenario's constraints, whose code is not in the study."""
    return KnobSpace(
        space.knobs, scenario.constraints, within=dict(zip(space.names, space.within, strict=True))
    )


def agent_of(state: State, space: KnobSpace, simulator: Simulator | None = None) -> Agent:
    """Return the agent of a study, restored with the identical next query.

    Args:
        state: State of the study.
        space: Knobs of the study.
        simulator: What an agent that simulates does so with; without it, it proposes nothing new.

    Raises:
        StudyError: If the study has other knobs.
        SettingsError: If this version does not know the agent.
    """
    check_space(state.configuration, space)
    agent = restore(space, agent_state(state))
    if simulator is None or not simulates(agent):
        return agent
    return cast(Screening, agent).with_simulations(simulator)


def is_simulating(state: State) -> bool:
    """Return whether the agent of a study needs a simulator."""
    row = CLASSES.get(str(state.configuration["agent"].get("agent")))
    return row is not None and row.simulates


def is_robust(state: State) -> bool:
    """Return whether a study judges its candidates by perturbed runs."""
    return bool(state.configuration.get("options", {}).get("robust"))


def agent_state(state: State) -> AgentState:
    """Return the state of a study's agent. Raises SettingsError if it is invalid."""
    configured = AgentState.of(state.configuration["agent"], state.history)
    return replace(configured, n_max=state.n_max)


def known_outcomes(state: State, store: ExperimentStore) -> History:
    """Return the answers with the KPIs of every experiment, even if the agent did not get them.

    So studies from before KPIs were recorded, and agents that do not learn from KPIs, can be
    analyzed like any other.
    """
    history = agent_state(state).history
    known = replace(history, comparisons=tuple(_known(c, store) for c in history.comparisons))
    return judged(known)


def index_of(history: History, seed: int) -> LearnedCost | None:
    """Return the weighted sum of KPIs that explains the answers in `history` best.

    As for a proposal, at most 250 answers count: with 1,000, a person would wait for seconds.
    """
    return LearnedCost.of(Memory.of(history).history, seed)


def trust_text(index: LearnedCost) -> str:
    """Return how reliable a learned sum of KPIs is."""
    right = f"{index.predicted} of {index.answers} answers that it had not learned from"
    doubt = "" if index.explains else ": not clearly better than chance"
    return f"A weighted sum of the KPIs predicted {right}{doubt}."


def _known(comparison: Comparison, store: ExperimentStore) -> Comparison:
    given = comparison.answer.outcomes
    if given is not None and given[0] is not None:
        return comparison
    outcomes = store.outcomes(comparison.challenger, None)  # each is a challenger once
    return replace(comparison, answer=replace(comparison.answer, outcomes=outcomes))
