"""Recompute the cheap figures of README and docs, and compare them with the pages.

    python benchmarks/checks/claims.py  # about ten seconds; exits with 1 if a figure differs
    python benchmarks/checks/claims.py --list  # every claim and its page, without computing

A claim is a page, the exact words in it with its figures in ‹ ›, and a function that computes them.
A figure is right if it is the computed one, rounded to the written digits. Figures of campaigns are
not included: their pages name the commands.
"""

import argparse
import os
import re
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_HALF_UP, Decimal
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import readings
from offset_free import noise_left, offsets
from reactor_pictures import lowest, rows_of, theta
from readings import AUTOMATED, CAR, PREFERRED
from rich.console import Console
from rich.table import Table

from prefcal_env.envs import cstr as reactor
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.mpc import LinearMPC
from prefcal_env.plants import CSTR
from prefcal_env.plants.cstr import FEED
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios import load
from prefcal_scenarios.cases.overtake import controller as car
from prefcal_scenarios.cases.overtake import overtake

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).parent / "reactor_index.csv"
FIGURE = re.compile("‹([^›]*)›")
Numbers = Sequence[float]


@dataclass(frozen=True)
class Claim:
    """Claim of a page with figures."""

    page: str  # path in the repository
    text: str  # text of the page with the figures in ‹ ›; line breaks do not matter
    compute: Callable[[], Numbers]  # function that returns the figures, in the order of the text

    @property
    def words(self) -> str:
        """Return the text as the page has it."""
        return FIGURE.sub(r"\1", self.text)

    @property
    def figures(self) -> list[str]:
        """Return the claimed figures."""
        return FIGURE.findall(self.text)

    def written(self, root: Path = ROOT) -> bool:
        """Return whether the words are still in the page."""
        return flowing(self.words) in flowing((root / self.page).read_text("utf-8"))

    def wrong(self) -> Iterator[str]:
        """Yield a sentence for each figure that differs from the computed one."""
        found = list(self.compute())
        if len(found) != len(self.figures):
            yield f"{self.page}: {self.words!r} has {len(self.figures)} figures, got {len(found)}"
            return
        for figure, value in zip(self.figures, found, strict=True):
            if rounded(value, figure) != Decimal(figure):
                yield f"{self.page}: {self.words!r} says {figure}, now {value:.6g}"


def flowing(text: str) -> str:
    """Return `text` with every sequence of white space as one blank."""
    return " ".join(text.split())


def rounded(value: float, figure: str) -> Decimal:
    """Return `value` with as many digits as `figure` has."""
    if not np.isfinite(value):
        return Decimal("NaN")
    return Decimal(repr(float(value))).quantize(Decimal(figure), ROUND_HALF_UP)


# Runs that several claims share are cached.


@cache
def react(theta: tuple[float, ...], base: float = 10.0) -> Experiment:
    return readings.react(theta, base=base)


@cache
def drive(base: float = 10.0) -> Experiment:
    return readings.drive(CAR, base=base)


def indices(
    *thetas: tuple[float, ...], change: readings.Change = readings.same, base: float = 10.0
) -> Numbers:
    return [readings.index(t, change, base) for t in thetas]


def both_optima() -> Numbers:
    scenario, rows = load("cstr"), rows_of(TABLE)
    assert scenario.cost is not None
    return [scenario.cost(scenario.run(theta(lowest(rows[kind])))) for kind in ("calm", "all")]


def parts_of_the_index() -> Numbers:
    """Return t_f, moves and final error of both optima by row, and the undershoot of the hole."""
    rows, scenario = rows_of(TABLE), load("cstr")
    runs = [scenario.run(theta(lowest(rows[kind]))) for kind in ("calm", "all")]
    found = [e.kpis["settling_time"] / 48 for e in runs]
    found += [e.kpis["mean_square_move"] / 10 for e in runs]
    found += [abs(e.kpis["final_concentration"] - 2) / 0.06 for e in runs]
    return [*found, runs[1].kpis["undershoot"]]


def with_rates(factor: float) -> Numbers:
    scaled = tuple(factor * rate for rate in reactor.SETTLED_RATES)
    with mock.patch.object(reactor, "SETTLED_RATES", scaled):
        return indices(AUTOMATED)


