"""Agents of the registry, so that a new row is tested without another list."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from contracts.proposals import MIXED
from prefcal_agents import restore
from prefcal_agents.registry import AGENTS, AgentRow


def quick(theta: np.ndarray) -> dict[str, float]:
    """Return KPIs of any θ at once: those of `latent`, the cost of the contract suites."""
    far = (np.log1p(np.abs(theta)) - 1.0) ** 2
    return {"first": float(far[0]), "others": float(far[1:].sum()), "size": float(abs(theta[0]))}


def woken(agent: Any, space: Any, state: Any) -> Any:
    """Return the agent of `state`, restored with what `agent` simulates by, if it does."""
    simulate = getattr(agent, "simulate", None)
    twin = type(agent).restore(space, state)
    return twin if simulate is None else twin.with_simulations(simulate)


def agents_without_extra(*, by_value: bool = False) -> dict[str, Callable[..., Any]]:
    """Return what makes each agent that needs no extra, by name, for one kind of agents."""
    return {row.name: maker(row) for row in AGENTS if row.by_value is by_value and not row.extra}


def maker(row: AgentRow) -> Callable[..., Any]:
    """Return what makes the agent of `row`; one that simulates gets a quick `simulate`."""
    agent: Callable[..., Any] = row.load()
    return partial(agent, simulate=quick, n_simulated=40) if row.simulates else agent


def assert_a_state_wakes_up(row: AgentRow) -> None:
    """Check that the state of the agent of `row` restores one that goes on with the same question."""
    agent = maker(row)(MIXED, n_init=2, n_max=4, seed=7)
    twin = restore(MIXED, agent.state)
    assert type(twin) is type(agent)
    assert twin.ask() == agent.ask()
