"""How gaps, ratios, regimes and seeds read in the table, the page and the figures."""

import re
from collections.abc import Sequence
from itertools import groupby

from prefcal_scenarios.bench.results.campaign import HUGE, Campaign, Regime
from prefcal_scenarios.bench.results.statistics import Difference, Quartiles


def short(value: float | None) -> str:
    """Two significant digits; a dash where there is no number."""
    if value is None or value != value:
        return "–"
    if abs(value) >= HUGE:
        return "∞"
    text = f"{value:.2g}"
    if 100 <= abs(value) < 1e4:
        text = f"{float(text):.0f}"
    return re.sub(r"e([-+])0*(\d+)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", text)


def spread(q: Quartiles | None) -> str:
    """The quartiles around a median."""
    return "–" if q is None else f"{short(q.low)} to {short(q.high)}"


def factor(log10: float) -> str:
    """10 to the power of a logarithm, with its sign of multiplication."""
    return f"×{short(10.0**log10)}"


def ratio(d: Difference | None) -> str:
    """How many times the baseline's gap an agent's is, with the interval."""
    if d is None:
        return "–"
    if d.low is None or d.high is None:
        return factor(d.log10_ratio)
    return f"{factor(d.log10_ratio)} ({short(10.0**d.low)} to {short(10.0**d.high)})"


def score(d: Difference | None) -> str:
    """Wins, ties and losses."""
    return "–" if d is None else f"{d.wins}–{d.ties}–{d.losses}"


def probability(p: float | None) -> str:
    """A p value; small ones as a bound."""
    if p is None:
        return "–"
    return "<0.001" if p < 0.001 else f"{p:.2g}" if p < 0.1 else f"{p:.2f}"


def percent(share: float) -> str:
    """A share of one as whole percent."""
    return f"{100 * share:.0f} %"


def regime_name(regime: Regime, regimes: Sequence[Regime]) -> str:
    """What tells a regime from the others, in words."""
    name = f"{regime.calibrator} calibrator"
    if len({(r.n_init, r.n_max) for r in regimes}) > 1:
        name += f", {regime.n_max} experiments ({regime.n_init} initial)"
    return name


def problem_name(campaign: Campaign, problem: str) -> str:
    """A problem with its number of knobs."""
    knobs = campaign.knobs(problem)
    return problem if knobs is None else f"{problem}, {knobs} knob{'s' * (knobs != 1)}"


def seeds_text(seeds: Sequence[int]) -> str:
    """Seeds, with runs of consecutive ones as ranges: 0 to 3, 7."""
    runs = [
        [seed for _, seed in group]
        for _, group in groupby(enumerate(sorted(seeds)), lambda pair: pair[1] - pair[0])
    ]
    texts = [f"{r[0]} to {r[-1]}" if len(r) > 2 else ", ".join(map(str, r)) for r in runs]
    return f"seed{'s' * (len(seeds) != 1)} {', '.join(texts)}"


def finished(seeds: int, failed: int) -> str:
    """How many seeds have finished, and of how many if some failed."""
    return f"{seeds} of {seeds + failed}" if failed else str(seeds)