def growth(T: float, C_A: float) -> float:
    """Return the largest growth rate of the model at a state, 1/h."""
    A = CSTR().jacobians(np.array([T, C_A]), np.array([298.0]), FEED).A
    return float(np.linalg.eigvals(A).real.max())


def growths() -> Numbers:
    """Return growth rates along the run of the automated θ, in steady states, and when hot."""
    x = react(AUTOMATED).x
    along = [growth(*each) for each in x]
    k = int(np.argmax(along))
    steady = [
        growth(*CSTR().steady_state_at_concentration(float(C_A))[0]) for C_A in np.linspace(0.5, 9.9, 200)
    ]
    at_365 = x[int(np.argmin(np.abs(x[:, 0] - 365.0)))]
    assert growth(*at_365) < 0
    return [along[k], *x[k], max(steady), growth(365.0, 5.0), at_365[1]]


def circle() -> Numbers:
    """Return the numbers of the three drives, if each is better than the next."""
    judge = overtake.calibrators["synthetic"]()
    draws = {i: np.random.default_rng([0, i]).random(5) for i in (3, 15, 12)}
    a, b, c = (overtake.run(overtake.space.decode(z)) for z in draws.values())
    better = [judge.prefer(*pair) is Preference.CHALLENGER for pair in ((a, b), (b, c), (c, a))]
    return list(draws) if all(better) else [np.nan] * 3


def worst_t_comp() -> float:
    return float(drive().kpis["t_comp_worst"])


def peaks(change: readings.Change) -> Numbers:
    return [drive().kpis["path_peak"], readings.drive(CAR, change).kpis["path_peak"]]


def at_optimum(limit: str) -> Numbers:
    """Return peak, lateral distance, lateral acceleration and steering at the paper's θ."""
    kpis = readings.drive(CAR, fixed=car.STEERING_LIMITS[limit]).kpis
    names = "path_peak", "lateral_distance", "lateral_acceleration", "steering"
    return [float(kpis[name]) for name in names]


def stiff_peak(limit: str = "per second") -> float:
    stiff = replace(car.STEERING_LIMITS[limit], Q_eps=1e5)
    return float(readings.drive(CAR, fixed=stiff).kpis["path_peak"])


def offset_table() -> Numbers:
    return [value for pair in offsets().values() for value in pair]


def z_weaker() -> float:
    """Return how much weaker z is in [0, 1] than in [-1, 1], where it is small."""
    from prefcal_agents.search import exploration

    d = np.full((1, 40), 0.01)
    return float((exploration(4 * d) / exploration(d))[0])


def unlimited(theta: tuple[float, ...]) -> Numbers:
    """Return the index without a limit on the first input and move."""
    with mock.patch.object(LinearMPC, "move", readings.first_unlimited):
        return indices(theta)


