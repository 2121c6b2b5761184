"""Write index.html: all results of a campaign in one self-contained file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from prefcal_scenarios.app.report.export import versions
from prefcal_scenarios.app.report.html import environment
from prefcal_scenarios.bench.worth.pictures import Worths
from prefcal_scenarios.bench.worth.tables import worth_tables

from .campaign import Campaign, Regime
from .missing import beaten, failures, in_holes, missing, not_run
from .pictures import Material, Shown
from .rows import Choices
from .tables import duels, failed, numbers, overview
from .words import regime_name, short


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of results: the command, their digest, and what the suite left out."""

    command: str = ""
    digest: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Loops:
    """What the page shows of closed loops.

    Args:
        worths: Worth of all studies, for the tables.
        overview: Figures with all loops together, which come before the tables.
        single: Figures with a panel for each loop.
    """

    worths: Worths
    overview: Sequence[Shown]
    single: Sequence[Shown]


def page(
    material: Material, shown: Sequence[Shown], loops: Loops, choices: Choices, origin: Origin
) -> str:
    """Return the text of index.html: closed loops first, then problems with gaps, then duels."""
    campaign, ends = material.campaign, _ends(material)
    lost = failures(campaign)
    text: str = (
        environment()
        .get_template("bench/results/page.html.j2")
        .render(
            lead=_lead(campaign, loops.worths),
            nothing=not len(campaign.finished),
            loops=loops,
            worth_tables=worth_tables(loops.worths),
            partial=bool(missing(campaign) or lost),
            overviews=[
                (f"Median gaps{end}", overview(campaign, material.rows_of(regime), regime, choices))
                for regime, end in ends
            ],
            pictures=[(one, duels(one.tallies) if one.tallies else None) for one in shown],
            all_numbers=[
                numbers(_with_gaps_or_failures(material, regime), choices, f"All numbers{end}")
                for regime, end in ends
            ],
            failed=failed(lost),
            absent=list(_absent(material, choices, origin)),
            origin=origin,
            statistics={
                "baseline": choices.baseline,
                **(_gap_choices(choices) if ends else {}),
                "seed of the bootstrap": choices.seed,
            },
            versions=versions(),
        )
    )
    return text


def _gap_choices(choices: Choices) -> dict[str, str]:
    return {
        "floor of the gaps": short(choices.floor),
        "average of the log ratios": choices.average,
    }


def _lead(campaign: Campaign, worths: Worths) -> str:
    studies = campaign.studies
    if not len(studies):
        return ""
    published = len({*worths.curves.agents} - {*campaign.agents})
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


def _ends(material: Material) -> list[tuple[Regime, str]]:
    """Return the regimes that have gaps, and a suffix for their headings if there are several."""
    regimes = material.campaign.regimes
    found = [regime for regime in regimes if len(material.rows_of(regime))]
    return [(r, f" ({regime_name(r, regimes)})" if len(found) > 1 else "") for r in found]


def _with_gaps_or_failures(material: Material, regime: Regime) -> Any:
    rows = material.rows[material.rows["regime"] == regime]
    return rows[rows["gap_median"].notna() | (rows["failed"] > 0)]


def _absent(material: Material, choices: Choices, origin: Origin) -> Iterator[str]:
    """Yield everything that a reader might miss on the page, with the reason."""
    campaign = material.campaign
    yield from origin.notes
    yield from missing(campaign)
    yield from not_run(campaign)
    yield from beaten(campaign, choices.floor)
    yield from in_holes(campaign)
    if len(material.rows) and choices.baseline not in campaign.agents:
        yield f"No differences are shown: there are no results of {choices.baseline}"
    for standing in material.standings:
        where: dict[str, list[str]] = {}
        both = (("the ranking", standing.ranking), ("the data profiles", standing.profiles))
        for what, outcome in both:
            for words in (outcome,) if isinstance(outcome, str) else outcome.left_out:
                where.setdefault(words, []).append(what)
        name = regime_name(standing.regime, campaign.regimes)
        for words, parts in where.items():
            yield f"Not in {' and '.join(parts)} ({name}): {words}"
    if len(campaign.finished) and material.rows["seconds_per_proposal"].isna().all():
        yield "Seconds per proposal: measured in serial runs only"
