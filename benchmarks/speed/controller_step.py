"""Compare the time of a controller step with that of the bare QP solve called from Python.

    python benchmarks/speed/controller_step.py [--rounds 60]

Every round takes the steps of one closed-loop experiment with each backend, complete (linearize,
build, solve, check), and with the bare solver on the same QPs (set up, solve), in processor time.
The result is the ratio of each step to the bare solve of its round.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial

import numpy as np
import piqp
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_env.experiments.experiment import Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings, control_horizon
from prefcal_env.mpc.controller import BACKENDS
from prefcal_env.plants.cstr import CSTR, FEED

STDERR = Console(stderr=True)
THETAS = ((0.25, 26, -0.91), (0.31, 26, -1.79), (0.25, 40, -0.91), (0.5, 12, 1.0))


def controller(T_s: float, N_p: int, log_q: float, backend: str) -> LinearMPC:
    settings = MPCSettings(
        T_s=T_s,
        N_p=N_p,
        N_u=control_horizon(1 / 3, N_p),
        Q_y=np.diag([0.0, 1.0]),
        Q_du=[[10.0**log_q]],
        du_min=[-10.0],
        du_max=[10.0],
        backend=backend,
    )
    return LinearMPC(CSTR(), settings)


def closed_loop(mpc: LinearMPC) -> list[Measurement]:
    plant = mpc.plant
    x, u = CSTR().steady_state_at_concentration(8.56)
    measured = []
    for k in range(round(48 / mpc.T_s)):
        measured.append(Measurement(k * mpc.T_s, x, u, FEED, np.array([0.0, 2.0])))
        u = mpc.move(measured[-1]).u
        x = plant.hold(x, u, FEED, np.array([mpc.T_s]))[0]
    return measured


def seconds(function: Callable[[], None]) -> float:
    start = time.process_time()
    function()
    return time.process_time() - start


def compare(theta: tuple[float, int, float], rounds: int, label: str) -> np.ndarray:
    """Return µs of a step with each backend and of the bare solver, one row a round."""
    measured = closed_loop(controller(*theta, "piqp"))
    mpcs = [controller(*theta, backend) for backend in BACKENDS]
    qps = [mpcs[0].problem(m) for m in measured]
    arrays = [(q.P, q.q, None, None, np.asfortranarray(q.G), q.lower, q.upper) for q in qps]
    solver = piqp.DenseSolver()

    def whole(mpc: LinearMPC) -> None:
        for m in measured:
            mpc.move(m)

    def bare() -> None:
        for a in arrays:
            solver.setup(*a)
            solver.solve()

    jobs = [*(partial(whole, mpc) for mpc in mpcs), bare]
    for job in jobs:
        job()
    times = [[seconds(job) for job in jobs] for _ in track(range(rounds), label, console=STDERR)]
    return np.array(times) / len(measured) * 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=60)
    rounds = parser.parse_args().rounds
    columns = [f"{b} [µs] (times PIQP, quartiles)" for b in BACKENDS]
    table = Table("T_s [h]", "N_p", "log Q", "bare PIQP [µs]", *columns)
    for theta in THETAS:
        times = compare(theta, rounds, str(theta))
        *steps, solve = np.median(times, axis=0)
        ratios = np.percentile(times[:, :-1] / times[:, -1:], [25, 50, 75], axis=0).T
        cells = [
            f"{step:.1f} ({middle:.2f}, {low:.2f} to {high:.2f})"
            for step, (low, middle, high) in zip(steps, ratios, strict=True)
        ]
        table.add_row(*map(str, theta), f"{solve:.1f}", *cells)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
