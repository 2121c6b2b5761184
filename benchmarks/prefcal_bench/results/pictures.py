"""Select the figures of a campaign, with captions and texts for people who cannot see them."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import pandas as pd

from prefcal_scenarios.style import png, style

from . import figures
from .campaign import Campaign, Setting
from .rows import BASELINE, ended, gap_rows, worth_rows
from .words import named, plain_number, short

_WORTH = (
    "The worth of a θ is how many random experiments it takes on average to find one at least as "
    "good, by the taste without noise."
)
SUMMARY = (
    f"{_WORTH} Marker: geometric mean over loops and seeds of the θ that the agent returns; bar: "
    "its 95 % bootstrap interval over the seeds of each loop. Dashed: random search in theory. "
    "Hollow: agents that are told values in place of answers."
)
DRIFT = (
    f"{_WORTH} Line: geometric mean over loops and seeds of the θ that the agent would return if "
    "it were stopped there. To the right, a bar leads from the worth at the end up to that of the "
    "best θ that the agent held before: a long bar means that good θ were lost again."
)
CURVES = {
    ("gap", "experiments"): (
        "True gap to the best known value, without noise, of the θ that an agent would return if "
        "it were stopped there. Line: median over the seeds. Band, and bars to the right for the "
        "end: the middle half of the seeds. Lower is better; the scales differ."
    ),
    ("worth", "experiments"): (
        "Worth of the θ that an agent would return if it were stopped there. Line: geometric mean "
        "over the seeds; bars to the right, at the end: the middle half of the seeds. Higher is "
        "better."
    ),
} | {
    (value, "answers"): (
        f"The same {value} against the number of comparisons that had to be answered; bars to the "
        "right: at the end of the study, even if it is beyond the right edge. An agent that sees "
        "values asks none; its end is a dashed line."
    )
    for value in ("gap", "worth")
}


@dataclass(frozen=True, slots=True)
class CampaignFigure:
    """A figure as PNG with its heading, its caption, and a text for people who cannot see it."""

    file: str
    title: str
    caption: str
    alt: str
    content: bytes


@dataclass(frozen=True)
class Material:
    """Results for figures and page."""

    campaign: Campaign  # all results, and published ones
    baseline: str = BASELINE  # agent that all others are compared with

    @cached_property
    def gaps(self) -> pd.DataFrame:
        """Return the table of gaps."""
        return gap_rows(self.campaign, self.baseline)

    @cached_property
    def worths(self) -> pd.DataFrame:
        """Return the table of worth."""
        return worth_rows(self.campaign, self.baseline)

    def gaps_of(self, setting: Setting) -> pd.DataFrame:
        """Return the rows of a setting that have a gap."""
        return self.gaps[(self.gaps["setting"] == setting) & self.gaps["gap_median"].notna()]


def draw_overview(material: Material) -> list[CampaignFigure]:
    """Draw the worth on all loops together, first that of answers that are never wrong."""
    with style():
        return [one for group in _groups(material) for one in _of_all_loops(material, group)]


def draw_loops(material: Material) -> list[CampaignFigure]:
    """Draw the worth with a panel for each loop.

    Tastes with wrong answers have none if there are others: the page would be endless.
    """
    with style():
        settings = next(iter(_groups(material)), [])
        ends = file_names([s.name(settings) for s in settings])
        return [
            one
            for setting, end in zip(settings, ends, strict=True)
            for one in _curves(material, setting, "worth", f": {setting.name(settings)}", end)
        ]


def draw_gaps(material: Material) -> list[CampaignFigure]:
    """Draw the figures of gaps, by setting."""
    with style():
        found, settings = list[CampaignFigure](), material.campaign.having("gap")
        ends = file_names([setting.calibrator for setting in settings])
        for setting, file in zip(settings, ends, strict=True):
            title = f" ({named(setting, material.campaign)})" if len(settings) > 1 else ""
            found += _curves(material, setting, "gap", title, file)
        return found


def file_names(names: Sequence[str]) -> list[str]:
    """Return a unique file name suffix for each of `names`; empty if there is only one."""
    if len(names) < 2:
        return [""] * len(names)
    slugs = [re.sub(r"[^\w.]+", "-", name).strip("-") for name in names]
    return [f"-{s}" if slugs.count(s) == 1 else f"-{s}-{i}" for i, s in enumerate(slugs, start=1)]


def _curves(
    material: Material, setting: Setting, value: str, title: str, file: str
) -> Iterator[CampaignFigure]:
    """Yield gap or worth against experiments, and against answers if there are any."""
    studies = material.campaign.of(setting, value)
    ends = studies.assign(end=studies[value].map(lambda curve: curve[-1]).astype(float))
    medians = ends.groupby(["problem", "agent"], observed=True)["end"].median()
    groups = medians.groupby(level="problem", observed=True)
    best = medians[groups.idxmin() if value == "gap" else groups.idxmax()]
    word, number = ("Lowest", short) if value == "gap" else ("Highest", plain_number)
    texts = ", ".join(f"{problem} {agent} ({number(end)})" for (problem, agent), end in best.items())
    for unit in ("experiments", "answers"):
        if unit == "answers" and not any(asked[-1] for asked in studies["asked"]):
            continue
        figure = figures.against(material.campaign, setting, value, unit, material.baseline)
        alt = f"Plots of the {value} against {unit}. {word} median {value} at the end: {texts}."
        yield CampaignFigure(
            f"{value}-{unit}{file}.png",
            f"{value.capitalize()} against {unit}{title}",
            CURVES[value, unit],
            alt,
            png(figure),
        )


def _groups(material: Material) -> list[list[Setting]]:
    """Return the settings of worth without and with wrong answers, as far as there are any."""
    settings = material.campaign.having("worth")
    both = ([s for s in settings if s.noisy == noisy] for noisy in (False, True))
    return [group for group in both if group]


def _of_all_loops(material: Material, settings: Sequence[Setting]) -> Iterator[CampaignFigure]:
    """Yield the figures with all `settings`, which are all sure or all noisy."""
    campaign, rows = material.campaign, material.worths
    end, file = (" with wrong answers", "-noisy") if settings[0].noisy else ("", "")
    budgets = " and ".join(map(str, sorted({s.n_max for s in settings})))
    worth = _by_setting(rows, settings, lambda row: plain_number(row.worth))
    yield CampaignFigure(
        f"worth-summary{file}.png",
        f"Worth after {budgets} experiments{end}",
        SUMMARY,
        f"Worth at the end. {worth}.",
        png(figures.summary(campaign, rows, settings)),
    )
    drift = _by_setting(rows, settings, lambda row: f"{row.drift:.1f}")
    yield CampaignFigure(
        f"worth-drift{file}.png",
        f"Worth along the study{end}",
        DRIFT,
        f"Plots of worth along the study. Best before over end: {drift}.",
        png(figures.along(campaign, settings, material.baseline)),
    )


def _by_setting(rows: pd.DataFrame, settings: Sequence[Setting], text: Callable[[Any], str]) -> str:
    """Return a text of each agent by setting, the highest worth first."""
    parts = []
    for setting in settings:
        agents = (f"{row.agent} {text(row)}" for row in ended(rows, setting).itertuples())
        parts.append(f"{setting.name(settings)}: {', '.join(agents)}")
    return "; ".join(parts)
