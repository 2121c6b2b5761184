"""What several campaigns need: the course of a study, and many studies in several processes."""

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track

from prefcal_env.experiments.experiment import Experiment
from prefcal_env.preferences.loop import Comparison

T = TypeVar("T")


def best_after_each(
    agent: Any, steps: Iterable[Comparison], cost: Callable[[Experiment], float]
) -> list[float]:
    """Cost of the agent's best after each experiment, (n_max,); `steps` drive the agent.

    Some studies ask more questions than they run experiments. Such an answer may change who is
    the best, so it changes the last entry and adds none.
    """
    costs: dict[tuple[float, ...], float] = {}
    course: list[float] = []
    for step in steps:
        theta = tuple(step.query.challenger.theta.tolist())
        if theta not in costs:
            costs[theta] = cost(step.challenger)
            course.append(0.0)
        course[-1] = costs[tuple(agent.best.tolist())]
    return course


def spread(
    function: Callable[[Any], T], jobs: Sequence[Any], processes: int, label: str = "calibrating"
) -> Iterator[T]:
    """Yield the result of each job, in order, with a progress bar."""
    console = Console(stderr=True)
    with ProcessPoolExecutor(processes) if processes > 1 else nullcontext() as pool:
        results = map(function, jobs) if pool is None else pool.map(function, jobs)
        yield from track(results, label, total=len(jobs), console=console)


def stored(folder: Path) -> list[dict[str, Any]]:
    """Return the studies that a campaign has stored in a folder."""
    path = folder / "studies.jsonl"
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def done(jobs: Sequence[Callable[[], T]], processes: int) -> Iterator[T]:
    """Yield the result of each job as soon as it is ready."""
    if processes == 1:
        yield from (job() for job in jobs)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from (each.result() for each in as_completed([pool.submit(job) for job in jobs]))
