"""Whether to go on: who else is unbeaten, and which knobs are at the end of their range."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor
from pathlib import Path

import numpy as np
from jaxtyping import Float

from prefcal_agents import Advice
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.study import State
from prefcal_env.study.locations import data_folder
from prefcal_scenarios.scenario import is_built_in

_AT_END = 0.01
"""Share of what is searched of a knob, in its scale, that counts as its end."""
_WIDER = 0.25
"""Share of a range by which it is widened in the command."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """What to do next, for people.

    Args:
        advice: Whether to go on, one sentence.
        ends: Which knobs are at the end of their range, one sentence; empty for none.
        command: The command that widens those ranges; empty without a study file.
        unbeaten: Which other experiments never lost, one sentence; empty for none.
    """

    advice: str
    ends: str = ""
    command: str = ""
    unbeaten: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is said, apart from the command."""
        return tuple(part for part in (self.unbeaten, self.advice, self.ends) if part)

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it, the command last."""
        return (*self.sentences, self.command) if self.command else self.sentences

    @property
    def text(self) -> str:
        """All of it in one line."""
        return " ".join(self.lines)


def others_unbeaten(indices: Sequence[int]) -> str:
    """Return a sentence on the experiments that never lost beside the best, which is the first.

    Nobody can say which of them is better: that was asked, and they could not be told apart.
    """
    if len(indices) < 2:
        return ""
    best, *others = (str(index + 1) for index in indices)
    *most, last = others
    named = f"experiments {', '.join(most)} and {last} were" if most else f"experiment {last} was"
    return f"Beside experiment {best}, {named} never beaten: no answer says which one is better."


def outlook(
    advice: Advice | None, best: Float[np.ndarray, " n"] | None, space: KnobSpace, place: str,
    state: State,
) -> Outlook | None:  # fmt: skip
    """The outlook of a study; None while too little is known.

    Args:
        advice: What another ten experiments would bring.
        best: The best θ, physical, shape (n,).
        space: The knobs, and what is searched of them.
        place: Path of the study file; ":memory:" has none.
        state: What the study file says.
    """
    if advice is None or best is None:
        return None
    ends = at_end(space, best)
    if not ends:
        return Outlook(advice.text)
    names = [knob.name for knob, _ in ends]
    *most, last = names
    listed = " and ".join([", ".join(most), last] if most else [last])
    verb, whose = ("are", "their ranges") if most else ("is", "its range")
    sentence = f"{listed} of the best θ {verb} at the end of {whose}"
    within = f"Within the present ranges, {advice.text[0].lower()}{advice.text[1:]}"
    if place == ":memory:":
        return Outlook(within, f"{sentence}; if your plant allows it, widen {whose}.")
    return Outlook(
        within,
        f"{sentence}; if your plant allows it, widen {whose}, for example with:",
        _command(ends, space, place, str(state.configuration["scenario"])),
    )


def at_end(space: KnobSpace, theta: Float[np.ndarray, " n"]) -> list[tuple[Knob, bool]]:
    """The knobs of θ at an end of what is searched, and whether it is the upper end.

    Frozen ones are where they were put.
    """
    found = []
    for knob, (low, high), value in zip(space, space.within, theta.tolist(), strict=True):
        start, end, here = knob.encode(low), knob.encode(high), knob.encode(value)
        share = (here - start) / (end - start) if end > start else 0.5
        if not _AT_END < share < 1 - _AT_END:
            found.append((knob, share >= 1 - _AT_END))
    return found


def _command(ends: list[tuple[Knob, bool]], space: KnobSpace, place: str, scenario: str) -> str:
    words = ["prefcal", "studies", "respace", study_name(place)]
    if not is_built_in(scenario):
        words += ["--scenario", scenario]
    within = dict(zip(space.names, space.within, strict=True))
    for knob, upper in ends:
        low, high = within[knob.name]
        low, high = (low, _beyond(knob, low, high)) if upper else (_beyond(knob, high, low), high)
        words += ["--knob", f"{knob.name.replace(' ', '_')}={low:g}:{high:g}"]
    return shlex.join(words)


def _beyond(knob: Knob, other: float, end: float) -> float:
    """A value beyond `end`, seen from the `other` end; positive numbers stay positive."""
    if knob.scale == "log10":
        return float(f"{end * (end / other) ** _WIDER:.3g}")
    beyond = end + _WIDER * (end - other)
    if end > 0 >= beyond:
        beyond = end / 2
    if knob.integer:
        return float(np.ceil(beyond) if end > other else max(floor(beyond), min(end, 1)))
    return float(f"{beyond:.3g}")


def study_name(place: str) -> str:
    """How a command calls the study file at `place`."""
    path = Path(place)
    return path.stem if path.parent == data_folder() else place
