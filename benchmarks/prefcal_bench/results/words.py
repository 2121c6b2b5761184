"""Format numbers, settings, seeds and tables as text, for page, figures, terminal and Markdown."""

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby

from .campaign import HUGE, Campaign, Setting
from .statistics import MeanEstimate


def short(value: float | None) -> str:
    """Return a number with two significant digits, or a dash for None."""
    if value is None or value != value:
        return "–"
    if abs(value) >= HUGE:
        return "∞"
    text = f"{value:.2g}"
    if 100 <= abs(value) < 1e4:
        text = f"{float(text):.0f}"
    return re.sub(r"e([-+])0*(\d+)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", text)


def ratio(log10: float | None, low: float | None = None, high: float | None = None) -> str:
    """Return the ratio of an agent's gap to the baseline's, with its interval."""
    if log10 is None:
        return "–"
    factor = f"×{short(10.0**log10)}"
    if low is None or high is None:
        return factor
    return f"{factor} ({short(10.0**low)} to {short(10.0**high)})"


def score(wins: int | None, ties: int | None, losses: int | None) -> str:
    """Return wins, ties and losses as text."""
    return "–" if wins is None else f"{wins}–{ties}–{losses}"


def probability(p: float | None) -> str:
    """Return a p value as text; small ones as a bound."""
    if p is None:
        return "–"
    return "<0.001" if p < 0.001 else f"{p:.2g}" if p < 0.1 else f"{p:.2f}"


def percent(share: float) -> str:
    """Return a share of one as a whole percentage."""
    return f"{100 * share:.0f} %"


def named(setting: Setting, campaign: Campaign) -> str:
    """Return a name of a calibrator's setting that distinguishes it from the campaign's others."""
    return setting.name(campaign.settings, " calibrator")


def problem_name(campaign: Campaign, problem: str) -> str:
    """Return the name of a problem with its number of knobs."""
    knobs = campaign.knobs(problem)
    return problem if knobs is None else f"{problem}, {knobs} knob{'s' * (knobs != 1)}"


def seeds_text(seeds: Sequence[int]) -> str:
    """Return seeds as text, with consecutive ones as ranges: 0 to 3, 7."""
    runs = [
        [seed for _, seed in group]
        for _, group in groupby(enumerate(sorted(seeds)), lambda pair: pair[1] - pair[0])
    ]
    texts = [f"{r[0]} to {r[-1]}" if len(r) > 2 else ", ".join(map(str, r)) for r in runs]
    return f"seed{'s' * (len(seeds) != 1)} {', '.join(texts)}"


def short_name(agent: str) -> str:
    """Return the name of an agent without the folder of a user's own file."""
    return agent.rpartition("/")[2] or agent


def plain_number(value: float | None) -> str:
    """Return a worth with two significant digits, or all its digits from 10 on."""
    if value is None:
        return "–"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"


def with_interval(
    value: float | None,
    low: float | None,
    high: float | None,
    form: Callable[[float], str] = plain_number,
    unit: str = "",
) -> str:
    """Return a number, such as a worth, with its interval as far as it is known."""
    if value is None:
        return "–"
    text = f"{form(value)}{unit}"
    return text if low is None or high is None else f"{text} [{form(low)}, {form(high)}]"


def chance(value: float | None, low: float | None, high: float | None) -> str:
    """Return a probability in percent, with its interval."""
    return with_interval(value, low, high, lambda share: f"{100 * share:.0f}", " %")


def interval(found: MeanEstimate | None, digits: int = 0) -> str:
    """Return a mean with so many digits after the point, and its interval."""
    if found is None:
        return "–"
    return with_interval(found.value, found.low, found.high, lambda value: f"{value:.{digits}f}")


def markdown(heads: Sequence[str], rows: Iterable[Sequence[object]], title: str = "") -> list[str]:
    """Return the lines of a table in Markdown, below its title."""
    lines = [heads, ["---"] * len(heads), *rows]
    table = [f"| {' | '.join(map(str, cells))} |" for cells in lines]
    return ["", title, "", *table] if title else table
