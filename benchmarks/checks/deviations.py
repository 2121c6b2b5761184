"""Measure the effect of each deviation from the paper: the figures of docs/deviations.md.

    python benchmarks/checks/deviations.py                        # all parts: half an hour
    python benchmarks/checks/deviations.py --parts box --seeds 4  # a look at one

Every part does the same thing twice, in our way and in the paper's (or the way that the paper may
mean), on the same θ or the same seeds, and prints one table. All variations are in `deviating/`.

box         GLISp.paper in [0, 1] and in [-1, 1], studies in pairs
hypercube   a plain Latin hypercube as the start, and the best of five (maximin)
search      how far the next θ is from the minimum of the acquisition
candidates  ε of cross-validation from 0.1 to 10, and from 0.01 to 100
surrogate   φ inverse quadratic, Gaussian and thin plate spline; λ, and a thousand times that
resolution  knobs with a step, and knobs of any value
glis        α and δ of GLIS, ours and those of its author
outputs     y_1 ... y_Np in the cost, and y_0 ... y_Np-1
moves       N_u free moves, and N_u + 1
first       limits from the first input on, and from the second
slack       Q_ε of the car, 10 and 1e5
settling    the rates below which the reactor has settled
logarithm   base 10 and base e
heat        the sign of the heat of reaction
start       the steady state with C_A = 8.56, and that at the table's T_c0
scene       overtaking: where 10 m and 3 m are measured from, both references, the edge of the road
thresholds  just noticeable differences of the car's criteria, times 0 to 2
ends        interrupted runs and unsolved QPs at random θ
"""

import argparse
import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

import time
from collections.abc import Callable

from deviating import agents, cases, control
from deviating.common import ERRORS
from rich.console import Console
from rich.table import Table

Part = Callable[[argparse.Namespace], Table]
PARTS: dict[str, Part] = {
    part.__name__: part
    for part in (
        agents.box, agents.hypercube, agents.search, agents.candidates, agents.surrogate,
        agents.resolution, agents.glis, control.outputs, control.moves, control.first,
        control.slack, cases.settling, cases.logarithm, cases.heat, cases.start, cases.scene,
        cases.thresholds, cases.ends,
    )
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--seeds", type=int, default=12, help="seeds of studies")
    parser.add_argument("--first", type=int, default=300, help="first seed, also of random θ")
    parser.add_argument("--samples", type=int, default=200, help="random θ")
    args = parser.parse_args()
    width = None if sys.stdout.isatty() else 120
    console = Console(markup=False, width=width)  # no markup: units stand in brackets
    for name in args.parts:
        began = time.perf_counter()
        console.print(PARTS[name](args))
        ERRORS.print(f"{name}: {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
