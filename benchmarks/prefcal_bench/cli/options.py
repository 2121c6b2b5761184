"""Options of `prefcal bench` and `prefcal bench compare`, each declared once."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

Jobs = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Number of processes.", show_default="one per core"),
]
CellTimeout = Annotated[
    float,
    typer.Option(
        metavar="SECONDS",
        help="Time limit for one cell; a longer one is ended and counts as failed. inf: no limit.",
        show_default="3600, an hour",
    ),
]
Out = Annotated[
    Path,
    typer.Option(
        metavar="FOLDER", help="Folder of the results; results already in it are not run again."
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json",
        metavar="",
        help="Print only JSON on standard output (messages go to standard error).",
    ),
]


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """Options of `prefcal bench`, in the order of its help; None leaves it to the suite."""

    quick: Annotated[
        bool,
        typer.Option(
            "--quick", metavar="", help="Run a small suite, which the options below can change."
        ),
    ] = False
    agents: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Agents, separated by commas: names or own.py:Agent. All are compared with the "
            "first. Those that simulate (Screening, EqualWeights) run where experiments have KPIs, "
            "so not on test functions. An unknown name lists all of them.",
            show_default="all that are installed",
        ),
    ] = None
    problems: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Problems, separated by commas: closed loops such as servo or loop-17, test "
            "functions, cstr, cstr-guidelines, overtake, or own.py:NAME of a Scenario or a "
            "Problem. An unknown name lists all of them.",
            show_default="all",
        ),
    ] = None
    calibrators: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Who answers: tastes (weights, priorities, limits, narrow, hidden, rising; with "
            "-noisy10 or -noisy20 that percentage of the answers is wrong), perfect (by the "
            "cost), lexicographic (by ordered criteria), noisy10 or noisy20.",
            show_default="all",
        ),
    ] = None
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1, metavar="N", help="Number of seeds: 0, 1, ..., N-1.", show_default="20; quick: 3"
        ),
    ] = None
    n_init: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Number of experiments before learning starts.",
            show_default="10, or half of --n-max if that is less",
        ),
    ] = None
    n_max: Annotated[
        int | None,
        typer.Option(min=2, metavar="N", help="Number of experiments.", show_default="50"),
    ] = None
    jobs: Jobs = None
    cell_timeout: CellTimeout = 3600.0
    out: Out = Path("prefcal-bench")
    json: Json = False


@dataclass(frozen=True, slots=True)
class CompareOptions:
    """Options of `prefcal bench compare`, in the order of its help; None means all published."""

    agent: Annotated[
        str, typer.Argument(metavar="AGENT", help="Your own agent as own.py:Agent, or a name.")
    ]
    published: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Published runs to compare with, such as your own: see "
            "benchmarks/campaigns/publish.py.",
            show_default="those that come with prefcal",
        ),
    ] = None
    problems: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Closed loops to run on, separated by commas. An unknown name lists all of them.",
            show_default="all that are published",
        ),
    ] = None
    calibrators: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Tastes that answer, separated by commas. An unknown name lists all of them.",
            show_default="all that are published",
        ),
    ] = None
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Number of seeds: 0, 1, ..., N-1.",
            show_default="as many as are published",
        ),
    ] = None
    jobs: Jobs = None
    cell_timeout: CellTimeout = 3600.0
    out: Out = Path("prefcal-compare")
    json: Json = False
