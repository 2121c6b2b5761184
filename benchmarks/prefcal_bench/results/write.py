"""Write the folder of a campaign: figures, tables and index.html."""

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import pandas as pd

from prefcal_bench.cells.duels import Duel
from prefcal_bench.cells.result import Result
from prefcal_scenarios.presentation.folder import folder_for, put

from .campaign import campaign_of
from .duelling import duel_rows
from .rows import BASELINE, as_csv, plain

_OURS = re.compile(r"(ranking|gaps?|profiles|questions|duels|seconds|worth)(-[\w.-]+)?\.png")


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
        published: Worth of other agents' studies to compare with, see `campaign_of`.

    Raises:
        SettingsError: If results or duels contradict each other, or the folder cannot be written
            to.
    """
    # Imported here: a table alone needs no plotting.
    from .page import page, parts
    from .pictures import Material

    material, met = Material(campaign_of(results, published), baseline), duel_rows(duels)
    target, found = folder_for(folder), parts(material, met)
    pictures = {part.picture.file: part.picture.content for part in found if part.picture}
    _remove_others(target, set(pictures))
    content = {
        **pictures,
        "table.csv": as_csv(plain(material.gaps)).encode(),
        "worth.csv": as_csv(plain(material.worths)).encode(),
        "duels.csv": as_csv(met.to_dict("records")).encode(),
        "index.html": page(material, found, command, digest, notes).encode(),
    }
    for name, written in content.items():
        put(target / name, written)
    return target / "index.html"


def _remove_others(folder: Path, kept: set[str]) -> None:
    """Remove figures of an earlier campaign, only files that have one of our names."""
    for path in folder.glob("*.png"):
        if _OURS.fullmatch(path.name) and path.name not in kept:
            path.unlink()
