"""Write the folder of a campaign: figures, tables and index.html."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from prefcal_bench.cells.duels import Duel
from prefcal_bench.cells.result import Result
from prefcal_scenarios.presentation.folder import folder_for, put

from .campaign import campaign_of
from .curves import curves_of, frame_of, joined
from .duelling import duel_table, tallies
from .rows import BASELINE, as_csv, plain, plain_gaps

_OURS = re.compile(r"(ranking|gaps|profiles|questions|duels|seconds|worth)(-[\w.-]+)?\.png")


def write(
    results: Iterable[Result],
    duels: Iterable[Duel],
    folder: str | Path,
    *,
    command: str = "",
    digest: str = "",
    notes: Sequence[str] = (),
    baseline: str = BASELINE,
    published: pd.DataFrame | None = None,
) -> Path:
    """Write index.html, its figures as PNG, and the tables as CSV; return the page's path.

    The tables are table.csv (gaps), worth.csv (worth on closed loops) and duels.csv.

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
        published: Worth of other agents' studies to compare with, see `frame_of`.

    Raises:
        SettingsError: If results or duels contradict each other, or the folder cannot be written
            to.
    """
    # Imported here: a table alone needs no plotting.
    from .page import draw_all, page
    from .pictures import Material

    results, duels = list(results), list(duels)
    curves = curves_of(joined(frame_of(results), published))
    material = Material(campaign_of(results), curves, tallies(duels), baseline)
    target, drawn = folder_for(folder), draw_all(material)
    kept = [one for group in drawn for one in group]
    _remove_others(target, {one.file for one in kept})
    for picture in kept:
        put(target / picture.file, picture.content)
    put(target / "table.csv", as_csv(plain_gaps(material.rows)).encode())
    put(target / "worth.csv", as_csv(plain(material.worths.rows)).encode())
    put(target / "duels.csv", as_csv(duel_table(duels)).encode())
    index = target / "index.html"
    put(index, page(material, drawn, command, digest, notes).encode())
    return index


def _remove_others(folder: Path, kept: set[str]) -> None:
    """Remove figures of an earlier campaign, only files that have one of our names."""
    for path in folder.glob("*.png"):
        if _OURS.fullmatch(path.name) and path.name not in kept:
            path.unlink()
