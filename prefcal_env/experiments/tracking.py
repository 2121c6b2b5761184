"""Tracking KPIs: those of any experiment with references, errors of outputs and moves of inputs.

An agent learns which of them matter to a person (`Answer.outcomes`); none is a cost by itself.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from prefcal_env.errors import ScenarioError

from .experiment import Channel, Channels, Experiment
from .formula import value_of
from .kpi import KPI
from .tracking_kinds import OF_INPUT, OF_OUTPUT, Kind, kinds_of

_MOST = 10
"""Number of found KPIs that people still read."""
_SHOWN = ("settling time", "overshoot", "integrated error", "total move")
"""Kinds of KPIs that are found, in the order in which they are shown."""
_DROPPED = ("integrated error", "overshoot", "total move")
"""Kinds that are left out, in this order, if there are too many KPIs to read."""
BAND = 0.03  # share of the largest error, for channels without a band
_NOTHING = 1e-3  # share of the largest error below which an error is invisible


def tracking_kpis(experiment: Experiment) -> dict[str, float]:
    """Return generic KPIs by name, lower is better, in the units of the experiment's channels.

    For each recorded output with a reference (see `Experiment.output`): the integrated error, the
    integrated error weighted with time, the time of the last entry into the band (3 % of the
    largest error if the channel has none; infinite means never), the overshoot, and the final
    error beyond a thousandth of the largest. For each input: the total, largest and root mean
    square move. An experiment without a record has no KPIs.
    """
    if len(experiment.t) < 2:
        return {}
    found: dict[str, float] = {}
    for channel, error in _errors(experiment):
        found |= _of_error(channel, experiment.t - experiment.t[0], error)
    for j, channel in enumerate(experiment.channels.u):
        moves = np.abs(np.diff(experiment.u_control[:, j]))
        if len(moves):
            sizes = moves.sum(), moves.max(), np.sqrt(np.mean(moves**2))
            found |= _named(OF_INPUT, channel, sizes)
    return found


def _named(kinds: Sequence[Kind], channel: Channel, values: Iterable[float]) -> dict[str, float]:
    """Return the values of a channel's kinds, in their order, by name."""
    names = (f"{kind} of {channel.name}" for kind, *_ in kinds)
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _errors(experiment: Experiment) -> Iterator[tuple[Channel, Float[np.ndarray, " K"]]]:
    """Yield channel and error of each output with a reference, on the dense grid."""
    for j, channel in enumerate(experiment.channels.y):
        reference = experiment.reference(j)
        curve = experiment.output(j)
        if curve is not None and np.isfinite(reference).all() and np.isfinite(curve).all():
            yield channel, np.asarray(curve - reference)


def _of_error(
    channel: Channel, t: Float[np.ndarray, " K"], error: Float[np.ndarray, " K"]
) -> dict[str, float]:
    dt, size = np.diff(t), np.abs(error)
    largest = float(size.max())
    # An overshoot lies on the other side of the reference than the start.
    beyond = -np.sign(error[0]) * error if error[0] else size
    values = (
        size[:-1] @ dt,
        (size * t)[:-1] @ dt,
        entered(t, error, band_of(channel, error)),
        max(beyond.max(), 0.0),
        max(size[-1] - _NOTHING * largest, 0.0),
    )
    return _named(OF_OUTPUT, channel, values)


def band_of(channel: Channel, error: Float[np.ndarray, " K"]) -> float:
    """Return the band in which an error counts as settled, in the channel's unit."""
    return BAND * float(np.abs(error).max()) if channel.band is None else channel.band


def entered(t: Float[np.ndarray, " K"], error: Float[np.ndarray, " K"], band: float) -> float:
    """Return the instant of the last entry of an error into the band; infinite for never."""
    outside = np.flatnonzero(np.abs(error) > band)
    last = int(outside[-1]) if len(outside) else -1
    return float(t[last + 1]) if last + 1 < len(t) else np.inf


def every_tracking_kpi(channels: Channels) -> dict[str, KPI]:
    """Return the tracking KPIs that channels allow, by name, as if all outputs had references."""
    return {
        name: KPI(name, name, unit, better="lower", about=about) for name, unit, about in kinds_of(channels)
    }


def found_kpis(channels: Channels, measured: Iterable[str] | None = None) -> tuple[KPI, ...]:
    """Return the few tracking KPIs to show to people, the most important first.

    Args:
        channels: Channels of the experiments.
        measured: KPIs of an experiment: only these are found. With None, those of the outputs
            with a target, and of the inputs.
    """
    aimed = tuple(c for c in channels.y if c.target is not None or measured is not None)
    every = every_tracking_kpi(Channels((), channels.u, aimed, channels.time_unit))
    there = [n for n in every if measured is None or n in measured]
    if not any(name.startswith(tuple(kind for kind, *_ in OF_OUTPUT)) for name in there):
        return ()  # nothing is tracked: moves alone would ask for a controller that does nothing
    kinds = list(_SHOWN)
    for kind in ("", *_DROPPED):
        kinds = [k for k in kinds if k != kind]
        names = [n for k in kinds for n in there if n.startswith(f"{k} of ")]
        if len(names) <= _MOST:
            break
    return tuple(every[name] for name in names)


@dataclass(frozen=True, slots=True)
class Tracking:
    """Function that returns the KPIs of an experiment, and its tracking KPIs.

    Args:
        names: KPIs that every complete experiment has, NaN if it could not be measured.
    """

    names: tuple[str, ...] = ()

    @classmethod
    def promised(cls, channels: Channels | None, names: Sequence[str]) -> "Tracking":
        """Promise those of `names` that channels allow, since others lack a target; all if unknown."""
        there = names if channels is None else {kpi.name for kpi in found_kpis(channels)}
        return cls(tuple(name for name in names if name in there))

    def __call__(self, experiment: Experiment) -> Mapping[str, float]:
        """Return the KPIs of an experiment by name; its own count."""
        unknown = {} if experiment.end.interrupted else dict.fromkeys(self.names, np.nan)
        return {**unknown, **tracking_kpis(experiment), **experiment.kpis}


@dataclass(frozen=True, slots=True)
class Formulas:
    """Function that returns the KPIs of an experiment, and those of formulas: pairs of name and text."""

    texts: tuple[tuple[str, str], ...]

    def __call__(self, experiment: Experiment) -> Mapping[str, float]:
        """Return the KPIs of an experiment by name; the formulas count, if there is a record.

        Raises ScenarioError if the experiment lacks what a formula names.
        """
        found = dict(experiment.kpis)
        for name, text in self.texts if len(experiment.t) else ():
            try:
                found[name] = value_of(text, experiment)
            except ScenarioError as error:
                raise ScenarioError(f"formula of KPI {name!r}: {error}") from error
        return found
