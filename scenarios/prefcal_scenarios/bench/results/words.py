"""Format numbers, regimes and seeds as text, for the table, the page and the figures."""

import re
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from .campaign import HUGE, Campaign, Regime


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


def spread(low: float | None, high: float | None) -> str:
    """Return the range between two quartiles."""
    return "–" if low is None else f"{short(low)} to {short(high)}"


def factor(log10: float) -> str:
    """Return 10 to the power of `log10`, with a multiplication sign."""
    return f"×{short(10.0**log10)}"


def ratio(log10: float | None, low: float | None = None, high: float | None = None) -> str:
    """Return the ratio of an agent's gap to the baseline's, with its interval."""
    if log10 is None:
        return "–"
    if low is None or high is None:
        return factor(log10)
    return f"{factor(log10)} ({short(10.0**low)} to {short(10.0**high)})"


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


def regime_name(regime: Regime, regimes: Sequence[Regime]) -> str:
    """Return a name that distinguishes a regime from the others."""
    name = f"{regime.calibrator} calibrator"
    if len({(r.n_init, r.n_max) for r in regimes}) > 1:
        name += f", {regime.n_max} experiments ({regime.n_init} initial)"
    return name


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


def row_texts(row: Any) -> dict[str, str]:
    """Return the cells of a row of the table as text, by column."""
    return {
        "seeds": finished(row.seeds, row.failed),
        "median gap": short(row.gap_median),
        "quartiles": spread(row.gap_lower_quartile, row.gap_upper_quartile),
        "best visited": short(row.visited_median),
        "questions": short(row.questions_median),
        "ratio": ratio(row.log10_ratio, row.log10_ratio_low, row.log10_ratio_high),
        "won–tied–lost": score(row.wins, row.ties, row.losses),
        "p": probability(row.p_holm),
        "in the hole": "–" if row.seeds_in_hole is None else str(row.seeds_in_hole),
        "s/proposal": short(row.seconds_per_proposal),
    }


def finished(seeds: int, failed: int) -> str:
    """Return the number of finished seeds, and the total if some failed."""
    return f"{seeds} of {seeds + failed}" if failed else str(seeds)
