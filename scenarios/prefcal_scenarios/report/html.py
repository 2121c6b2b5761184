"""report.html: one file that holds everything and asks the network for nothing."""

from base64 import b64encode
from collections.abc import Iterator, Sequence
from html import escape
from importlib.resources import files

from prefcal_scenarios.export import REBUILD, versions
from prefcal_scenarios.report.pictures import Drawn
from prefcal_scenarios.report.record import Record
from prefcal_scenarios.report.tables import comparison_table, result_table
from prefcal_scenarios.report.wording import html, number


def page(record: Record, drawn: Sequence[Drawn]) -> str:
    """The text of report.html."""
    title = escape(f"{record.scenario.title}: calibration by preferences")
    css = files("prefcal_scenarios.report").joinpath("report.css").read_text(encoding="utf-8")
    body = "\n".join(_body(record, drawn))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f"{body}\n</main>\n</body>\n</html>\n"
    )


def _body(record: Record, drawn: Sequence[Drawn]) -> Iterator[str]:
    yield from _header(record)
    if record.best is not None:
        yield from _best(record)
        yield from _section("Result", result_table(record))
    for d in drawn:
        caption = f"<figcaption>{escape(d.picture.caption)}</figcaption>"
        shown = _image(d) if d.markup is None else d.markup
        yield from _section(d.picture.title, f"<figure>\n{shown}\n{caption}\n</figure>")
    if record.asked:
        yield from _section("Comparisons", comparison_table(record))
    yield from _section("How to repeat it", "\n".join(_repeat(record)))


def _image(d: Drawn) -> str:
    kind = d.picture.file.rpartition(".")[2]
    data = b64encode(d.content).decode("ascii")
    return (
        '<div class="scroll" tabindex="0" role="region" '
        f'aria-label="Figure: {escape(d.picture.title)}">'
        f'<img src="data:image/{kind};base64,{data}" alt="{escape(d.alt)}"></div>'
    )


def _section(heading: str, content: str) -> Iterator[str]:
    yield f"<section>\n<h2>{escape(heading)}</h2>\n{content}\n</section>"


def _header(record: Record) -> Iterator[str]:
    counts = record.verdict_counts()
    verdicts = ", ".join(f"{words} {count}" for words, count in counts.items())
    yield "<header>"
    yield f"<h1>{escape(record.scenario.title)}</h1>"
    tried = f"{len(record.trials)} experiments"
    how = f"Calibrated by preferences: {tried}, {len(record.asked)} comparisons"
    if record.scored:
        how = f"Calibrated by its score, nobody was asked: {tried}"
    yield f'<p class="lead">{how} ({escape(verdicts)}).</p>'
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
    yield from _section("Best θ", f'<dl class="values">\n{"".join(items)}\n</dl>')


def _repeat(record: Record) -> Iterator[str]:
    if record.command:
        yield f"<p>The study again:</p>\n<pre><code>{escape(record.command)}</code></pre>"
    if record.best is not None and record.scenario.controller is not None:
        yield (
            "<p>The tuned controller in Python, from this folder:</p>\n"
            f"<pre><code>{escape(REBUILD)}</code></pre>"
        )
    yield '<div class="pair">'
    yield from _listing("Settings", record.settings)
    yield from _listing("Versions", versions())
    yield "</div>"


def _listing(caption: str, items: object) -> Iterator[str]:
    rows = "".join(
        f'<tr><th scope="row">{escape(str(k))}</th><td class="words">{escape(str(v))}</td></tr>'
        for k, v in dict(items).items()  # type: ignore[call-overload]
    )
    yield f"<table>\n<caption>{caption}</caption>\n<tbody>{rows}</tbody>\n</table>"
