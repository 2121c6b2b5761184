"""What the best θ of an earlier study are worth, and what they cost where they mislead.

    python benchmarks/warm_start.py [--functions held-out] [--seeds 6] [--first 0] [--places 1 3]

GLISp, 10 + 40 experiments, a calibrator who never errs. Each run with `--places` θ of an earlier
study among its initial experiments has a twin of the same seed without. The earlier study, 50
experiments of another seed, was of a relative of the function:

    same      the function itself
    shifted   moved by 0.05 to 0.15 of the range along every knob, either way
    turned    turned by up to 20° about the middle of the box, and stretched by 1.2
    mirrored  with its first knob and a random half of the others reversed
    negated   its worst is best

Mean log10 ratio of the gaps to the optimum with its standard error (below 0: the earlier study
helps), and wins to losses, after so many experiments. docs/research/warm_start.md has the results.
"""

import argparse
from collections.abc import Callable
from itertools import product

import numpy as np
from rich.console import Console
from rich.progress import track
from strength import against
from variants import ALL

from prefcal_agents import Earlier, GLISp
from prefcal_scenarios.functions import TestFunction

N_INIT, N_MAX = 10, 50
AFTER = (15, 20, 30, 50)
DEVELOPED_ON = ("camel", "hartman3", "rosenbrock4", "levy4", "styblinski3")
HELD_OUT = ("branin", "ackley2", "dixon3", "griewank4", "ackley5", "hartman6")
GROUPS = {"developed-on": DEVELOPED_ON, "held-out": HELD_OUT}
RELATIVES = ("same", "shifted", "turned", "mirrored", "negated")

Latent = Callable[[np.ndarray], float]


def relative(kind: str, f: TestFunction, seed: int) -> Latent:
    """What the earlier study minimised: `kind` of `f`, of physical θ."""
    if kind == "same":
        return f
    if kind == "negated":
        return lambda theta: -f(theta)
    n, rng = len(f.space), np.random.default_rng([seed, RELATIVES.index(kind)])
    low = np.array([knob.low for knob in f.space])
    width = np.array([knob.high for knob in f.space]) - low
    offset, matrix = np.zeros(n), np.eye(n)
    if kind == "shifted":
        offset = rng.uniform(0.05, 0.15) * rng.choice([-1, 1], n)
    elif kind == "turned":
        matrix = 1.2 * _turn(rng, n)
    else:
        matrix = np.diag([-1, *rng.choice([-1, 1], n - 1)])
    return lambda theta: f(low + width * (0.5 + offset + matrix @ ((theta - low) / width - 0.5)))


def _turn(rng: np.random.Generator, n: int) -> np.ndarray:
    """A rotation whose largest angle is 20°."""
    from scipy.linalg import expm

    a = rng.standard_normal((n, n))
    return expm(np.deg2rad(20) * (a - a.T) / np.linalg.norm(a - a.T, 2))


def study(agent: GLISp, f: Latent) -> np.ndarray:
    """The lowest value so far after each experiment, shape (n_max,)."""
    lowest = []
    while not agent.done:
        query = agent.ask()
        value = f(query.challenger.theta)
        agent.tell(query, int(np.sign(value - lowest[-1])) if lowest else None)
        lowest.append(min([value, *lowest[-1:]]))
    return np.array(lowest)


def gaps(name: str, seed: int, places: list[int], relatives: list[str]) -> dict:
    """Gap after each experiment by relative and number of places, (n_max,); None is without."""
    f = ALL[name]
    plan = {"n_init": N_INIT, "n_max": N_MAX, "seed": seed}
    found = {None: study(GLISp(f.space, **plan), f) - f.optimum}
    for kind in relatives:
        earlier = GLISp(f.space, **{**plan, "seed": 1000 + seed})
        study(earlier, relative(kind, f, seed))
        record = Earlier.of(earlier)
        for count in places:
            warm = GLISp(f.space, start=record.start(f.space, count=count), **plan)
            found[kind, count] = study(warm, f) - f.optimum
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--functions", default="held-out", help="developed-on, held-out, or names")
    parser.add_argument("--relatives", nargs="+", choices=RELATIVES, default=RELATIVES)
    parser.add_argument("--places", nargs="+", type=int, default=[1, 3])
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    names = GROUPS.get(given.functions) or given.functions.split(",")
    runs = list(product(range(given.first, given.first + given.seeds), names))
    console = Console(stderr=True)
    found = [
        gaps(name, seed, given.places, given.relatives)
        for seed, name in track(runs, "calibrating", console=console)
    ]
    print("| earlier study of | θ | " + " | ".join(f"after {n}" for n in AFTER) + " |")
    print("| --- | --- " + "| --- " * len(AFTER) + "|")
    for key in product(given.relatives, given.places):
        pairs = [(one[key], one[None]) for one in found]
        cells = [against(*np.array(pairs)[:, :, n - 1].T) for n in AFTER]
        print(f"| {key[0]} | {key[1]} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
