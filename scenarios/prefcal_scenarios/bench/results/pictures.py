"""Which figures a campaign has, with their captions."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from io import BytesIO
from itertools import groupby

import pandas as pd
from matplotlib.figure import Figure

from prefcal_scenarios.bench.results import captions, figures
from prefcal_scenarios.bench.results.campaign import Campaign, Regime
from prefcal_scenarios.bench.results.duelling import Tally
from prefcal_scenarios.bench.results.figures import Look, looks
from prefcal_scenarios.bench.results.profiles import Profiles, profiles
from prefcal_scenarios.bench.results.ranking import Ranking, rank
from prefcal_scenarios.bench.results.words import regime_name
from prefcal_scenarios.report.style import save, style


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure as PNG with its heading, what it shows, and what it says."""

    file: str
    title: str
    caption: str
    alt: str
    content: bytes
    tallies: tuple[Tally, ...] = ()
    """The numbers of a heat map of duels."""


@dataclass(frozen=True)
class Material:
    """The results that figures and page are made of.

    Args:
        campaign: All results.
        rows: The table of them.
        tallies: The counted duels.
        floor: Gaps below this are equal.
    """

    campaign: Campaign
    rows: pd.DataFrame
    tallies: Sequence[Tally]
    floor: float

    @property
    def looks(self) -> Mapping[str, Look]:
        """The look of each agent, the same in every figure."""
        return looks({*self.campaign.agents, *(t.agent for t in self.tallies)})

    def rows_of(self, regime: Regime) -> pd.DataFrame:
        """Return the rows of a regime that have a gap."""
        rows = self.rows
        return rows[(rows["regime"] == regime) & rows["gap_median"].notna()]


@dataclass(frozen=True, slots=True)
class _Planned:
    """A figure before it is drawn."""

    file: str
    title: str
    caption: str
    alt: str
    make: Callable[[], Figure]
    tallies: tuple[Tally, ...] = ()


def draw(material: Material) -> list[Shown]:
    """Draw every figure that there are results for."""
    with style():
        return [
            Shown(p.file, p.title, p.caption, p.alt, _png(p.make()), p.tallies)
            for p in _plan(material)
        ]


def standings(
    material: Material,
) -> Iterator[tuple[Regime, Ranking | str, Profiles | str]]:
    """Yield ranking and data profiles of every regime that has gaps."""
    campaign, floor = material.campaign, material.floor
    for regime in campaign.regimes:
        if campaign.problems(regime, cost=True):
            yield (
                regime,
                rank(campaign, regime, floor),
                profiles(campaign, regime, floor=floor),
            )


def file_names(names: Sequence[str]) -> list[str]:
    """Return a different end of a file name for each of `names`; empty if there is only one."""
    if len(names) < 2:
        return [""] * len(names)
    slugs = [re.sub(r"[^\w.]+", "-", name).strip("-") for name in names]
    return [f"-{s}" if slugs.count(s) == 1 else f"-{s}-{i}" for i, s in enumerate(slugs, start=1)]


def _plan(material: Material) -> Iterator[_Planned]:
    found = list(standings(material))
    regimes = material.campaign.regimes
    ends = [f" ({regime_name(r, regimes)})" if len(found) > 1 else "" for r, _, _ in found]
    files = file_names([regime.calibrator for regime, _, _ in found])
    for standing, title, file in zip(found, ends, files, strict=True):
        yield from _of_regime(material, standing, title, file)
    yield from _duels(material)
    yield from _seconds(material)


def _of_regime(
    material: Material, standing: tuple[Regime, Ranking | str, Profiles | str], end: str, file: str
) -> Iterator[_Planned]:
    regime, ranked, profiled = standing
    c, styles, floor, rows = (
        material.campaign, material.looks, material.floor, material.rows_of(regime),
    )  # fmt: skip
    if isinstance(ranked, Ranking):
        yield _Planned(
            f"ranking{file}.png", f"Ranking{end}", captions.RANKING,
            captions.ranking_alt(ranked), lambda: figures.ranking(ranked, styles),
        )  # fmt: skip
    yield _Planned(
        f"gaps{file}.png", f"Gap against experiments{end}", captions.GAPS,
        captions.gaps_alt(rows, "experiments"),
        lambda: figures.against_experiments(c, regime, styles, floor),
    )  # fmt: skip
    if isinstance(profiled, Profiles):
        yield _Planned(
            f"profiles{file}.png", f"Data profiles{end}", captions.profiles_caption(profiled),
            captions.profiles_alt(profiled), lambda: figures.data_profiles(profiled, styles),
        )  # fmt: skip
    yield _Planned(
        f"questions{file}.png", f"Gap against number of questions{end}", captions.QUESTIONS,
        captions.gaps_alt(rows, "questions"),
        lambda: figures.against_questions(c, regime, styles, floor),
    )  # fmt: skip


def _duels(material: Material) -> Iterator[_Planned]:
    groups = [
        (key, list(group))
        for key, group in groupby(material.tallies, lambda t: (t.problem, t.calibrator))
    ]
    files = file_names([" ".join(key) for key, _ in groups])
    for ((problem, calibrator), group), file in zip(groups, files, strict=True):
        yield _Planned(
            f"duels{file}.png", f"Who is preferred: {problem} ({calibrator} calibrator)",
            captions.DUELS, captions.duels_alt(group),
            partial(figures.heat_map, group), tuple(group),
        )  # fmt: skip


def _seconds(material: Material) -> Iterator[_Planned]:
    timed = material.rows.dropna(subset="seconds_per_proposal")
    groups = timed.groupby("agent", sort=False)["seconds_per_proposal"]
    measured: dict[str, list[float]] = {agent: list(values) for agent, values in groups}
    if measured:
        yield _Planned(
            "seconds.png", "Seconds per proposal", captions.SECONDS,
            captions.seconds_alt(measured), lambda: figures.seconds(measured, material.looks),
        )  # fmt: skip


def _png(figure: Figure) -> bytes:
    buffer = BytesIO()
    save(figure, buffer)
    return buffer.getvalue()
