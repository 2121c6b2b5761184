"""The benchmark's tables in HTML."""

from collections.abc import Iterator, Sequence
from html import escape

from prefcal_scenarios.bench.results.campaign import Campaign, Regime
from prefcal_scenarios.bench.results.duelling import Tally
from prefcal_scenarios.bench.results.ranking import SIGNIFICANCE
from prefcal_scenarios.bench.results.rows import Choices, Row
from prefcal_scenarios.bench.results.words import (
    finished,
    percent,
    probability,
    ratio,
    regime_name,
    score,
    short,
    spread,
)


def overview(campaign: Campaign, rows: Sequence[Row], regime: Regime, choices: Choices) -> str:
    """Median gaps of a regime: problems down, agents across, the lowest tinted."""
    shown = [r for r in rows if r.regime == regime and r.gap is not None]
    agents = [a for a in campaign.agents if any(r.agent == a for r in shown)]
    problems = list(dict.fromkeys(r.problem for r in shown))
    found = {(r.problem, r.agent): r for r in shown}
    lowest = {p: short(min(r.gap.median for r in shown if r.problem == p and r.gap))
              for p in problems}  # fmt: skip
    counts = dict.fromkeys(agents, 0)
    lines = []
    for p in problems:
        cells = []
        for a in agents:
            row = found.get((p, a))
            gap = row.gap if row else None
            best = gap is not None and short(gap.median) == lowest[p]
            counts[a] += best
            tint = ' class="best"' if best else ""
            cells.append(f"<td{tint}>{short(gap.median) if gap else '–'}{_mark(row, choices)}</td>")
        knobs = f'<td class="note">{campaign.knobs(p) or "–"}</td>'
        lines.append(f'<tr><th scope="row">{escape(p)}</th>{knobs}{"".join(cells)}</tr>')
    ends = "".join(f"<td>{counts[a]} of {len(problems)}</td>" for a in agents)
    lines.append(f'<tr><th scope="row">lowest on</th><td></td>{ends}</tr>')
    head = "".join(f'<th scope="col">{escape(a)}</th>' for a in ("problem", "knobs", *agents))
    caption = (
        f"Median gap after {regime.n_max} experiments, {regime_name(regime, campaign.regimes)}; "
        "the lowest is tinted. ▲ significantly nearer, ▼ significantly farther than "
        f"{choices.baseline} (Wilcoxon, 5 % after Holm's correction for the agents "
        "on that problem)."
    )
    return _table(
        f"Median gaps, {regime.calibrator} {regime.n_max}", caption, head, lines, tall=False
    )


def _mark(row: Row | None, choices: Choices) -> str:
    """Whether a row differs significantly from the baseline."""
    if row is None or row.against is None or row.p_holm is None or row.p_holm >= SIGNIFICANCE:
        return ""
    nearer = row.against.log10_ratio < 0
    if row.against.log10_ratio == 0:  # ties at the median
        nearer = row.against.wins > row.against.losses
    kind, sign, word = ("yes", "▲", "nearer") if nearer else ("no", "▼", "farther")
    title = f"significantly {word} than {choices.baseline}"
    return f' <span class="{kind}" title="{escape(title)}">{sign}</span>'


def numbers(rows: Sequence[Row], choices: Choices, label: str) -> str:
    """All that is known of the rows of one regime."""
    timed = any(row.seconds is not None for row in rows)
    holed = any(row.in_hole is not None for row in rows)
    names = (
        "problem", "agent", "seeds", "median gap", "quartiles", "best visited", "questions",
        f"× {choices.baseline} (95 %)", "won–tied–lost", "p", *(("in the hole",) if holed else ()),
        *(("s/proposal",) if timed else ()),
    )  # fmt: skip
    head = "".join(
        f'<th{_words(name == "agent")} scope="col">{escape(name)}</th>' for name in names
    )
    caption = (
        f"× {choices.baseline}: {choices.average} over the seeds of the ratio of both gaps, each "
        f"counted as at least {short(choices.floor)}, with a 95 % bootstrap interval; below 1 the "
        "agent is nearer. p: Wilcoxon signed-rank test, two-sided, after Holm's correction for the "
        "agents on that problem. Failed seeds have no gap. Full precision in table.csv."
    )
    if holed:
        caption += " In the hole: seeds that ended where the cost is lower than it should be."
    lines = ["".join(_number_cells(row, holed, timed)) for row in rows]
    return _table(label, caption, head, lines)


def _number_cells(row: Row, holed: bool, timed: bool) -> Iterator[str]:
    yield f'<tr><th scope="row">{escape(row.problem)}</th>'
    yield f'<td class="words">{escape(row.agent)}</td>'
    for text in (
        finished(row.seeds, len(row.failed)), short(row.gap.median if row.gap else None),
        spread(row.gap), short(row.visited), short(row.questions), ratio(row.against),
        score(row.against), probability(row.p_holm),
    ):  # fmt: skip
        yield f"<td>{text}</td>"
    if holed:
        yield f"<td>{'–' if row.in_hole is None else row.in_hole}</td>"
    if timed:
        yield f"<td>{short(row.seconds)}</td>"
    yield "</tr>"


def duels(tallies: Sequence[Tally]) -> str:
    """Every tally of one problem and calibrator."""
    names = ("agent", "against", "seeds", "preferred", "95 % interval", "won–tied–lost", "p")
    head = "".join(
        f'<th{_words(name == "against")} scope="col">{escape(name)}</th>' for name in names
    )
    caption = (
        "Share of seeds in which the agent's θ is preferred, with its exact binomial interval; "
        "p of the exact sign test on wins and losses, not corrected."
    )
    lines = [
        f'<tr><th scope="row">{escape(t.agent)}</th><td class="words">{escape(t.rival)}</td>'
        f"<td>{t.seeds}</td><td>{percent(t.share)}</td>"
        f"<td>{percent(t.low)} to {percent(t.high)}</td>"
        f"<td>{t.wins}–{t.ties}–{t.losses}</td><td>{probability(t.p)}</td></tr>"
        for t in tallies
    ]
    return _table(f"Duels: {tallies[0].problem}, {tallies[0].calibrator}", caption, head, lines)


def failed(cells: Sequence[tuple[str, str]]) -> str:
    """Failed cells with their words."""
    head = '<th scope="col">cell</th><th class="words" scope="col">what happened</th>'
    lines = [
        f'<tr><th scope="row">{escape(cell)}</th><td class="words">{escape(words)}</td></tr>'
        for cell, words in cells
    ]
    return _table("Failed cells", "They have no numbers in any table or figure.", head, lines)


def _words(there: bool) -> str:
    return ' class="words"' if there else ""


def _table(label: str, caption: str, head: str, lines: Sequence[str], tall: bool = True) -> str:
    kind = "scroll tall" if tall else "scroll"
    body = "\n".join(lines)
    return (
        f'<div class="{kind}" tabindex="0" role="region" aria-label="{escape(label)}">\n'
        f'<table class="tight">\n<caption>{escape(caption)}</caption>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>"
    )
