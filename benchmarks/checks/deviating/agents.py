"""Compare our agent with the paper's: paired studies."""

import argparse
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache, partial
from typing import Any
from unittest import mock

import numpy as np
from rich.table import Table
from scipy.stats import qmc

from prefcal_agents import GLIS, GLISp, GLISpSettings
from prefcal_agents.acquisition import exploration as acquisition
from prefcal_agents.baselines.glis import GLISSettings
from prefcal_agents.glisp import selection
from prefcal_agents.glisp import settings as glisp_settings
from prefcal_agents.glisp import strategy as proposal
from prefcal_agents.models.preference_qp import Learning
from prefcal_agents.models.rbf import squared_distances
from prefcal_agents.optimize import search as optimizer
from prefcal_agents.optimize.search import multistart
from prefcal_agents.space import design as cube
from prefcal_env import Knob, KnobSpace
from prefcal_env.preferences.loop import ask_and_tell
from prefcal_scenarios.cases.cstr.scenario import SPACE
from prefcal_scenarios.cases.functions import FUNCTIONS

from .common import bar, seeds, table
from .control import index

PROBLEMS = (
    "branin", "camel", "adjiman", "ackley2", "rosenbrock2", "hartman3", "styblinski3", "levy4",
    "rosenbrock4", "ackley5", "hartman6", "levy8",
)  # fmt: skip
FLOOR = 1e-9  # the optima are not known better
REACTOR = 0.69066
"""Best known index of the broad basin."""
QUARTILES = (0.25, 0.5, 0.75, 1.0)
Settings = GLISpSettings | GLISSettings
Patch = Callable[[], Any]


@contextmanager
def z_of(function: Callable[[np.ndarray], np.ndarray]) -> Iterator[None]:
    """Replace the exploration function by one of d in the unit cube, shape (m, N)."""
    with mock.patch.object(acquisition, "exploration", function):
        yield


@contextmanager
def regularized(lam: float) -> Iterator[None]:
    """Replace λ of eq. QP-pref, in cross-validation too."""
    with mock.patch.object(selection, "Learning", partial(Learning, lam=lam)):
        yield


def z_printed(d: np.ndarray) -> np.ndarray:
    """Return eq. IDW-distance in [-1, 1]^n, where squared distances are four times as large."""
    return EXPLORATION(4 * d)


