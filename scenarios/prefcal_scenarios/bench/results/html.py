"""index.html: the whole outcome of a campaign in one file that needs no network."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from prefcal_scenarios.bench.results import tables
from prefcal_scenarios.bench.results.campaign import Regime
from prefcal_scenarios.bench.results.missing import beaten, failures, in_holes, missing, not_run
from prefcal_scenarios.bench.results.pictures import Material, Shown, standings
from prefcal_scenarios.bench.results.rows import Choices
from prefcal_scenarios.bench.results.words import regime_name, short
from prefcal_scenarios.export import versions
from prefcal_scenarios.report.parts import document, image, listing, section


@dataclass(frozen=True, slots=True)
class Origin:
    """Where results come from: what was typed, their digest, and what the suite says of itself."""

    command: str = ""
    digest: str = ""
    notes: tuple[str, ...] = ()


def page(material: Material, shown: Sequence[Shown], choices: Choices, origin: Origin) -> str:
    """The text of index.html."""
    return document("Benchmark of agents", "\n".join(_body(material, shown, choices, origin)))


def _body(
    material: Material, shown: Sequence[Shown], choices: Choices, origin: Origin
) -> Iterator[str]:
    absent, lost = _absent(material, choices, origin), failures(material.campaign)
    yield from _header(material, len(lost), bool(missing(material.campaign)))
    yield from _overviews(material, choices)
    for picture in shown:
        caption = f"<figcaption>{escape(picture.caption)}</figcaption>"
        drawn = image(picture.title, "png", picture.content, picture.alt)
        table = tables.duels(picture.tallies) if picture.tallies else ""
        yield section(picture.title, f"<figure>\n{drawn}\n{caption}\n</figure>\n{table}")
    yield from _numbers(material, choices)
    if lost:
        yield section("Failed cells", tables.failed(lost))
    if absent:
        items = "\n".join(f"<li>{escape(words)}</li>" for words in absent)
        yield section("Left out, missing and worth knowing", f"<ul>\n{items}\n</ul>")
    yield section("How to repeat it", "\n".join(_repeat(choices, origin)))


def _header(material: Material, lost: int, partial: bool) -> Iterator[str]:
    campaign = material.campaign
    results = list(campaign)
    problems = {r.cell.problem for r in (*results, *campaign.failed)}
    seeds = {r.cell.seed for r in (*results, *campaign.failed)}
    yield "<header>"
    yield "<h1>Benchmark of agents</h1>"
    if problems:
        yield (
            f'<p class="lead">{_count(len(campaign.agents), "agent")} on '
            f"{_count(len(problems), 'problem')}, up to {_count(len(seeds), 'seed')} each: "
            f"{_count(len(results), 'finished study', 'finished studies')}, {lost} failed.</p>"
        )
    if not results:
        yield '<p class="warning"><strong>No results.</strong> No study has finished yet.</p>'
    elif partial or lost:
        yield (
            '<p class="warning"><strong>Not complete.</strong> Studies failed or are missing; '
            "they are listed below.</p>"
        )
    yield "</header>"


def _count(number: int, one: str, more: str = "") -> str:
    return f"{number} {one if number == 1 else more or one + 's'}"


def _overviews(material: Material, choices: Choices) -> Iterator[str]:
    campaign = material.campaign
    for regime, end in _ends(material):
        content = tables.overview(campaign, material.rows, regime, choices)
        yield section(f"Median gaps{end}", content)


def _numbers(material: Material, choices: Choices) -> Iterator[str]:
    for regime, end in _ends(material):
        rows = [
            row
            for row in material.rows
            if row.regime == regime and (row.gap is not None or row.failed)
        ]
        yield section(f"All numbers{end}", tables.numbers(rows, choices, f"All numbers{end}"))


def _ends(material: Material) -> list[tuple[Regime, str]]:
    """The regimes that have gaps, and what their headings end with, if there are several."""
    regimes = material.campaign.regimes
    found = [regime for regime in regimes if material.rows_of(regime)]
    return [(r, f" ({regime_name(r, regimes)})" if len(found) > 1 else "") for r in found]


def _absent(material: Material, choices: Choices, origin: Origin) -> list[str]:
    """Everything that a reader might look for in vain, with the reason."""
    campaign = material.campaign
    found = [
        *origin.notes,
        *missing(campaign),
        *not_run(campaign),
        *beaten(campaign, choices.floor),
        *in_holes(campaign),
    ]
    if material.rows and choices.baseline not in campaign.agents:
        found.append(f"No differences are shown: there are no results of {choices.baseline}")
    for regime, ranked, profiled in standings(material):
        where: dict[str, list[str]] = {}
        for what, outcome in (("the ranking", ranked), ("the data profiles", profiled)):
            for words in (outcome,) if isinstance(outcome, str) else outcome.left_out:
                where.setdefault(words, []).append(what)
        name = regime_name(regime, campaign.regimes)
        found += [f"Not in {' and '.join(w)} ({name}): {words}" for words, w in where.items()]
    if list(campaign) and all(row.seconds is None for row in material.rows):
        found.append("Seconds per proposal: measured in serial runs only")
    return found


def _repeat(choices: Choices, origin: Origin) -> Iterator[str]:
    if origin.command:
        yield f"<p>The campaign again:</p>\n<pre><code>{escape(origin.command)}</code></pre>"
    if origin.digest:
        yield (
            "<p>Digest of the results, the same on any number of workers:</p>\n"
            f"<pre><code>{escape(origin.digest)}</code></pre>"
        )
    yield '<div class="pair">'
    settings = {
        "baseline": choices.baseline,
        "floor of the gaps": f"{short(choices.floor)}",
        "average of the log ratios": choices.average,
        "seed of the bootstrap": choices.seed,
    }
    yield listing("Statistics", settings)
    yield listing("Versions", versions())
    yield "</div>"
