"""Which studies each part of the campaign needs, as suites of the benchmark."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from prefcal_bench.cells.suite import Suite
from prefcal_scenarios.names import CLOSED_LOOPS

SCREENING, GLISP, RANDOM, PEER = "Screening", "GLISp", "RandomSearch", "BOPE"
AGENTS = (SCREENING, "EqualWeights", GLISP, "GLISp.no-outcomes", RANDOM, PEER)
GROUPS = {
    "held-out": tuple(f"loop-{number}" for number in range(900, 915)),
    "named": tuple(name for name in CLOSED_LOOPS if not name.startswith("mpc-")),
    "cases": ("cstr", "overtake"),
    "rough": tuple(f"rough-{number}" for number in range(8)),
    "rough-held-out": tuple(f"rough-{number}" for number in range(900, 915)),
}
"""Loops by group. Nobody develops or tunes an agent on those that are held out."""
DEVELOPED = ("rough",)
"""Groups on which agents are developed: they run only if asked for."""
OTHERS = ("ideal", "majority", "ranks", "curves")
"""People with eyes whose form the learner does not have; the headline is about them."""
TASTES = ("weights", "priorities", "limits", "narrow", "rising", "trade", "order", *OTHERS)
"""The first five notice every difference, at least in the end. The learner has trade-offs and
orders, too."""
NOISES = ("-noisy10", "-noisy20")
REACTOR_SHOWN, OVERTAKING_SHOWN = 12, 10
_N_INIT = 10


@dataclass(frozen=True)
class Selection:
    """What the options select.

    Args:
        agents: Agents, of `AGENTS`.
        loops: Names of loops by group.
        tastes: Kinds of tastes, without those whose KPIs are hidden.
        noisy: Kinds of tastes that also answer with mistakes.
        seeds: Number of seeds of each loop and taste.
        case_seeds: Number of seeds of the reactor and of the overtaking.
        case_agents: Agents on the reactor and the overtaking.
        longest: Largest number of answers given to Screening on the loops.
    """

    agents: Sequence[str]
    loops: dict[str, Sequence[str]]
    tastes: Sequence[str]
    noisy: Sequence[str]
    seeds: int
    case_seeds: int
    case_agents: Sequence[str]
    longest: int = 20

    @property
    def all_loops(self) -> tuple[str, ...]:
        """Return the loops of all groups."""
        return tuple(loop for loops in self.loops.values() for loop in loops)


def suites(part: str, choice: Selection) -> Iterator[Suite]:
    """Yield the suites of a part: one for each number of experiments.

    Agents of which the number of experiments changes no experiment run once, for the longest.
    """
    if part == "reactor":
        yield _suite(choice.case_agents, ("cstr",), ("perfect",), choice.case_seeds, REACTOR_SHOWN)
    elif part == "overtaking":
        found = (choice.case_agents, ("overtake",), ("lexicographic",), choice.case_seeds)
        yield _suite(*found, OVERTAKING_SHOWN)
    else:
        yield from _on_loops(part, choice)


def _on_loops(part: str, choice: Selection) -> Iterator[Suite]:
    tastes = {
        "loops": tuple(choice.tastes),
        "noise": tuple(f"{kind}{end}" for kind in choice.noisy for end in ("", *NOISES)),
        "hidden": ("hidden",),
    }[part]
    by_budget: dict[int, list[str]] = {}
    for agent in choice.agents:
        for n_max in _budgets(part, agent, choice.longest):
            by_budget.setdefault(n_max, []).append(agent)
    for n_max, agents in sorted(by_budget.items()):
        yield _suite(agents, choice.all_loops, tastes, choice.seeds, n_max)


def _budgets(part: str, agent: str, longest: int) -> tuple[int, ...]:
    """Return the numbers of experiments of an agent's studies; none if it is not in the part."""
    if part == "noise":
        return {SCREENING: (21,), GLISP: (51,)}.get(agent, ())
    if part == "hidden":
        return () if agent == PEER else (51,)
    if agent == SCREENING:  # it plans ahead for the number that is shown
        return tuple(answers + 1 for answers in (10, 20, 50) if answers <= longest)
    return (21,) if agent == PEER else (51,)


def _suite(
    agents: Sequence[str], loops: Sequence[str], tastes: Sequence[str], seeds: int, n_max: int
) -> Suite:
    n_init = min(_N_INIT, n_max // 2)  # as `prefcal bench` chooses it
    return Suite(tuple(agents), tuple(loops), tastes, seeds, n_init, n_max)
