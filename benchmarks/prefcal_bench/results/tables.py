"""Tables of the page and the terminal: the text and the kind of each cell."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import pandas as pd

from .campaign import Campaign, Setting, problems_of
from .rows import checkpoints, ended
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

SIGNIFICANCE = 0.05


class TableCell(NamedTuple):
    """Cell of a table: plain text, and its class in the style sheet."""

    text: str
    kind: str = ""


@dataclass(frozen=True, slots=True)
class TextTable:
    """TextTable of the page or the terminal."""

    label: str  # title, and name of the table for people who cannot see it
    caption: str
    columns: tuple[str, ...]
    rows: list[list[TableCell]]  # cells of each row, starting with its heading
    words: tuple[str, ...] = ()  # columns that hold text, not numbers
    tall: bool = True  # whether the table may need to scroll vertically
    page_only: tuple[str, ...] = ()  # columns that a terminal has no room for

    def without(self, columns: Collection[str]) -> "TextTable":
        """Return the table without some of its columns."""
        kept = [i for i, column in enumerate(self.columns) if column not in columns]
        rows = [[row[i] for i in kept] for row in self.rows]
        return replace(self, columns=tuple(self.columns[i] for i in kept), rows=rows)


def overview(campaign: Campaign, rows: pd.DataFrame, setting: Setting, baseline: str) -> TextTable:
    """Return the median gaps of a setting by problem (rows) and agent, with the lowest tinted.

    Below are each agent's number of lowest medians, and its average rank.
    """
    agents = [agent for agent in campaign.agents if agent in set(rows["agent"])]
    counts = dict.fromkeys(agents, 0)
    medians = rows.pivot(index="problem", columns="agent", values="gap_median").astype(float)
    ranks = medians.clip(lower=FLOOR).dropna(axis="columns").rank(axis="columns").mean()
    lines = []
    for problem, group in rows.groupby("problem", sort=False):
        lowest = short(group["gap_median"].min())
        cells = {agent: TableCell("–") for agent in agents}
        for row in group.itertuples():
            best = short(row.gap_median) == lowest
            counts[row.agent] += best
            text = f"{short(row.gap_median)}{_sign(row)}"
            cells[row.agent] = TableCell(text, "best" if best else "")
        knobs = TableCell(str(campaign.knobs(problem) or "–"), "note")
        lines.append([TableCell(problem), knobs, *cells.values()])
    ends = [TableCell(f"{counts[agent]} of {len(lines)}") for agent in agents]
    averages = [TableCell(f"{ranks[agent]:.2f}" if agent in ranks else "–") for agent in agents]
    caption = (
        f"Median gap after {setting.n_max} experiments, {named(setting, campaign)}; "
        "the lowest is tinted. ▲ significantly nearer, ▼ significantly farther than "
        f"{baseline} (Wilcoxon, 5 % after Holm's correction for the agents "
        "on that problem). Average rank of the medians: 1 is the nearest, of the agents with "
        "results on all problems; gaps below the floor are alike."
    )
    label = f"Median gaps, {setting.calibrator} {setting.n_max}"
    lines.append([TableCell("lowest on"), TableCell(""), *ends])
    lines.append([TableCell("average rank"), TableCell(""), *averages])
    return TextTable(label, caption, ("problem", "knobs", *agents), lines, tall=False)


def _sign(row: Any) -> str:
    """Return the sign of a row that differs significantly from the baseline, else nothing."""
    if not _is_sure(row):
        return ""
    nearer = row.log10_ratio < 0
    if row.log10_ratio == 0:  # ties at the median
        nearer = row.wins > row.losses
    return " ▲" if nearer else " ▼"


def _is_sure(row: Any) -> bool:
    return row.p_holm is not None and row.p_holm < SIGNIFICANCE


def numbers(rows: pd.DataFrame, baseline: str, label: str) -> TextTable:
    """Return all numbers of the rows of one setting, with the lowest medians tinted."""
    caption = (
        f"× {baseline}: median over the seeds of the ratio of both gaps, each at least "
        f"{short(FLOOR)}, with a 95 % bootstrap interval; below 1 the agent is nearer. "
        "p: Wilcoxon signed-rank test, two-sided, after Holm's correction for the "
        "agents on that problem. Failed seeds have no gap. Full precision in table.csv."
        f"{_warning(rows)}"
    )
    lines = []
    for _, group in rows.groupby("problem", sort=False):
        lowest = short(group["gap_median"].astype(float).min())
        lines += [_gap_cells(row, lowest) for row in group.itertuples()]
    columns = (
        "problem",
        "agent",
        "seeds",
        "median gap",
        "quartiles",
        "best visited",
        "questions",
        f"× {baseline} (95 %)",
        "won–tied–lost",
        "p",
        "s/proposal",
    )
    room = ("best visited", "questions", "s/proposal")
    return TextTable(label, caption, columns, lines, words=("problem", "agent"), page_only=room)


def _warning(rows: pd.DataFrame) -> str:
    """Return a sentence if the seeds are too few to show which agent is nearer; else nothing."""
    seeds = int(rows["seeds"].max())
    least = 2.0 ** (1 - seeds)  # p of the signed-rank test if all pairs agree
    if not seeds or least < SIGNIFICANCE:
        return ""
    return (
        f" With {seeds} seed{'s' * (seeds != 1)} no p can be below {probability(least)}: "
        "which agent is nearer may be chance."
    )


def _gap_cells(row: Any, lowest: str) -> list[TableCell]:
    """Return the cells of a row of the table of gaps."""
    low, median, high = row.gap_lower_quartile, short(row.gap_median), row.gap_upper_quartile
    tried = row.seeds + row.failed
    return [
        TableCell(row.problem),
        TableCell(row.agent, "words"),
        TableCell(f"{row.seeds} of {tried}" if row.failed else str(row.seeds)),
        TableCell(median, "best" if median == lowest != "–" else ""),
        TableCell("–" if low is None else f"{short(low)} to {short(high)}"),
        TableCell(short(row.visited_median)),
        TableCell(short(row.questions_median)),
        TableCell(ratio(row.log10_ratio, row.log10_ratio_low, row.log10_ratio_high)),
        TableCell(score(row.wins, row.ties, row.losses)),
        TableCell(probability(row.p_holm), "sure" if _is_sure(row) else ""),
        TableCell(short(row.seconds_per_proposal)),
    ]


def duel_numbers(rows: pd.DataFrame) -> TextTable:
    """Return the rows of `duel_rows` of one problem and calibrator."""
    caption = (
        "Share of seeds in which the agent's θ is preferred, by the criteria without noise, with "
        "its exact binomial interval; p of the exact sign test on wins and losses, not corrected."
    )
    columns = ("agent", "against", "seeds", "preferred", "95 % interval", "won–tied–lost", "p")
    lines = [
        [
            TableCell(t.agent),
            TableCell(t.rival, "words"),
            TableCell(str(t.seeds)),
            TableCell(percent(t.share)),
            TableCell(f"{percent(t.low)} to {percent(t.high)}"),
            TableCell(score(t.wins, t.ties, t.losses)),
            TableCell(probability(t.p)),
        ]
        for t in rows.itertuples()
    ]
    where = rows.iloc[0]
    label = f"Who is preferred: {where['problem']}, {where['calibrator']} calibrator"
    return TextTable(label, caption, columns, lines, ("agent", "against"), page_only=("seeds",))


def failed(cells: Sequence[tuple[str, str]]) -> TextTable:
    """Return the failed cells with their reasons."""
    lines = [[TableCell(cell), TableCell(words, "words")] for cell, words in cells]
    caption = "They have no numbers in any table or figure."
    return TextTable("Failed cells", caption, ("cell", "what happened"), lines, ("what happened",))


def worth_numbers(campaign: Campaign, rows: pd.DataFrame, setting: Setting, baseline: str) -> TextTable:
    """Return the table of worth of a setting, with the highest worth tinted.

    Args:
        campaign: All results.
        rows: TextTable of worth, see `worth_rows`.
        setting: Setting of the table.
        baseline: Agent that the others are compared with.
    """
    spots, loops = checkpoints(setting), len(problems_of(campaign.of(setting, "worth")))
    ends = ended(rows, setting)
    tinted = _leaders(ends)
    lines = []
    for last in ends.itertuples():
        own = rows[(rows["setting"] == setting) & (rows["agent"] == last.agent)]
        found = {(row.unit, row.after): row for row in own.itertuples()}
        line = [TableCell(last.agent), TableCell(_studies(last, loops))]
        for n in spots:
            line += map(TableCell, _worth_cells(found["experiments", n]))
        if last.agent in tinted:
            line[-5] = line[-5]._replace(kind="best")
        by_answers = found.get(("answers", spots[-1] - 1))
        lines.append([*line, TableCell("–" if by_answers is None else _worth_cells(by_answers)[0])])
    beats = f"beats {short_name(baseline)} [95 %]"
    names = ("worth [95 %]", "middle half", "answers", beats, "drift")
    columns = [f"{name} ({n})" for n in spots for name in names]
    by_answers = f"worth after {spots[-1] - 1} answers [95 %]"
    caption = (
        f"After {spots[0]} and {spots[-1]} experiments. Worth: geometric mean over the loops and "
        "seeds, with its bootstrap interval; the highest of the agents that ask is tinted. Middle "
        "half: interquartile mean. Answers: mean number given by then. Beats: probability that one "
        "study of the agent on any loop is worth more than one of the baseline. Drift: how many "
        "times more the best θ held before was worth; 1 means that nothing was lost. "
        "Full precision in worth.csv."
    )
    room = ("studies", *columns[1 : len(names)], by_answers)
    heads = ("agent", "studies", *columns, by_answers)
    title = f"Worth: {setting.name(campaign.having('worth'))}"
    return TextTable(title, caption, heads, lines, ("agent",), page_only=room)


def _leaders(ends: pd.DataFrame) -> set[str]:
    """Return the agents with the highest worth at the end, as shown: of those that ask, if any."""
    asking = ends[ends["answers"].astype(float) > 0]
    compared = asking if len(asking) else ends
    highest = plain_number(compared["worth"].max())
    return {row.agent for row in compared.itertuples() if plain_number(row.worth) == highest}


def _worth_cells(row: Any) -> list[str]:
    """Return the cells of a row as text: worth, middle half, answers, chance to be better, drift."""
    return [
        with_interval(row.worth, row.worth_low, row.worth_high),
        plain_number(row.interquartile_mean),
        f"{row.answers:.0f}",
        chance(row.improvement, row.improvement_low, row.improvement_high),
        f"×{row.drift:.2f}",
    ]


def _studies(row: Any, loops: int) -> str:
    """Return the number of studies; an agent that lacks a loop cannot be compared by its mean."""
    return f"{row.studies}" if row.loops == loops else f"{row.studies} (on {row.loops} of {loops})"
