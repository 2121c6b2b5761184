"""A suite: the cells of a benchmark, and the combinations that are impossible."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from prefcal_bench.problems import CALIBRATORS, GUIDELINES, PROBLEMS, problem
from prefcal_env.errors import SettingsError
from prefcal_env.wording import did_you_mean

from .cell import Cell
from .roster import AGENTS, entry

QUICK_AGENTS = ("GLISp", "Screening", "GLIS", "RandomSearch")
QUICK_PROBLEMS = ("lag", "servo", "quadruple-tank", "camel", "hartman6", GUIDELINES)
QUICK_CALIBRATORS = ("weights", "priorities", "perfect", "lexicographic")
QUICK_SEEDS = 2  # a study of Screening takes 3 s of processor time, and one of it on the reactor 6
QUICK_EXPERIMENTS = 20
_NOISY = ("limits", "narrow", "hidden", "rising")
FULL_CALIBRATORS = tuple(name for name in CALIBRATORS if not (name.startswith(_NOISY) and "-" in name))
"""Everyone who answers, with wrong answers only where a taste is one of the first two."""
FULL_SEEDS = 20


@dataclass(frozen=True)
class Suite:
    """All possible combinations of agents, problems, calibrators and seeds.

    Value-based agents run only where the answers follow a value: with the calibrator "perfect" on
    problems with a cost, and with sure tastes that have a value of their own. Agents that simulate
    run only where experiments have KPIs, so not on test functions.

    Args:
        agents: Names in the roster, or path/to/own.py:Agent.
        problems: Names of problems, see `problem`.
        calibrators: Names of calibrators; each problem uses those that it has.
        seeds: Number of seeds: 0, 1, ...
        n_init: Number of experiments before an agent learns.
        n_max: Number of experiments.

    Raises:
        SettingsError: If a name is unknown or repeated, or a number is invalid.
        ScenarioError: If the file of a user's own agent cannot be loaded.
    """

    agents: Sequence[str]
    problems: Sequence[str]
    calibrators: Sequence[str]
    seeds: int = FULL_SEEDS
    n_init: int = 10
    n_max: int = 50

    def __post_init__(self) -> None:
        for word in self.calibrators:
            if word not in CALIBRATORS:
                raise SettingsError(
                    f"no calibrator is called {word!r}.{did_you_mean(word, CALIBRATORS)} "
                    f"Expected {', '.join(CALIBRATORS)}"
                )
        for name in self.problems:
            if name not in PROBLEMS:  # making one runs a few experiments, for its version
                problem(name)
        for name in ("agents", "problems", "calibrators"):
            words = list(getattr(self, name))
            if not words or len(set(words)) < len(words):
                raise SettingsError(f"{name} must be one or more different names, got {words}")
        for agent in self.agents:
            entry(agent)
        if isinstance(self.seeds, bool) or not isinstance(self.seeds, int) or self.seeds < 1:
            raise SettingsError(f"seeds must be an integer, 1 or more, got {self.seeds!r}")
        Cell("any", "any", "any", 0, self.n_init, self.n_max)

    @classmethod
    def quick(cls) -> "Suite":
        """Return our own agents, the default one among them, on three closed loops and a few more."""
        return cls(QUICK_AGENTS, QUICK_PROBLEMS, QUICK_CALIBRATORS, QUICK_SEEDS, n_max=QUICK_EXPERIMENTS)

    @classmethod
    def full(cls) -> "Suite":
        """Return the suite of all agents, problems and calibrators."""
        return cls(tuple(AGENTS), PROBLEMS, FULL_CALIBRATORS)

    @cached_property
    def cells(self) -> tuple[Cell, ...]:
        """Return all cells sorted by seed, so that early results cover all agents."""
        studies = [
            (agent, where, calibrator)
            for where in self.problems
            for calibrator in self.calibrators
            for agent in self.agents
            if not self._obstacle(agent, where, calibrator)
        ]
        return tuple(
            Cell(*study, seed, self.n_init, self.n_max) for seed in range(self.seeds) for study in studies
        )

    @cached_property
    def baseline(self) -> str:
        """Return the agent that others are compared with: the first named agent that runs."""
        running = {cell.agent for cell in self.cells}
        return next((agent for agent in self.agents if agent in running), self.agents[0])

    @cached_property
    def left_out(self) -> tuple[str, ...]:
        """Return descriptions of the named combinations that have no cells, with the reasons."""
        return tuple(dict.fromkeys(self._reasons()))

    def _reasons(self) -> Iterator[str]:
        for agent in self.agents:
            if entry(agent).missing:
                yield entry(agent).missing
                continue
            for where in self.problems:
                answering = [c for c in self.calibrators if c in problem(where).answering]
                reasons = {self._obstacle(agent, where, c) for c in answering or self.calibrators}
                if "" not in reasons:
                    yield f"{agent} on {where}: {'; '.join(sorted(reasons))}"

    def _obstacle(self, agent: str, where: str, calibrator: str) -> str:
        """Return why there is no such cell; empty if there is one."""
        one, place = entry(agent), problem(where)
        if one.missing:
            return one.missing
        if calibrator not in place.answering:
            return f"only {', '.join(place.answering)} answer there"
        if one.by_value and not place.has_value(calibrator):
            return "it learns from exact values, which the answers do not follow"
        if one.simulates and place.simulated is None:
            return "it simulates experiments for their KPIs, and there are none"
        return ""
