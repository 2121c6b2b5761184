"""Compare an agent with published studies, which do not run again."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from prefcal_bench.cells.roster import entry
from prefcal_bench.cells.suite import Suite
from prefcal_bench.problems import problem
from prefcal_bench.results.campaign import COLUMNS, campaign_of
from prefcal_env.errors import SettingsError
from prefcal_env.wording import did_you_mean

from .raw import VERSIONS, read, read_curves, version_of

PUBLISHED = Path(__file__).with_name("worth.parquet")  # file of the studies that are published with prefcal
_SORTED = ["taste", "loop", "agent", "seed", "n_init", "n_max", "experiment"]


@dataclass(frozen=True)
class Plan:
    """What `prefcal bench compare` runs, and what it compares the results with."""

    suite: Suite  # suite of the agent alone, on the loops and tastes of the published studies
    published: pd.DataFrame  # published studies to compare with, see `campaign_of`
    notes: tuple[str, ...]  # where the published studies are of other versions than this prefcal's


def publish(raw: Iterable[str | Path], out: str | Path) -> pd.DataFrame:
    """Condense raw results to the published form: write `out`, and return what is in it.

    Args:
        raw: Files raw.parquet, see `write_raw`. Studies that are in several count once.
        out: File to write.

    Raises:
        SettingsError: If a file cannot be read or written, there are no studies with a worth, or
            the same study has two courses.
    """
    found = [read_curves(path).astype(dict.fromkeys(("agent", "loop", "taste"), str)) for path in raw]
    frame = pd.concat(found, ignore_index=True).drop_duplicates() if found else pd.DataFrame()
    if not len(frame):
        raise SettingsError("there are no studies with a worth to publish")
    campaign_of((), frame)  # raises if two studies contradict each other
    frame = frame.sort_values(_SORTED, ignore_index=True)
    words = ["agent", "loop", "taste", *VERSIONS]
    try:
        frame.astype(dict.fromkeys(words, "category")).to_parquet(out, index=False, compression="zstd")
    except OSError as error:
        raise SettingsError(f"cannot write {out}: {error}") from error
    return frame


def read_published(path: str | Path | None = None) -> pd.DataFrame:
    """Return the studies of a published file; None for the one that comes with prefcal.

    Raises:
        SettingsError: If there is no such file, it holds something else, or it is empty.
    """
    frame = read(PUBLISHED if path is None else path, [*COLUMNS, *VERSIONS])
    if not len(frame):
        raise SettingsError(f"{path} holds no studies")
    return frame.astype(dict.fromkeys(("agent", "loop", "taste", *VERSIONS), str))


def plan(
    agent: str,
    published: pd.DataFrame,
    loops: Sequence[str] | None = None,
    tastes: Sequence[str] | None = None,
    seeds: int | None = None,
) -> Plan:
    """Return the plan to compare `agent` with published studies.

    Args:
        agent: Name of an agent, or path/to/own.py:Agent.
        published: Published studies, see `read_published`.
        loops: Loops to run; None for all of them.
        tastes: Tastes to run; None for all of them.
        seeds: Number of seeds of the agent; None for as many as published.

    Raises:
        SettingsError: If a name is unknown, nothing is left to run, or the published studies do
            not share one budget.
        ScenarioError: If the file of a user's own agent cannot be loaded.
    """
    chosen = _chosen(_chosen(published, "loop", loops), "taste", tastes)
    known = [loop for loop in chosen["loop"].unique() if version_of(problem, loop)]
    notes = [
        f"{loop}: published, but this prefcal has no such problem"
        for loop in sorted(set(chosen["loop"]) - set(known))
    ]
    chosen = chosen[chosen["loop"].isin(known)]
    budgets = chosen[["n_init", "n_max"]].drop_duplicates()
    if len(budgets) != 1:
        raise SettingsError(f"published studies must share one number of experiments, got {len(budgets)}")
    ((n_init, n_max),) = budgets.itertuples(index=False)
    seeds = int(chosen["seed"].max()) + 1 if seeds is None else seeds
    suite = Suite((agent,), known, tuple(chosen["taste"].unique()), seeds, int(n_init), int(n_max))
    if not suite.cells:
        raise SettingsError(f"there is nothing to run: {'; '.join(suite.left_out)}")
    # The installed agent of the same name runs again, for example after a change of its code.
    others = chosen.assign(agent=chosen["agent"].replace({agent: f"{agent} (published)"}))
    return Plan(suite, others, (*notes, *_differences(chosen)))


def _chosen(published: pd.DataFrame, column: str, names: Sequence[str] | None) -> pd.DataFrame:
    if names is None:
        return published
    known = list(dict.fromkeys(published[column]))
    for name in names:
        if name not in known:
            raise SettingsError(
                f"no {column} {name!r} is published.{did_you_mean(name, known)} Expected {', '.join(known)}"
            )
    return published[published[column].isin(names)]


def _differences(published: pd.DataFrame) -> Iterator[str]:
    """Yield where the published studies are of other versions than the installed ones."""
    for column, version, find in (("agent", "agent_version", entry), ("loop", "problem_version", problem)):
        for name, group in published.groupby(column, sort=True)[version]:
            now = version_of(find, str(name))
            if now and set(group) != {now}:
                yield (
                    f"{name}: the published studies {_apart(set(group), now)}: the comparison "
                    "with them may not hold any more"
                )


def _apart(then: set[str], now: str) -> str:
    """Return what distinguishes versions, which start with a number that settings follow."""
    numbers = {_number(version) for version in then}
    if numbers == {_number(now)}:
        return "have other settings or package versions than those installed here"
    return f"are of version {', '.join(sorted(numbers))}, this prefcal has {_number(now)}"


def _number(version: str) -> str:
    return version.split()[0].rstrip(",") if version else "unknown"
