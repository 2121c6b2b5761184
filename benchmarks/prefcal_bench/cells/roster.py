"""Agents that the benchmark knows by name, and users' own agents."""

import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property, partial
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from prefcal_agents.registry import AGENTS as REGISTRY
from prefcal_agents.registry import AgentRow
from prefcal_agents.screening.simulations import Simulate
from prefcal_bench.peers import PEERS
from prefcal_env.errors import MissingExtraError, ScenarioError, SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.own.own_file import module_at

Kind = Literal["preference", "value"]
Make = Callable[..., Any]
"""Function of space, n_init, n_max and seed, and of `simulate` if the agent simulates."""


@dataclass(frozen=True)
class Entry:
    """Agent known by name; nothing is imported until it is made.

    Args:
        name: Name in tables and on the command line.
        kind: Whether the agent learns from preferences, or from the value of each experiment.
        build: Function that makes the agent from space, n_init, n_max and seed.
        algorithm: Function that returns the version of the algorithm, including its settings.
        needs: Modules that must be installed.
        extra: Extra that installs them: `pip install prefcal[extra]`.
        learns: Whether the agent uses answers for more than keeping the winner.
        simulates: Whether the agent needs `simulate`, a function of θ that returns KPIs.
    """

    name: str
    kind: Kind
    build: Make
    algorithm: Callable[[], str]
    needs: tuple[str, ...] = ()
    extra: str = ""
    learns: bool = True
    simulates: bool = False

    def make(
        self,
        space: KnobSpace,
        n_init: int,
        n_max: int,
        seed: int,
        simulate: Simulate | None = None,
    ) -> Any:
        """Return the agent, which has `ask`, `tell`, `done` and `best`.

        Args:
            space: Knobs to tune.
            n_init: Number of experiments before the agent learns.
            n_max: Number of experiments.
            seed: Seed of the agent.
            simulate: Function of a physical θ that returns KPIs, for an agent that simulates.

        Raises:
            MissingExtraError: If a package is not installed.
            SettingsError: If a value is invalid.
        """
        if self.missing:
            raise MissingExtraError(self.missing)
        if self.simulates:
            return self.build(space, n_init, n_max, seed, simulate)
        return self.build(space, n_init, n_max, seed)

    @property
    def missing(self) -> str:
        """Return a message about packages that are not installed; empty if none is missing."""
        absent = [name for name in self.needs if not is_installed(name)]
        if not absent:
            return ""
        return f"{self.name} needs {', '.join(absent)}: pip install 'prefcal[{self.extra}]'"

    @cached_property
    def version(self) -> str:
        """Return the version of the algorithm; a new version runs its cells again."""
        return "" if self.missing else self.algorithm()


def entry(name: str) -> Entry:
    """Return the agent called `name`: one of `AGENTS`, or "path/to/own.py:Agent".

    Raises:
        SettingsError: If no agent has that name, or the object with that name is not an agent.
        ScenarioError: If the file does not exist or cannot be imported.
    """
    if name in AGENTS:
        return AGENTS[name]
    path, _, attribute = name.rpartition(":")
    if path.endswith(".py"):
        try:
            content = Path(path).read_bytes()
        except OSError as error:
            raise ScenarioError(f"no file {path!r} to load an agent from") from error
        return _own(name, hashlib.sha256(content).hexdigest())
    if attribute.endswith(".py"):
        raise SettingsError(f"{name!r} is a file: say which agent in it, {name}:NAME")
    raise SettingsError(
        f"no agent is called {name!r}.{did_you_mean(name, AGENTS)} "
        f"Expected {', '.join(AGENTS)} or path/to/own.py:Agent"
    )


@cache
def _own(name: str, version: str) -> Entry:
    """Return a user's agent; `version` is the hash of its file, so that a change reloads it."""
    path, _, attribute = name.rpartition(":")
    found = getattr(module_at(Path(path)), attribute, None)
    if not callable(found):
        raise SettingsError(f"{name!r} must name an agent's class, got {found!r}")
    simulates = _has_parameter(found, "simulate")
    make = partial(_make, found)
    return Entry(name, _kind(name, found), make, lambda: version, simulates=simulates)


