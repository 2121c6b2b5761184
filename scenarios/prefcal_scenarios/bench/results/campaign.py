"""Results in order: who ran what, before whom, with which budget, and what is missing."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import SettingsError
from prefcal_scenarios.bench.cell import Cell
from prefcal_scenarios.bench.result import Result
from prefcal_scenarios.bench.results.order import in_order

HUGE = 1e300
"""Stands for an infinite gap, so that quantiles remain numbers."""
_FIRST_CALIBRATORS = ("perfect", "lexicographic")


@dataclass(frozen=True, slots=True, order=True)
class Regime:
    """What results must share to be compared: who answers, and how many experiments there are."""

    calibrator: str
    n_init: int
    n_max: int


@dataclass(frozen=True)
class Campaign:
    """Results of any subset of cells, in an order that does not depend on theirs.

    Made by `campaign_of`. The same agents, problems and seeds need not be there everywhere.

    Args:
        finished: The results with numbers, by regime, problem and agent, then by seed.
        failed: The others, in order.
    """

    finished: Mapping[tuple[Regime, str, str], Mapping[int, Result]]
    failed: tuple[Result, ...]

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """All of them, those that failed everywhere too."""
        names = {agent for _, _, agent in self.finished} | {r.cell.agent for r in self.failed}
        return in_order(names)

    @cached_property
    def regimes(self) -> tuple[Regime, ...]:
        """All of them; calibrators that are sure of themselves first."""
        found = {regime for regime, _, _ in self.finished} | {_regime(r.cell) for r in self.failed}
        return tuple(sorted(found, key=lambda r: (*_calibrator_key(r.calibrator), r)))

    def problems(self, regime: Regime, *, cost: bool | None = None) -> tuple[str, ...]:
        """Names of the problems of a regime, fewer knobs first.

        Args:
            regime: Which.
            cost: Only those with a cost (True) or without (False).
        """
        found = {p for r, p, _ in self.finished if r == regime}
        if cost is None:
            found |= {r.cell.problem for r in self.failed if _regime(r.cell) == regime}
        else:
            found = {p for p in found if self.has_cost(p) == cost}
        return tuple(sorted(found, key=lambda p: (self.knobs(p) or 0, p.lower(), p)))

    def runs(self, regime: Regime, problem: str, agent: str) -> Mapping[int, Result]:
        """The finished results by seed, in order; none if there are none."""
        return self.finished.get((regime, problem, agent), {})

    def failures(self, regime: Regime, problem: str, agent: str) -> tuple[int, ...]:
        """Seeds whose cells failed."""
        wanted = (regime, problem, agent)
        return tuple(
            r.cell.seed
            for r in self.failed
            if (_regime(r.cell), r.cell.problem, r.cell.agent) == wanted
        )

    def knobs(self, problem: str) -> int | None:
        """How many knobs a problem has, if any result tells."""
        return self._knobs.get(problem)

    def has_cost(self, problem: str) -> bool:
        """Whether gaps are known."""
        return problem in self._costs

    @cached_property
    def _knobs(self) -> Mapping[str, int]:
        return {r.cell.problem: len(r.best) for r in self}

    @cached_property
    def _costs(self) -> frozenset[str]:
        return frozenset(r.cell.problem for r in self if r.gaps is not None)

    def __iter__(self) -> Iterator[Result]:
        for runs in self.finished.values():
            yield from runs.values()


def campaign_of(results: Iterable[Result]) -> Campaign:
    """Put results in order; a result that is there twice counts once.

    Raises:
        SettingsError: something that is no `Result`, numbers that contradict each other, or two
            different results of one cell.
    """
    by_cell: dict[Cell, Result] = {}
    for result in results:
        _check(result)
        known = by_cell.setdefault(result.cell, result)
        if known != result:
            raise SettingsError(f"two different results of one cell: {result.cell}")
    ordered = sorted(by_cell.values(), key=_key)
    finished: dict[tuple[Regime, str, str], dict[int, Result]] = {}
    for r in ordered:
        if not r.failure:
            place = (_regime(r.cell), r.cell.problem, r.cell.agent)
            finished.setdefault(place, {})[r.cell.seed] = r
    campaign = Campaign(finished, tuple(r for r in ordered if r.failure))
    for r in campaign:
        if r.gaps is None and campaign.has_cost(r.cell.problem):
            raise SettingsError(f"other results of {r.cell.problem!r} have gaps, not so {r.cell}")
    return campaign


def curve(result: Result, *, returned: bool = True) -> Float[np.ndarray, " n_max"]:
    """Gap after each of n_max experiments; a study that ended before keeps its last one.

    Args:
        result: A finished one of a problem with a cost.
        returned: Of what the agent would return; else of the best point visited.
    """
    gaps = result.gaps if returned else result.visited
    assert gaps is not None
    known = np.minimum(np.array(gaps, dtype=float), HUGE)[: result.cell.n_max]
    return np.pad(known, (0, result.cell.n_max - len(known)), mode="edge")


def _regime(cell: Cell) -> Regime:
    return Regime(cell.calibrator, cell.n_init, cell.n_max)


def _key(result: Result) -> tuple[object, ...]:
    c = result.cell
    return (c.calibrator, c.n_init, c.n_max, c.problem, c.agent, c.seed)


def _calibrator_key(name: str) -> tuple[int, str]:
    known = _FIRST_CALIBRATORS
    return (known.index(name) if name in known else len(known), name)


def _check(result: Result) -> None:
    if not isinstance(result, Result):
        raise SettingsError(f"results must be of type Result, got {result!r}")
    if result.failure:
        return
    if not result.best or not result.questions:
        raise SettingsError(f"a result without failure must have numbers, got {result}")
    for name in ("gaps", "visited"):
        values = getattr(result, name)
        if values is None:
            continue
        if len(values) != len(result.questions):
            raise SettingsError(
                f"{name} and questions must be of one length, got {len(values)} and "
                f"{len(result.questions)} in {result.cell}"
            )
        if np.isnan(values).any() or min(values) == -np.inf:
            raise SettingsError(f"{name} must be numbers, got {min(values)} in {result.cell}")
