"""Say what happens in an experiment with PIDs, and what was chosen."""

from prefcal_env.plants.plant import Plant

from .design import Design


def brief_of(plant: Plant, design: Design) -> str:
    """Return the brief: steps, loads, what was assumed, and what to judge by."""
    time, phase = plant.time_unit, design.phase
    said = []
    for k, loop in enumerate(design.loops):
        y = plant.outputs[loop.output]
        when = "at the start" if not k else f"at {k * phase:.4g} {time}"
        said.append(
            f"The reference of {y.name} steps from {loop.start:.4g} to "
            f"{_with(f'{loop.target:.4g}', y.unit)} {when}."
        )
    loads = ", ".join(
        f"{_with(f'{loop.load:g}', loop.channel.unit)} on {loop.channel.name}"
        for loop in design.loops
    )
    said.append(f"From {len(design.loops) * phase:.4g} {time} on a load acts: {loads}.")
    said.append(f"The controller moves every {design.T_s:g} {time}.")
    for loop in design.loops:
        c = plant.inputs[loop.input]
        if (c.low, c.high) != (loop.channel.low, loop.channel.high):
            limits = _with(f"{loop.channel.low:g} to {loop.channel.high:g}", c.unit)
            said.append(f"The plant does not limit {c.name}; {limits} is assumed.")
    said.append(
        "Good control reaches the reference soon, without overshoot or oscillation, rejects the "
        "load, and spares the actuator. What counts more is up to you."
    )
    return " ".join(said)


def _with(number: str, unit: str) -> str:
    return f"{number} {unit}".rstrip()
