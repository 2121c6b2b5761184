"""Measure the tuning in the middle of a PID's ranges on plants of the field's standard kinds.

    python benchmarks/stress/middle_pids.py         # 50 plants, 300 random tunings each: minutes
    python benchmarks/stress/middle_pids.py --random 20 --only swing

The batch follows Åström and Hägglund, Advanced PID Control (2006): equal and spread lags, lags with dead
time, integrators, inverse responses, oscillating and unstable plants, some of them sampled; and the tank of
a starter, without its dead time. Prints a row for each, and what the page on PIDs says of all.
"""

import argparse
from collections.abc import Iterator
from functools import reduce

import numpy as np
from scipy import signal

from prefcal_bench.results.words import markdown
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.function_plant import FunctionPlant
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.described.pid_scenario import pid_scenario

Coefficients = list[float]


def lags(*times: float) -> Coefficients:
    """Return the product of (T s + 1)."""
    factors = [[time, 1.0] for time in times]
    return [float(each) for each in reduce(np.polymul, factors, np.ones(1))]


def times_s(polynomial: Coefficients) -> Coefficients:
    """Return s times a polynomial: an integrator in the denominator."""
    return [*polynomial, 0.0]


def continuous() -> Iterator[tuple[str, Coefficients, Coefficients, float, float]]:
    """Yield name, numerator, denominator, dead time and largest input of each continuous plant."""
    free = np.inf
    yield from ((f"{n} equal lags", [1.0], lags(*[1.0] * n), 0.0, free) for n in (1, 2, 3, 4, 8))
    yield from ((f"4 lags, {a}", [1.0], lags(1, a, a * a, a**3), 0.0, free) for a in (0.1, 0.2, 0.5, 0.7))
    yield from ((f"lag {T}, dead time", [1.0], lags(T), 1.0, free) for T in (0.02, 0.2, 1, 10))
    yield from ((f"2 lags {T}, dead time", [1.0], lags(T, T), 1.0, free) for T in (0.1, 1, 10))
    yield "2 lags 10, 2", [1.0], lags(10, 2), 0.0, free
    yield "2 lags 10, 2, limited", [0.8], lags(10, 2), 0.0, 50.0
    yield "3 lags 10, 2, 0.3, limited", [0.8], lags(10, 2, 0.3), 0.0, 50.0
    yield from ((f"integrator, lag {T}", [1.0], times_s(lags(T)), 0.0, free) for T in (0.1, 1, 5))
    yield "integrator, 2 lags", [1.0], times_s(lags(1, 0.5)), 0.0, free
    yield "integrator, limited", [0.02], [1.0, 0.0], 0.0, 50.0
    yield "integrator, lag 3, limited", [0.02], times_s(lags(3)), 0.0, 50.0
    yield "integrator, dead time", [1.0], [1.0, 0.0], 1.0, free
    yield "integrator, lag 2, dead time", [1.0], times_s(lags(2)), 0.5, free
    yield "drive, limited", [2.0], times_s(lags(0.5)), 0.0, 2.0
    yield from ((f"inverse response {a}", [-a, 1.0], lags(1, 1, 1), 0.0, free) for a in (0.2, 0.5, 1, 2))
    yield from ((f"swing {z}", [1.0], [1.0, 2 * z, 1.0], 0.0, free) for z in (0.2, 0.4, 0.6, 0.8))
    yield "swing 0.3, dead time", [1.0], [1.0, 0.6, 1.0], 0.5, free
    yield "swing 0.5, lag", [1.0], [0.2, 1.2, 1.2, 1.0], 0.0, free
    yield "lag and fast swing", [9.0], [1.0, 1.4, 9.4, 9.0], 0.0, free
    yield "unstable, dead time", [1.0], [2.0, -1.0], 0.2, free
    yield "unstable, lag", [1.0], [0.1, 0.9, -1.0], 0.0, free
    yield "double integrator", [1.0], [1.0, 0.0, 0.0], 0.0, free
    yield "zero 3, lags 5, 2, 1", [3.0, 1.0], lags(5, 2, 1), 0.0, free
    yield "fast and slow", [1.0], lags(1, 0.1, 0.01, 0.001), 0.0, free


def plants() -> Iterator[tuple[str, Plant]]:
    """Yield all plants by name."""
    for name, numerator, denominator, delay, most in continuous():
        inputs = [Channel("u", low=-most, high=most)]
        yield name, Plant.of((numerator, denominator), inputs=inputs, outputs=["y"], delay=delay)
    sampled = [("2 lags", lags(3, 1), 0.2), ("integrator, lag", [1.0, 1.0, 0.0], 0.2)]
    for name, denominator, dt in [*sampled, ("4 lags", lags(1, 1, 1, 1), 0.5), ("swing", [1, 0.8, 1], 0.2)]:
        b, a, _ = signal.cont2discrete(([1.0], denominator), dt)
        system = signal.dlti(np.trim_zeros(np.round(np.ravel(b), 12), "f"), a, dt=dt)
        yield f"sampled: {name}", Plant.of(system, inputs=[Channel("u")], outputs=["y"])
    b, a, _ = signal.cont2discrete(([1.0], [2.0, 1.0]), 0.5)
    late = signal.dlti(np.ravel(b)[1:], [*a, *[0.0] * 6], dt=0.5)
    yield "sampled: lag, six samples", Plant.of(late, inputs=[Channel("u")], outputs=["y"])
    level, valve = Channel("level", "m", target=2.0), Channel("valve", "%", low=0, high=100)
    yield (
        "tank",
        FunctionPlant(
            lambda x, u, d: [0.004 * u[0] - 0.1 * max(x[0], 0.0) ** 0.5], states=[level], inputs=[valve]
        ),
    )


def measure(plant: Plant, count: int) -> dict[str, float]:
    """Return what the middle tuning does, and shares of random tunings in percent."""
    made, random = pid_scenario(plant), np.random.default_rng(1)
    middle = made.run(np.array(made.references["MIGO"])).kpis
    found = [made.run(made.space.decode(random.random(len(made.space)))).kpis for _ in range(count)]
    settles = [np.isfinite([each["settling_time"], each["recovery"]]).all() for each in found]
    stable = [np.isfinite(each["M_s"]) for each in found]
    shares = {"stable [%]": 100 * np.mean(stable), "settle [%]": 100 * np.mean(settles)}
    named = {"overshoot [%]": middle["overshoot"], "M_s": middle["M_s"], "settling": middle["settling_time"]}
    return {name: float(value) for name, value in {**named, **shares}.items()}


def main() -> None:
    """Print a row for each plant, then medians and ends."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--random", type=int, default=300)
    parser.add_argument("--only", default="", metavar="TEXT")
    asked = parser.parse_args()
    rows = {name: measure(plant, asked.random) for name, plant in plants() if asked.only in name}
    heads = [*next(iter(rows.values()))]
    print(
        "\n".join(
            markdown(["plant", *heads], [[n, *(f"{v:.3g}" for v in r.values())] for n, r in rows.items()])
        )
    )
    for head in heads:
        values = [row[head] for row in rows.values()]
        print(f"{head}: {min(values):.3g} to {max(values):.3g}, median {np.median(values):.3g}")


if __name__ == "__main__":
    main()
