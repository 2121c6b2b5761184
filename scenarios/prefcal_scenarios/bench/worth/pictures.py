"""Select the figures of worth, with their captions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from prefcal_scenarios.app.presentation.style import style
from prefcal_scenarios.bench.results.figures import Look
from prefcal_scenarios.bench.results.pictures import Shown, file_names, png

from . import intervals, lines
from .curves import Curves, Setting
from .intervals import ended
from .words import plain_number, short_name

WORTH = (
    "The worth of a θ is how many random experiments it takes on average to find one at least as "
    "good, by the taste without noise."
)
SUMMARY = (
    f"{WORTH} Marker: geometric mean over loops and seeds of the θ that the agent returns; bar: "
    "its 95 % bootstrap interval over the seeds of each loop. Dashed: random search in theory. "
    "Hollow: agents that are told values in place of answers."
)
DRIFT = (
    f"{WORTH} Line: geometric mean over loops and seeds of the θ that the agent would return if it "
    "were stopped there. To the right, a bar leads from the worth at the end up to that of the "
    "best θ that the agent held before: a long bar means that good θ were lost again."
)
EXPERIMENTS = (
    "Worth of the θ that an agent would return if it were stopped there. Line: geometric mean over "
    "the seeds; bars to the right, at the end: the middle half of the seeds. Higher is better."
)
ANSWERS = (
    "The same worth against the number of comparisons that had to be answered; bars to the right: "
    "at the end of the study, even if it is beyond the right edge. An agent that sees values asks "
    "none; its mean at the end is a dashed line."
)


@dataclass(frozen=True)
class Worths:
    """Worth of all studies, for figures and page.

    Args:
        curves: Worth along each study.
        rows: Table of worth, see `worth_rows`.
        baseline: Agent that the others are compared with.
        looks: Looks of the agents.
    """

    curves: Curves
    rows: pd.DataFrame
    baseline: str
    looks: Mapping[str, Look]


def draw_overview(worths: Worths) -> list[Shown]:
    """Draw the figures with all loops together, first those of answers that are never wrong."""
    with style():
        return [one for group in _groups(worths.curves) for one in _of_all(worths, group)]


def draw_loops(worths: Worths) -> list[Shown]:
    """Draw the figures with a panel for each loop.

    Tastes with wrong answers have none if there are others: the page would be endless.
    """
    with style():
        return [one for group in _groups(worths.curves)[:1] for one in _of_loops(worths, group)]


def _groups(curves: Curves) -> list[list[Setting]]:
    """Return the settings without and with wrong answers, as far as there are any."""
    both = ([s for s in curves.settings if s.noisy == noisy] for noisy in (False, True))
    return [group for group in both if group]


def _of_all(worths: Worths, settings: Sequence[Setting]) -> Iterator[Shown]:
    """Yield the figures with all `settings`, which are all sure or all noisy."""
    end, file = (" with wrong answers", "-noisy") if settings[0].noisy else ("", "")
    curves, rows, looks = worths.curves, worths.rows, worths.looks
    budgets = " and ".join(map(str, sorted({s.n_max for s in settings})))
    yield Shown(
        f"worth-summary{file}.png", f"Worth after {budgets} experiments{end}", SUMMARY,
        _summary_alt(rows, settings), png(intervals.summary(rows, settings, looks)),
    )  # fmt: skip
    if any(ended(rows, s)["improvement"].notna().any() for s in settings):
        yield Shown(
            f"worth-improvement{file}.png", f"Who beats {short_name(worths.baseline)}{end}",
            _improvement_caption(short_name(worths.baseline)), _improvement_alt(rows, settings),
            png(intervals.improvements(rows, settings)),
        )  # fmt: skip
    yield Shown(
        f"worth-drift{file}.png", f"Worth along the study{end}", DRIFT,
        _drift_alt(rows, settings), png(lines.along(curves, settings, looks, worths.baseline)),
    )  # fmt: skip


def _of_loops(worths: Worths, settings: Sequence[Setting]) -> Iterator[Shown]:
    files = file_names([s.name(settings) for s in settings])
    for setting, file in zip(settings, files, strict=True):
        name = setting.name(settings)
        given = (worths.curves, setting, worths.looks, worths.baseline)
        alt = _loops_alt(worths.curves, setting)
        yield Shown(
            f"worth-experiments{file}.png", f"Worth against experiments: {name}", EXPERIMENTS,
            f"Plots of worth against experiments. {alt}", png(lines.against_experiments(*given)),
        )  # fmt: skip
        if any(asked[-1] for asked in worths.curves.of(setting)["asked"]):
            yield Shown(
                f"worth-answers{file}.png", f"Worth against answers: {name}", ANSWERS,
                f"Plots of worth against answers. {alt}", png(lines.against_answers(*given)),
            )  # fmt: skip


def _improvement_caption(baseline: str) -> str:
    return (
        f"Probability that the agent's θ is worth more than that of {baseline}, for one seed of "
        "each on any loop; a tie counts half. Small: its 95 % bootstrap interval, if there is "
        "room; bold if that interval excludes 50 %."
    )


def _summary_alt(rows: pd.DataFrame, settings: Sequence[Setting]) -> str:
    texts = []
    for setting in settings:
        ends = ended(rows, setting).sort_values("worth", ascending=False)
        agents = ", ".join(f"{r.agent} {plain_number(r.worth)}" for r in ends.itertuples())
        texts.append(f"{setting.name(settings)}: {agents}")
    return f"Worth at the end. {'; '.join(texts)}."


def _improvement_alt(rows: pd.DataFrame, settings: Sequence[Setting]) -> str:
    texts = []
    for setting in settings:
        ends = ended(rows, setting).dropna(subset="improvement")
        agents = ", ".join(f"{r.agent} {100 * r.improvement:.0f} %" for r in ends.itertuples())
        texts.append(f"{setting.name(settings)}: {agents or 'nobody'}")
    return f"Heat map of the probability to beat the baseline. {'; '.join(texts)}."


def _drift_alt(rows: pd.DataFrame, settings: Sequence[Setting]) -> str:
    texts = []
    for setting in settings:
        agents = ", ".join(f"{r.agent} {r.drift:.1f}" for r in ended(rows, setting).itertuples())
        texts.append(f"{setting.name(settings)}: {agents}")
    return f"Plots of worth along the study. Best before over end: {'; '.join(texts)}."


def _loops_alt(curves: Curves, setting: Setting) -> str:
    studies = curves.of(setting)
    ends = studies.assign(end=studies["worth"].map(lambda w: w[-1]).astype(float))
    means = ends.groupby(["loop", "agent"], observed=True)["end"].median().reset_index()
    best = means.loc[means.groupby("loop", observed=True)["end"].idxmax()]
    agents = ", ".join(f"{r.loop} {r.agent} ({plain_number(r.end)})" for r in best.itertuples())
    return f"Highest median worth at the end: {agents}."
