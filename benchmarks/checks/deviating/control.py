"""Compare our MPC with eq. MPC and eq. MPC_constraints as printed: the same θ both ways."""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from unittest import mock

import numpy as np
from rich.table import Table

from prefcal_env import KnobSpace
from prefcal_env.envs.cstr import cstr_env
from prefcal_env.envs.overtake import Course
from prefcal_env.envs.overtake.road.rules import Phase
from prefcal_env.experiments.control import Controller, Measurement, Move
from prefcal_env.experiments.experiment import Experiment
from prefcal_env.experiments.rollout import rollout
from prefcal_env.mpc import LinearMPC, MPCSettings
from prefcal_env.mpc.kernels import step
from prefcal_env.plants import CSTR
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.cases.cstr import controller as cstr_tuning
from prefcal_scenarios.cases.cstr.kpis import compute_kpis as cstr_kpis
from prefcal_scenarios.cases.cstr.kpis import performance_index
from prefcal_scenarios.cases.overtake import controller as car_tuning
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.kpis import compute_kpis as car_kpis
from prefcal_scenarios.cases.overtake.supervisor import Supervisor

from .common import AUTOMATED, CAR, PREFERRED, bar, lowest, quantile, table, two

Change = Callable[[MPCSettings], MPCSettings]


def same(settings: MPCSettings) -> MPCSettings:
    return settings


def up_to_last_but_one(settings: MPCSettings) -> MPCSettings:
    """Weigh y_0 ... y_Np-1: without D this is a horizon one step shorter with the same inputs.

    The soft limits of the car's last step are dropped, too.
    """
    N_p = settings.N_p - 1
    return replace(settings, N_p=N_p, N_u=min(settings.N_u, N_p))


def one_more(settings: MPCSettings) -> MPCSettings:
    """Leave u_Nu free as well, as the last line of eq. MPC_constraints reads."""
    return replace(settings, N_u=min(settings.N_u + 1, settings.N_p))


def react(theta: Sequence[float], change: Change = same, base: float = 10.0) -> Experiment:
    """Run one experiment of the reactor."""
    T_s, N_p, log_Q = theta
    at = np.array([T_s, N_p, log_Q * np.log10(base)])
    driver: Controller = LinearMPC(CSTR(), change(cstr_tuning.mpc_settings(at)))
    return rollout(cstr_env(), driver, np.array(theta), kpis=cstr_kpis)


def index(theta: Sequence[float] | np.ndarray, change: Change = same, base: float = 10.0) -> float:
    return performance_index(react(np.asarray(theta).tolist(), change, base))


def drive(
    theta: Sequence[float], change: Change = same, fixed: car_tuning.Fixed = car_tuning.PAPER,
    base: float = 10.0,
) -> Experiment:  # fmt: skip
    """Run one overtaking."""
    at = np.array(theta, dtype=float)
    at[3:] *= np.log10(base)
    tuned = {p: change(car_tuning.mpc_settings(at, p, fixed)) for p in Phase}
    driver = Supervisor(tuned)
    return rollout(Course(), driver, np.array(theta, dtype=float), kpis=car_kpis)


def random_theta(space: KnobSpace, args: argparse.Namespace) -> list[list[float]]:
    """Return seeded physical θ of the box."""
    n = len(space)
    draws = [np.random.default_rng([args.first, i]).random(n) for i in range(args.samples)]
    return [space.decode(z).tolist() for z in draws]


def horizons(title: str, change: Change, args: argparse.Namespace) -> Table:
    """Compare the same θ with the printed horizons, in both case studies."""
    shown = table(title, "what", "ours", "changed")
    for name, theta in (("automated", AUTOMATED), ("preferences", PREFERRED)):
        shown.add_row(f"index, paper's θ ({name})", *two(index(theta), index(theta, change), ".4f"))
    grid = np.arange(-2.5, 1.01, 0.05)
    both = [[index((0.25, 26, q), c) for q in grid] for c in (same, change)]
    shown.add_row("lowest index over log Q", *(lowest(grid, costs) for costs in both))
    thetas = random_theta(cstr_tuning.SPACE, args)
    costs = np.array([(index(t), index(t, change)) for t in bar(thetas, title)])
    shown.add_row(f"median index, {len(costs)} random θ", *two(*np.median(costs, axis=0), ".3f"))
    apart = np.abs(costs[:, 1] - costs[:, 0])
    shown.add_row("difference, median and 95 %", "", " ".join(f"{q:.3f}" for q in quantile(apart)))
    shown.add_row("rank correlation", "", f"{rank_correlation(*costs.T):.3f}")
    tell_drives(shown, drive(CAR), drive(CAR, change))
    tell_verdicts(shown, [(drive(t), drive(t, change)) for t in bar(random_cars(args), title)])
    return shown


