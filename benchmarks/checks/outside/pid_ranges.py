"""How good are the ranges that `prefcal calibrate pid` finds? Random tunings of 19 plants.

For each plant: the sensitivity peak of the tuning in the middle, and the shares of random tunings
that are stable in the linearized loop, and that settle after the step and recover from the load.

    python benchmarks/checks/outside/pid_ranges.py --count 100
"""

import argparse

import numpy as np

from prefcal_env import Channel, End
from prefcal_env.plants.plant import Plant
from prefcal_scenarios.own.pid_scenario import pid_scenario

VALVE = Channel("valve", "%", 0, 100)
PLANTS = {
    "development": {
        "lag with dead time": Plant.of(([0.8], [20, 1]), delay=6.0, inputs=[VALVE], outputs=["T"]),
        "dead time": Plant.of(([1.0], [0.1, 1]), delay=5.0),
        "integrator": Plant.of(([0.05], [1, 0]), delay=2.0),
        "double lag": Plant.of(([1.0], [1, 2, 1])),
        "oscillating": Plant.of(([1.0], [1, 0.2, 1])),
        "unstable": Plant.of(([1.0], [5, -1]), delay=0.4),
        "non-minimum phase": Plant.of(([-1.0, 1.0], [1, 3, 3, 1])),
    },
    "other": {
        "balanced": Plant.of(([2.0], [3, 1]), delay=3.0),
        "dead time 2": Plant.of(([-4.0], [1, 1]), delay=20.0),
        "three lags": Plant.of(([1.0], np.poly([-1, -0.5, -0.1]))),
        "integrator with lag": Plant.of(([1.0], [5, 1, 0]), delay=0.5),
        "slow lag": Plant.of(([1.0], [100, 1]), delay=1.0),
        "negative gain": Plant.of(([-2.0], [10, 1]), delay=1.0),
    },
    "fresh": {
        "dead time 3": Plant.of(([2.0], [2, 1]), delay=15.0),
        "four lags": Plant.of(([3.0], np.poly([-1] * 4))),
        "two-mass": Plant.of(([2.0], [1, 0.5, 4])),
        "fast unstable": Plant.of(([3.0], [1, -1]), delay=0.15),
        "lag and zero": Plant.of(([-4.0, 2.0], [50, 15, 1]), delay=1.0),
        "integrator 2": Plant.of(([0.3], [1, 0]), delay=10.0),
    },
}
"""Plants that the ranges were developed on, looked at meanwhile, and run once at the end."""


def shares(plant, count, seed=5):
    """Return the middle's sensitivity peak, and the shares that are stable and that settle."""
    scenario = pid_scenario(plant)
    space, run = scenario.space, scenario.run
    drawn = [space.decode(z) for z in np.random.default_rng(seed).random((count, len(space)))]
    stable = np.mean([np.isfinite(run.kpis.sensitivity(theta)) for theta in drawn])
    good = np.mean([_settles(run(theta)) for theta in drawn])
    middle = run(space.decode(np.full(len(space), 0.5)))
    return middle.kpis["M_s"], stable, good


def _settles(experiment):
    kpis = experiment.kpis
    done = experiment.end is End.TIME_UP
    return done and np.isfinite([kpis["settling_time"], kpis["recovery"]]).all()


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="random tunings a plant")
    count = parser.parse_args().count
    for kind, plants in PLANTS.items():
        for name, plant in plants.items():
            middle, stable, good = shares(plant, count)
            print(
                f"{kind:12} {name:20} middle M_s {middle:.2f}, stable {stable:.0%}, "
                f"settle and recover {good:.0%}",
                flush=True,
            )


if __name__ == "__main__":
    main()
