"""Measure which deviation of GLISp from the paper helps: paired studies on many functions.

    python benchmarks/campaigns/variants.py  # all variants, all functions, 10 seeds
    python benchmarks/campaigns/variants.py --variants 'default,no process' --functions held-out
    python benchmarks/campaigns/variants.py --functions camel,hartman6 --first 100 --n-init 6

Every study of a variant is paired with the study of `default` on the same function and seed. One
process; a study of 50 experiments takes a few seconds. docs/research/process.md has the
results.
"""

import argparse
from functools import partial

import numpy as np

from prefcal_agents import GLISp, GLISpSettings, minimize_by_preference
from prefcal_scenarios.cases.functions import FUNCTIONS, TestFunction, box

FLOOR = 1e-9  # the optima are not known better
VARIANTS: dict[str, GLISpSettings] = {
    "default": GLISpSettings(),
    "no process": GLISpSettings(process=False),
    "paper": GLISpSettings.paper(),
}
DEVELOPED_ON = ("camel", "rosenbrock2", "hartman3", "styblinski3", "levy4", "ackley5", "hartman6")


def dixon_price(x: np.ndarray) -> float:
    """Compute a valley curved twice, minimum 0."""
    i = np.arange(2, len(x) + 1)
    return float((x[0] - 1) ** 2 + i @ (2 * x[1:] ** 2 - x[:-1]) ** 2)


def griewank(x: np.ndarray) -> float:
    """Compute a bowl with shallow waves, minimum 0 at 0."""
    return float(1 + x @ x / 4000 - np.prod(np.cos(x / np.sqrt(np.arange(1, len(x) + 1)))))


def zakharov(x: np.ndarray) -> float:
    """Compute a plate that bends up steeply along one direction, minimum 0 at 0."""
    s = 0.5 * np.arange(1, len(x) + 1) @ x
    return float(x @ x + s**2 + s**4)


_TURN = np.linalg.qr(np.random.default_rng(7).standard_normal((6, 6)))[0]


def ellipsoid(x: np.ndarray) -> float:
    """Return a bowl 100 times steeper along one (turned) axis than along another, minimum 0."""
    return float(10 ** np.linspace(0, 2, 6) @ (_TURN @ (x - 0.37)) ** 2)


def michalewicz(x: np.ndarray) -> float:
    """Compute steep ridges along every knob; a sum of one function per knob."""
    i = np.arange(1, len(x) + 1)
    return float(-np.sum(np.sin(x) * np.sin(i * x**2 / np.pi) ** 20))


OTHERS = (
    TestFunction("dixon3", dixon_price, box(*[(-10, 10)] * 3), 0.0, ()),
    TestFunction("griewank4", griewank, box(*[(-6, 9)] * 4), 0.0, ()),
    TestFunction("zakharov5", zakharov, box(*[(-5, 10)] * 5), 0.0, ()),
    TestFunction("ellipsoid6", ellipsoid, box(*[(0, 1)] * 6), 0.0, ()),
    TestFunction("michalewicz4", michalewicz, box(*[(0, np.pi)] * 4), -3.698857098466, ()),
)
ALL = {**FUNCTIONS, **{function.name: function for function in OTHERS}}
GROUPS = {
    "all": tuple(ALL),
    "developed-on": DEVELOPED_ON,
    "held-out": tuple(name for name in ALL if name not in DEVELOPED_ON),
}


def gap(settings: GLISpSettings, function: TestFunction, seed: int, n_init: int) -> float:
    """Return the gap to the optimum after 50 experiments."""
    agent, space = partial(GLISp, settings=settings), function.space
    found = minimize_by_preference(
        function.prefer, space, agent=agent, n_init=n_init, n_max=50, seed=seed
    )
    return max(function.gap(found.best), FLOOR)


def main() -> None:
    """Print one line per function and variant, and the mean over all."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--variants", default=",".join(VARIANTS))
    parser.add_argument("--functions", default="all", help="all, developed-on, held-out, or names")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--n-init", type=int, default=10)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    names = given.variants.split(",")
    ratios: dict[str, list[float]] = {name: [] for name in names}
    for key in GROUPS.get(given.functions) or given.functions.split(","):
        paired = [gap(VARIANTS["default"], ALL[key], seed, given.n_init) for seed in seeds]
        for name in names:
            settings = VARIANTS[name]
            gaps = [gap(settings, ALL[key], seed, given.n_init) for seed in seeds]
            against = np.log10(gaps) - np.log10(paired)
            ratios[name].extend(against)
            print(f"{key:13} {name:16} {np.median(gaps):9.2g} {_summary(against)}", flush=True)
    for name, against in ratios.items():
        print(f"{'mean':13} {name:16} {'':9} {_summary(np.array(against))}")


def _summary(against: np.ndarray) -> str:
    """Return the mean log10 ratio to `default` with its standard error, wins and losses."""
    error = np.std(against) / np.sqrt(len(against))
    won, lost = np.sum(against < -1e-9), np.sum(against > 1e-9)
    return f"{np.mean(against):+.2f} ± {error:.2f}  {won}:{lost}"


if __name__ == "__main__":
    main()
