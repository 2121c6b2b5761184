"""Select the figures of a campaign, with their captions."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import groupby

import pandas as pd
from matplotlib.figure import Figure

from prefcal_scenarios.presentation.style import save, style

from . import figures
from .campaign import Campaign
from .curves import Curves, Setting
from .duelling import Tally
from .figures import Look, captions, looks
from .rows import BASELINE, gap_rows
from .standing import Profiles, Ranking, profiles, rank
from .tables import Worths
from .words import named, short_name


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
    """Ranking and data profiles of a setting, each replaced by a reason if there are none."""

    setting: Setting
    ranking: Ranking | str
    profiles: Profiles | str


@dataclass(frozen=True)
class Material:
    """Results for figures and page.

    Args:
        campaign: All results.
        curves: Worth along all studies, also published ones.
        tallies: Counted duels.
        baseline: Agent that all others are compared with.
    """

    campaign: Campaign
    curves: Curves
    tallies: Sequence[Tally]
    baseline: str

    @cached_property
    def rows(self) -> pd.DataFrame:
        """Return the table of gaps."""
        return gap_rows(self.campaign, self.baseline)

    @cached_property
    def worths(self) -> Worths:
        """Return the worth of all studies, and its table."""
        return Worths(self.curves, self.baseline)

    @property
    def looks(self) -> Mapping[str, Look]:
        """Return the look of each agent, the same in every figure."""
        duelling = (tally.agent for tally in self.tallies)
        return looks({*self.campaign.agents, *duelling, *self.curves.agents})

    @cached_property
    def standings(self) -> list[Standing]:
        """Return the standing of the agents in every setting that has gaps."""
        campaign = self.campaign
        return [
            Standing(s, rank(campaign, s), profiles(campaign, s))
            for s in campaign.settings
            if campaign.problems(s, cost=True)
        ]

    def rows_of(self, setting: Setting) -> pd.DataFrame:
        """Return the rows of a setting that have a gap."""
        rows = self.rows
        return rows[(rows["setting"] == setting) & rows["gap_median"].notna()]


def draw(material: Material) -> list[Shown]:
    """Draw every figure of gaps, duels and times that there are results for."""
    with style():
        return [*_of_settings(material), *_duels(material), *_seconds(material)]


def draw_overview(worths: Worths, looks: Mapping[str, Look]) -> list[Shown]:
    """Draw the worth on all loops together, first that of answers that are never wrong."""
    with style():
        groups = _groups(worths.curves)
        return [one for group in groups for one in _of_all_loops(worths, looks, group)]


def draw_loops(worths: Worths, looks: Mapping[str, Look]) -> list[Shown]:
    """Draw the worth with a panel for each loop.

    Tastes with wrong answers have none if there are others: the page would be endless.
    """
    with style():
        groups = _groups(worths.curves)[:1]
        return [one for group in groups for one in _of_loops(worths, looks, group)]


def draw_worth(curves: Curves) -> tuple[list[Shown], Worths]:
    """Draw all figures of worth, compared with `BASELINE`."""
    worths, found = Worths(curves, BASELINE), looks(curves.agents)
    return [*draw_overview(worths, found), *draw_loops(worths, found)], worths


def file_names(names: Sequence[str]) -> list[str]:
    """Return a unique file name suffix for each of `names`; empty if there is only one."""
    if len(names) < 2:
        return [""] * len(names)
    slugs = [re.sub(r"[^\w.]+", "-", name).strip("-") for name in names]
    return [f"-{s}" if slugs.count(s) == 1 else f"-{s}-{i}" for i, s in enumerate(slugs, start=1)]


def _of_settings(material: Material) -> Iterator[Shown]:
    files = file_names([standing.setting.calibrator for standing in material.standings])
    several = len(files) > 1
    for standing, file in zip(material.standings, files, strict=True):
        end = f" ({named(standing.setting, material.campaign)})" if several else ""
        yield from _of_setting(material, standing, end, file)


def _of_setting(material: Material, standing: Standing, end: str, file: str) -> Iterator[Shown]:
    rows, given = material.rows_of(standing.setting), (material.campaign, standing.setting)
    if isinstance(ranked := standing.ranking, Ranking):
        yield Shown(
            f"ranking{file}.png", f"Ranking{end}", captions.RANKING,
            captions.ranking_alt(ranked), png(figures.ranking(ranked, material.looks)),
        )  # fmt: skip
    yield Shown(
        f"gaps{file}.png", f"Gap against experiments{end}", captions.GAPS,
        captions.gaps_alt(rows, "experiments"),
        png(figures.against_experiments(*given, material.looks)),
    )  # fmt: skip
    if isinstance(profiled := standing.profiles, Profiles):
        yield Shown(
            f"profiles{file}.png", f"Data profiles{end}", captions.profiles_caption(profiled),
            captions.profiles_alt(profiled), png(figures.data_profiles(profiled, material.looks)),
        )  # fmt: skip
    yield Shown(
        f"questions{file}.png", f"Gap against number of questions{end}", captions.QUESTIONS,
        captions.gaps_alt(rows, "questions"),
        png(figures.against_questions(*given, material.looks)),
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


def _groups(curves: Curves) -> list[list[Setting]]:
    """Return the settings without and with wrong answers, as far as there are any."""
    both = ([s for s in curves.settings if s.noisy == noisy] for noisy in (False, True))
    return [group for group in both if group]


def _of_all_loops(
    worths: Worths, looks: Mapping[str, Look], settings: Sequence[Setting]
) -> Iterator[Shown]:
    """Yield the figures with all `settings`, which are all sure or all noisy."""
    end, file = (" with wrong answers", "-noisy") if settings[0].noisy else ("", "")
    budgets = " and ".join(map(str, sorted({s.n_max for s in settings})))
    baseline = short_name(worths.baseline)
    yield Shown(
        f"worth-summary{file}.png", f"Worth after {budgets} experiments{end}", captions.SUMMARY,
        captions.summary_alt(worths, settings), png(figures.summary(worths, settings, looks)),
    )  # fmt: skip
    if any(worths.ended(s)["improvement"].notna().any() for s in settings):
        yield Shown(
            f"worth-improvement{file}.png", f"Who beats {baseline}{end}",
            captions.improvement_caption(baseline), captions.improvement_alt(worths, settings),
            png(figures.improvements(worths, settings)),
        )  # fmt: skip
    yield Shown(
        f"worth-drift{file}.png", f"Worth along the study{end}", captions.DRIFT,
        captions.drift_alt(worths, settings), png(figures.along(worths, settings, looks)),
    )  # fmt: skip


def _of_loops(
    worths: Worths, looks: Mapping[str, Look], settings: Sequence[Setting]
) -> Iterator[Shown]:
    files = file_names([s.name(settings) for s in settings])
    for setting, file in zip(settings, files, strict=True):
        name, alt = setting.name(settings), captions.loops_alt(worths.curves, setting)
        yield Shown(
            f"worth-experiments{file}.png", f"Worth against experiments: {name}",
            captions.WORTH_BY_EXPERIMENTS, f"Plots of worth against experiments. {alt}",
            png(figures.worth_by_experiments(worths, setting, looks)),
        )  # fmt: skip
        if any(asked[-1] for asked in worths.curves.of(setting)["asked"]):
            yield Shown(
                f"worth-answers{file}.png", f"Worth against answers: {name}",
                captions.WORTH_BY_ANSWERS, f"Plots of worth against answers. {alt}",
                png(figures.worth_by_answers(worths, setting, looks)),
            )  # fmt: skip


def png(figure: Figure) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    buffer = BytesIO()
    save(figure, buffer)
    return buffer.getvalue()
