"""Write the page of the reproduction, a single self-contained file."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from prefcal_app.report.export import versions
from prefcal_app.report.html import environment
from prefcal_scenarios.presentation.folder import put

from .deviations import DEVIATIONS
from .figures import Pictured, pictures
from .printed import COMPARISONS, N_MAX
from .results import Found, Row, compared, disagreements, found, rows
from .settings import algorithm, parameters, ranges
from .studies import Study

TITLES = {
    "cstr-preferences": "Reactor, calibrated by preferences",
    "cstr-automated": "Reactor, calibrated automatically",
    "overtake-preferences": "Car, calibrated by preferences",
}
PAPER = "Zhu, Bemporad, Piga: Preference-based MPC calibration (ECC 2021)"
DOI = "10.23919/ECC54610.2021.9654900"


@dataclass(frozen=True, slots=True)
class Shown:
    """The table of one case."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[Row, ...]


def write_page(studies: Sequence[Study], folder: Path, command: str) -> Path:
    """Write paper.html and its figures into `folder`, and return the path of the page.

    Args:
        studies: Studies of all cases, for one or more seeds.
        folder: Existing folder.
        command: Command line that repeats the reproduction.
    """
    results = found(studies)
    drawn = list(pictures(results))
    for picture in drawn:
        put(folder / f"{picture.label.removeprefix('Fig. ')}.png", picture.content)
    page = folder / "paper.html"
    put(page, _text(results, drawn, command).encode())
    return page


def _text(results: Sequence[Found], drawn: Sequence[Pictured], command: str) -> str:
    seeds = len(results[0].studies)
    return (
        environment("prefcal_bench")
        .get_template("reproduce/paper.html.j2")
        .render(
            paper=PAPER,
            doi=DOI,
            repeated="once, with seed 0"
            if seeds == 1
            else f"{seeds} times, with seeds 0 to {seeds - 1}",
            n_max=N_MAX,
            comparisons=COMPARISONS,
            compared=compared(results),
            disagreements=disagreements(results),
            results=[_shown(result) for result in results],
            drawn=drawn,
            tables=(
                ("Table CSTR_para", parameters()),
                ("Settings of the algorithm", algorithm()),
                ("Ranges of the tuned parameters", ranges()),
            ),
            deviations=[(d.paper, d.ours, d.why, d.effect) for d in DEVIATIONS],
            line=command,
            versions=versions(),
        )
    )


def _shown(result: Found) -> Shown:
    median = f"median of {len(result.studies)}"
    heads = ("", "printed", "paper's θ here", "seed 0 here", median, "range")
    return Shown(TITLES[result.case.name], heads, tuple(rows(result)))
