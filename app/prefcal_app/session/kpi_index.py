"""Learn the weighted sum of KPIs that explains the answers of a study best."""

from dataclasses import replace

from prefcal_agents.history.lessons import Memory, judged
from prefcal_agents.models.learned_cost import LearnedCost
from prefcal_env.preferences.history import Comparison, History
from prefcal_env.study import State

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
