"""Find what the answers of a study, with the KPIs of its experiments, say about the person."""

from dataclasses import replace

from prefcal_agents.history.censored import judged
from prefcal_agents.history.lessons import Memory
from prefcal_agents.models.kpi_importance import Importance
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.qp import make_backend
from prefcal_env.study import State
from prefcal_scenarios.kpis import reading, seen
from prefcal_scenarios.scenario import Scenario

from .experiments import ExperimentStore
from .memory import agent_state


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
    return LearnedCost.of(Memory.of(history).history, seed, make_backend("piqp"))


def importance_of(history: History, scenario: Scenario) -> Importance | None:
    """Return which of the scenario's KPIs matter in the answers of `history`."""
    return Importance.of(history, seen(scenario), reading(scenario))


def _known(comparison: Comparison, store: ExperimentStore) -> Comparison:
    given = comparison.answer.outcomes
    if given is not None and given[0] is not None:
        return comparison
    outcomes = store.outcomes(comparison.challenger, None)  # each is a challenger once
    return replace(comparison, answer=replace(comparison.answer, outcomes=outcomes))
