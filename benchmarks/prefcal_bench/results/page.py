"""Make index.html: all results of a campaign in one self-contained file."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from prefcal_app.report.export import versions
from prefcal_app.report.html import environment

from .campaign import Campaign
from .curves import Curves, Setting
from .missing import beaten, failures, in_holes, missing, not_run
from .pictures import Material, Shown, draw, draw_loops, draw_overview
from .rows import SEED
from .statistics import FLOOR
from .tables import duels, failed, numbers, overview, worth_numbers
from .words import named, short


class Drawn(NamedTuple):
    """All figures: of worth on all loops and on each, and of gaps, duels and times."""

    overview: Sequence[Shown]
    loops: Sequence[Shown]
    others: Sequence[Shown]


def draw_all(material: Material) -> Drawn:
    """Draw every figure that there are results for."""
    worths, looks = material.worths, material.looks
    return Drawn(draw_overview(worths, looks), draw_loops(worths, looks), draw(material))


def page(material: Material, drawn: Drawn, command: str, digest: str, notes: Sequence[str]) -> str:
    """Return the text of index.html: closed loops first, then problems with gaps, then duels."""
    campaign, ends, baseline = material.campaign, _ends(material), material.baseline
    lost, gaps = failures(campaign), {"floor of the gaps": short(FLOOR),
                                      "average of the log ratios": "median"}  # fmt: skip
    text: str = (
        environment("prefcal_bench")
        .get_template("results/page.html.j2")
        .render(
            lead=_lead(campaign, material.curves),
            nothing=not len(campaign.finished),
            drawn=drawn,
            worth_tables=[worth_numbers(material.worths, s) for s in material.curves.settings],
            partial=bool(missing(campaign) or lost),
            overviews=[
                (f"Median gaps{end}", overview(campaign, material.rows_of(s), s, baseline))
                for s, end in ends
            ],
            pictures=[(one, duels(one.tallies) if one.tallies else None) for one in drawn.others],
            all_numbers=[
                numbers(_with_gaps_or_failures(material, s), baseline, f"All numbers{end}")
                for s, end in ends
            ],
            failed=failed(lost),
            absent=list(_absent(material, notes)),
            command=command,
            digest=digest,
            statistics={"baseline": baseline, **(gaps if ends else {}),
                        "seed of the bootstrap": SEED},
            versions=versions(),
        )
    )  # fmt: skip
    return text


def _lead(campaign: Campaign, curves: Curves) -> str:
    studies = campaign.studies
    if not len(studies):
        return ""
    published = len({*curves.agents} - {*campaign.agents})
    beside = f" Beside them, {_count(published, 'published agent')}." if published else ""
    return (
        f"{_count(len(campaign.agents), 'agent')} on "
        f"{_count(studies['problem'].nunique(), 'problem')}, up to "
        f"{_count(studies['seed'].nunique(), 'seed')} each: "
        f"{_count(len(campaign.finished), 'finished study', 'finished studies')}, "
        f"{len(campaign.failed)} failed.{beside}"
    )


def _count(number: int, one: str, more: str = "") -> str:
    return f"{number} {one if number == 1 else more or one + 's'}"


def _ends(material: Material) -> list[tuple[Setting, str]]:
    """Return the settings that have gaps, and a suffix for their headings if there are several."""
    campaign = material.campaign
    found = [setting for setting in campaign.settings if len(material.rows_of(setting))]
    return [(s, f" ({named(s, campaign)})" if len(found) > 1 else "") for s in found]


def _with_gaps_or_failures(material: Material, setting: Setting) -> Any:
    rows = material.rows[material.rows["setting"] == setting]
    return rows[rows["gap_median"].notna() | (rows["failed"] > 0)]


def _absent(material: Material, notes: Sequence[str]) -> Iterator[str]:
    """Yield everything that a reader might miss on the page, with the reason."""
    campaign = material.campaign
    yield from notes
    yield from missing(campaign)
    yield from not_run(campaign)
    yield from beaten(campaign)
    yield from in_holes(campaign)
    if len(material.rows) and material.baseline not in campaign.agents:
        yield f"No differences are shown: there are no results of {material.baseline}"
    for standing in material.standings:
        where: dict[str, list[str]] = {}
        both = (("the ranking", standing.ranking), ("the data profiles", standing.profiles))
        for what, outcome in both:
            for words in (outcome,) if isinstance(outcome, str) else outcome.left_out:
                where.setdefault(words, []).append(what)
        name = named(standing.setting, campaign)
        for words, parts in where.items():
            yield f"Not in {' and '.join(parts)} ({name}): {words}"
    if len(campaign.finished) and material.rows["seconds_per_proposal"].isna().all():
        yield "Seconds per proposal: measured in serial runs only"
