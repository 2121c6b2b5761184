"""Results of the benchmark, made by hand."""

from dataclasses import replace

from prefcal_bench.cells.cell import Cell, Result
from prefcal_bench.cells.duels import Duel


def result(agent="GLISp", problem="bowl", seed=0, gaps=(1.0, 0.1), *, knobs=2, **changes):
    """A finished result with these gaps; a preference-based agent asks from the second θ on."""
    calibrator = changes.pop("calibrator", "perfect")
    count = 2 if gaps is None else len(gaps)
    cell = Cell(agent, problem, calibrator, seed, changes.pop("n_init", 1), changes.pop("n_max", count))
    made = Result(
        cell=cell,
        thetas=((0.0,) * knobs,) * count,
        gaps=gaps if gaps is None else tuple(float(g) for g in gaps),
        visited=gaps if gaps is None else tuple(float(min(gaps[: i + 1])) for i in range(count)),
        questions=tuple(range(count)),
        best=(0.0,) * knobs,
    )
    return replace(made, **changes)


def failed(agent="GLISp", problem="bowl", seed=0, words="the worker died", n_max=2):
    """A failed cell."""
    return Result(Cell(agent, problem, "perfect", seed, 1, n_max), (), None, None, (), (), failure=words)


def ends(agent, problem, values, **changes):
    """One result for each seed, which starts at 1 and ends at the given gap."""
    return [result(agent, problem, seed, (1.0, end), **changes) for seed, end in enumerate(values)]


def grid(factors, problems=("bowl", "valley", "waves"), seeds=4):
    """Agents whose gaps are everywhere `factors` times those of the first."""
    return [
        result(agent, problem, seed, (1.0, 0.5, 1e-3 * factor * (seed + 1) * (p + 1)), knobs=p + 2)
        for agent, factor in factors.items()
        for p, problem in enumerate(problems)
        for seed in range(seeds)
    ]


def duel(agent, rival, seed, outcome, problem="road", calibrator="lexicographic"):
    """One verdict."""
    return Duel(problem, calibrator, agent, rival, seed, outcome)
