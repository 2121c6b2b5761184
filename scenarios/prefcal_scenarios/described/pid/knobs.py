"""The knobs of the PIDs of a plant, with ranges around known tunings."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from prefcal_env.controllers.pid_law import Tuning
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import Channel
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.wording import did_you_mean

from .design import Design, Single, Tuned
from .kpis import names_of

_ABOUT = {
    "K_p": "Gain: a larger one reacts more strongly to errors and to noise.",
    "T_i": "Integral time: a shorter one removes lasting errors sooner, but may oscillate.",
    "T_d": "Derivative time: a longer one brakes more, and amplifies noise; 0 is off.",
    "b": "Share of the reference's step that acts at once; a small one starts gently.",
}
_REACH = 5.0
"""Least ratio of the end of a range to its middle."""


def space_of(
    design: Design, outputs: tuple[Channel, ...], time_unit: str, own: Sequence[Knob] = ()
) -> KnobSpace:
    """Return K_p, T_i, T_d and b of each loop; knobs of the same name in `own` replace them.

    Raises:
        ScenarioError: If an own knob has another name.
    """
    knobs: list[Knob] = []
    for k, (loop, tuned) in enumerate(zip(design.loops, design.tunings, strict=True)):
        knobs += _of_loop(loop, tuned, names_of(design, k), outputs[loop.output], time_unit)
    return replaced(knobs, own, "PID")


def replaced(knobs: Sequence[Knob], own: Sequence[Knob], kind: str) -> KnobSpace:
    """Return the space of `knobs`, where those of the same name in `own` replace them.

    Raises:
        ScenarioError: If an own knob has another name.
    """
    names = [knob.name for knob in knobs]
    given = {knob.name: knob for knob in own}
    for name in given:
        if name not in names:
            raise ScenarioError(
                f"no knob of this {kind} is called {name!r}.{did_you_mean(name, names)} "
                f"Expected one of {names}"
            )
    about = {knob.name: knob.about for knob in knobs}
    chosen = [given.get(knob.name, knob) for knob in knobs]
    return KnobSpace([replace(k, about=k.about or about[k.name]) for k in chosen])


def theta_of(space: KnobSpace, tunings: Sequence[Tuning]) -> Float[np.ndarray, " n"]:
    """Return θ of one tuning for each loop, with b = 1, moved into the ranges, shape (n,)."""
    values = [v for t in tunings for v in (abs(t.K_p), t.T_i, t.T_d, 1.0)]
    pairs = zip(space, values, strict=True)
    return np.array([knob.round(min(max(v, knob.low), knob.high)) for knob, v in pairs])


def _of_loop(loop: Single, tuned: Tuned, end: str, y: Channel, time_unit: str) -> list[Knob]:
    center, known = tuned.center, list(tuned.known.values())
    where = f"Loop {end[1:]}, {y.name} by {loop.channel.name}. " if end else ""
    unit = f"{loop.channel.unit or '1'}/{y.unit}" if y.unit else loop.channel.unit
    gain = _around(abs(center.K_p), [abs(t.K_p) for t in known])
    time = _around(center.T_i, [t.T_i for t in known])
    longest = _digits(2 * center.T_d)
    return [
        Knob(f"K_p{end}", *gain, unit, scale="log10", about=where + _ABOUT["K_p"]),
        Knob(f"T_i{end}", *time, time_unit, scale="log10", about=where + _ABOUT["T_i"]),
        Knob(f"T_d{end}", 0.0, longest, time_unit, about=where + _ABOUT["T_d"]),
        Knob(f"b{end}", 0.0, 1.0, about=where + _ABOUT["b"]),
    ]


def _around(middle: float, others: Sequence[float]) -> tuple[float, float]:
    """Return a range around `middle`, equally wide on both sides, that holds the others."""
    ratios = [max(o / middle, middle / o) for o in others]
    reach = max([_REACH, *(1.2 * r for r in ratios)])
    return _digits(middle / reach), _digits(middle * reach)


def _digits(value: float) -> float:
    return float(f"{value:.2g}")
