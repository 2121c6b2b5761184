"""Panels: which curve of an experiment is drawn, named by its channel, and how it looks."""

from collections.abc import Collection, Iterator
from dataclasses import KW_ONLY, dataclass, replace
from difflib import get_close_matches

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ExperimentError, ScenarioError

from .experiment import Channel, Channels, Experiment

KINDS = {"x": "states", "u": "inputs", "y": "outputs", "signal": "signals"}
"""Where a curve is found, and what stands there."""
_LOOK = ("unit", "low", "high", "target", "band", "symbol")
"""What a panel may state in place of its channel."""


@dataclass(frozen=True, slots=True)
class Plot:
    """One curve of experiments and its look: a `Panel` whose channel has been found.

    Args:
        channel: Title, unit, limits, target and band, all as drawn.
        kind: Where the curve is: "x", "u", "y" or "signal".
        name: Of the channel or signal there.
        nth: Which of several channels of that name, from 0.
        scale: Factor from the experiment's unit to that of `channel`.
        reference: Key of the signal that holds a reference which changes in time; "" for none.
        low_signal: Key of the signal that holds a lower limit which changes in time, likewise.
        high_signal: Key of the signal that holds an upper limit which changes in time, likewise.
    """

    channel: Channel
    kind: str
    name: str
    nth: int = 0
    scale: float = 1.0
    reference: str = ""
    low_signal: str = ""
    high_signal: str = ""

    @property
    def held(self) -> bool:
        """Whether the curve is drawn as steps: inputs are held between instants."""
        return self.kind == "u"

    def values(self, experiment: Experiment) -> Float[np.ndarray, " K"]:
        """Return the curve on `experiment.t`, shape (K,); NaN if the experiment lacks it."""
        found = _data(experiment, self) if len(experiment.t) else np.zeros(0)
        return np.full(len(experiment.t), np.nan) if found is None else self.scale * found


@dataclass(frozen=True, slots=True)
class Panel:
    """One plot of an experiment: the state, input, output or signal called `name`.

    Inputs are drawn as steps, all else as lines. What is left out is the channel's own; a state
    that is an output too, in the same unit, shows that output's target and band.
    `Panel("x", channel)`, a kind and a `Channel`, takes name and look from that channel.

    Args:
        name: Name (or symbol) of a channel of the experiment, or the key of a signal.
        kind: Where to look, if the name is not unique: "x", "u", "y" or "signal".
        title: Name on show.
        unit: Unit on show; needed if `scale` is given.
        low: Lower limit, in the unit on show; -inf for none.
        high: Upper limit, in the unit on show; inf for none.
        target: Value that is asked for, in the unit on show.
        band: Accepted distance from the target, in the unit on show.
        symbol: Mathtext symbol.
        scale: Factor from the channel's unit to `unit`, 3.6 from m/s to km/h.
        reference: Key of the signal that holds a reference which changes in time, in the
            channel's unit.
        low_signal: Key of the signal that holds a lower limit which changes in time, in the
            channel's unit; it is drawn in place of `low`, which states the lowest that it takes.
        high_signal: Key of the signal that holds an upper limit, likewise.

    Raises:
        ScenarioError: no name, an unknown kind, a scale without a unit, impossible limits.
    """

    name: str
    kind: str = ""
    _: KW_ONLY
    title: str = ""
    unit: str | None = None
    low: float | None = None
    high: float | None = None
    target: float | None = None
    band: float | None = None
    symbol: str | None = None
    scale: float = 1.0
    reference: str = ""
    low_signal: str = ""
    high_signal: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.kind, Channel):
            self._take(self.name, self.kind)
        if not isinstance(self.name, str) or not self.name:
            raise ScenarioError(f"a panel needs the name of a channel or signal, got {self.name!r}")
        if self.kind not in ("", *KINDS):
            raise ScenarioError(
                f"panel {self.name!r}: kind must be one of {list(KINDS)} or left out, "
                f"got {self.kind!r}"
            )
        if not np.isfinite(self.scale) or self.scale == 0:
            raise ScenarioError(
                f"panel {self.name!r}: scale must be finite and not 0, got {self.scale}"
            )
        if self.scale != 1 and self.unit is None:
            raise ScenarioError(
                f"panel {self.name!r}: scale {self.scale:g} changes the unit, so say which: unit="
            )
        if self.band is not None and not self.band > 0:
            raise ScenarioError(f"panel {self.name!r}: band must be above 0, got {self.band}")

    def _take(self, kind: str, channel: Channel) -> None:
        """Read `Panel(kind, channel)`: the channel's name, and its look unless given beside it."""
        look = {n: getattr(channel, n) for n in _LOOK if getattr(self, n) is None}
        taken = {"name": channel.name, "kind": kind, **look}
        for name, value in taken.items():
            object.__setattr__(self, name, value)

    def plot(self, experiment: Experiment) -> Plot:
        """Find the curve in `experiment`, which has a record.

        Raises:
            ScenarioError: no such channel or signal, several of them, or none recorded.
        """
        plot = self.among(experiment.channels, experiment.signals)
        self._check_state_is_output(plot, experiment)
        if _data(experiment, plot) is None:
            raise ScenarioError(
                f"panel {self.name!r}: the experiment does not record the output {plot.name!r}; "
                "give the Experiment its outputs as y=..., shape (K, n_y)"
            )
        drawn = {
            "the reference": self.reference,
            "the lower limit": self.low_signal,
            "the upper limit": self.high_signal,
        }
        for what, key in drawn.items():
            if key and key not in experiment.signals:
                raise ScenarioError(
                    f"panel {self.name!r}: no signal is called {key!r} to draw {what}; "
                    f"there are {_quoted(experiment.signals) or 'none'}"
                )
        return plot

    def among(self, channels: Channels, signals: Collection[str]) -> Plot:
        """Find the curve by its name.

        Args:
            channels: States, inputs and outputs that there are.
            signals: Keys of the signals that there are.

        Raises:
            ScenarioError: no such channel or signal, or several of them.
        """
        pool = _of_kind(self.kind, channels, signals) if self.kind else plots_of(channels, signals)
        found = [p for p in pool if p.name == self.name]
        found = found or [p for p in pool if p.channel.symbol == self.name]
        if not found:
            raise ScenarioError(self._unknown(channels, signals))
        if len(found) > 1:
            places = ", ".join(f"{p.kind!r}" for p in found)
            raise ScenarioError(
                f"panel {self.name!r}: {len(found)} curves are called so (kind {places}): "
                "name them differently, or say which kind"
            )
        return self._dressed(found[0])

    def _check_state_is_output(self, plot: Plot, experiment: Experiment) -> None:
        """Refuse a name that a state and another curve, an output, have in common."""
        if self.kind or plot.kind != "x":
            return
        state = _data(experiment, plot)
        for output in _of_kind("y", experiment.channels, ()):
            other = _data(experiment, output) if output.name == plot.name else None
            if state is None or other is None or np.allclose(state, other, equal_nan=True):
                continue
            raise ScenarioError(
                f"panel {self.name!r}: a state and an output are called so, and differ: "
                "name them differently, or say which, kind='x' or kind='y'"
            )

    def absent(self) -> Plot:
        """Return a plot without values, for experiments that lack this curve."""
        return Plot(self._look(Channel(self.name)), "signal", self.name)

    def _dressed(self, plot: Plot) -> Plot:
        look = self._look(_scaled(plot.channel, self.scale))
        return replace(
            plot, channel=look, scale=self.scale, reference=self.reference,
            low_signal=self.low_signal, high_signal=self.high_signal,
        )  # fmt: skip

    def _look(self, channel: Channel) -> Channel:
        """`channel` with what this panel states in place of its own."""
        given = {n: getattr(self, n) for n in _LOOK if getattr(self, n) is not None}
        try:
            return replace(channel, **given, name=self.title or channel.name)
        except ExperimentError as error:
            raise ScenarioError(f"panel {self.name!r}: {error}") from error

    def _unknown(self, channels: Channels, signals: Collection[str]) -> str:
        there = {kind: [c.name for c in getattr(channels, kind)] for kind in ("x", "u", "y")}
        there["signal"] = list(signals)
        close = get_close_matches(self.name, [n for names in there.values() for n in names], 1)
        listed = "; ".join(f"{KINDS[k]} {_quoted(names)}" for k, names in there.items() if names)
        where = f"of kind {self.kind!r} " if self.kind else ""
        hint = f"did you mean {close[0]!r}? " if close else ""
        return (
            f"panel {self.name!r}: no channel or signal {where}is called so; "
            f"{hint}There are {listed or 'none'}"
        )


