"""What the answers of a study, with the KPIs of its experiments, can be asked about the person."""

from dataclasses import replace

from prefcal_agents.models.kpi_importance import Importance
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.qp import make_backend
from prefcal_env.study import State
from prefcal_scenarios.kpis import seen
from prefcal_scenarios.scenario import Scenario

from .experiments import ExperimentStore
from .memory import agent_state


def known_outcomes(state: State, album: ExperimentStore) -> History:
    """The answers, with the KPIs of every experiment, whatever the agent was told.

    So a study from before KPIs were recorded, or of an agent that does not learn from them, says
    as much as any other.
    """
    history = agent_state(state).history
    return replace(history, comparisons=tuple(_known(c, album) for c in history.comparisons))


def index_of(history: History, seed: int) -> LearnedCost | None:
    """The index that explains the answers in `history` best."""
    return LearnedCost.of(history, seed, make_backend("piqp"))


def importance_of(history: History, scenario: Scenario) -> Importance | None:
    """Which of the scenario's KPIs stand out in the answers of `history`."""
    return Importance.of(history, seen(scenario))


def _known(comparison: Comparison, album: ExperimentStore) -> Comparison:
    told = comparison.answer.outcomes
    if told is not None and told[0] is not None:
        return comparison
    outcomes = album.outcomes(comparison.challenger, None)  # each is a challenger once
    return replace(comparison, answer=replace(comparison.answer, outcomes=outcomes))
