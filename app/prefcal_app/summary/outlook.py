"""Advise whether to continue: unbeaten experiments, and knobs at the end of their range."""

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import floor
from pathlib import Path

import numpy as np
from jaxtyping import Float

from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.history import History
from prefcal_env.study import State
from prefcal_env.study.locations import data_folder
from prefcal_scenarios.names import is_built_in

_AT_END = 0.02
"""Share of a knob's searched range, in its scale, that counts as its end."""
_INWARD = 0.1
"""Distance in the cube over which a learned cost tells whether it falls toward an end."""
_WIDER = 0.25
"""Share of a range by which the command widens it."""


@dataclass(frozen=True, slots=True)
class Outlook:
    """Advice on what to do next.

    Args:
        promise: Sentence on what simulated θ or the next experiment promise; empty if unknown.
        ends: Sentence on the knobs at the end of their range; empty if there are none.
        command: Command that widens those ranges; empty without a study file.
        unbeaten: Sentence on other experiments that never lost; empty if there are none.
        missed: Sentence on the objectives that the best experiment misses; empty if it meets all.
        result: Sentences on what was wanted, and on which answer the result rests.
    """

    promise: str = ""
    ends: str = ""
    command: str = ""
    unbeaten: str = ""
    missed: str = ""
    result: tuple[str, ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return all sentences, without the command."""
        parts = (self.unbeaten, self.missed, *self.result, self.promise, self.ends)
        return tuple(part for part in parts if part)

    @property
    def lines(self) -> tuple[str, ...]:
        """Return all sentences, then the command."""
        return (*self.sentences, self.command) if self.command else self.sentences


def others_unbeaten(history: History, *, robust: bool = False) -> str:
    """Return a sentence on the experiments besides the best that never lost; empty without any.

    The answers do not say which of them is better: they were compared without a verdict. Or the
    agent takes one of them for a slip.
    """
    if history.leads and history.incumbent != history.by_answers:
        return after_a_slip(history, robust=robust)
    indices = history.unbeaten()
    if len(indices) < 2:
        return ""
    best, *others = (str(index + 1) for index in indices)
    *most, last = others
    named = f"experiments {', '.join(most)} and {last} were" if most else f"experiment {last} was"
    return f"Besides experiment {best}, {named} never beaten: no answer says which one is better."


def after_a_slip(history: History, *, robust: bool = False) -> str:
    """Return a sentence on the best, which is not the winner of the answers."""
    best, winner = ((index or 0) + 1 for index in (history.incumbent, history.by_answers))
    if robust:
        return f"Experiment {best} is the best so far of those that hold, though {winner} won."
    return (
        f"Experiment {best} is the best so far, though {winner} won: all answers together speak "
        f"for {best}, so one of them is probably a slip."
    )


def foreseen(chance: float | None, index: int | None) -> str:
    """Return a sentence on what the next experiment can bring, by the answers before it.

    Args:
        chance: Chance that it is noticeably better; None if the KPIs do not explain the answers.
        index: Index of the experiment; None if it is not proposed yet.
    """
    if chance is None:
        return "The KPIs do not explain your answers well enough to say how likely the next run is better."
    which = "the next run" if index is None else f"experiment {index + 1}"
    better = f"{which} is noticeably better than the best is {100 * chance:.0f} %"
    return f"By the answers so far, the chance that {better}."


def outlook(
    promise: str,
    best: Float[np.ndarray, " n"],
    space: KnobSpace,
    place: str,
    state: State,
    *,
    missed: Sequence[str] = (),
    helps: Callable[[int, bool], bool],
) -> Outlook:
    """Return the outlook of a study.

    Args:
        promise: Sentence on what simulated θ or the next experiment promise; empty if unknown.
        best: Best θ, physical, shape (n,).
        space: Knobs with their searched ranges.
        place: Path of the study file; ":memory:" if there is none.
        state: State of the study.
        missed: Titles of the KPIs whose objectives the best experiment misses.
        helps: Function of the number of a knob at its end, and whether it is the upper end, that
            returns whether going further is expected to help.
    """
    why = _missed(missed)
    ends = [(knob, up) for knob, up in at_end(space, best) if helps(space.knobs.index(knob), up)]
    if not ends:
        return Outlook(promise, missed=why)
    several = len(ends) > 1
    verb, whose = ("are", "their ranges") if several else ("is", "its range")
    listed = _listed([knob.name for knob, _ in ends])
    sentence = f"{listed} of the best θ {verb} near the end of {whose}"
    within = promise and f"Within the present ranges, {promise[0].lower()}{promise[1:]}"
    if place == ":memory:":
        end = f"{sentence}; if your plant allows it, widen {whose}."
        return Outlook(within, end, missed=why)
    return Outlook(
        within,
        f"{sentence}; if your plant allows it, widen {whose}, for example with:",
        _command(ends, space, place, str(state.configuration["scenario"])),
        missed=why,
    )


def _missed(titles: Sequence[str]) -> str:
    """Return a sentence on missed objectives; empty if there are none."""
    if not titles:
        return ""
    which = "objectives" if len(titles) > 1 else "objective"
    return (
        f"The best experiment misses the {which} for {_listed(titles)}: continue or, if more "
        "experiments do not help, widen the ranges or change the controller."
    )


def _listed(names: Sequence[str]) -> str:
    *most, last = names
    return " and ".join([", ".join(most), last] if most else [last])


def at_end(space: KnobSpace, theta: Float[np.ndarray, " n"]) -> list[tuple[Knob, bool]]:
    """Return the knobs of θ at an end of their searched range, and whether it is the upper end.

    Frozen knobs are left out.
    """
    found = []
    for knob, (low, high), value in zip(space, space.within, theta.tolist(), strict=True):
        start, end, here = knob.encode(low), knob.encode(high), knob.encode(value)
        share = (here - start) / (end - start) if end > start else 0.5
        if not _AT_END < share < 1 - _AT_END:
            found.append((knob, share >= 1 - _AT_END))
    return found


def falls_outward(
    cost: Callable[[Float[np.ndarray, "m n"]], Float[np.ndarray, " m"]],
    space: KnobSpace,
    best: Float[np.ndarray, " n"],
    knob: int,
    upper: bool,
) -> bool:
    """Return whether a learned cost of physical θ falls toward an end of the range of a knob."""
    inward = space.encode(best).copy()
    inward[knob] += -_INWARD if upper else _INWARD
    here, there = cost(np.array([best, space.decode(np.clip(inward, 0.0, 1.0))]))
    return bool(here < there)


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
    """Return a value beyond `end`, seen from the `other` end; positive numbers stay positive."""
    if knob.scale == "log10":
        return float(f"{end * (end / other) ** _WIDER:.3g}")
    beyond = end + _WIDER * (end - other)
    if end > 0 >= beyond:
        beyond = end / 2
    if knob.integer:
        return float(np.ceil(beyond) if end > other else max(floor(beyond), min(end, 1)))
    return float(f"{beyond:.3g}")


def study_name(place: str) -> str:
    """Return the name of the study file at `place` for the command line."""
    path = Path(place)
    return path.stem if path.parent == data_folder() else place
