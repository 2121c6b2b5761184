"""Records of the toy as a rig would log them."""

import numpy as np

from prefcal_env.experiments.experiment import Channel, Channels

CHANNELS = Channels(
    x=(Channel("level <h>", "m", target=2.0, band=0.06),),
    u=(Channel("valve", "%"),),
    y=(Channel("level <h>", "m"),),
    time_unit="h",
)


def record_of_toy(rows: int = 30) -> str:
    """A CSV of a level that settles."""
    lines = ["time [h],level <h> [m],valve [%]"]
    for t in np.arange(rows) * 0.5:
        lines.append(f"{t:g},{2 + 6 * np.exp(-0.3 * t):.4f},{5 * np.exp(-0.3 * t):.3f}")
    return "\n".join(lines) + "\n"


def csv(highest: float) -> bytes:
    """A record of the toy whose highest level is so much."""
    return record_of_toy().replace("0,8.0000,", f"0,{highest:.4f},").encode()
