"""From results to tables and the page: the one place that calls `bench.results`."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from .duels import Duel
from .result import Result
from .runner import Finished

Row = Mapping[str, Any]


@dataclass(frozen=True)
class Presented:
    """A benchmark as people and programs read it.

    Args:
        rows: Of the table, one for each problem, calibrator and agent.
        duels: One row for each agent and rival on a problem without a cost.
        page: The HTML page; None where none was written.
    """

    rows: list[Row]
    duels: list[Row]
    page: Path | None


def present(finished: Finished, folder: Path) -> Presented:
    """Make the tables, and write the page into `folder`."""
    return Presented(list(_rows(finished.results)), list(_tallies(finished.duels)), None)


def as_csv(rows: Sequence[Row]) -> str:
    """Rows as CSV with a heading; empty without rows."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    return text.getvalue()


def _rows(results: Sequence[Result]) -> Iterator[Row]:
    def place(result: Result) -> tuple[str, str, str]:
        return result.cell.problem, result.cell.calibrator, result.cell.agent

    for (problem, calibrator, agent), group in groupby(sorted(results, key=place), place):
        every = list(group)
        sound = [result for result in every if not result.failure]
        gaps = [result.gaps[-1] for result in sound if result.gaps]
        low, median, high = np.quantile(gaps, [0.25, 0.5, 0.75]) if gaps else [None] * 3
        times = [result.seconds for result in sound if result.seconds is not None]
        yield {
            "problem": problem,
            "calibrator": calibrator,
            "agent": agent,
            "seeds": len(sound),
            "failed": len(every) - len(sound),
            "gap_lower_quartile": low,
            "gap_median": median,
            "gap_upper_quartile": high,
            "seconds_per_proposal": float(np.median(times)) if times else None,
        }


def _tallies(duels: Sequence[Duel]) -> Iterator[Row]:
    def place(duel: Duel) -> tuple[str, str, str, str]:
        return duel.problem, duel.calibrator, duel.agent, duel.rival

    for (problem, calibrator, agent, rival), group in groupby(sorted(duels, key=place), place):
        outcomes = [duel.outcome for duel in group]
        yield {
            "problem": problem,
            "calibrator": calibrator,
            "agent": agent,
            "rival": rival,
            "seeds": len(outcomes),
            "wins": outcomes.count(-1),
            "ties": outcomes.count(0),
            "losses": outcomes.count(1),
            "share": outcomes.count(-1) / len(outcomes),
        }
