"""The page of the reproduction: one file that asks the network for nothing."""

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from prefcal_scenarios.export import versions
from prefcal_scenarios.report.folder import put
from prefcal_scenarios.report.parts import document, image, listing, section
from prefcal_scenarios.report.wording import html

from .deviations import DEVIATIONS
from .figures import Pictured, pictures
from .printed import COMPARISONS, N_MAX
from .results import Found, found, rows, summary
from .settings import algorithm, parameters, ranges
from .studies import Study

TITLES = {
    "cstr-preferences": "Reactor, calibrated by preferences",
    "cstr-automated": "Reactor, calibrated automatically",
    "overtake-preferences": "Car, calibrated by preferences",
}
PAPER = "Zhu, Bemporad, Piga: Preference-based MPC calibration (ECC 2021)"


def write_page(studies: Sequence[Study], folder: Path, command: str) -> Path:
    """Write paper.html and its figures into `folder`, and return the path of the page.

    Args:
        studies: Of all cases, for one or more seeds.
        folder: An existing folder.
        command: The command line that repeats it.
    """
    results = found(studies)
    drawn = list(pictures(results))
    for picture in drawn:
        put(folder / f"{picture.label.removeprefix('Fig. ')}.png", picture.content)
    page = folder / "paper.html"
    body = "\n".join(_body(results, drawn, command))
    put(page, document("The paper's case studies, done again", body).encode())
    return page


def _body(results: Sequence[Found], drawn: Sequence[Pictured], command: str) -> Iterator[str]:
    seeds = len(results[0].studies)
    yield "<header>\n<h1>The paper's case studies, done again</h1>"
    yield f'<p class="lead">{escape(PAPER)}, section IV.</p>'
    repeated = "once, with seed 0" if seeds == 1 else f"{seeds} times, with seeds 0 to {seeds - 1}"
    yield (
        f"<p>Each study is done {repeated}, by <code>GLISp.paper</code> or <code>GLIS</code>, "
        f"with {N_MAX} experiments and, by preferences, {COMPARISONS} comparisons. Synthetic "
        "calibrators take the place of the person: the performance index for the reactor, "
        "criteria (i) to (vi) for the car.</p>"
    )
    yield "</header>"
    yield section("Findings", _paragraphs(summary(results)))
    for result in results:
        yield section(TITLES[result.case.name], _results(result))
    for picture in drawn:
        yield section(picture.label, _figure(picture))
    for title, table in (
        ("Table CSTR_para", parameters()), ("Settings of the algorithm", algorithm()),
        ("Ranges of the tuned parameters", ranges()),
    ):  # fmt: skip
        yield section(title, _table(("", "paper", "here"), table))
    yield section("Deviations", _deviations())
    yield section("How to repeat it", f"<pre><code>{escape(command)}</code></pre>")
    yield section("Versions", listing("Versions", versions()))


def _results(result: Found) -> str:
    heads = (
        "", "printed", "paper's θ here", "seed 0 here",
        f"median of {len(result.studies)}", "range",
    )  # fmt: skip
    counts = result.studies[0]
    note = ""
    if counts.comparisons and counts.comparisons != COMPARISONS:
        note = f'<p class="note">{counts.comparisons} comparisons here, 49 in the paper.</p>'
    return _table(heads, rows(result)) + note


def _figure(picture: Pictured) -> str:
    alt = f"{picture.label}: {picture.caption}"
    shown = [image(picture.label, "png", picture.content, alt)]
    if picture.reference is not None:
        at_paper = f"{picture.label} at the paper's θ, simulated here"
        shown.insert(0, image(at_paper, "png", picture.reference, at_paper))
    return (
        "<figure>\n" + "\n".join(shown) + "\n<figcaption>"
        f"<strong>Paper:</strong> {escape(picture.statement)} "
        f"<strong>Here:</strong> {escape(picture.caption)}</figcaption>\n</figure>"
    )


def _deviations() -> str:
    heads = ("The paper", "Here", "Why", "What it changes")
    return _table(heads, [(d.paper, d.ours, d.why, d.effect) for d in DEVIATIONS], words=True)


def _paragraphs(texts: Sequence[str]) -> str:
    return "\n".join(f"<p>{html(text)}</p>" for text in texts)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], *, words: bool = False) -> str:
    """A table whose first column names the row; all plain text."""
    look = ' class="words"' if words else ""
    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in heads)
    body = "\n".join(
        f'<tr><th scope="row"{look}>{html(first)}</th>'
        + "".join(f"<td{look}>{html(text)}</td>" for text in rest)
        + "</tr>"
        for first, *rest in rows
    )
    return (
        '<div class="scroll" tabindex="0" role="region" aria-label="Table">\n<table>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>\n</div>"
    )
