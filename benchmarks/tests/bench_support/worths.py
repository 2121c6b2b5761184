"""Results with a worth: random walks, and studies made by hand."""

import numpy as np
import pandas as pd

from prefcal_bench.cells.cell import Cell, Result
from prefcal_bench.results.campaign import COLUMNS


def study(agent="GLISp", loop="servo", seed=0, worth=(1.0, 4.0), *, taste="weights", **changes):
    """A finished study that held θ of this worth; one answer an experiment, or as `questions`."""
    n_max = changes.pop("n_max", len(worth))
    questions = tuple(changes.pop("questions", range(len(worth))))
    cell = Cell(agent, loop, taste, seed, changes.pop("n_init", 1), n_max)
    comparisons = changes.pop("comparisons", None)
    if comparisons is None:
        comparisons = tuple((k + 1, k, -1) for k in range(questions[-1]))
    return Result(
        cell,
        tuple((float(k), 0.5) for k in range(len(worth))),
        None,
        None,
        questions,
        (0.0, 0.5),
        worth=tuple(map(float, worth)),
        comparisons=comparisons,
        **changes,
    )


def walk(agent, loop, seed, strength, *, taste="weights", n_max=50, per_experiment=1, loss=0.1):
    """A study whose worth goes up at random, and now and then down.

    `strength` 1 is random search; `per_experiment` answers are asked from the second θ on.
    """
    rng = np.random.default_rng([seed, *map(ord, agent + loop + taste)])
    best, held = 1.0, []
    for _ in range(n_max):
        found = (1 / rng.random()) ** strength
        best = found if found > best or rng.random() < loss * 0.3 else best
        held.append(min(best, 4001.0))
    asked = [per_experiment * k for k in range(n_max)]
    return study(
        agent,
        loop,
        seed,
        held,
        taste=taste,
        questions=asked,
        n_init=min(10, n_max),
        n_max=n_max,
        comparisons=tuple((min(k, n_max - 1), 0, 1) for k in range(1, asked[-1] + 1)),
    )


def walks(agents, loops=("servo", "boost", "steering"), tastes=("weights",), seeds=4, **options):
    """Studies of agents of these strengths on loops, with tastes and seeds."""
    return [
        walk(agent, loop, seed, strength, taste=taste, **options)
        for taste in tastes
        for loop in loops
        for agent, strength in agents.items()
        for seed in range(seeds)
    ]


def published(results):
    """These studies in the published form, with a row for each experiment."""
    rows = [
        (c.calibrator, c.n_init, c.n_max, c.problem, c.agent, c.seed, k, asked, worth)
        for c, r in ((result.cell, result) for result in results)
        for k, (asked, worth) in enumerate(zip(r.questions, r.worth, strict=True))
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS)).astype({"worth": "float32"})
