"""Compare the time of a controller step with that of the bare QP solve called from Python.

    python benchmarks/speed/controller_step.py [--rounds 200] [--backend piqp]

Every round takes the steps of one closed-loop experiment twice: complete (linearize, build, solve,
check), and with the bare solver on the same QPs (set up, solve). The result is the ratio of each
pair.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
import piqp
from rich.console import Console
from rich.progress import track
from rich.table import Table

from prefcal_env.experiments.control import Measurement
from prefcal_env.mpc import LinearMPC, MPCSettings, control_horizon
from prefcal_env.plants.cstr import CSTR, FEED

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
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def compare(mpc: LinearMPC, rounds: int, label: str) -> tuple[float, float, np.ndarray]:
    measured = closed_loop(mpc)
    qps = [next(mpc.problems(m)) for m in measured]
    arrays = [(q.P, q.q, None, None, np.asfortranarray(q.G), q.lower, q.upper) for q in qps]
    solver = piqp.DenseSolver()

    def whole() -> None:
        for m in measured:
            mpc.move(m)

    def bare() -> None:
        for a in arrays:
            solver.setup(*a)
            solver.solve()

    whole(), bare()
    times = np.array([(seconds(whole), seconds(bare)) for _ in track(range(rounds), label)])
    step, solve = np.median(times, axis=0) / len(measured) * 1e6
    return float(step), float(solve), times[:, 0] / times[:, 1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--backend", default="piqp", choices=("piqp", "daqp"))
    arguments = parser.parse_args()
    table = Table("T_s [h]", "N_p", "log Q", "step [µs]", "bare PIQP [µs]", "ratio (quartiles)")
    for theta in THETAS:
        step, solve, ratio = compare(
            controller(*theta, arguments.backend), arguments.rounds, str(theta)
        )
        low, middle, high = np.percentile(ratio, [25, 50, 75])
        ratios = f"{middle:.2f} ({low:.2f} to {high:.2f})"
        table.add_row(*map(str, theta), f"{step:.1f}", f"{solve:.1f}", ratios)
    Console().print(table)


if __name__ == "__main__":
    main()
