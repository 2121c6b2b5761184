"""Agents that the benchmark knows by name, and users' own agents."""

import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.registry import AGENTS as REGISTRY
from prefcal_agents.screening.bank import Simulate
from prefcal_bench.peers import BANDITS, PEERS
from prefcal_env.errors import MissingExtraError, ScenarioError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.wording import did_you_mean
from prefcal_scenarios.own import module_at


@dataclass(frozen=True)
class Entry:
    """Agent known by name; nothing is imported until it is made."""

    name: str  # name in tables and on the command line
    # Function that returns the agent's class, or another function of space, `n_init`, `n_max` and `seed`, and
    # of `simulate` if the agent simulates
    load: Callable[[], Callable[..., Any]]
    by_value: bool = False  # whether it learns from the value of each experiment, otherwise from preferences
    # Modules that must be installed, to their distributions
    packages: Mapping[str, str] = field(default_factory=dict)
    extra: str = ""  # extra that installs them: `pip install prefcal-bench[extra]`
    learns: bool = True  # whether the agent uses answers for more than keeping the winner
    simulates: bool = False  # whether the agent needs `simulate`, a function of θ that returns KPIs
    content: str = ""  # hash of a user's own file, which is its version

    def make(
        self, space: KnobSpace, n_init: int, n_max: int, seed: int, simulate: Simulate | None = None
    ) -> Any:
        """Return the agent, which has `ask`, `tell`, `done` and `best`; arguments are those of `Agent`.

        With `simulate`, a function of a physical θ that returns KPIs, an agent that simulates does so.

        Raises:
            MissingExtraError: If a package is not installed.
            SettingsError: If a value is invalid.
        """
        if self.missing:
            raise MissingExtraError(self.missing)
        given = {"simulate": simulate} if self.simulates and simulate is not None else {}
        return self.load()(space, n_init=n_init, n_max=n_max, seed=seed, **given)

    @property
    def missing(self) -> str:
        """Return a message about packages that are not installed; empty if none is missing."""
        absent = [name for name in self.packages if find_spec(name) is None]
        if not absent:
            return ""
        return f"{self.name} needs {', '.join(absent)}: pip install 'prefcal-bench[{self.extra}]'"

    @cached_property
    def version(self) -> str:
        """Return the version of the algorithm; a new version runs its cells again.

        It names the packages that do the work, or the settings of a new agent.
        """
        if self.missing or self.content:
            return self.content
        agent = self.load()
        if self.packages:
            found = [f"{package} {package_version(package)}" for package in self.packages.values()]
            return ", ".join([str(getattr(agent, "version", "")), *found])
        space = KnobSpace([Knob("x", 0, 1)])
        state = agent(space, n_init=1, n_max=2, seed=0, start=[0.5]).state  # proposes nothing
        return f"{state.version} {state.settings!r}"


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
def _own(name: str, content: str) -> Entry:
    """Return a user's agent; `content` is the hash of its file, so that a change reloads it."""
    path, _, attribute = name.rpartition(":")
    found = getattr(module_at(Path(path)), attribute, None)
    if not callable(found):
        raise SettingsError(f"{name!r} must name an agent's class, got {found!r}")
    tell = getattr(found, "tell", None)
    if tell is None:
        raise SettingsError(f"{name!r} must have a method tell(query, answer) or (query, value)")
    by_value = bool(getattr(found, "by_value", _has_parameter(tell, "value")))
    simulates = _has_parameter(found, "simulate")
    return Entry(name, lambda: found, by_value, simulates=simulates, content=content)


def _has_parameter(function: Callable[..., Any], name: str) -> bool:
    """Return whether `name` is a parameter; False if nothing tells the parameters."""
    try:
        return name in inspect.signature(function).parameters
    except ValueError:  # of C code
        return False


def package_version(name: str) -> str:
    """Return the version of an installed package."""
    try:
        return installed(name)
    except PackageNotFoundError:
        return "not installed"


def _load_glisp(**settings: Any) -> Callable[..., Any]:
    """Return what makes GLISp with some settings changed."""
    return partial(GLISp, settings=GLISpSettings(**settings))


VARIANTS = (
    Entry("GLISp.no-outcomes", partial(_load_glisp, kpis=False)),
    Entry("GLISp.3-questions", partial(_load_glisp, questions_per_experiment=3)),
    Entry("GLISp.12-questions", partial(_load_glisp, questions_per_experiment=12)),
)
"""GLISp with other settings, which the tables show after the registry's GLISp."""


def _make_roster() -> Mapping[str, Entry]:
    """Return all agents; GLISp comes first, since others are compared with the first agent."""
    place = [row.name for row in REGISTRY].index("GLIS") + 1  # all that see values stand together
    rows = (*REGISTRY[:place], *BANDITS, *REGISTRY[place:], *PEERS)
    entries = [
        Entry(r.label or r.name, r.load, r.by_value, r.packages, r.extra, r.learns, r.simulates) for r in rows
    ]
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
