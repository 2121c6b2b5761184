"""Options of `prefcal bench` and `prefcal bench compare`, each declared once."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from typer import Argument, Option


@dataclass(frozen=True, slots=True)
class BenchOptions:
    """Options of `prefcal bench`, in the order of its help; None leaves it to the suite.

    Args:
        quick: Run a small suite, which the options below can change.
        agents: Agents, separated by commas: names or own.py:Agent. All are compared with the first.
            Those that simulate (Screening, EqualWeights) run where experiments have KPIs, so not on
            test functions. An unknown name lists all of them.
        problems: Problems, separated by commas: closed loops such as servo or loop-17, test
            functions, cstr, cstr-guidelines, overtake, or own.py:NAME of a Scenario or a Problem.
            An unknown name lists all of them.
        calibrators: Who answers: tastes (weights, priorities, limits, narrow, hidden, rising; with
            -noisy10 or -noisy20 that percentage of the answers is wrong), perfect (by the cost),
            lexicographic (by ordered criteria), noisy10 or noisy20.
        seeds: Number of seeds: 0, 1, ..., N-1.
        n_init: Number of experiments before learning starts.
        n_max: Number of experiments.
        jobs: Number of processes.
        cell_timeout: Time limit for one cell; a longer one is ended and counts as failed. inf: no
            limit.
        out: Folder of the results; results already in it are not run again.
        json: Print only JSON on standard output (messages go to standard error).
    """

    quick: Annotated[bool, Option("--quick")] = False
    agents: Annotated[str | None, Option(metavar="NAMES", show_default="all that are installed")] = None
    problems: Annotated[str | None, Option(metavar="NAMES", show_default="all")] = None
    calibrators: Annotated[str | None, Option(metavar="NAMES", show_default="all")] = None
    seeds: Annotated[int | None, Option(metavar="N", min=1, max=100_000, show_default="20; quick: 2")] = None
    n_init: Annotated[
        int | None,
        Option(metavar="N", min=1, max=10_000, show_default="10, or half of --n-max if that is less"),
    ] = None
    n_max: Annotated[int | None, Option(metavar="N", min=2, max=10_000, show_default="50; quick: 20")] = None
    jobs: Annotated[int | None, Option(metavar="N", min=1, max=256, show_default="one per core")] = None
    cell_timeout: Annotated[float, Option(metavar="SECONDS", show_default="3600, an hour")] = 3600.0
    out: Annotated[Path, Option(metavar="FOLDER")] = Path("prefcal-bench")
    json: Annotated[bool, Option("--json")] = False


@dataclass(frozen=True, slots=True)
class CompareOptions:
    """Options of `prefcal bench compare`, in the order of its help; None means all published.

    Args:
        agent: Your own agent as own.py:Agent, or a name.
        published: Published runs to compare with, such as your own: see
            benchmarks/campaigns/publish.py.
        problems: Closed loops to run on, separated by commas. An unknown name lists all of them.
        calibrators: Tastes that answer, separated by commas. An unknown name lists all of them.
        seeds: Number of seeds: 0, 1, ..., N-1.
        jobs: Number of processes.
        cell_timeout: Time limit for one cell; a longer one is ended and counts as failed. inf: no
            limit.
        out: Folder of the results; results already in it are not run again.
        json: Print only JSON on standard output (messages go to standard error).
    """

    agent: Annotated[str, Argument(metavar="AGENT")]
    published: Annotated[Path | None, Option(metavar="FILE", show_default="those that come with prefcal")] = (
        None
    )
    problems: Annotated[str | None, Option(metavar="NAMES", show_default="all that are published")] = None
    calibrators: Annotated[str | None, Option(metavar="NAMES", show_default="all that are published")] = None
    seeds: Annotated[
        int | None, Option(metavar="N", min=1, max=100_000, show_default="as many as are published")
    ] = None
    jobs: Annotated[int | None, Option(metavar="N", min=1, max=256, show_default="one per core")] = None
    cell_timeout: Annotated[float, Option(metavar="SECONDS", show_default="3600, an hour")] = 3600.0
    out: Annotated[Path, Option(metavar="FOLDER")] = Path("prefcal-compare")
    json: Annotated[bool, Option("--json")] = False
