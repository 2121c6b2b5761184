"""Generic KPIs of any experiment with references: tracking errors and moves of the inputs.

An agent learns which of them matter to a person (`Answer.outcomes`); none is a cost by itself.
"""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from .experiment import Channel, Experiment
from .kpi_units import OF_INPUT, OF_OUTPUT, TrackingKind

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


def _named(kinds: Sequence[TrackingKind], channel: Channel, values: Iterable[float]) -> dict[str, float]:
    """Return the values of a channel's kinds, in their order, by name."""
    return {kind.of(channel): float(value) for kind, value in zip(kinds, values, strict=True)}


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