def plots_of(channels: Channels, signals: Collection[str] = ()) -> tuple[Plot, ...]:
    """Return one plot for each state, input, output that is no state, and signal, in this order."""
    found = [*_numbered("x", channels.x), *_numbered("u", channels.u)]
    outputs = list(_numbered("y", channels.y))
    places = {(p.kind, p.name): i for i, p in enumerate(found) if p.kind == "x"}
    for output in outputs:
        place = places.get(("x", output.name))
        state = None if place is None else found[place]
        if state is None or state.channel.unit != output.channel.unit:
            found.append(output)
            continue
        assert place is not None
        found[place] = replace(state, channel=_with_target(state.channel, output.channel))
    known = {p.name for p in outputs}
    return (*found, *(Plot(Channel(k), "signal", k) for k in signals if k not in known))


def _of_kind(kind: str, channels: Channels, signals: Collection[str]) -> tuple[Plot, ...]:
    """Every curve of one kind, also those that another kind has too."""
    if kind == "signal":
        return tuple(Plot(Channel(name), kind, name) for name in signals)
    found = tuple(_numbered(kind, getattr(channels, kind)))
    if kind != "x":
        return found
    merged = {(p.name, p.nth): p for p in plots_of(channels) if p.kind == "x"}
    return tuple(merged[p.name, p.nth] for p in found)


def _numbered(kind: str, channels: Collection[Channel]) -> Iterator[Plot]:
    names: list[str] = []
    for channel in channels:
        yield Plot(channel, kind, channel.name, names.count(channel.name))
        names.append(channel.name)


def _with_target(state: Channel, output: Channel) -> Channel:
    """The state's look with the target and the band of the output that it is."""
    if state.target is not None:
        return state
    return replace(state, target=output.target, band=output.band)


def _data(experiment: Experiment, plot: Plot) -> Float[np.ndarray, " K"] | None:
    """The curve of `plot`, shape (K,); None if the experiment lacks it."""
    if plot.kind == "signal":
        return experiment.signals.get(plot.name)
    channels = getattr(experiment.channels, plot.kind)
    places = [i for i, channel in enumerate(channels) if channel.name == plot.name]
    if len(places) <= plot.nth:
        return None
    if plot.kind == "y":
        return experiment.output(places[plot.nth])
    array = experiment.x if plot.kind == "x" else experiment.u
    return np.asarray(array[:, places[plot.nth]])


def _scaled(channel: Channel, scale: float) -> Channel:
    """`channel` with its numbers in the unit that `scale` leads to."""
    low, high = sorted((scale * channel.low, scale * channel.high))
    target = None if channel.target is None else scale * channel.target
    band = None if channel.band is None else abs(scale) * channel.band
    return replace(channel, low=low, high=high, target=target, band=band)


def _quoted(names: Collection[str]) -> str:
    return ", ".join(repr(name) for name in names)
