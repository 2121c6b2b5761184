"""The report's tables in HTML."""

from collections.abc import Iterator
from html import escape

from prefcal_env.experiment import Experiment
from prefcal_env.preference import Preference
from prefcal_env.study import Comparison
from prefcal_scenarios.report.record import Record, verdict_text
from prefcal_scenarios.report.wording import html, marks_text, measured, number
from prefcal_scenarios.scenario import KPI

_MOST = 3
"""KPIs of one side of a comparison that are shown on the page."""


def result_table(record: Record) -> str:
    """Best, first and reference θ side by side: a row for each knob, KPI and the cost."""
    columns = result_columns(record)
    head = "".join(f'<th scope="col">{escape(name)}</th>' for name in columns)
    rows = "\n".join(
        f'<tr><th scope="row">{heading}</th>{"".join(cells)}</tr>'
        for heading, cells in _result_rows(record, list(columns.values()))
    )
    return (
        '<div class="scroll" tabindex="0" role="region" aria-label="Result table">\n'
        '<table class="result">\n'
        "<caption>✓ meets the objective, ✗ does not.</caption>\n"
        f"<thead><tr><td></td>{head}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table>\n</div>"
    )


def result_columns(record: Record) -> dict[str, Experiment]:
    """What the best is shown beside, by heading, the best first."""
    assert record.best is not None
    return {
        "best": record.best.experiment,
        **record.references,
        "first experiment": record.trials[0].experiment,
    }


def objective(kpi: KPI) -> str:
    """What a KPI should be, in words; nothing where no objective is stated."""
    parts = [
        f"{sign} {number(limit)}"
        for sign, limit in (("≥", kpi.at_least), ("≤", kpi.at_most))
        if abs(limit) != float("inf")
    ]
    return " and ".join(parts)


def _result_rows(record: Record, experiments: list[Experiment]) -> Iterator[tuple[str, list[str]]]:
    for i, knob in enumerate(record.scenario.space):
        yield (
            _with_unit(html(knob.name), knob.unit),
            [_cell(number(e.theta[i]), column=c) for c, e in enumerate(experiments)],
        )
    if record.shows_cost:
        yield (
            "performance index",
            [_cell(number(record.cost(e)), column=c) for c, e in enumerate(experiments)],
        )
    for kpi in record.kpis:
        aim = objective(kpi)
        heading = _with_unit(html(kpi.title), kpi.unit)
        yield (
            heading + (f' <small class="note">({aim})</small>' if aim else ""),
            [_cell(_judged(kpi, e), column=c) for c, e in enumerate(experiments)],
        )
    yield "ended", [_cell(escape(e.end.value), column=c) for c, e in enumerate(experiments)]


def _with_unit(name: str, unit: str) -> str:
    return f'{name} <span class="note">[{escape(unit)}]</span>' if unit else name


def _cell(content: str, column: int) -> str:
    return f'<td class="best">{content}</td>' if column == 0 else f"<td>{content}</td>"


def _judged(kpi: KPI, experiment: Experiment) -> str:
    value = experiment.kpis.get(kpi.name)
    met = None if value is None else kpi.met(value)
    mark = {
        None: "",
        True: ' <span class="yes" title="met">✓</span>',
        False: ' <span class="no" title="not met">✗</span>',
    }[met]
    return measured(kpi, experiment) + mark


def comparison_table(record: Record) -> str:
    """Every question and its answer; the preferred side is tinted."""
    scenario = record.scenario
    width = 1 + len(scenario.space) + len(_columns(record))
    sides = "".join(
        f'<th class="edge" scope="colgroup" colspan="{width}">{side}</th>'
        for side in ("newer experiment", "compared with")
    )
    names = "".join(_side_headings(record) * 2)
    rows = "\n".join(_comparison_row(record, i + 1, c) for i, c in enumerate(record.asked))
    return (
        '<div class="scroll tall" tabindex="0" role="region" aria-label="Comparisons">\n'
        '<table class="tight">\n<caption>The tinted side was preferred. All KPIs '
        "and full precision are in comparisons.csv.</caption>\n<thead>\n"
        '<tr><th scope="col" rowspan="2">no.</th>'
        '<th class="words" scope="col" rowspan="2">verdict</th>'
        f"{sides}</tr>\n<tr>{names}</tr>\n</thead>\n<tbody>\n{rows}\n</tbody>\n</table>\n</div>"
    )


def _columns(record: Record) -> tuple[KPI, ...]:
    """The KPIs that a row has room for: the most important ones."""
    return record.kpis[:_MOST]


def _side_headings(record: Record) -> list[str]:
    named = [(k.name, k.unit) for k in record.scenario.space]
    named += [(k.title, k.unit) for k in _columns(record)]
    cells = [
        f'<th scope="col">{html(name)}<br><span class="note">{escape(unit)}&nbsp;</span></th>'
        for name, unit in named
    ]
    return ['<th class="edge" scope="col">exp.</th>', *cells]


def _comparison_row(record: Record, row: int, comparison: Comparison) -> str:
    assert comparison.incumbent is not None
    assert comparison.query.incumbent is not None
    preference = comparison.answer.preference
    sides = (
        (comparison.query.challenger.index, comparison.challenger, Preference.CHALLENGER),
        (comparison.query.incumbent.index, comparison.incumbent, Preference.INCUMBENT),
    )
    cells = "".join(
        _side_cells(record, index + 1, experiment, preference == wins)
        for index, experiment, wins in sides
    )
    marks = "".join(f"<br><small>{escape(m)}</small>" for m in marks_text(comparison.answer))
    verdict = escape(verdict_text(comparison.answer)) + marks
    return f'<tr><th scope="row">{row}</th><td class="words">{verdict}</td>{cells}</tr>'


def _side_cells(record: Record, exp: int, experiment: Experiment, preferred: bool) -> str:
    tint = " best" if preferred else ""
    values = [number(v) for v in experiment.theta]
    values += [_judged(k, experiment) for k in _columns(record)]
    rest = "".join(
        f'<td class="{tint.strip()}">{v}</td>' if tint else f"<td>{v}</td>" for v in values
    )
    return f'<td class="edge{tint}">{exp}</td>{rest}'
