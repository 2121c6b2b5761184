"""Print the tables of the benchmark in the terminal."""

from collections.abc import Iterable, Sequence
from itertools import groupby

import pandas as pd
from rich import box, table
from rich.console import Console
from rich.markup import escape

from prefcal_bench.cells.cell import Result
from prefcal_bench.cells.duels import PAPER, Duel
from prefcal_scenarios.wording import printable

from .campaign import campaign_of
from .missing import failures, in_holes, missing
from .rows import BASELINE, duel_rows, gap_rows, worth_rows
from .tables import TextTable, duel_numbers, numbers, worth_numbers
from .words import named

_MOST = 5  # number of lines about missing or failed cells; the page shows all of them
_WIDE = 110  # width of a terminal, in characters, that has room for quartiles and p
_STYLES = {"best": "[bold green]", "sure": "[bold]"}  # styles by the kind of a cell


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
    campaign = campaign_of(results, published)
    worth, gaps = worth_rows(campaign, baseline), gap_rows(campaign, baseline)
    narrow = () if console.width >= _WIDE else ("quartiles", "p")
    for setting in campaign.having("worth"):
        _print(console, worth_numbers(campaign, worth, setting, baseline))
    for setting, rows in gaps[gaps["gap_median"].notna()].groupby("setting", sort=False):
        label = f"Gap after {setting.n_max} experiments, {named(setting, campaign)}"
        _print(console, numbers(rows, baseline, label).without(narrow))
    met = duel_rows(duels)
    for _, rows in met[met["rival"].isin((PAPER, baseline))].groupby(["problem", "calibrator"]):
        _print(console, duel_numbers(rows))
    if not len(campaign.ours):
        console.print("No results yet.")
    _list(console, "Failed", [f"{cell}: {words}" for cell, words in failures(campaign)])
    _list(console, "Missing", missing(campaign))
    _list(console, "Worth knowing", in_holes(campaign))


def _print(console: Console, shown: TextTable) -> None:
    """Print a table, of which a heading that repeats is shown once, with rows of it together."""
    shown = shown.without(shown.page_only)
    printed = table.Table(
        title=_safe(shown.label),
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        caption=_safe(shown.caption),
        caption_justify="left",
        pad_edge=False,
        collapse_padding=True,
    )
    for name in shown.columns:  # intervals can wrap, names cannot
        words = name in shown.words
        printed.add_column(_safe(name), justify="left" if words else "right", no_wrap=words)
    for heading, rows in groupby(shown.rows, lambda row: row[0].text):
        for number, (_, *cells) in enumerate(rows):
            texts = [_STYLES.get(cell.kind, "") + _safe(cell.text) for cell in cells]
            printed.add_row("" if number else _safe(heading), *texts)
        if number:
            printed.add_section()
    console.print(printed)


def _list(console: Console, what: str, lines: Sequence[str]) -> None:
    if not lines:
        return
    console.print(f"[bold]{what}[/] ({len(lines)}):")
    for line in lines[:_MOST]:
        console.print(f"  {_safe(line)}", highlight=False)
    if len(lines) > _MOST:
        console.print(f"  and {len(lines) - _MOST} more")


def _safe(text: str) -> str:
    """Return text without markup or control characters, since names can come from anyone."""
    return escape(printable(text))
