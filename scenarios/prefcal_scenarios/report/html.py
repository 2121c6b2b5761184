"""report.html: one file that holds everything and asks the network for nothing."""

from collections.abc import Iterator, Sequence
from html import escape

from prefcal_scenarios.export import REBUILD, versions
from prefcal_scenarios.interview.outlook import Outlook
from prefcal_scenarios.report.minded import Minded
from prefcal_scenarios.report.parts import document, image, listing, section
from prefcal_scenarios.report.pictures import Drawn
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.tables import comparison_table, result_table
from prefcal_scenarios.report.wording import html, number


def page(record: Record, drawn: Sequence[Drawn]) -> str:
    """The text of report.html."""
    title = f"{record.scenario.title}: calibration by preferences"
    return document(title, "\n".join(_body(record, drawn)))


def _body(record: Record, drawn: Sequence[Drawn]) -> Iterator[str]:
    yield from _header(record)
    if record.best is not None:
        yield from _best(record)
        yield section("Result", result_table(record))
    if record.minded is not None:
        yield section("What counts", _minded(record.minded, record.settings.get("calibrator")))
    for d in drawn:
        caption = f"<figcaption>{escape(d.picture.caption)}</figcaption>"
        shown = _image(d) if d.markup is None else d.markup
        yield section(d.picture.title, f"<figure>\n{shown}\n{caption}\n</figure>")
    if record.asked and not record.scored:
        yield section("Comparisons", comparison_table(record))
    if record.outlook is not None:
        yield section("Go on or stop?", _outlook(record.outlook))
    title = "How it was made" if record.by_a_person else "How to repeat it"
    yield section(title, "\n".join(_repeat(record)))


def _image(d: Drawn) -> str:
    return image(d.picture.title, d.picture.file.rpartition(".")[2], d.content, d.alt)


def _header(record: Record) -> Iterator[str]:
    counts = record.verdict_counts()
    verdicts = ", ".join(f"{words} {count}" for words, count in counts.items())
    yield "<header>"
    yield f"<h1>{escape(record.scenario.title)}</h1>"
    tried = f"{len(record.trials)} experiments"
    how = f"Calibrated by preferences: {tried}, {record.questions} comparisons ({verdicts})"
    if record.scored:
        how = f"Calibrated by its score, nobody was asked: {tried}"
    yield f'<p class="lead">{escape(how)}.</p>'
    if record.stopped and record.good_enough:
        yield (
            f"<p>Ended after {len(record.trials)} of {record.n_max} experiments: "
            "the best is good enough.</p>"
        )
    elif record.stopped:
        yield (
            f'<p class="warning"><strong>Partial report.</strong> The study was stopped after '
            f"{len(record.trials)} of {record.n_max} experiments.</p>"
        )
    yield "</header>"


def _best(record: Record) -> Iterator[str]:
    assert record.best is not None
    values = record.scenario.space.named(record.best.experiment.theta)
    items = [
        f"<div><dt>{html(k.name)}</dt><dd>{number(values[k.name])} "
        f"<small>{escape(k.unit)}</small></dd></div>"
        for k in record.scenario.space
    ]
    yield section("Best θ", f'<dl class="values">\n{"".join(items)}\n</dl>')


def _minded(minded: Minded, calibrator: object) -> str:
    """How far KPIs agree with the answers, as bars from 0 to 100 % with the numbers beside them."""
    who = "You seem" if calibrator == "human" else "The calibrator seems"
    rows = "".join(
        f'<tr><th scope="row">{html(bar.title)}</th><td>{bar.text}</td>'
        '<td class="bar" aria-hidden="true">'
        f'<span style="width:{100 * bar.share:.1f}%"></span></td></tr>'
        for bar in minded.bars
    )
    caption = f"<caption>{escape(minded.caption)}</caption>"
    table = f'<table class="shares">\n{caption}\n<tbody>{rows}</tbody>\n</table>\n'
    lead = f'<p class="finding">{html(minded.sentence(who))}</p>'
    return f'{lead}\n{table}<p class="note">{escape(minded.trust)}</p>'


def _outlook(outlook: Outlook) -> str:
    """One sentence, and the way to wider ranges where the best is at an end of them."""
    parts = [f"<p>{html(text)}</p>" for text in outlook.sentences]
    if outlook.command:
        parts.append(f"<pre><code>{escape(outlook.command)}</code></pre>")
    return "\n".join(parts)


def _repeat(record: Record) -> Iterator[str]:
    if record.command:
        # The same answers again, only a program gives; a person begins anew.
        again = "Begin such a study anew:" if record.by_a_person else "The same study again:"
        yield f"<p>{again}</p>\n<pre><code>{escape(record.command)}</code></pre>"
    if record.best is not None and record.scenario.controller is not None:
        yield (
            "<p>The tuned controller in Python, from this folder:</p>\n"
            f"<pre><code>{escape(REBUILD)}</code></pre>"
        )
    yield '<div class="pair">'
    yield listing("Settings", record.settings)
    yield listing("Versions", versions())
    yield "</div>"
    if record.agent_settings:
        rows = listing("Every setting of the agent", record.agent_settings)
        yield f"<details><summary>Settings of the agent</summary>\n{rows}\n</details>"