def random_cars(args: argparse.Namespace) -> list[list[float]]:
    return random_theta(overtake.space, args)


def tell_drives(shown: Table, ours: Experiment, changed: Experiment) -> None:
    """Add the results of the paper's θ for the car."""
    for kpi, words, digits in (
        ("path_peak", "largest y_f [m], paper's θ", ".3f"),
        ("lateral_distance", "lateral distance [m], paper's θ", ".3f"),
        ("lateral_acceleration", "lateral acceleration [m/s²], paper's θ", ".1f"),
    ):
        shown.add_row(words, *two(ours.kpis[kpi], changed.kpis[kpi], digits))


def tell_verdicts(shown: Table, runs: Sequence[tuple[Experiment, Experiment]]) -> None:
    """Add the calibrator's verdicts on the changed run against ours of the same θ."""
    judge = overtake.calibrators["synthetic"]()
    found = [judge.prefer(changed, ours) for ours, changed in runs]
    counts = [sum(v is p for v in found) for p in (Preference.CHALLENGER, Preference.TIE)]
    shown.add_row(
        f"changed run of {len(runs)} random θ is better, a tie, worse", "",
        f"{counts[0]}, {counts[1]}, {len(runs) - sum(counts)}",
    )  # fmt: skip
    for kpi in ("path_peak", "lateral_acceleration"):
        each = np.array([[e.kpis[kpi] for e in pair] for pair in runs])
        shown.add_row(f"median {kpi}, random θ", *two(*np.median(each, axis=0), ".2f"))
    near = [sum(pair[i].kpis["lateral_distance"] < 2.9 for pair in runs) for i in (0, 1)]
    shown.add_row("below 2.9 m beside the obstacle", *map(str, near))


def rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    ranks = [np.argsort(np.argsort(values)) for values in (a, b)]
    return float(np.corrcoef(*ranks)[0, 1])


def outputs(args: argparse.Namespace) -> Table:
    return horizons("y_0 ... y_Np-1 in the cost", up_to_last_but_one, args)


def moves(args: argparse.Namespace) -> Table:
    return horizons("N_u + 1 free moves", one_more, args)


def first_unlimited(mpc: LinearMPC, m: Measurement) -> Move:
    """Decide within the limits of k = 1 ... N_p, as printed: only the plant limits the first input.

    In place of `LinearMPC.move`.
    """
    n_u, data = len(m.u), mpc._data(m)
    how, _, _, *arrays = step.decide(*data, *mpc._problem, mpc._solver)
    for U, qp in mpc._both(how, arrays, data):
        low, high = qp.lower.copy(), qp.upper.copy()
        low[:n_u], high[:n_u] = -np.inf, np.inf
        solution = mpc._backend.solve(replace(qp, lower=low, upper=high))
        if solution.solved:
            v = solution.z[: U.shape[2] - 1]
            return Move(m.u + U[0] @ np.append(v, 1.0), solution.iterations)
    return Move(m.u, solved=False)


def first(args: argparse.Namespace) -> Table:
    shown = table("No limit on the first input and move", "what", "ours", "changed")
    thetas = random_theta(cstr_tuning.SPACE, args)
    cars = [CAR, *random_cars(args)]
    runs = [[react(t) for t in bar([AUTOMATED, PREFERRED, *thetas], "limited")]]
    drives = [[drive(t) for t in bar(cars, "limited")]]
    with mock.patch.object(LinearMPC, "move", first_unlimited):
        runs.append([react(t) for t in bar([AUTOMATED, PREFERRED, *thetas], "unlimited")])
        drives.append([drive(t) for t in bar(cars, "unlimited")])
    for i, name in enumerate(("automated", "preferences")):
        costs = [performance_index(each[i]) for each in runs]
        shown.add_row(f"index, paper's θ ({name})", *two(costs[0], costs[1], ".4f"))
    moves_ = [[e.kpis["largest_move"] for e in each[2:]] for each in runs]
    words = f"random θ of {len(thetas)} with a move above 10 K, largest [K]"
    cells = [f"{sum(m > 10 + 1e-6 for m in each)}, {max(each):.1f}" for each in moves_]
    shown.add_row(words, *cells)
    tell_drives(shown, drives[0][0], drives[1][0])
    tell_verdicts(shown, list(zip(drives[0][1:], drives[1][1:], strict=True)))
    return shown


def slack(args: argparse.Namespace) -> Table:
    """Compare values of Q_ε of the car."""
    shown = table("Q_ε of the car", "what", "10", "1e5")
    stiff = replace(car_tuning.PAPER, Q_eps=1e5)
    tell_drives(shown, drive(CAR), drive(CAR, fixed=stiff))
    both = [(drive(t), drive(t, fixed=stiff)) for t in bar(random_cars(args), "Q_ε")]
    tell_verdicts(shown, both)
    return shown