def _kind(name: str, agent: Any) -> Kind:
    """Return what an agent is told, based on its `tell(query, answer)` or `tell(query, value)`."""
    tell = getattr(agent, "tell", None)
    if tell is None:
        raise SettingsError(f"{name!r} must have a method tell(query, answer) or (query, value)")
    return "value" if _has_parameter(tell, "value") else "preference"


def _has_parameter(function: Callable[..., Any], name: str) -> bool:
    """Return whether `name` is a parameter; False if nothing tells the parameters."""
    try:
        return name in inspect.signature(function).parameters
    except ValueError:  # of C code
        return False


def _make(
    agent: Callable[..., Any],
    space: KnobSpace,
    n_init: int,
    n_max: int,
    seed: int,
    simulate: Simulate | None = None,
    **further: Any,
) -> Any:
    given = further if simulate is None else {"simulate": simulate, **further}
    return agent(space, n_init=n_init, n_max=n_max, seed=seed, **given)


def _state_version(make: Make) -> str:
    """Return version and settings from the state of a new agent."""
    state = make(KnobSpace([Knob("x", 0, 1)]), 1, 2, 0, start=[0.5]).state  # proposes nothing
    return f"{state.version} {state.settings!r}"


def _row_entry(row: AgentRow) -> Entry:
    """Return the entry of a row of the registry."""
    make = partial(_make_row, row)

    def version() -> str:
        if not row.extra:
            return _state_version(make)
        found = [f"{package} {package_version(package)}" for package in row.packages.values()]
        return ", ".join([str(row.load().version), *found])

    kind: Kind = "value" if row.by_value else "preference"
    needs = (*row.packages, f"{row.package}.{row.module}") if row.extra else ()
    return Entry(
        row.label or row.name, kind, make, version, needs, row.extra, row.learns, row.simulates
    )


def _make_row(row: AgentRow, *arguments: Any, **further: Any) -> Any:
    return _make(row.load(), *arguments, **further)


def _glisp(name: str, **settings: Any) -> Entry:
    """Return the entry of GLISp with some settings changed."""
    make = partial(_make_glisp, tuple(settings.items()))
    return Entry(name, "preference", make, partial(_state_version, make))


def _make_glisp(settings: tuple[tuple[str, Any], ...], *arguments: Any, **further: Any) -> Any:
    from prefcal_agents import GLISp, GLISpSettings

    chosen = GLISpSettings(**dict(settings))
    return _make(GLISp, *arguments, settings=chosen, **further)


def is_installed(module: str) -> bool:
    """Return whether `module` could be imported; imports only its parents."""
    try:
        return find_spec(module) is not None
    except ModuleNotFoundError:
        return False


def package_version(name: str) -> str:
    """Return the version of an installed package."""
    try:
        return installed(name)
    except PackageNotFoundError:
        return "not installed"


VARIANTS = (
    _glisp("GLISp.no-outcomes", kpis=False),
    _glisp("GLISp.3-questions", questions_per_experiment=3),
    _glisp("GLISp.12-questions", questions_per_experiment=12),
)
"""GLISp with other settings, which the tables show after the registry's GLISp."""


def _make_roster() -> Mapping[str, Entry]:
    """Return all agents; GLISp comes first, since others are compared with the first agent."""
    entries = [_row_entry(row) for row in (*REGISTRY, *PEERS)]
    first = [one for one in entries if one.name.startswith("GLISp")]
    rest = [one for one in entries if one not in first]
    return MappingProxyType({one.name: one for one in (*first, *VARIANTS, *rest)})


AGENTS = _make_roster()
"""Agents by name, in the order of the tables."""


def in_order(agents: Iterable[str]) -> tuple[str, ...]:
    """Return agents in the order of the tables; users' own come before the blind searches."""
    names = list(AGENTS)

    def key(agent: str) -> tuple[int, int, str]:
        if agent not in AGENTS:
            return (1, 0, agent)
        return (0 if AGENTS[agent].learns else 2, names.index(agent), agent)

    return tuple(sorted(set(agents), key=key))
