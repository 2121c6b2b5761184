"""Measure what the estimator of docs/mpc.md is worth: plants that differ from the model, and noise.

    python benchmarks/checks/offset_free.py     # a few seconds

The reactor runs at the paper's θ by preferences with settling switched off: an experiment that
stops once it has settled would not show the remaining offset. Prints Markdown.
"""

import argparse
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from prefcal_bench.results.words import markdown
from prefcal_env.envs.closed_loop import rollout
from prefcal_env.envs.cstr import cstr_task
from prefcal_env.envs.plant_env import PlantEnv
from prefcal_env.envs.task import never
from prefcal_env.experiments.experiment import Controller, Measurement
from prefcal_env.mpc import EstimatingMPC
from prefcal_env.plants import CSTR
from prefcal_env.plants.cstr import FEED, CSTRParams
from prefcal_scenarios.cases import cstr as reactor

THETA = np.array([0.31, 26.0, -1.79])
NOISE = np.array([0.3, 0.03])
PLANTS: Mapping[str, CSTRParams] = {
    "k_0 5 % higher": CSTRParams(k_0=1.05 * CSTRParams().k_0),
    "US/V 5 % higher": CSTRParams(US_V=1.05 * CSTRParams().US_V),
    "US/V 5 % lower": CSTRParams(US_V=0.95 * CSTRParams().US_V),
}


def final_concentration(params: CSTRParams, controller: Controller) -> float:
    """Return C_A after 48 h of a plant that differs from the controller's model, kgmol/m³."""
    plant = CSTR(params)
    task = replace(cstr_task(plant), settled=never)
    return float(rollout(PlantEnv(plant, task), controller, THETA).x[-1, 1])


def offsets() -> dict[str, tuple[float, float]]:
    """Return the final C_A of each plant, without and with the estimator."""
    return {
        name: (
            final_concentration(params, reactor.controller(THETA)),
            final_concentration(params, reactor.controller(THETA, reactor.ESTIMATOR)),
        )
        for name, params in PLANTS.items()
    }


def noise_left() -> tuple[float, float]:
    """Return the RMS error of the estimated T and C_A, as a share of the measurement's."""
    rng, plant = np.random.default_rng(0), CSTR()
    controller = reactor.controller(THETA, reactor.ESTIMATOR)
    assert isinstance(controller, EstimatingMPC)
    task = cstr_task(plant)
    x, u = task.x0, task.u0
    errors, measured = [], []
    for k in range(150):
        noise = NOISE * rng.standard_normal(2)
        u = controller.move(Measurement(k * THETA[0], x + noise, u, FEED, task.reference(0.0))).u
        estimate = controller.estimator.estimate.mean
        errors.append(estimate[:2] + estimate[2:] - x)
        measured.append(noise)
        x = plant.hold(x, u, FEED, np.array([THETA[0]]))[0]
    shares = np.sqrt(np.mean(np.square(errors), axis=0) / np.mean(np.square(measured), axis=0))
    return float(shares[0]), float(shares[1])


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    rows = [[name, *(f"{C_A:.3f}" for C_A in pair)] for name, pair in offsets().items()]
    print(*markdown(["what differs in the plant", "MPC alone", "offset-free"], rows), sep="\n")
    T, C_A = noise_left()
    print(f"\nError of the estimate / of the measurement: T {T:.2f}, C_A {C_A:.2f}")


if __name__ == "__main__":
    main()
