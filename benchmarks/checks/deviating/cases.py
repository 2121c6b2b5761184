"""Vary what the paper leaves open in the case studies: reactor, car, calibrator."""

import argparse
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
from rich.table import Table

from prefcal_agents import GLISp
from prefcal_env import calibrate
from prefcal_env.calibrators import Lexicographic
from prefcal_env.envs import cstr as reactor
from prefcal_env.envs.overtake.rules import WIDTH
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.plants import CSTR
from prefcal_env.plants.cstr import FEED
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.cases.cstr.controller import SPACE
from prefcal_scenarios.cases.cstr.kpis import performance_index
from prefcal_scenarios.cases.overtake import controller as car_tuning
from prefcal_scenarios.cases.overtake import overtake, supervisor
from prefcal_scenarios.cases.overtake.supervisor import Supervisor

from . import control
from .common import AUTOMATED, CAR, PREFERRED, bar, lowest, seeds, table, two
from .control import drive, index, random_cars, random_theta, react, tell_drives, tell_verdicts

GRID = np.arange(-5.0, 3.001, 0.05)


def settling(args: argparse.Namespace) -> Table:
    shown = table(
        "Settling rates", "factor", "index, automated θ", "index, preferences θ",
        "lowest over log Q (T_s 0.25 h, N_p 26)", "never settled",
    )  # fmt: skip
    rates = reactor.SETTLED_RATES
    for factor in bar((0.1, 0.3, 1.0, 1.5, 2.0, 4.0), "settling"):
        scaled = tuple(factor * rate for rate in rates)
        with mock.patch.object(reactor, "SETTLED_RATES", scaled):
            runs = [react((0.25, 26, q)) for q in GRID]
            costs = [performance_index(e) for e in runs]
            never = sum(np.isinf(e.kpis["settling_time"]) for e in runs)
            shown.add_row(
                f"{factor:g}", f"{index(AUTOMATED):.4f}", f"{index(PREFERRED):.4f}",
                lowest(GRID, costs), f"{never} of {len(runs)}",
            )  # fmt: skip
    return shown


def logarithm(args: argparse.Namespace) -> Table:
    shown = table("Base of log Q", "what", "10", "e")
    for name, theta in (("automated", AUTOMATED), ("preferences", PREFERRED)):
        both = index(theta), index(theta, base=np.e)
        shown.add_row(f"index, paper's θ ({name})", *two(*both, ".4f"))
    costs = [[index((0.25, 26, q), base=b) for q in GRID] for b in (10.0, np.e)]
    words = "lowest over log Q (T_s 0.25 h, N_p 26)"
    shown.add_row(words, *(lowest(GRID, each) for each in costs))
    tell_drives(shown, drive(CAR), drive(CAR, base=np.e))
    return shown


def heat(args: argparse.Namespace) -> Table:
    """Tabulate the zeros of the right side at T_c = 298 K with either sign of H."""
    shown = table("Sign of the heat of reaction, T_c = 298 K", "sign", "steady states C_A")
    ours = CSTR().steady_states_at_input(298.0)
    shown.add_row("+ (heats)", ", ".join(f"{C_A:.3f}" for C_A in ours[:, 1]))
    T = np.linspace(250, 450, 200_001)
    k = np.array([CSTR()._rate(float(t)) for t in T])
    C_A = FEED[1] / (1 + k)
    p = CSTR().params
    dT = p.F_V * (FEED[0] - T) - p.H / p.rho_Cp * k * C_A - p.US_V / p.rho_Cp * (T - 298.0)
    zeros = np.flatnonzero(np.sign(dT[:-1]) != np.sign(dT[1:]))
    shown.add_row("- (as printed)", ", ".join(f"{C_A[i]:.3f}" for i in zeros))
    return shown


def start(args: argparse.Namespace) -> Table:
    """Compare starts: C_A = 8.56, and the uppermost steady state at the table's T_c0 = 298 K."""
    shown = table("Start of the reactor", "paper's θ", "C_A = 8.56", "T_c0 = 298 K")
    there = CSTR().steady_states_at_input(298.0)
    x0 = there[int(np.argmax(there[:, 1]))]
    task = replace(reactor.cstr_task(), x0=x0, u0=np.array([298.0]))
    for name, theta in (("automated", AUTOMATED), ("preferences", PREFERRED)):
        before = index(theta)
        with mock.patch.object(reactor, "cstr_task", return_value=task):
            experiment = react(theta)
        with mock.patch("prefcal_scenarios.cases.cstr.kpis._T_C_START", np.array([298.0])):
            shown.add_row(name, *two(before, performance_index(experiment), ".4f"))
    return shown


class CatchingUp(Supervisor):
    """Controller whose reference of x_f starts with the car, so that lost distance is made up."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._goal: float | None = None

    def move(self, measurement: Any) -> Any:
        """Decide the next input."""
        here = float(measurement.x[0])
        goal = here if self._goal is None else self._goal
        original = dict(self._ahead)
        lead = np.array([goal - here, 0.0, 0.0])
        self._ahead = {phase: rows + lead for phase, rows in original.items()}
        try:
            return super().move(measurement)
        finally:
            self._ahead = original
            steps = original[self.phase]
            self._goal = goal + float(steps[0, 0])


@contextmanager
def lateral(reference: float, distance: float) -> Iterator[None]:
    """Pass at another y_f: its reference, and its soft limit, from the obstacle's center line."""
    car_tuning._settings.cache_clear()  # it holds the limits
    with (
        mock.patch.object(supervisor, "MIN_LATERAL_DISTANCE", reference),
        mock.patch.object(car_tuning, "MIN_LATERAL_DISTANCE", distance),
    ):
        yield
    car_tuning._settings.cache_clear()


