"""Tables of the page, prepared for its template: the text and the kind of each cell."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from .campaign import Campaign, Regime
from .duelling import Tally
from .ranking import SIGNIFICANCE
from .rows import Choices
from .words import percent, probability, regime_name, row_texts, score, short


@dataclass(frozen=True, slots=True)
class Mark:
    """Sign after a number: its class in the style sheet, and its meaning."""

    kind: str
    sign: str
    title: str


@dataclass(frozen=True, slots=True)
class Cell:
    """Cell of a table: plain text, its class in the style sheet, and an optional sign."""

    text: str
    kind: str = ""
    mark: Mark | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """Table of the page.

    Args:
        label: Name of the table, for people who cannot see it.
        caption: Caption.
        columns: Names of the columns.
        rows: Cells of each row, starting with its heading.
        words: Columns that hold text, not numbers.
        tall: Whether the table may need to scroll vertically.
    """

    label: str
    caption: str
    columns: tuple[str, ...]
    rows: list[list[Cell]]
    words: tuple[str, ...] = ()
    tall: bool = True


def overview(campaign: Campaign, rows: pd.DataFrame, regime: Regime, choices: Choices) -> Table:
    """Return the median gaps of a regime by problem (rows) and agent, with the lowest tinted."""
    agents = [agent for agent in campaign.agents if agent in set(rows["agent"])]
    counts = dict.fromkeys(agents, 0)
    lines = []
    for problem, group in rows.groupby("problem", sort=False):
        lowest = short(group["gap_median"].min())
        found = {row.agent: row for row in group.itertuples()}
        cells = [Cell(problem), Cell(str(campaign.knobs(problem) or "–"), "note")]
        for agent in agents:
            row = found.get(agent)
            text = "–" if row is None else short(row.gap_median)
            best = row is not None and text == lowest
            counts[agent] += best
            mark = None if row is None else _mark(row, choices)
            cells.append(Cell(text, "best" if best else "", mark))
        lines.append(cells)
    ends = [Cell(f"{counts[agent]} of {len(lines)}") for agent in agents]
    caption = (
        f"Median gap after {regime.n_max} experiments, {regime_name(regime, campaign.regimes)}; "
        "the lowest is tinted. ▲ significantly nearer, ▼ significantly farther than "
        f"{choices.baseline} (Wilcoxon, 5 % after Holm's correction for the agents "
        "on that problem)."
    )
    return Table(
        f"Median gaps, {regime.calibrator} {regime.n_max}", caption,
        ("problem", "knobs", *agents), [*lines, [Cell("lowest on"), Cell(""), *ends]], tall=False,
    )  # fmt: skip


def _mark(row: Any, choices: Choices) -> Mark | None:
    """Return the sign of a row that differs significantly from the baseline, else None."""
    if row.p_holm is None or row.p_holm >= SIGNIFICANCE:
        return None
    nearer = row.log10_ratio < 0
    if row.log10_ratio == 0:  # ties at the median
        nearer = row.wins > row.losses
    kind, sign, word = ("yes", "▲", "nearer") if nearer else ("no", "▼", "farther")
    return Mark(kind, sign, f"significantly {word} than {choices.baseline}")


def numbers(rows: pd.DataFrame, choices: Choices, label: str) -> Table:
    """Return all numbers of the rows of one regime."""
    columns = [
        "seeds", "median gap", "quartiles", "best visited", "questions", "ratio",
        "won–tied–lost", "p",
    ]  # fmt: skip
    holed = rows["seeds_in_hole"].notna().any()
    columns += ["in the hole"] if holed else []
    columns += ["s/proposal"] if rows["seconds_per_proposal"].notna().any() else []
    caption = (
        f"× {choices.baseline}: {choices.average} over the seeds of the ratio of both gaps, each "
        f"counted as at least {short(choices.floor)}, with a 95 % bootstrap interval; below 1 the "
        "agent is nearer. p: Wilcoxon signed-rank test, two-sided, after Holm's correction for the "
        "agents on that problem. Failed seeds have no gap. Full precision in table.csv."
    )
    if holed:
        caption += " In the hole: seeds that ended where the cost is lower than it should be."
    lines = []
    for row in rows.itertuples():
        texts = row_texts(row)
        cells = [Cell(texts[column]) for column in columns]
        lines.append([Cell(row.problem), Cell(row.agent, "words"), *cells])
    titles = {"ratio": f"× {choices.baseline} (95 %)"}
    names = ("problem", "agent", *(titles.get(column, column) for column in columns))
    return Table(label, caption, names, lines, words=("agent",))


def duels(tallies: Sequence[Tally]) -> Table:
    """Return all tallies of one problem and calibrator."""
    caption = (
        "Share of seeds in which the agent's θ is preferred, with its exact binomial interval; "
        "p of the exact sign test on wins and losses, not corrected."
    )
    lines = []
    for t in tallies:
        texts = (
            str(t.seeds), percent(t.share), f"{percent(t.low)} to {percent(t.high)}",
            score(t.wins, t.ties, t.losses), probability(t.p),
        )  # fmt: skip
        lines.append([Cell(t.agent), Cell(t.rival, "words"), *map(Cell, texts)])
    columns = ("agent", "against", "seeds", "preferred", "95 % interval", "won–tied–lost", "p")
    label = f"Duels: {tallies[0].problem}, {tallies[0].calibrator}"
    return Table(label, caption, columns, lines, words=("against",))


def failed(cells: Sequence[tuple[str, str]]) -> Table:
    """Return the failed cells with their reasons."""
    lines = [[Cell(cell), Cell(words, "words")] for cell, words in cells]
    caption = "They have no numbers in any table or figure."
    return Table("Failed cells", caption, ("cell", "what happened"), lines, ("what happened",))
