"""Options of `prefcal bench` and `prefcal bench compare`, each declared once."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from prefcal_app.cli.options import JSON_HELP
from prefcal_app.cli.parameters import argument, option

_jobs = partial(option, None, "Number of processes.", "N", min=1, shown="one per core")
_cell_timeout = partial(
    option,
    3600.0,
    "Time limit for one cell; a longer one is ended and counts as failed. inf: no limit.",
    "SECONDS",
    shown="3600, an hour",
)
_json = partial(option, False, JSON_HELP, flag="--json")
_OUT = "Folder of the results; results already in it are not run again."
_SEEDS = "Number of seeds: 0, 1, ..., N-1."


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """Options of `prefcal bench`, in the order of its help; None leaves it to the suite."""

    quick: bool = option(
        False, "Run a small suite, which the options below can change.", flag="--quick"
    )
    agents: str | None = option(
        None,
        "Agents, separated by commas: names or own.py:Agent. All are compared with the first. "
        "Those that simulate (Screening, EqualWeights) run where experiments have KPIs, so not on "
        "test functions. An unknown name lists all of them.",
        "NAMES",
        shown="all that are installed",
    )
    problems: str | None = option(
        None,
        "Problems, separated by commas: closed loops such as servo or loop-17, test functions, "
        "cstr, cstr-guidelines, overtake, or own.py:NAME of a Scenario or a Problem. An unknown "
        "name lists all of them.",
        "NAMES",
        shown="all",
    )
    calibrators: str | None = option(
        None,
        "Who answers: tastes (weights, priorities, limits, narrow, hidden, rising; with -noisy10 "
        "or -noisy20 that percentage of the answers is wrong), perfect (by the cost), "
        "lexicographic (by ordered criteria), noisy10 or noisy20.",
        "NAMES",
        shown="all",
    )
    seeds: int | None = option(None, _SEEDS, "N", min=1, shown="20; quick: 3")
    n_init: int | None = option(
        None,
        "Number of experiments before learning starts.",
        "N",
        min=1,
        shown="10, or half of --n-max if that is less",
    )
    n_max: int | None = option(None, "Number of experiments.", "N", min=2, shown="50")
    jobs: int | None = _jobs()
    cell_timeout: float = _cell_timeout()
    out: Path = option(Path("prefcal-bench"), _OUT, "FOLDER")
    json: bool = _json()


@dataclass(frozen=True, slots=True)
class CompareOptions:
    """Options of `prefcal bench compare`, in the order of its help; None means all published."""

    agent: str = argument("AGENT", "Your own agent as own.py:Agent, or a name.")
    published: Path | None = option(
        None,
        "Published runs to compare with, such as your own: see benchmarks/campaigns/publish.py.",
        "FILE",
        shown="those that come with prefcal",
    )
    problems: str | None = option(
        None,
        "Closed loops to run on, separated by commas. An unknown name lists all of them.",
        "NAMES",
        shown="all that are published",
    )
    calibrators: str | None = option(
        None,
        "Tastes that answer, separated by commas. An unknown name lists all of them.",
        "NAMES",
        shown="all that are published",
    )
    seeds: int | None = option(None, _SEEDS, "N", min=1, shown="as many as are published")
    jobs: int | None = _jobs()
    cell_timeout: float = _cell_timeout()
    out: Path = option(Path("prefcal-compare"), _OUT, "FOLDER")
    json: bool = _json()
