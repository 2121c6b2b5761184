"""What the answers of a study, with the KPIs of its experiments, can be asked about the person."""

from dataclasses import replace

from prefcal_agents.importance import Importance
from prefcal_agents.learned_index import LearnedIndex
from prefcal_agents.ledger import Comparison, Ledger
from prefcal_env.qp import make_backend
from prefcal_env.studies import State
from prefcal_scenarios.outcomes import seen
from prefcal_scenarios.scenario import Scenario

from .album import Album
from .memory import agent_state


def known_outcomes(state: State, album: Album) -> Ledger:
    """The answers, with the KPIs of every experiment, whatever the agent was told.

    So a study from before KPIs were recorded, or of an agent that does not learn from them, says
    as much as any other.
    """
    ledger = agent_state(state).ledger
    return replace(ledger, comparisons=tuple(_known(c, album) for c in ledger.comparisons))


def index_of(ledger: Ledger, seed: int) -> LearnedIndex | None:
    """The index that explains the answers in `ledger` best."""
    return LearnedIndex.of(ledger, seed, make_backend("piqp"))


def importance_of(ledger: Ledger, scenario: Scenario) -> Importance | None:
    """Which of the scenario's KPIs stand out in the answers of `ledger`."""
    return Importance.of(ledger, seen(scenario))


def _known(comparison: Comparison, album: Album) -> Comparison:
    told = comparison.answer.outcomes
    if told is not None and told[0] is not None:
        return comparison
    outcomes = album.outcomes(comparison.challenger, None)  # each is a challenger once
    return replace(comparison, answer=replace(comparison.answer, outcomes=outcomes))
