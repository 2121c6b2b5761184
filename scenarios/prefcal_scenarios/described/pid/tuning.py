"""Tune the PIDs of a plant: a robust tuning in the middle, and the field's rules around it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.pid_law import LinearPIDs, Tuning
from prefcal_env.controllers.rules import robust, simc, ziegler_nichols
from prefcal_env.controllers.sampled import Sampled, sampled
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.plants.plant import Plant

from .design import PATIENCE, SAMPLES, Design, Single, Tuned, load_of
from .response import settling

N = 10.0
"""Filter of the derivative part: its largest gain relative to K_p."""
_FARTHEST = 6.0
"""Largest ratio of a rule's gain or integral time to those of the robust tuning."""


def tuned_pids(plant: Plant, found: Design) -> Design:
    """Return the design with tunings of its PIDs, and the loads and phases that suit them.

    Raises:
        ScenarioError: If no PID stabilizes the plant.
    """
    pairs = [_tuned(plant, found, loop) for loop in found.loops]
    loops, tunings = zip(*pairs, strict=True)
    return replace(found, loops=loops, tunings=tunings)


def _tuned(plant: Plant, found: Design, loop: Single) -> tuple[Single, Tuned]:
    i, j, T_s, channel, point = loop.output, loop.input, found.T_s, loop.channel, found.point
    model = sampled(found.J.part([i], [j]), T_s, found.delay[[i]][:, [j]])
    omega = np.geomspace(1e-4 * np.pi / T_s, 0.999 * np.pi / T_s, 400)
    step = abs(loop.target - loop.start)
    largest = max(channel.high - point.u[j], point.u[j] - channel.low) / step
    best = robust(model, omega, np.geomspace(2e-3, 0.25, 26) * np.pi / T_s, largest=largest)
    if best is None:
        raise ScenarioError(
            f"no PID from {channel.name!r} to {plant.outputs[i].name!r} was found that stabilizes "
            f"plant {plant.name!r} at its steady state {_named(plant.states, point.x)}: choose "
            "another output by its reference, or another kind of controller"
        )
    center = best[0]
    pid = LinearPIDs.of([center], N)
    try:
        time, peak = settling(lambda count: pid.responses(model, count), T_s)
    except FloatingPointError:
        time, peak = 200 * T_s, 0.0
    load = load_of(channel, peak, step)
    known = _known(loop, model, omega, center)
    return replace(loop, load=load, phase=PATIENCE * time), Tuned(center, known)


def _known(
    loop: Single, model: Sampled, omega: Float[np.ndarray, " m"], center: Tuning
) -> dict[str, Tuning]:
    """Return the tunings by rules of the field that apply, are stable and near `center`."""
    process, T_s = loop.process, model.T_s
    # Sampling delays by T_s / 2; without any dead time the rules would ask for infinite gains.
    half = replace(process, delay=max(process.delay + T_s / 2, SAMPLES / 2 * T_s))
    rules = {"SIMC": simc(half), "SIMC without T_d": simc(half, derivative=False)}
    if not process.unstable:
        rules["Ziegler-Nichols"] = ziegler_nichols(model, omega, float(np.sign(center.K_p)))
    return {
        name: t
        for name, t in rules.items()
        if t is not None and _near(t, center) and LinearPIDs.of([t], N).stable(model)[0]
    }


def _near(tuning: Tuning, center: Tuning) -> bool:
    """Return whether a range around `center` can hold `tuning` without becoming useless."""
    ratios = tuning.K_p / center.K_p, tuning.T_i / center.T_i
    # T_d starts at 0, so a longer range would move its middle.
    return tuning.T_d <= 2 * center.T_d and all(
        1 / _FARTHEST <= ratio <= _FARTHEST for ratio in ratios
    )


def _named(channels: tuple[Channel, ...], values: Float[np.ndarray, " n"]) -> str:
    pairs = zip(channels, values, strict=True)
    return ", ".join(f"{c.name} = {v:.4g} {c.unit}".rstrip() for c, v in pairs)
