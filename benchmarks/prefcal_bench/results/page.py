"""Write the folder of a campaign: figures, tables, and index.html, which holds all of them."""

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from prefcal_app.report.export import versions
from prefcal_app.report.write import environment
from prefcal_bench.cells.cell import Result
from prefcal_bench.cells.duels import Duel
from prefcal_scenarios.wording import folder_for, put

from .campaign import Campaign, campaign_of
from .missing import beaten, failures, in_holes, missing, not_run
from .pictures import CampaignFigure, Material, draw_gaps, draw_loops, draw_overview
from .rows import BASELINE, SEED, as_csv, duel_rows, plain
from .statistics import FLOOR
from .tables import TextTable, duel_numbers, failed, numbers, overview, worth_numbers
from .words import named, short

_OURS = re.compile(r"(ranking|gaps?|profiles|questions|duels|seconds|worth)(-[\w.-]+)?\.png")


class Section(NamedTuple):
    """Section of the page: a heading with a figure, a table, or both."""

    title: str
    picture: CampaignFigure | None = None
    table: TextTable | None = None


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
    material, met = Material(campaign_of(results, published), baseline), duel_rows(duels)
    target, found = folder_for(folder), sections_of(material, met)
    pictures = {one.picture.file: one.picture.content for one in found if one.picture}
    for path in target.glob("*.png"):  # of an earlier campaign; only files that have one of our names
        if _OURS.fullmatch(path.name) and path.name not in pictures:
            path.unlink()
    content = {
        **pictures,
        "table.csv": as_csv(plain(material.gaps)).encode(),
        "worth.csv": as_csv(plain(material.worths)).encode(),
        "duels.csv": as_csv(met.to_dict("records")).encode(),
        "index.html": _text(material, found, command, digest, notes).encode(),
    }
    for name, written in content.items():
        put(target / name, written)
    return target / "index.html"


def sections_of(material: Material, met: pd.DataFrame) -> list[Section]:
    """Return the sections with results: closed loops first, then problems with gaps, then duels."""
    campaign, worths, baseline = material.campaign, material.worths, material.baseline
    found = [Section(one.title, one) for one in draw_overview(material)]
    for setting in campaign.having("worth"):
        table = worth_numbers(campaign, worths, setting, baseline)
        found.append(Section(table.label, table=table))
    found += [Section(one.title, one) for one in draw_loops(material)]
    settings = [s for s in campaign.having("gap") if len(material.gaps_of(s))]
    ends = {s: f" ({named(s, campaign)})" if len(settings) > 1 else "" for s in settings}
    for setting, end in ends.items():
        table = overview(campaign, material.gaps_of(setting), setting, baseline)
        found.append(Section(f"Median gaps{end}", table=table))
    found += [Section(one.title, one) for one in draw_gaps(material)]
    for _, rows in met.groupby(["problem", "calibrator"]):
        table = duel_numbers(rows)
        found.append(Section(table.label, table=table))
    for setting, end in ends.items():
        rows = material.gaps[material.gaps["setting"] == setting]
        rows = rows[rows["gap_median"].notna() | (rows["failed"] > 0)]
        table = numbers(rows, baseline, f"All numbers{end}")
        found.append(Section(table.label, table=table))
    if lost := failures(campaign):
        found.append(Section("Failed cells", table=failed(lost)))
    return found


def _text(
    material: Material, sections: Sequence[Section], command: str, digest: str, notes: Sequence[str]
) -> str:
    """Return the text of index.html."""
    campaign = material.campaign
    statistics = {"baseline": material.baseline, "seed of the bootstrap": SEED}
    if len(material.gaps["gap_median"].dropna()):
        statistics |= {"floor of the gaps": short(FLOOR), "average of the log ratios": "median"}
    template = environment("prefcal_bench").get_template("results/page.html.j2")
    text: str = template.render(
        lead=_lead(campaign),
        nothing=not len(campaign.finished),
        partial=bool(missing(campaign) or len(campaign.failed)),
        sections=sections,
        absent=list(_absent(material, notes)),
        command=command,
        digest=digest,
        statistics=statistics,
        versions=versions(),
    )
    return text


def _lead(campaign: Campaign) -> str:
    ours = campaign.ours
    if not len(ours):
        return ""
    agents, problems, seeds = (ours[name].nunique() for name in ("agent", "problem", "seed"))
    published = len(campaign.agents) - agents
    beside = f" Beside them, {_count(published, 'published agent')}." if published else ""
    return (
        f"{_count(agents, 'agent')} on {_count(problems, 'problem')}, up to "
        f"{_count(seeds, 'seed')} each: "
        f"{_count(len(campaign.finished), 'finished study', 'finished studies')}, "
        f"{len(campaign.failed)} failed.{beside}"
    )


def _count(number: int, one: str, more: str = "") -> str:
    return f"{number} {one if number == 1 else more or one + 's'}"


def _absent(material: Material, notes: Sequence[str]) -> Iterator[str]:
    """Yield everything that a reader might miss on the page, with the reason."""
    campaign = material.campaign
    yield from notes
    for describe in (missing, not_run, beaten, in_holes):
        yield from describe(campaign)
    if len(material.gaps) and material.baseline not in campaign.agents:
        yield f"No differences are shown: there are no results of {material.baseline}"
    if len(campaign.finished) and campaign.finished["seconds"].isna().all():
        yield "Seconds per proposal: measured in serial runs only"
