"""Tables of worth for the page and the terminal: the text of each cell."""

from typing import Any

import pandas as pd

from prefcal_scenarios.bench.results.tables import Cell, Table

from .curves import Setting
from .pictures import Worths
from .rows import checkpoints
from .words import chance, plain_number, short_name, with_interval


def worth_tables(worths: Worths) -> list[Table]:
    """Return the table of each setting for the page, with the highest worth tinted."""
    return [_of_setting(worths, setting) for setting in worths.curves.settings]


def _of_setting(worths: Worths, setting: Setting) -> Table:
    rows = worths.rows[worths.rows["setting"] == setting]
    spots, loops = checkpoints(setting), len(worths.curves.loops(setting))
    tinted = leaders(rows, setting)
    lines = []
    for agent in ranked(rows, setting):
        found = _by_spot(rows, agent)
        line = [Cell(agent), Cell(_studies(found["experiments", spots[-1]], loops))]
        for n in spots:
            row = found["experiments", n]
            texts = row_texts(row)
            kind = "best" if n == spots[-1] and agent in tinted else ""
            line += [Cell(texts["interval"], kind), *(Cell(texts[c]) for c in list(texts)[2:])]
        line += [Cell(_worth_of(found.get(("answers", n - 1)))) for n in spots[-1:]]
        lines.append(line)
    names = (
        "worth [95 %]",
        "middle half",
        "answers",
        f"beats {short_name(worths.baseline)} [95 %]",
        "drift",
    )
    columns = [f"{name} ({n})" for n in spots for name in names]
    caption = (
        f"After {spots[0]} and {spots[-1]} experiments. Worth: geometric mean over the loops and "
        "seeds, with its bootstrap interval; the highest of the agents that ask is tinted. Middle "
        "half: interquartile mean. Answers: mean number given by then. Beats: probability that one "
        "study of the agent on any loop is worth more than one of the baseline. Drift: how many "
        "times more the best θ held before was worth; 1 means that nothing was lost. "
        "Full precision in worth.csv."
    )
    title = f"Worth: {setting.name(worths.curves.settings)}"
    last = f"worth after {spots[-1] - 1} answers [95 %]"
    return Table(title, caption, ("agent", "studies", *columns, last), lines)


def ranked(rows: pd.DataFrame, setting: Setting) -> list[str]:
    """Return the agents of a setting, the one with the highest worth at the end first."""
    ends = rows[(rows["unit"] == "experiments") & (rows["after"] == setting.n_max)]
    return list(ends.sort_values("worth", ascending=False, kind="stable")["agent"])


def leaders(rows: pd.DataFrame, setting: Setting) -> set[str]:
    """Return the agents with the highest worth at the end, as shown: of those that ask, if any."""
    ends = rows[(rows["unit"] == "experiments") & (rows["after"] == setting.n_max)]
    asking = ends[ends["answers"].astype(float) > 0]
    compared = asking if len(asking) else ends
    highest = plain_number(compared["worth"].max())
    return {row.agent for row in compared.itertuples() if plain_number(row.worth) == highest}


def row_texts(row: Any) -> dict[str, str]:
    """Return the cells of a row of the table of worth as text, by column."""
    return {
        "worth": plain_number(row.worth),
        "interval": _worth_of(row),
        "middle half": plain_number(row.interquartile_mean),
        "answers": f"{row.answers:.0f}",
        "beats": chance(row.improvement, row.improvement_low, row.improvement_high),
        "drift": f"×{row.drift:.2f}",
    }


def _by_spot(rows: pd.DataFrame, agent: str) -> dict[tuple[str, int], Any]:
    return {(row.unit, row.after): row for row in rows[rows["agent"] == agent].itertuples()}


def _studies(row: Any, loops: int) -> str:
    """Return the number of studies; an agent that lacks a loop cannot be compared by its mean."""
    return f"{row.studies}" if row.loops == loops else f"{row.studies} (on {row.loops} of {loops})"


def _worth_of(row: Any) -> str:
    return "–" if row is None else with_interval(row.worth, row.worth_low, row.worth_high)