DEVIATIONS = "docs/deviations.md"
CLAIMS: tuple[Claim, ...] = (
    Claim("docs/benchmarks.md", "best ‹0.691› outside of [a hole]", lambda: both_optima()[:1]),
    Claim("docs/gallery/reactor.md", "| index | ‹0.6907› | ‹0.4151› |", both_optima),
    Claim(
        "docs/gallery/reactor.md",
        "| of which t_f / 48 h | ‹0.469› | ‹0.385› | | of which moves | ‹0.162› | ‹0.030› | "
        "| of which final error | ‹0.060› | ‹0.000› | | undershoot of C_A below the target "
        "| none | ‹0.49› kgmol/m³ |",
        parts_of_the_index,
    ),
    Claim("docs/benchmarks.md", "the best index of the broad basin, ‹0.6907›", lambda: both_optima()[:1]),
    Claim(
        "docs/mpc.md",
        "grow by up to ‹0.85› per hour (at T = ‹344› K, C_A = ‹5.4›), and in the steady states "
        "in between by up to ‹0.52›. In a hot tank with much of A left, for example after a "
        "disturbance, they grow far faster: ‹3.2› per hour at T = 365 K, C_A = 5. At 365 K along "
        "the run itself, where C_A has fallen to ‹2.8›, they decay",
        growths,
    ),
    Claim(
        "docs/mpc.md",
        "| k_0 5 % higher | ‹1.819› | ‹2.000› | | US/V 5 % higher | ‹2.126› | ‹2.000› | "
        "| US/V 5 % lower | ‹1.892› | ‹2.000› |",
        offset_table,
    ),
    Claim("docs/mpc.md", "the same estimator's error is ‹0.47› and ‹0.37› of the measurement's", noise_left),
    Claim(
        "docs/overtaking.md",
        "| per second (default) | ‹3.129› m | ‹2.968› m | ‹3.3› m/s² | ‹3.4›° |",
        lambda: at_optimum("per second"),
    ),
    Claim(
        "docs/overtaking.md",
        "| per step | ‹3.036› m | ‹2.9998› m | ‹14.9› m/s² | ‹15.0›° |",
        lambda: at_optimum("per step"),
    ),
    Claim(
        "docs/overtaking.md",
        "for Q_ε the car swerves to ‹5.9› m per step, and off the road per second",
        lambda: [stiff_peak("per step")] if stiff_peak("per second") > 6 else [np.nan],
    ),
    Claim("docs/overtaking.md", "the paper's worst t_comp of ‹0.081› s", lambda: [worst_t_comp()]),
    Claim("docs/overtaking.md", "(numbers ‹3›, ‹15› and ‹12› of the seeded sample) form a circle", circle),
    Claim(DEVIATIONS, "C_A = ‹8.538›, ‹5.590› and ‹2.332›; as printed only ‹9.497›", readings.heat),
    Claim(
        DEVIATIONS, "two θ ‹0.6996› and ‹0.8217›; from T_c0 = 298 K ‹0.6970› and ‹0.8036›", readings.starts
    ),
    Claim(
        DEVIATIONS,
        "automated θ ‹0.6996›, with base e ‹0.8149›",
        lambda: [*indices(AUTOMATED), *indices(AUTOMATED, base=np.e)],
    ),
    Claim(
        DEVIATIONS,
        "the car's peak ‹3.129› m, with base e ‹3.108› m",
        lambda: [drive().kpis["path_peak"], drive(np.e).kpis["path_peak"]],
    ),
    Claim(
        DEVIATIONS,
        "automated θ ‹0.6996›, with twice the rates ‹0.7462›",
        lambda: [*indices(AUTOMATED), *with_rates(2.0)],
    ),
    Claim(
        DEVIATIONS,
        "as printed ‹0.7009› and ‹0.8230›; the car's peak ‹3.129› m, as printed ‹3.128› m",
        lambda: [
            *indices(AUTOMATED, PREFERRED, change=readings.up_to_last_but_one),
            *peaks(readings.up_to_last_but_one),
        ],
    ),
    Claim(
        DEVIATIONS,
        "with one more ‹0.6999› and ‹0.8213›; the car's peak ‹3.129› m and ‹3.119› m",
        lambda: [*indices(AUTOMATED, PREFERRED, change=readings.one_more), *peaks(readings.one_more)],
    ),
    Claim(
        DEVIATIONS,
        "the preferences θ ‹0.8217›, without it ‹0.8848›",
        lambda: [*indices(PREFERRED), *unlimited(PREFERRED)],
    ),
    Claim(
        DEVIATIONS,
        "a peak of ‹3.129› m, with 1e5 ‹6.205› m",
        lambda: [drive().kpis["path_peak"], stiff_peak()],
    ),
    Claim(DEVIATIONS, "δ acts up to ‹16› times weaker", lambda: [z_weaker()]),
    Claim(DEVIATIONS, "‹0.081› s at the paper's θ by construction", lambda: [worst_t_comp()]),
)


def main() -> int:
    """Check every claim; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--list", action="store_true", help="only list the claims and their pages")
    console = Console(soft_wrap=True, highlight=False, markup=False)
    if parser.parse_args().list:
        table = Table("page", "claim")
        for claim in CLAIMS:
            table.add_row(claim.page, claim.words)
        Console(markup=False).print(table)
        return 0
    wrong = [f"{c.page} no longer says: {c.words}" for c in CLAIMS if not c.written()]
    for claim in CLAIMS:
        wrong += claim.wrong()
    for words in wrong:
        console.print(words)
    figures = sum(len(claim.figures) for claim in CLAIMS)
    console.print(f"{figures} figures in {len(CLAIMS)} claims, {len(wrong)} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
