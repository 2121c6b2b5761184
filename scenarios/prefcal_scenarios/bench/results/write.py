"""Write the folder of a campaign: figures, tables and index.html."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from prefcal_scenarios.app.presentation.folder import folder_for, put
from prefcal_scenarios.bench.duels import Duel
from prefcal_scenarios.bench.result import Result

from .campaign import campaign_of
from .duelling import duel_table, tallies
from .rows import BASELINE, Choices, as_csv, plain, rows_of

_OURS = re.compile(r"(ranking|gaps|profiles|questions|duels|seconds)(-[\w.-]+)?\.png")


def write(
    results: Iterable[Result],
    duels: Iterable[Duel],
    folder: str | Path,
    *,
    command: str = "",
    digest: str = "",
    notes: Sequence[str] = (),
    baseline: str = BASELINE,
) -> Path:
    """Write index.html, its figures as PNG, table.csv and duels.csv; return the page's path.

    Equal results give equal bytes, regardless of their order. Figures left over from an earlier
    campaign in `folder` are removed.

    Args:
        results: Results; the page lists cells that are missing or failed.
        duels: Verdicts on problems without a cost; may be empty.
        folder: Folder to write to, created if necessary.
        command: Command line that was typed, for the page.
        digest: Digest of the results, for the page.
        notes: Combinations that were left out on purpose, with reasons, and other remarks.
        baseline: Agent that all others are compared with.

    Raises:
        SettingsError: If results or duels contradict each other, or the folder cannot be written
            to.
    """
    origin = (command, digest, tuple(notes))
    return _write(list(results), list(duels), Path(folder), Choices(baseline), origin)


def _write(
    results: list[Result],
    duels: list[Duel],
    folder: Path,
    choices: Choices,
    origin: tuple[str, str, tuple[str, ...]],
) -> Path:
    # Imported here: a table alone needs no plotting.
    from .html import Origin, page
    from .pictures import Material, draw

    campaign = campaign_of(results)
    material = Material(campaign, rows_of(campaign, choices), tallies(duels), choices.floor)
    target, shown = folder_for(folder), draw(material)
    _remove_others(target, {s.file for s in shown})
    for picture in shown:
        put(target / picture.file, picture.content)
    put(target / "table.csv", as_csv(plain(material.rows)).encode())
    put(target / "duels.csv", as_csv(duel_table(duels)).encode())
    index = target / "index.html"
    put(index, page(material, shown, choices, Origin(*origin)).encode())
    return index


def _remove_others(folder: Path, kept: set[str]) -> None:
    """Remove figures of an earlier campaign, only files that have one of our names."""
    for path in folder.glob("*.png"):
        if _OURS.fullmatch(path.name) and path.name not in kept:
            path.unlink()
