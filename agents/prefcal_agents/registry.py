"""The list of agents: a new one is its file and a row here.

Extensions `register` agents of their own when they are imported. Rows are plain data,
so that `prefcal --help` can show the agents without loading any of them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from operator import attrgetter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from prefcal_env.knobs import KnobSpace

    from .agent import Agent, AgentState
    from .screening.bank import Simulate


@dataclass(frozen=True, slots=True)
class AgentRow:
    """One agent, as Python, command line, benchmark and saved studies know it."""

    name: str  # name in `prefcal_agents`: a class, or "CLASS.METHOD" for another way to make one
    module: str  # module of `package` that holds the class
    word: str = ""  # word for `prefcal calibrate --agent`; empty if it is not offered there
    about: str = ""  # remark in the help
    label: str = ""  # name in the benchmark's tables; empty: `name`
    by_value: bool = False  # whether it learns from scores; otherwise from preferences
    learns: bool = True  # whether it uses answers for more than keeping the winner
    simulates: bool = False  # whether it needs `simulate`, a function of θ that returns KPIs
    extra: str = ""  # extra of its distribution that it needs
    packages: Mapping[str, str] = field(default_factory=dict)  # modules of that extra to their distributions
    package: str = "prefcal_agents"  # package of `module`

    def load(self) -> Any:
        """Return the class, or the method that makes the agent, loaded now."""
        return attrgetter(self.name)(import_module(f"{self.package}.{self.module}"))


AGENTS = (
    AgentRow("Screening", "screening.agent", "screening", "simulates many θ, asks about few", simulates=True),
    AgentRow("GLISp", "glisp.agent", "glisp"),
    AgentRow("GLISp.paper", "glisp.agent", "glisp-paper", "the algorithm as published"),
    AgentRow(
        "GLIS", "baselines", "glis", "learns from the scenario's score, needs no answers", by_value=True
    ),
    AgentRow("EqualWeights", "baselines", learns=False, simulates=True),
    AgentRow("StepSearch", "baselines"),
    AgentRow("LatinHypercube", "baselines", "lhs", learns=False),
    AgentRow("RandomSearch", "baselines", "random", learns=False),
)
"""All agents of this package, in the order of tables and help."""

CLASSES: dict[str, AgentRow] = {row.name: row for row in AGENTS if "." not in row.name}
"""Class to row, also of registered ones; a saved state has the name of its agent's class."""
JUDGES: list[Callable[[Any], Mapping[str, Callable[[int], Any]]]] = []
"""Who else answers for a closed loop: functions of a scenario that return calibrators by name.

Each calibrator is a function of a seed. Extensions add theirs when they are imported.
"""
FAMILIES: dict[str, Callable[[int], Any]] = {}
"""Families of scenarios by name, such as "loop" for "loop-17": functions of a seed, of extensions."""
WORDS: Mapping[str, AgentRow] = {row.word: row for row in AGENTS if row.word}  # command-line word to row


def register(*rows: AgentRow) -> None:
    """Add agents of an extension, so that their saved states can be restored."""
    CLASSES.update({row.name: row for row in rows})


def agent_class(name: str) -> Any:
    """Return the class called `name`; creating it without its extra raises MissingExtraError.

    Raises:
        SettingsError: If no agent has that name, also none of an extension.
    """
    if name not in CLASSES:
        from prefcal_env.errors import SettingsError  # these load numpy
        from prefcal_env.optional import BENCHMARK, load_extensions

        load_extensions()
        if name not in CLASSES:
            known = f"the agent must be one of {sorted(CLASSES)}, got {name!r}"
            raise SettingsError(f"{known}. The benchmark has more: {BENCHMARK}")
    return CLASSES[name].load()


def restore(space: "KnobSpace", state: "AgentState", *, simulate: "Simulate | None" = None) -> "Agent":
    """Return the agent that `state` was taken from; its next query is identical.

    The state of an older version of the algorithm is accepted: its samples stay, and the current
    algorithm continues from them.

    Args:
        space: Space of the agent.
        state: Saved state.
        simulate: Function that simulates a θ, for an agent that needs one: a state holds no
            function. Without it, such an agent repeats its open query but proposes nothing new.

    Raises:
        SettingsError: If the agent is unknown, the state does not fit `space`, or the agent takes
            no `simulate`.
        MissingExtraError: If the agent needs an extra that is not installed.
    """
    agent: Any = agent_class(state.agent).restore(space, state)
    if simulate is not None:
        if not CLASSES[state.agent].simulates:
            from prefcal_env.errors import SettingsError  # loads numpy

            raise SettingsError(f"{state.agent} takes no simulate")
        agent = agent.with_simulations(simulate)
    restored: Agent = agent
    return restored
