"""Collect results in one table with a row for each study, in a canonical order."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from jaxtyping import Float

from prefcal_bench.cells.cell import Cell
from prefcal_bench.cells.result import Result
from prefcal_bench.cells.roster import in_order
from prefcal_env.errors import SettingsError

from .curves import Setting, padded, set_order, setting_key

HUGE = 1e300
"""Value that replaces an infinite gap, so that quantiles remain numbers."""
_NUMBERS = ("knobs", "gap", "visited", "questions", "seconds")
_COLUMNS = (
    "setting", "problem", "agent", "seed", "failure", "cost", "knobs", "gap", "visited",
    "questions", "seconds", "curve", "asked", "worth",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Campaign:
    """Results of any subset of cells, made by `campaign_of`.

    Args:
        studies: Table with a row for each cell and the columns setting, problem, agent (categories
            in the order of the tables), seed, failure (text, empty if finished), cost (whether
            gaps are known), knobs, gap (of the returned θ at the end), visited (smallest gap),
            questions (at the end), seconds, curve (gap after each experiment), asked (questions
            by then), worth (whether results are judged by their worth); NaN or None for missing
            numbers.
    """

    studies: pd.DataFrame

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Return all agents, including those that failed everywhere."""
        return tuple(self.studies["agent"].cat.categories)

    @cached_property
    def settings(self) -> tuple[Setting, ...]:
        """Return all settings; those with a calibrator that is never wrong come first."""
        return tuple(self.studies["setting"].cat.categories)

    @cached_property
    def finished(self) -> pd.DataFrame:
        """Return the studies that finished."""
        return self.studies[self.studies["failure"] == ""]

    @cached_property
    def failed(self) -> pd.DataFrame:
        """Return the studies that failed."""
        return self.studies[self.studies["failure"] != ""]

    def problems(self, setting: Setting, *, cost: bool = False) -> tuple[str, ...]:
        """Return the problems of a setting, sorted by number of knobs.

        Args:
            setting: Setting of the results.
            cost: Whether to return only problems with known gaps.
        """
        found = self.costly(setting) if cost else self.studies[self.studies["setting"] == setting]
        return tuple(found["problem"].cat.remove_unused_categories().cat.categories)

    def costly(self, setting: Setting) -> pd.DataFrame:
        """Return the finished studies of a setting whose gaps are known."""
        return self.finished[(self.finished["setting"] == setting) & self.finished["cost"]]

    def knobs(self, problem: str) -> int | None:
        """Return the number of knobs of a problem; None if no result shows it."""
        return self._knobs.get(problem)

    @cached_property
    def _knobs(self) -> dict[str, int]:
        first = self.finished.groupby("problem", observed=True)["knobs"].first()
        return {problem: int(count) for problem, count in first.items()}


def campaign_of(results: Iterable[Result]) -> Campaign:
    """Return the campaign for results in any order; duplicates count once.

    Raises:
        SettingsError: If numbers contradict each other, or a cell has two different results.
    """
    by_cell: dict[Cell, Result] = {}
    for result in results:
        _check(result)
        if by_cell.setdefault(result.cell, result) != result:
            raise SettingsError(f"two different results of one cell: {result.cell}")
    ordered = sorted(by_cell.values(), key=_key)
    frame = pd.DataFrame([_row(result) for result in ordered], columns=_COLUMNS)
    frame = frame.astype({"cost": bool, "worth": bool, **dict.fromkeys(_NUMBERS, float)})
    costly = set(frame.loc[frame["cost"], "problem"])
    for r in ordered:
        alone = not r.failure and r.gaps is None and r.worth is None
        if alone and r.cell.problem in costly:
            raise SettingsError(f"other results of {r.cell.problem!r} have gaps, not so {r.cell}")
    knobs = frame.groupby("problem")["knobs"].max().fillna(0)
    orders = {
        "setting": sorted(frame["setting"].unique(), key=setting_key),
        "problem": sorted(knobs.index, key=lambda p: (knobs[p], p.lower(), p)),
        "agent": in_order(frame["agent"]),
    }
    set_order(frame, orders)
    return Campaign(frame)


def _row(result: Result) -> tuple[object, ...]:
    cell, failed = result.cell, bool(result.failure)
    setting = Setting(cell.calibrator, cell.n_init, cell.n_max)
    curve = None if failed or result.gaps is None else _curve(result.gaps, cell.n_max)
    seen = None if failed or result.visited is None else _curve(result.visited, cell.n_max)
    return (
        setting, cell.problem, cell.agent, cell.seed, result.failure, curve is not None,
        None if failed else len(result.best), np.nan if curve is None else curve[-1],
        np.nan if seen is None else seen[-1], np.nan if failed else result.questions[-1],
        np.nan if result.seconds is None else result.seconds, curve, result.questions,
        result.worth is not None,
    )  # fmt: skip


def _curve(gaps: tuple[float, ...], n_max: int) -> Float[np.ndarray, " n_max"]:
    """Return the gap after each of n_max experiments."""
    return padded(np.minimum(np.array(gaps, dtype=float), HUGE), n_max)


def _key(result: Result) -> tuple[object, ...]:
    c = result.cell
    return (c.calibrator, c.n_init, c.n_max, c.problem, c.agent, c.seed)


def _check(result: Result) -> None:
    if result.failure:
        return
    if not result.best or not result.questions:
        raise SettingsError(f"a result without failure must have numbers, got {result}")
    for name in ("gaps", "visited"):
        values = getattr(result, name)
        if values is not None and min(values) == -np.inf:
            raise SettingsError(f"{name} must be numbers, got {min(values)} in {result.cell}")
