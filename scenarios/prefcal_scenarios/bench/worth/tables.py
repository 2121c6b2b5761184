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
    spots = checkpoints(setting)
    highest = best(rows, setting)
    lines = []
    for agent in ranked(rows, setting):
        found = _by_spot(rows, agent)
        line = [Cell(agent), Cell(str(found["experiments", spots[-1]].studies))]
        for n in spots:
            row = found["experiments", n]
            texts = row_texts(row)
            tinted = "best" if n == spots[-1] and texts["worth"] == highest else ""
            line += [Cell(texts["interval"], tinted), *(Cell(texts[c]) for c in list(texts)[2:])]
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


def best(rows: pd.DataFrame, setting: Setting) -> str:
    """Return the highest worth at the end as text, of the agents that ask if there are any."""
    ends = rows[(rows["unit"] == "experiments") & (rows["after"] == setting.n_max)]
    asking = ends[ends["answers"].astype(float) > 0]
    return plain_number((asking if len(asking) else ends)["worth"].max())


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


def _worth_of(row: Any) -> str:
    return "–" if row is None else with_interval(row.worth, row.worth_low, row.worth_high)
