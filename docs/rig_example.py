"""A rig that only you can run: `prefcal calibrate rig_example.py:oven` shows θ and waits."""

import numpy as np

from prefcal_agents import GLISp
from prefcal_env import Channel, Channels, HumanCalibrator, Knob, KnobSpace, Rig, calibrate
from prefcal_scenarios import KPI, Panel, Scenario

TEMPERATURE = Channel("temperature", "°C", high=230.0, target=200.0, band=2.0)
POWER = Channel("power", "%", low=0.0, high=100.0)
rig = Rig(
    channels=Channels(x=(TEMPERATURE,), u=(POWER,), y=(TEMPERATURE,), time_unit="min"),
    y_ref=(200.0,),
    kpis=lambda e: {"overshoot": float(max(e.x[:, 0].max() - 200.0, 0.0))},
    ranges={"temperature": (0.0, 400.0)},
    instructions="Let the oven cool below 30 °C. Set both gains on the controller's panel.\n"
    "Start the logger, then the heating; stop after 60 min.",
)
oven = Scenario(
    name="oven",
    title="Heating an oven",
    space=KnobSpace(
        [Knob("K_p", 0.5, 20, "%/K", scale="log10"), Knob("K_i", 0.01, 2, "%/(K min)", scale="log10")]
    ),
    run=rig,
    kpis=(KPI("overshoot", "overshoot", "K", at_most=5.0),),
    panels=(Panel("temperature"), Panel("power")),
)


def logged(theta):
    """Return the CSV of one run, in place of you, the oven and its logger."""
    K_p, K_i = theta
    T, total, lines = 25.0, 0.0, [rig.template().strip()]
    for t in np.arange(0.0, 60.0, 0.25):
        error = 200.0 - T
        power = float(np.clip(K_p * error + K_i * total, 0.0, 100.0))
        if 0.0 < power < 100.0:
            total += 0.25 * error
        lines.append(f"{t:g},{T:.3f},{power:.2f}")
        T += 0.25 * (0.2 * power - 0.05 * (T - 25.0))
    return "\n".join(lines)


def ask(a, b):
    """Compare two runs in place of you: less time outside the band is better."""
    outside = [int(np.sum(np.abs(e.x[:, 0] - 200.0) > 2.0)) for e in (a, b)]
    return int(np.sign(outside[0] - outside[1]))


if __name__ == "__main__":
    agent = GLISp(oven.space, n_init=5, n_max=15, seed=0)
    for done in calibrate(agent, lambda theta: rig.read(logged(theta), theta), HumanCalibrator(ask)):
        best = done.winner
    print("best", oven.space.named(agent.best), dict(best.kpis))
