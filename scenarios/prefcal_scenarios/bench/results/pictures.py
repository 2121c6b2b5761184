"""Select the figures of a campaign, with their captions."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import groupby

import pandas as pd
from matplotlib.figure import Figure

from prefcal_scenarios.app.presentation.style import save, style

from . import captions, figures
from .campaign import Campaign, Regime
from .duelling import Tally
from .figures import Look, looks
from .profiles import Profiles, profiles
from .ranking import Ranking, rank
from .words import regime_name


@dataclass(frozen=True, slots=True)
class Shown:
    """A figure as PNG with its heading, its caption, and a text for people who cannot see it."""

    file: str
    title: str
    caption: str
    alt: str
    content: bytes
    tallies: tuple[Tally, ...] = ()
    """Numbers of a heat map of duels."""


@dataclass(frozen=True, slots=True)
class Standing:
    """Ranking and data profiles of a regime, each replaced by a reason if there are none."""

    regime: Regime
    ranking: Ranking | str
    profiles: Profiles | str


@dataclass(frozen=True)
class Material:
    """Results for figures and page.

    Args:
        campaign: All results.
        rows: Table of the results.
        tallies: Counted duels.
        floor: Gap below which all gaps are equal.
        others: Agents of other figures on the same page, which get looks of their own.
    """

    campaign: Campaign
    rows: pd.DataFrame
    tallies: Sequence[Tally]
    floor: float
    others: Sequence[str] = ()

    @property
    def looks(self) -> Mapping[str, Look]:
        """Return the look of each agent, the same in every figure."""
        return looks({*self.campaign.agents, *(t.agent for t in self.tallies), *self.others})

    @cached_property
    def standings(self) -> list[Standing]:
        """Return the standing of the agents in every regime that has gaps."""
        campaign, floor = self.campaign, self.floor
        return [
            Standing(r, rank(campaign, r, floor), profiles(campaign, r, floor=floor))
            for r in campaign.regimes
            if campaign.problems(r, cost=True)
        ]

    def rows_of(self, regime: Regime) -> pd.DataFrame:
        """Return the rows of a regime that have a gap."""
        rows = self.rows
        return rows[(rows["regime"] == regime) & rows["gap_median"].notna()]


def draw(material: Material) -> list[Shown]:
    """Draw every figure that there are results for."""
    with style():
        return [*_of_regimes(material), *_duels(material), *_seconds(material)]


def file_names(names: Sequence[str]) -> list[str]:
    """Return a unique file name suffix for each of `names`; empty if there is only one."""
    if len(names) < 2:
        return [""] * len(names)
    slugs = [re.sub(r"[^\w.]+", "-", name).strip("-") for name in names]
    return [f"-{s}" if slugs.count(s) == 1 else f"-{s}-{i}" for i, s in enumerate(slugs, start=1)]


def _of_regimes(material: Material) -> Iterator[Shown]:
    regimes = material.campaign.regimes
    files = file_names([standing.regime.calibrator for standing in material.standings])
    for standing, file in zip(material.standings, files, strict=True):
        several = len(material.standings) > 1
        end = f" ({regime_name(standing.regime, regimes)})" if several else ""
        yield from _of_regime(material, standing, end, file)


def _of_regime(material: Material, standing: Standing, end: str, file: str) -> Iterator[Shown]:
    campaign, regime, floor = material.campaign, standing.regime, material.floor
    rows, styles = material.rows_of(regime), material.looks
    if isinstance(ranked := standing.ranking, Ranking):
        yield Shown(
            f"ranking{file}.png", f"Ranking{end}", captions.RANKING,
            captions.ranking_alt(ranked), png(figures.ranking(ranked, styles)),
        )  # fmt: skip
    yield Shown(
        f"gaps{file}.png", f"Gap against experiments{end}", captions.GAPS,
        captions.gaps_alt(rows, "experiments"),
        png(figures.against_experiments(campaign, regime, styles, floor)),
    )  # fmt: skip
    if isinstance(profiled := standing.profiles, Profiles):
        yield Shown(
            f"profiles{file}.png", f"Data profiles{end}", captions.profiles_caption(profiled),
            captions.profiles_alt(profiled), png(figures.data_profiles(profiled, styles)),
        )  # fmt: skip
    yield Shown(
        f"questions{file}.png", f"Gap against number of questions{end}", captions.QUESTIONS,
        captions.gaps_alt(rows, "questions"),
        png(figures.against_questions(campaign, regime, styles, floor)),
    )  # fmt: skip


def _duels(material: Material) -> Iterator[Shown]:
    groups = [
        (key, tuple(group))
        for key, group in groupby(material.tallies, lambda t: (t.problem, t.calibrator))
    ]
    files = file_names([" ".join(key) for key, _ in groups])
    for ((problem, calibrator), group), file in zip(groups, files, strict=True):
        yield Shown(
            f"duels{file}.png", f"Who is preferred: {problem} ({calibrator} calibrator)",
            captions.DUELS, captions.duels_alt(group), png(figures.heat_map(group)), group,
        )  # fmt: skip


def _seconds(material: Material) -> Iterator[Shown]:
    timed = material.rows.dropna(subset="seconds_per_proposal")
    groups = timed.groupby("agent", sort=False)["seconds_per_proposal"]
    measured: dict[str, list[float]] = {agent: list(values) for agent, values in groups}
    if measured:
        yield Shown(
            "seconds.png", "Seconds per proposal", captions.SECONDS,
            captions.seconds_alt(measured), png(figures.seconds(measured, material.looks)),
        )  # fmt: skip


def png(figure: Figure) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    buffer = BytesIO()
    save(figure, buffer)
    return buffer.getvalue()
