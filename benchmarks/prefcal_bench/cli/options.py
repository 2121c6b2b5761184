"""Options of `prefcal bench` and `prefcal bench compare`, each declared once."""

from dataclasses import dataclass
from pathlib import Path

from prefcal_app.cli.parameters import argument, option


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

    quick: bool = option(False, flag="--quick")
    agents: str | None = option(None, "NAMES", shown="all that are installed")
    problems: str | None = option(None, "NAMES", shown="all")
    calibrators: str | None = option(None, "NAMES", shown="all")
    seeds: int | None = option(None, "N", min=1, most=100_000, shown="20; quick: 3")
    n_init: int | None = option(None, "N", min=1, most=10_000, shown="10, or half of --n-max if that is less")
    n_max: int | None = option(None, "N", min=2, most=10_000, shown="50")
    jobs: int | None = option(None, "N", min=1, most=256, shown="one per core")
    cell_timeout: float = option(3600.0, "SECONDS", shown="3600, an hour")
    out: Path = option(Path("prefcal-bench"), "FOLDER")
    json: bool = option(False, flag="--json")


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

    agent: str = argument("AGENT")
    published: Path | None = option(None, "FILE", shown="those that come with prefcal")
    problems: str | None = option(None, "NAMES", shown="all that are published")
    calibrators: str | None = option(None, "NAMES", shown="all that are published")
    seeds: int | None = option(None, "N", min=1, most=100_000, shown="as many as are published")
    jobs: int | None = option(None, "N", min=1, most=256, shown="one per core")
    cell_timeout: float = option(3600.0, "SECONDS", shown="3600, an hour")
    out: Path = option(Path("prefcal-compare"), "FOLDER")
    json: bool = option(False, flag="--json")
