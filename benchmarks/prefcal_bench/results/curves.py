"""Collect the worth along each study, from results or from a published file."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from prefcal_bench.cells.result import Result
from prefcal_bench.cells.roster import in_order
from prefcal_bench.problems import CALIBRATORS, NOISES, PROBLEMS
from prefcal_env.errors import SettingsError

STUDY = ("taste", "n_init", "n_max", "loop", "agent", "seed")
"""Columns that identify a study."""
COLUMNS = (*STUDY, "experiment", "answers", "worth")
"""Columns of a frame with a row for each experiment, see `frame_of`."""


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
class Curves:
    """Worth along each study, made by `curves_of`.

    Args:
        studies: Table with a row for each study and the columns setting, loop, agent (categories
            in the order of the tables), seed, worth (of the θ that the agent would return after
            each of n_max experiments) and asked (answers given up to each experiment).
    """

    studies: pd.DataFrame

    @cached_property
    def settings(self) -> tuple[Setting, ...]:
        """Return all settings; those whose answers are never wrong come first."""
        return tuple(self.studies["setting"].cat.categories)

    @cached_property
    def agents(self) -> tuple[str, ...]:
        """Return all agents, in the order of the tables."""
        return tuple(self.studies["agent"].cat.categories)

    def of(self, setting: Setting) -> pd.DataFrame:
        """Return the studies of a setting."""
        return self.studies[self.studies["setting"] == setting]

    def loops(self, setting: Setting) -> tuple[str, ...]:
        """Return the loops of a setting, in the order of the tables."""
        return tuple(self.of(setting)["loop"].cat.remove_unused_categories().cat.categories)


def frame_of(results: Iterable[Result]) -> pd.DataFrame:
    """Return the finished results that have a worth, with a row for each experiment.

    The columns are `COLUMNS`: loop is the problem, taste the calibrator, experiment counts from 0,
    and answers is the number of answers given up to that experiment.
    """
    kept = [r for r in results if r.worth is not None and not r.failure]
    counts = [len(r.questions) for r in kept]
    cells = [r.cell for r in kept]
    studies: dict[str, list[object]] = {
        "taste": [c.calibrator for c in cells],
        "n_init": [c.n_init for c in cells],
        "n_max": [c.n_max for c in cells],
        "loop": [c.problem for c in cells],
        "agent": [c.agent for c in cells],
        "seed": [c.seed for c in cells],
    }
    frame = pd.DataFrame(studies).loc[np.repeat(np.arange(len(kept)), counts)]
    columns: dict[str, list[Any]] = {
        "experiment": [np.arange(n) for n in counts],
        "answers": [r.questions for r in kept],
        "worth": [r.worth for r in kept],
    }
    for name, parts in columns.items():
        frame[name] = np.concatenate([np.asarray(p) for p in parts] or [np.zeros(0)])
    return frame.reset_index(drop=True)


def joined(ours: pd.DataFrame, published: pd.DataFrame | None) -> pd.DataFrame:
    """Return a frame with our studies and published ones, of which any may be missing.

    Our worth is rounded as the published one is (float32): otherwise equal ones would not tie.
    """
    if published is None or not len(published):
        return ours
    others = published[list(COLUMNS)]
    rounded = ours.astype({"worth": others["worth"].dtype})
    return pd.concat([rounded, others], ignore_index=True) if len(ours) else others


def curves_of(frame: pd.DataFrame) -> Curves:
    """Return the curves of a frame with the columns of `frame_of`, in any order of its rows.

    A study that ended early keeps its last worth.

    Raises:
        SettingsError: If a worth is below 1 or no number, a study occurs twice, or one lacks
            experiments before its last one.
    """
    frame = frame.sort_values([*STUDY, "experiment"], kind="stable")
    keys = frame[list(STUDY)]
    if frame.duplicated([*STUDY, "experiment"]).any():
        twice = frame[frame.duplicated([*STUDY, "experiment"])].iloc[0]
        raise SettingsError(f"two studies of {twice['agent']} on {twice['loop']}, {twice['taste']}")
    if not (valid := frame["worth"] >= 1).all():
        raise SettingsError(f"worth must be 1 or more, got {frame['worth'][~valid].iloc[0]}")
    starts = np.flatnonzero(~keys.duplicated().to_numpy())
    _check_complete(frame, starts)
    studies = keys.iloc[starts].reset_index(drop=True)
    budgets = [int(n) for n in studies["n_max"]]
    for column, name, kind in (("worth", "worth", float), ("answers", "asked", int)):
        parts = np.split(frame[column].to_numpy(kind), starts[1:])
        studies[name] = pd.Series(
            [padded(part, n) for part, n in zip(parts, budgets, strict=False)], dtype=object
        )
    studies["setting"] = [
        Setting(str(t), int(i), n)
        for t, i, n in zip(studies["taste"], studies["n_init"], budgets, strict=True)
    ]
    orders = {
        "setting": sorted(set(studies["setting"]), key=setting_key),
        "loop": sorted(set(studies["loop"]), key=_loop_key),
        "agent": in_order(studies["agent"]),
    }
    set_order(studies, orders)
    studies = studies.sort_values(["setting", "loop", "agent", "seed"], ignore_index=True)
    return Curves(studies[["setting", "loop", "agent", "seed", "worth", "asked"]])


def after_answers(
    worth: Float[np.ndarray, " n_max"], asked: Int[np.ndarray, " n_max"], count: int
) -> Float[np.ndarray, " {count}+1"]:
    """Return the worth after 0, 1, ..., `count` answers, from the last experiment by then."""
    place = np.searchsorted(asked, np.arange(count + 1), side="right") - 1
    return np.asarray(worth[np.maximum(place, 0)])


def _check_complete(frame: pd.DataFrame, starts: Int[np.ndarray, " S"]) -> None:
    """Raise SettingsError if the rows of a study, from its start, are not experiments 0, 1, ..."""
    counts = np.diff([*starts, len(frame)])
    missing = frame["experiment"].to_numpy() != np.arange(len(frame)) - np.repeat(starts, counts)
    if missing.any():
        row = frame[missing].iloc[0]
        raise SettingsError(
            f"{row['agent']} on {row['loop']}, {row['taste']}, seed {row['seed']}: "
            f"there is an experiment {row['experiment']}, but not all before it"
        )


def padded(values: Float[np.ndarray, " N"], n_max: int) -> Float[np.ndarray, " n_max"]:
    """Return n_max values; a study that ended early keeps its last one."""
    return np.pad(values, (0, max(n_max - len(values), 0)), mode="edge")[:n_max]


def set_order(studies: pd.DataFrame, orders: Mapping[str, Iterable[Any]]) -> None:
    """Make columns categories in the order of the tables."""
    for name, order in orders.items():
        studies[name] = pd.Categorical(studies[name], categories=list(order), ordered=True)


def setting_key(setting: Setting) -> tuple[bool, int, Setting]:
    """Return what settings are sorted by: those whose answers are never wrong come first."""
    known = CALIBRATORS
    place = known.index(setting.calibrator) if setting.calibrator in known else len(known)
    return (setting.noisy, place, setting)


def _loop_key(loop: str) -> tuple[int, str, int, str]:
    """Sort known loops as in the list of problems, and generated ones by their number."""
    place = PROBLEMS.index(loop) if loop in PROBLEMS else len(PROBLEMS)
    stem, _, number = loop.rpartition("-")
    return (place, stem, int(number), loop) if number.isdigit() else (place, loop, -1, loop)
