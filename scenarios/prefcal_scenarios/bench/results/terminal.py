"""Print the table of the benchmark in the terminal."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from prefcal_scenarios.app.presentation.wording import printable
from prefcal_scenarios.bench.duels import PAPER, Duel
from prefcal_scenarios.bench.result import Result
from prefcal_scenarios.bench.worth.curves import Curves, Setting, curves_of, frame_of, joined
from prefcal_scenarios.bench.worth.rows import checkpoints, worth_rows
from prefcal_scenarios.bench.worth.words import chance, plain_number, with_interval

from .campaign import Campaign, Regime, campaign_of
from .duelling import Tally, tallies
from .missing import failures, in_holes, missing
from .ranking import SIGNIFICANCE
from .rows import BASELINE, Choices, rows_of
from .words import percent, probability, regime_name, row_texts, short

_MOST = 5
"""Number of lines about missing or failed cells; the page shows all of them."""
_WIDE = 110
"""Width of a terminal, in characters, that has room for quartiles and p."""


def print_table(
    console: Console,
    results: Iterable[Result],
    duels: Iterable[Duel] = (),
    *,
    baseline: str = BASELINE,
    published: pd.DataFrame | None = None,
) -> None:
    """Print tables of worth by taste and of gaps by calibrator, the duels, and what is missing.

    Prints only duels with the paper's optimum and with `baseline`; the page shows all.

    Raises:
        SettingsError: If results or duels contradict each other.
    """
    choices, results = Choices(baseline), list(results)
    campaign, curves = campaign_of(results), curves_of(joined(frame_of(results), published))
    rows = rows_of(campaign, choices)
    worths = worth_rows(curves, baseline, choices.seed)
    for setting in curves.settings:
        console.print(_worths(curves, setting, worths[worths["setting"] == setting], baseline))
    for regime in campaign.regimes:
        shown = rows[(rows["regime"] == regime) & rows["gap_median"].notna()]
        if len(shown):
            console.print(_gaps(campaign, regime, shown, choices, console.width >= _WIDE))
    for _, group in groupby(tallies(duels), lambda t: (t.problem, t.calibrator)):
        console.print(_duels([t for t in group if t.rival in (PAPER, baseline)]))
    if not len(rows):
        console.print("No results yet.")
    _tell(console, "failed", [f"{cell}: {words}" for cell, words in failures(campaign)])
    _tell(console, "missing", missing(campaign))
    _tell(console, "worth knowing", in_holes(campaign))


def _table(title: str, caption: str, words: Sequence[str], numbers: Sequence[str]) -> Table:
    table = Table(
        title=_safe(title), title_justify="left", title_style="bold", box=SIMPLE_HEAD,
        caption=_safe(caption), caption_justify="left", pad_edge=False, collapse_padding=True,
    )  # fmt: skip
    for name in words:
        table.add_column(_safe(name), no_wrap=True)
    for name in numbers:  # intervals can wrap, names cannot
        table.add_column(_safe(name), justify="right")
    return table


def _worths(curves: Curves, setting: Setting, rows: pd.DataFrame, baseline: str) -> Table:
    early, late = checkpoints(setting)
    beats = f"beats {baseline.rpartition(':')[2]}"
    table = _table(
        f"Worth on {_count_of(curves, setting)}, {setting.name(curves.settings)}",
        "Worth: number of random experiments that find a θ at least as good, geometric mean with "
        "its 95 % interval. Beats: probability. Drift: best held before over end.",
        ("agent",),
        (f"after {early}", f"after {late} experiments", "middle half", "answers",
         beats, "drift"),
    )  # fmt: skip
    by_experiments = rows[rows["unit"] == "experiments"]
    first = by_experiments[by_experiments["after"] == early].set_index("agent")["worth"]
    ends = by_experiments[by_experiments["after"] == late]
    for row in ends.sort_values("worth", ascending=False, kind="stable").itertuples():
        table.add_row(
            _safe(row.agent), plain_number(first[row.agent]),
            escape(with_interval(row.worth, row.worth_low, row.worth_high)),
            plain_number(row.interquartile_mean), f"{row.answers:.0f}",
            escape(chance(row.improvement, row.improvement_low, row.improvement_high)),
            f"×{row.drift:.2f}",
        )  # fmt: skip
    return table


def _count_of(curves: Curves, setting: Setting) -> str:
    count = len(curves.loops(setting))
    return f"{count} closed loop{'s' * (count != 1)}"


def _gaps(
    campaign: Campaign, regime: Regime, rows: pd.DataFrame, choices: Choices, wide: bool
) -> Table:
    name = regime_name(regime, campaign.regimes)
    table = _table(
        f"Gap after {regime.n_max} experiments, {name}",
        f"× {choices.baseline}: {choices.average} ratio of both gaps, seed by seed, each at "
        f"least {short(choices.floor)}, with its 95 % interval. p: Wilcoxon's test, corrected "
        "(Holm) for the agents on that problem. w–t–l: seeds won, tied, lost.",
        ("problem", "agent"),
        ("seeds", "median gap", *(("quartiles",) if wide else ()), f"× {choices.baseline}",
         "w–t–l", *(("p",) if wide else ())),
    )  # fmt: skip
    for problem, group in rows.groupby("problem", sort=False):
        lowest = short(group["gap_median"].min())
        for number, row in enumerate(group.itertuples()):
            table.add_row("" if number else _safe(problem), *_cells(row, lowest, wide))
        table.add_section()
    return table


def _cells(row: Any, lowest: str, wide: bool) -> Iterator[str]:
    texts = row_texts(row)
    median, p = texts["median gap"], texts["p"]
    yield _safe(row.agent)
    yield texts["seeds"]
    yield f"[bold green]{median}[/]" if median == lowest else median
    if wide:
        yield texts["quartiles"]
    yield texts["ratio"]
    yield texts["won–tied–lost"]
    if wide:
        yield f"[bold]{p}[/]" if row.p_holm is not None and row.p_holm < SIGNIFICANCE else p


def _duels(found: Sequence[Tally]) -> Table | str:
    if not found:
        return ""
    first = found[0]
    table = _table(
        f"Who is preferred: {first.problem}, {first.calibrator} calibrator",
        "Share of seeds in which the agent's θ is preferred, with its exact 95 % interval.",
        ("agent", "against"),
        ("preferred", "95 %", "w–t–l", "p"),
    )
    for agent, group in groupby(found, lambda t: t.agent):
        name = agent
        for t in group:
            table.add_row(
                _safe(name), _safe(t.rival), percent(t.share),
                f"{percent(t.low)} to {percent(t.high)}", f"{t.wins}–{t.ties}–{t.losses}",
                probability(t.p),
            )  # fmt: skip
            name = ""
    return table


def _tell(console: Console, what: str, lines: Sequence[str]) -> None:
    if not lines:
        return
    console.print(f"[bold]{what.capitalize()}[/] ({len(lines)}):")
    for line in lines[:_MOST]:
        console.print(f"  {_safe(line)}", highlight=False)
    if len(lines) > _MOST:
        console.print(f"  and {len(lines) - _MOST} more")


def _safe(text: str) -> str:
    """Return text without markup or control characters, since names can come from anyone."""
    return escape(printable(text))