@contextmanager
def front_ends() -> Iterator[None]:
    """Measure the 10 m between front ends."""
    rules = "prefcal_env.envs.overtake.rules"
    with (
        mock.patch(f"{rules}.gap", lambda x_f, x_o: x_o - x_f),
        mock.patch(f"{rules}.clearance", lambda x_f, x_o: x_f - x_o),
    ):
        yield


READINGS: dict[str, Callable[[], AbstractContextManager[Any]]] = {
    "10 m between front ends, not bodies": front_ends,
    "reference of x_f that catches up": lambda: mock.patch.object(
        control, "Supervisor", CatchingUp
    ),
    "3 m between bodies, not center lines": lambda: lateral(3 + WIDTH, 3 + WIDTH),
    "y_ref = y_o while overtaking": lambda: lateral(0.0, 3.0),
    "no edge of the road": lambda: mock.patch("prefcal_env.envs.overtake.course.ROAD_MARGIN", 1e3),
}


def scene(args: argparse.Namespace) -> Table:
    """Compare other readings of the scene with ours."""
    shown = table("Readings of the scene", "what", "ours", "changed")
    ours = [drive(t) for t in bar([CAR, *random_cars(args)], "scene")]
    for words, reading in READINGS.items():
        shown.add_section()
        shown.add_row(words, "", "")
        with reading():
            changed = [drive(t) for t in bar([CAR, *random_cars(args)], words)]
        tell_drives(shown, ours[0], changed[0])
        shown.add_row("end, paper's θ", *(each[0].end.value for each in (ours, changed)))
        cut = [sum(e.end.interrupted for e in each[1:]) for each in (ours, changed)]
        shown.add_row("interrupted, random θ", *map(str, cut))
        tell_verdicts(shown, list(zip(ours[1:], changed[1:], strict=True)))
    return shown


def with_thresholds(factor: float) -> Lexicographic:
    """Return the car's calibrator with every just noticeable difference times `factor`."""
    judge = overtake.calibrators["synthetic"]()
    assert isinstance(judge, Lexicographic)
    scaled = [replace(c, just_noticeable=factor * c.just_noticeable) for c in judge.criteria]
    return Lexicographic(scaled, judge.first)


def thresholds(args: argparse.Namespace) -> Table:
    """Compare verdicts on random θ, and studies, with other just noticeable differences."""
    shown = table(
        "Just noticeable differences", "factor", "ties among random pairs", "verdicts reversed",
        "random θ better than the paper's", "studies better, tie, worse than the paper's",
        "ties in a study, median",
    )  # fmt: skip
    papers = drive(CAR)
    runs = [drive(t) for t in bar(random_cars(args), "random θ")]
    rng = np.random.default_rng(args.first)
    drawn = [rng.choice(len(runs), 2, replace=False) for _ in range(5000)]
    ours = [with_thresholds(1.0).prefer(runs[a], runs[b]) for a, b in drawn]
    for factor in (0.0, 0.5, 1.0, 2.0):
        judge = with_thresholds(factor)
        found = [judge.prefer(runs[a], runs[b]) for a, b in drawn]
        ties = np.mean([v is Preference.TIE for v in found])
        turned = np.mean([a * b < 0 for a, b in zip(ours, found, strict=True)])
        better = np.mean([judge.prefer(e, papers) is Preference.CHALLENGER for e in runs])
        counts, tied = studies(judge, papers, args, factor)
        shown.add_row(
            f"{factor:g}", f"{ties:.1%}", f"{turned:.1%}", f"{better:.1%}", counts, f"{tied:g}"
        )
    return shown


def studies(
    judge: Lexicographic, papers: Experiment, args: argparse.Namespace, factor: float
) -> tuple[str, float]:
    """Calibrate the car with each seed; return verdicts against the paper's θ, and ties.

    The final verdict uses our own thresholds, regardless of those in the study.
    """
    verdicts, ties = [], []
    for seed in bar(list(seeds(args)), f"studies, times {factor:g}"):
        agent = GLISp(overtake.space, n_max=50, seed=seed)
        steps = list(calibrate(agent, overtake.run, judge))
        verdicts.append(with_thresholds(1.0).prefer(overtake.run(agent.best), papers))
        ties.append(sum(step.answer.preference is Preference.TIE for step in steps))
    order = (Preference.CHALLENGER, Preference.TIE, Preference.INCUMBENT)
    counts = ", ".join(str(sum(v is p for v in verdicts)) for p in order)
    return counts, float(np.median(ties))


def ends(args: argparse.Namespace) -> Table:
    """Count how random runs end, to see what rules for interruptions and unsolved QPs change."""
    shown = table("Random θ", "what", "reactor", "car")
    react_runs = [react(t) for t in bar(random_theta(SPACE, args), "reactor")]
    car_runs = [drive(t) for t in bar(random_cars(args), "car")]
    runs = react_runs, car_runs
    shown.add_row("runs", *(str(len(r)) for r in runs))
    shown.add_row("interrupted", *(str(sum(e.end.interrupted for e in r)) for r in runs))
    unsolved = (sum(not e.solved.all() for e in r) for r in runs)
    shown.add_row("with an unsolved QP", *map(str, unsolved))
    peak = max(e.kpis["peak_temperature"] for e in react_runs)
    shown.add_row("peak temperature [K]", f"{peak:.1f}", "")
    never = sum(np.isinf(e.kpis["settling_time"]) for e in react_runs)
    shown.add_row("never settled", str(never), "")
    return shown
