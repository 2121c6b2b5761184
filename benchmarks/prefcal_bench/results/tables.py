"""Tables of the page and the terminal: the text and the kind of each cell."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import pandas as pd

from .campaign import Campaign
from .curves import Curves, Setting
from .duelling import Tally
from .rows import checkpoints, worth_rows
from .standing import SIGNIFICANCE
from .statistics import FLOOR
from .words import (
    chance,
    named,
    percent,
    plain_number,
    probability,
    ratio,
    score,
    short,
    short_name,
    with_interval,
)


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
    """Table of the page or the terminal.

    Args:
        label: Title, and name of the table for people who cannot see it.
        caption: Caption.
        columns: Names of the columns.
        rows: Cells of each row, starting with its heading.
        words: Columns that hold text, not numbers.
        tall: Whether the table may need to scroll vertically.
        page_only: Columns that a terminal has no room for.
    """

    label: str
    caption: str
    columns: tuple[str, ...]
    rows: list[list[Cell]]
    words: tuple[str, ...] = ()
    tall: bool = True
    page_only: tuple[str, ...] = ()

    def without(self, columns: Collection[str]) -> "Table":
        """Return the table without some of its columns."""
        kept = [i for i, column in enumerate(self.columns) if column not in columns]
        rows = [[row[i] for i in kept] for row in self.rows]
        return replace(self, columns=tuple(self.columns[i] for i in kept), rows=rows)


def overview(campaign: Campaign, rows: pd.DataFrame, setting: Setting, baseline: str) -> Table:
    """Return the median gaps of a setting by problem (rows) and agent, with the lowest tinted."""
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
            mark = None if row is None else _mark(row, baseline)
            cells.append(Cell(text, "best" if best else "", mark))
        lines.append(cells)
    ends = [Cell(f"{counts[agent]} of {len(lines)}") for agent in agents]
    caption = (
        f"Median gap after {setting.n_max} experiments, {named(setting, campaign)}; "
        "the lowest is tinted. ▲ significantly nearer, ▼ significantly farther than "
        f"{baseline} (Wilcoxon, 5 % after Holm's correction for the agents "
        "on that problem)."
    )
    return Table(
        f"Median gaps, {setting.calibrator} {setting.n_max}", caption,
        ("problem", "knobs", *agents), [*lines, [Cell("lowest on"), Cell(""), *ends]], tall=False,
    )  # fmt: skip


def _mark(row: Any, baseline: str) -> Mark | None:
    """Return the sign of a row that differs significantly from the baseline, else None."""
    if row.p_holm is None or row.p_holm >= SIGNIFICANCE:
        return None
    nearer = row.log10_ratio < 0
    if row.log10_ratio == 0:  # ties at the median
        nearer = row.wins > row.losses
    kind, sign, word = ("yes", "▲", "nearer") if nearer else ("no", "▼", "farther")
    return Mark(kind, sign, f"significantly {word} than {baseline}")


_GAP_COLUMNS = (
    "seeds", "median gap", "quartiles", "best visited", "questions", "ratio", "won–tied–lost", "p",
    "in the hole", "s/proposal",
)  # fmt: skip


def _gap_cells(row: Any) -> dict[str, str]:
    """Return the cells of a row of the table of gaps as text, by column."""
    low, high = row.gap_lower_quartile, row.gap_upper_quartile
    return {
        "seeds": f"{row.seeds} of {row.seeds + row.failed}" if row.failed else str(row.seeds),
        "median gap": short(row.gap_median),
        "quartiles": "–" if low is None else f"{short(low)} to {short(high)}",
        "best visited": short(row.visited_median),
        "questions": short(row.questions_median),
        "ratio": ratio(row.log10_ratio, row.log10_ratio_low, row.log10_ratio_high),
        "won–tied–lost": score(row.wins, row.ties, row.losses),
        "p": probability(row.p_holm),
        "in the hole": "–" if row.seeds_in_hole is None else str(row.seeds_in_hole),
        "s/proposal": short(row.seconds_per_proposal),
    }


def numbers(rows: pd.DataFrame, baseline: str, label: str) -> Table:
    """Return all numbers of the rows of one setting, with the lowest medians tinted."""
    holed = rows["seeds_in_hole"].notna().any()
    timed = rows["seconds_per_proposal"].notna().any()
    absent = {"in the hole": not holed, "s/proposal": not timed}
    columns = [column for column in _GAP_COLUMNS if not absent.get(column)]
    caption = (
        f"× {baseline}: median over the seeds of the ratio of both gaps, each at least "
        f"{short(FLOOR)}, with a 95 % bootstrap interval; below 1 the agent is nearer. "
        "p: Wilcoxon signed-rank test, two-sided, after Holm's correction for the "
        "agents on that problem. Failed seeds have no gap. Full precision in table.csv."
    )
    if holed:
        caption += " In the hole: seeds that ended where the cost is lower than it should be."
    lines = []
    for problem, group in rows.groupby("problem", sort=False):
        lowest = short(group["gap_median"].astype(float).min())
        for row in group.itertuples():
            texts = _gap_cells(row)
            sure = row.p_holm is not None and row.p_holm < SIGNIFICANCE
            kinds = {"median gap": "best" if texts["median gap"] == lowest != "–" else "",
                     "p": "sure" if sure else ""}  # fmt: skip
            cells = (Cell(texts[column], kinds.get(column, "")) for column in columns)
            lines.append([Cell(problem), Cell(row.agent, "words"), *cells])
    titles = {"ratio": f"× {baseline} (95 %)"}
    names = ("problem", "agent", *(titles.get(column, column) for column in columns))
    room = ("best visited", "questions", "in the hole", "s/proposal")
    return Table(label, caption, names, lines, words=("problem", "agent"), page_only=room)


def duels(tallies: Sequence[Tally]) -> Table:
    """Return tallies of one problem and calibrator."""
    caption = (
        "Share of seeds in which the agent's θ is preferred, with its exact binomial interval; "
        "p of the exact sign test on wins and losses, not corrected."
    )
    columns = ("agent", "against", "seeds", "preferred", "95 % interval", "won–tied–lost", "p")
    lines = [[Cell(t.agent), Cell(t.rival, "words"), Cell(str(t.seeds)), *_duel_cells(t)]
             for t in tallies]  # fmt: skip
    label = f"Who is preferred: {tallies[0].problem}, {tallies[0].calibrator} calibrator"
    return Table(label, caption, columns, lines, ("agent", "against"), page_only=("seeds",))


def _duel_cells(t: Tally) -> list[Cell]:
    texts = (percent(t.share), f"{percent(t.low)} to {percent(t.high)}",
             score(t.wins, t.ties, t.losses), probability(t.p))  # fmt: skip
    return list(map(Cell, texts))


def failed(cells: Sequence[tuple[str, str]]) -> Table:
    """Return the failed cells with their reasons."""
    lines = [[Cell(cell), Cell(words, "words")] for cell, words in cells]
    caption = "They have no numbers in any table or figure."
    return Table("Failed cells", caption, ("cell", "what happened"), lines, ("what happened",))


@dataclass(frozen=True)
class Worths:
    """Worth of all studies.

    Args:
        curves: Worth along each study.
        baseline: Agent that the others are compared with.
    """

    curves: Curves
    baseline: str

    @cached_property
    def rows(self) -> pd.DataFrame:
        """Return the table of worth, see `worth_rows`."""
        return worth_rows(self.curves, self.baseline)

    def ended(self, setting: Setting) -> pd.DataFrame:
        """Return the rows of a setting after all its experiments."""
        rows = self.rows
        last = (rows["unit"] == "experiments") & (rows["after"] == setting.n_max)
        return rows[(rows["setting"] == setting) & last]

    def ranked(self, setting: Setting) -> pd.DataFrame:
        """Return these rows, the highest worth first."""
        return self.ended(setting).sort_values("worth", ascending=False, kind="stable")


def worth_numbers(worths: Worths, setting: Setting) -> Table:
    """Return the table of worth of a setting, with the highest worth tinted."""
    rows = worths.rows[worths.rows["setting"] == setting]
    spots, loops = checkpoints(setting), len(worths.curves.loops(setting))
    tinted = _leaders(worths.ended(setting))
    lines = []
    for agent in worths.ranked(setting)["agent"]:
        found = {(r.unit, r.after): r for r in rows[rows["agent"] == agent].itertuples()}
        line = [Cell(agent), Cell(_studies(found["experiments", spots[-1]], loops))]
        for n in spots:
            kind = "best" if n == spots[-1] and agent in tinted else ""
            first, *others = _worth_cells(found["experiments", n])
            line += [Cell(first, kind), *map(Cell, others)]
        by_answers = found.get(("answers", spots[-1] - 1))
        line.append(Cell("–" if by_answers is None else _worth_cells(by_answers)[0]))
        lines.append(line)
    names = ("worth [95 %]", "middle half", "answers",
             f"beats {short_name(worths.baseline)} [95 %]", "drift")  # fmt: skip
    columns = [f"{name} ({n})" for n in spots for name in names]
    last = f"worth after {spots[-1] - 1} answers [95 %]"
    room = ("studies", *columns[1 : len(names)], last)
    caption = (
        f"After {spots[0]} and {spots[-1]} experiments. Worth: geometric mean over the loops and "
        "seeds, with its bootstrap interval; the highest of the agents that ask is tinted. Middle "
        "half: interquartile mean. Answers: mean number given by then. Beats: probability that one "
        "study of the agent on any loop is worth more than one of the baseline. Drift: how many "
        "times more the best θ held before was worth; 1 means that nothing was lost. "
        "Full precision in worth.csv."
    )
    title = f"Worth: {setting.name(worths.curves.settings)}"
    heads = ("agent", "studies", *columns, last)
    return Table(title, caption, heads, lines, ("agent",), page_only=room)


def _leaders(ends: pd.DataFrame) -> set[str]:
    """Return the agents with the highest worth at the end, as shown: of those that ask, if any."""
    asking = ends[ends["answers"].astype(float) > 0]
    compared = asking if len(asking) else ends
    highest = plain_number(compared["worth"].max())
    return {row.agent for row in compared.itertuples() if plain_number(row.worth) == highest}


def _worth_cells(row: Any) -> list[str]:
    """Return worth with its interval, middle half, answers, who beats whom, and drift as text."""
    return [
        with_interval(row.worth, row.worth_low, row.worth_high),
        plain_number(row.interquartile_mean), f"{row.answers:.0f}",
        chance(row.improvement, row.improvement_low, row.improvement_high), f"×{row.drift:.2f}",
    ]  # fmt: skip


def _studies(row: Any, loops: int) -> str:
    """Return the number of studies; an agent that lacks a loop cannot be compared by its mean."""
    return f"{row.studies}" if row.loops == loops else f"{row.studies} (on {row.loops} of {loops})"