def z_authors(d: np.ndarray) -> np.ndarray:
    """Return the authors' z in [-1, 1]^n, with w the inverse of the squared distance."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.arctan(1 / np.sum(1 / (4 * d), axis=1)))


def maximin(space: KnobSpace, count: int, seed: int) -> np.ndarray:
    """Return the best of five Latin hypercubes, by the smallest distance of two points."""
    sampler = qmc.LatinHypercube(len(space), rng=np.random.default_rng([seed, 0]))
    plans = [np.asarray(sampler.random(count)) for _ in range(5)]
    return space.scaled(max(plans, key=smallest_distance))


def smallest_distance(points: np.ndarray) -> float:
    """Return the smallest distance between two rows, shape (N, n), in the unit cube."""
    d = squared_distances(points, points)
    return float(np.sqrt(d[np.triu_indices(len(points), 1)].min()))


EXPLORATION = acquisition.exploration
PAPER = GLISpSettings.paper()
# φ(εd) with d four times as large is φ(4ε d): the candidates of ε are multiples of it.
WIDE = replace(PAPER, epsilon=4.0)
MORE = tuple(float(e) for e in 10.0 ** np.linspace(-2, 2, 17))
VARIANTS: dict[str, tuple[Settings, Patch]] = {
    "ours": (PAPER, ExitStack),
    "box [-1, 1], z as printed": (WIDE, lambda: z_of(z_printed)),
    "box [-1, 1], z of the authors' code": (WIDE, lambda: z_of(z_authors)),
    "maximin hypercube": (
        PAPER, lambda: mock.patch.object(proposal, "latin_hypercube", maximin)
    ),
    "ε from 0.01 to 100": (
        PAPER, lambda: mock.patch.object(glisp_settings, "EPSILONS", MORE)
    ),
    "φ Gaussian": (replace(PAPER, rbf="gaussian"), ExitStack),
    "φ thin plate": (replace(PAPER, rbf="thin_plate_spline"), ExitStack),
    "λ times 1000": (PAPER, lambda: regularized(1000.0)),
    "knobs of any value": (PAPER, ExitStack),
    "GLIS": (GLISSettings(), ExitStack),
    "GLIS, α 0.8, δ 0.5": (GLISSettings(alpha=0.8, delta=0.5), ExitStack),
}  # fmt: skip


def problem(name: str, *, stepless: bool) -> tuple[KnobSpace, Callable[[np.ndarray], float], float]:
    """Return the space, the latent cost of a physical θ, and its best known value."""
    if name == "cstr":
        knobs = [replace(k, step=0) if stepless and not k.integer else k for k in SPACE]
        return KnobSpace(knobs), reactor_index, REACTOR
    function = FUNCTIONS[name]
    return function.space, function, function.optimum


def reactor_index(theta: np.ndarray) -> float:
    return _index(tuple(theta.tolist()))


@cache
def _index(theta: tuple[float, ...]) -> float:
    return index(theta)


@cache
def gap(name: str, variant: str, seed: int) -> float:
    """Return the gap to the optimum after 50 experiments, 10 of them initial."""
    space, cost, best = problem(name, stepless=variant == "knobs of any value")
    settings, patch = VARIANTS[variant]
    make: Any = GLIS if isinstance(settings, GLISSettings) else GLISp
    agent = make(space, n_init=10, n_max=50, seed=seed, settings=settings)
    with patch():
        deque(ask_and_tell(agent, cost, _score if make is GLIS else _better), maxlen=0)
    return max(cost(agent.best) - best, FLOOR)


def _score(new: float, _old: float | None) -> float:
    return new


def _better(new: float, old: float | None) -> int | None:
    return None if old is None else int(np.sign(new - old))


def pairs(
    title: str, variants: Sequence[str], args: argparse.Namespace, *,
    ours: str = "ours", problems: Sequence[str] = (*PROBLEMS, "cstr"),
) -> Table:  # fmt: skip
    """Tabulate the gaps of each variant and ours, for the same problem and seed."""
    jobs = [(p, v, s) for p in problems for v in (ours, *variants) for s in seeds(args)]
    found = {job: gap(*job) for job in bar(jobs, title)}
    shown = table(title, "problem", *(c for v in variants for c in (v, "won:lost")))
    everything: dict[str, list[float]] = {v: [] for v in variants}
    for p in problems:
        cells = [p]
        for v in variants:
            ratios = [float(np.log10(found[p, v, s] / found[p, ours, s])) for s in seeds(args)]
            cells += summary(ratios)
            # The reactor has a row of its own and is not in the mean over the functions.
            everything[v] += ratios if p != "cstr" else []
        shown.add_row(*cells)
    if len(problems) > 1:
        means = [c for v in variants for c in summary(everything[v])]
        shown.add_row(f"{len(problems) - 1} functions", *means)
    for v in (ours, *variants):
        costs = np.array([found["cstr", v, s] for s in seeds(args)]) + REACTOR
        quartiles = " ".join(f"{q:.4f}" for q in np.quantile(costs, QUARTILES))
        print(f"cstr, {v}: index, quartiles and worst {quartiles}")
    return shown


def summary(ratios: Sequence[float]) -> tuple[str, str]:
    """Return the mean log10 ratio to ours with its standard error, wins and losses."""
    error = np.std(ratios) / np.sqrt(len(ratios))
    won, lost = sum(r < -1e-9 for r in ratios), sum(r > 1e-9 for r in ratios)
    return f"{np.mean(ratios):+.2f} ± {error:.2f}", f"{won}:{lost}"


def box(args: argparse.Namespace) -> Table:
    return pairs("log10 ratio of gaps to GLISp.paper in [0, 1]", list(VARIANTS)[1:3], args)


def hypercube(args: argparse.Namespace) -> Table:
    unit = KnobSpace([Knob(f"z{k}", 0, 1, step=0) for k in range(3)])
    for name, make in (("plain", cube.latin_hypercube), ("maximin", maximin)):
        apart = [smallest_distance(make(unit, 10, s)) for s in range(args.first, args.first + 200)]
        print(f"{name}: smallest distance of 10 points in 3 dimensions {np.mean(apart):.3f}")
    return pairs("log10 ratio of gaps to a plain hypercube", ["maximin hypercube"], args)


def candidates(args: argparse.Namespace) -> Table:
    return pairs("log10 ratio of gaps to ε from 0.1 to 10", ["ε from 0.01 to 100"], args)


def surrogate(args: argparse.Namespace) -> Table:
    variants = ["φ Gaussian", "φ thin plate", "λ times 1000"]
    return pairs("log10 ratio of gaps to φ inverse quadratic, λσ = 1e-6", variants, args)


def resolution(args: argparse.Namespace) -> Table:
    title = "log10 ratio of gaps to knobs with a step"
    return pairs(title, ["knobs of any value"], args, problems=["cstr"])


def glis(args: argparse.Namespace) -> Table:
    few = ("camel", "branin", "hartman3", "hartman6", "cstr")  # seconds a study
    variants = ["GLIS, α 0.8, δ 0.5"]
    return pairs("log10 ratio of gaps to our GLIS", variants, args, ours="GLIS", problems=few)


def search(args: argparse.Namespace) -> Table:
    """Measure how far a(θ) of each proposal is above the minimum of a broader search, in ΔĴ."""
    shown = table(
        "Acquisition above the lowest known [ΔĴ]", "function", "median", "95 %", "worst",
        "proposals",
    )  # fmt: skip
    missed: dict[str, list[float]] = {}

    def watched(objective: Any, domain: Any, rng: np.random.Generator) -> np.ndarray:
        found = multistart(objective, domain, rng)
        more = multistart(objective, domain, rng, draws=20000, starts=12)
        random = objective(rng.random((20000, len(domain.start))))
        lowest = min(objective(more[:1])[0], random.min())
        missed[name].append(max(float(objective(found[:1])[0] - lowest), 0.0))
        return found

    for name in bar(("camel", "hartman3", "hartman6"), "searching"):
        missed[name] = []
        with mock.patch.object(optimizer, "multistart", watched):
            for seed in range(args.first, args.first + max(args.seeds // 4, 1)):
                gap.__wrapped__(name, "ours", seed)
        cells = [f"{q:.5f}" for q in np.quantile(missed[name], (0.5, 0.95, 1.0))]
        shown.add_row(name, *cells, str(len(missed[name])))
    return shown
