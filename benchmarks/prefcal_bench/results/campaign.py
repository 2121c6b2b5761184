"""Collect results in one table with a row for each study, in a canonical order."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from prefcal_bench.cells.cell import Cell, Result
from prefcal_bench.cells.roster import in_order
from prefcal_bench.problems import CALIBRATORS, NOISES, PROBLEMS
from prefcal_env.errors import SettingsError

STUDY = ("taste", "n_init", "n_max", "loop", "agent", "seed")
"""Columns that identify a study in a published frame."""
COLUMNS = (*STUDY, "experiment", "answers", "worth")
"""Columns of a published frame, which has a row for each experiment: see `campaign_of`."""
HUGE = 1e300  # value that replaces an infinite gap, so that quantiles remain numbers
_PLACE = ["setting", "problem", "agent", "seed"]
_COLUMNS = (*_PLACE, "failure", "knobs", "gap", "visited", "worth", "asked", "seconds", "published")


@dataclass(frozen=True, slots=True, order=True)
class Setting:
    """What studies share that can be compared: who answers, and the number of experiments."""

    calibrator: str
    n_init: int
    n_max: int

    @property
    def noisy(self) -> bool:
        """Return whether some answers are wrong on purpose."""
        return self.calibrator.rpartition("-")[2] in NOISES

    def name(self, settings: Iterable["Setting"], kind: str = "") -> str:
        """Return a name that distinguishes this one of `settings` from the others."""
        if len({(s.n_init, s.n_max) for s in settings}) < 2:
            return f"{self.calibrator}{kind}"
        return f"{self.calibrator}{kind}, {self.n_max} experiments ({self.n_init} initial)"


@dataclass(frozen=True, eq=False)
class Campaign:
    """Results of any subset of cells, and published studies beside them; see `campaign_of`.

    Args:
        studies: TextTable with a row for each study and the columns setting, problem, agent (categories
            in the order of the tables), seed, failure (text, empty if finished), knobs (number),
            gap, worth (of the θ that the agent would return after each of n_max experiments, shape
            (n_max,); None if the problem has none), visited (smallest gap), asked (answers given up
            to each experiment), seconds (of a proposal) and published (whether it came with the
            published studies); NaN or None for missing numbers.
    """

    studies: pd.DataFrame

    @cached_property
    def ours(self) -> pd.DataFrame:
        """Return the studies that were not published before."""
        return self.studies[~self.studies["published"]]

    @cached_property
    def finished(self) -> pd.DataFrame:
        """Return our studies that finished."""
        return self.ours[self.ours["failure"] == ""]

    @cached_property
    def failed(self) -> pd.DataFrame:
        """Return our studies that failed."""
        return self.ours[self.ours["failure"] != ""]

    @cached_property
    def settings(self) -> tuple[Setting, ...]:
        """Return all settings; those with a calibrator that is never wrong come first."""
        return tuple(self.studies["setting"].cat.categories)

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Return all agents, including those that failed everywhere."""
        return tuple(self.studies["agent"].cat.categories)

    def of(self, setting: Setting, value: str) -> pd.DataFrame:
        """Return the finished studies of a setting that have a "gap" or a "worth"."""
        studies = self.studies
        return studies[(studies["setting"] == setting) & studies[value].notna()]

    def having(self, value: str) -> tuple[Setting, ...]:
        """Return the settings in which studies have a "gap" or a "worth"."""
        return tuple(setting for setting in self.settings if len(self.of(setting, value)))

    def knobs(self, problem: str) -> int | None:
        """Return the number of knobs of a problem; None if no result shows it."""
        return self._knobs.get(problem)

    @cached_property
    def _knobs(self) -> dict[str, int]:
        first = self.finished.groupby("problem", observed=True)["knobs"].first().dropna()
        return {problem: int(count) for problem, count in first.items()}


def problems_of(studies: pd.DataFrame) -> tuple[str, ...]:
    """Return the problems of studies, in the order of the tables."""
    return tuple(studies["problem"].cat.remove_unused_categories().cat.categories)


def campaign_of(results: Iterable[Result], published: pd.DataFrame | None = None) -> Campaign:
    """Return the campaign for results in any order; duplicates count once.

    Args:
        results: Results of our studies.
        published: Worth of other studies, with the columns `COLUMNS` and a row for each experiment
            in any order: loop is the problem, taste the calibrator, experiment counts from 0, and
            answers is the number of answers up to that experiment. Our worth is rounded as theirs
            (float32), so that equal ones tie.

    Raises:
        SettingsError: If numbers contradict each other, a worth is below 1, a cell has two
            different results, or a published study lacks experiments before its last one.
    """
    ours = _unique(results)
    rows = [_row(result, rounded=published is not None) for result in ours]
    rows += [] if published is None else _published(published)
    frame = pd.DataFrame(rows, columns=_COLUMNS).astype({"published": bool, "seconds": float})
    for row in frame[frame.duplicated(_PLACE)].itertuples():
        where = f"{row.problem}, {row.setting.calibrator}"
        raise SettingsError(f"two studies of {row.agent} on {where}")
    costly = set(frame.loc[frame["gap"].notna(), "problem"])
    for r in ours:
        alone = not r.failure and r.gaps is None and r.worth is None
        if alone and r.cell.problem in costly:
            raise SettingsError(f"other results of {r.cell.problem!r} have gaps, not so {r.cell}")
    orders: dict[str, Iterable[Any]] = {
        "setting": sorted(set(frame["setting"]), key=_setting_key),
        "problem": sorted(set(frame["problem"]), key=_problem_key),
        "agent": in_order(frame["agent"]),
    }
    for name, order in orders.items():
        frame[name] = pd.Categorical(frame[name], categories=list(order), ordered=True)
    return Campaign(frame.sort_values(_PLACE, ignore_index=True))


def after_answers(
    values: Float[np.ndarray, " n_max"], asked: Int[np.ndarray, " n_max"], count: int
) -> Float[np.ndarray, " {count}+1"]:
    """Return gap or worth after 0, 1, ..., `count` answers, from the last experiment by then."""
    place = np.searchsorted(asked, np.arange(count + 1), side="right") - 1
    return np.asarray(values[np.maximum(place, 0)])


def _unique(results: Iterable[Result]) -> list[Result]:
    by_cell: dict[Cell, Result] = {}
    for result in results:
        if not result.failure and not (result.best and result.questions):
            raise SettingsError(f"a result without failure must have numbers, got {result}")
        for name in ("gaps", "visited"):
            if -np.inf in (getattr(result, name) or ()):
                raise SettingsError(f"{name} must be numbers, got -inf in {result.cell}")
        if by_cell.setdefault(result.cell, result) != result:
            raise SettingsError(f"two different results of one cell: {result.cell}")
    return list(by_cell.values())


def _row(result: Result, *, rounded: bool) -> tuple[object, ...]:
    cell, n_max = result.cell, result.cell.n_max
    setting = Setting(cell.calibrator, cell.n_init, n_max)
    place = (setting, cell.problem, cell.agent, cell.seed, result.failure)
    if result.failure:
        return (*place, np.nan, None, np.nan, None, None, np.nan, False)
    gap, visited = (
        None if gaps is None else _padded(np.minimum(gaps, HUGE), n_max)
        for gaps in (result.gaps, result.visited)
    )
    kind = "float32" if rounded else "float64"
    worth = None if result.worth is None else _checked(np.array(result.worth, kind), n_max)
    return (
        *place,
        len(result.best),
        gap,
        np.nan if visited is None else visited[-1],
        worth,
        _padded(np.array(result.questions), n_max),
        np.nan if result.seconds is None else result.seconds,
        False,
    )


def _published(frame: pd.DataFrame) -> Iterator[tuple[object, ...]]:
    """Yield a row for each study of a frame with the columns `COLUMNS`."""
    ordered = frame.sort_values([*STUDY, "experiment"], kind="stable")
    for (taste, n_init, n_max, loop, agent, seed), study in ordered.groupby(list(STUDY)):
        experiments = study["experiment"].to_numpy()
        if len(set(experiments)) < len(experiments):
            raise SettingsError(f"two studies of {agent} on {loop}, {taste}")
        if len(wrong := np.flatnonzero(experiments != np.arange(len(experiments)))):
            raise SettingsError(
                f"{agent} on {loop}, {taste}, seed {seed}: there is an experiment "
                f"{experiments[wrong[0]]}, but not all before it"
            )
        yield (
            Setting(str(taste), int(n_init), int(n_max)),
            str(loop),
            str(agent),
            int(seed),
            "",
            np.nan,
            None,
            np.nan,
            _checked(study["worth"].to_numpy(), n_max),
            _padded(study["answers"].to_numpy(int), n_max),
            np.nan,
            True,
        )


def _checked(worth: np.ndarray, n_max: int) -> Float[np.ndarray, " n_max"]:
    if len(low := worth[~(worth >= 1)]):
        raise SettingsError(f"worth must be 1 or more, got {low[0]}")
    return _padded(worth.astype(float), n_max)


def _padded(values: np.ndarray, n_max: int) -> np.ndarray:
    """Return n_max values, shape (n_max,); a study that ended early keeps its last one."""
    return np.pad(values, (0, max(n_max - len(values), 0)), mode="edge")[:n_max]


def _setting_key(setting: Setting) -> tuple[bool, int, Setting]:
    known = CALIBRATORS
    place = known.index(setting.calibrator) if setting.calibrator in known else len(known)
    return (setting.noisy, place, setting)


def _problem_key(problem: str) -> tuple[int, str, int, str]:
    """Sort known problems as in their list, and generated loops by their number."""
    place = PROBLEMS.index(problem) if problem in PROBLEMS else len(PROBLEMS)
    stem, _, number = problem.rpartition("-")
    return (place, stem, int(number), problem) if number.isdigit() else (place, problem, -1, problem)
