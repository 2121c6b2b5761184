"""Encode experiments as bytes: a JSON header, then little-endian arrays. Nothing is pickled."""

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from math import prod
from typing import Annotated, Any

import msgspec
import numpy as np

from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.experiments.end import End
from prefcal_env.experiments.experiment import Channel, Channels, Experiment
from prefcal_env.plain import UNREADABLE, canonical, to_plain

MAGIC = b"prefcal1"
_MOST = 1 << 30
"""Maximum size of an experiment in bytes: a file from elsewhere may try to fill the memory."""
LONGEST_HEADER = 1 << 16
"""Number of bytes that hold the whole header of most experiments."""
_FLOATS = ("theta", "t", "x", "u", "t_control", "u_control", "y_ref", "solve_time")
_DTYPES = {**dict.fromkeys(_FLOATS, "<f8"), "iterations": "<i8", "solved": "|b1"}

Size = Annotated[int, msgspec.Meta(ge=0, le=_MOST)]


_Words = tuple[str, str, str]
"""Name, unit and symbol of a channel; its limits, target and band are in an array."""


class _Header(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """Everything about an experiment except its arrays, which follow in the order of `layout`.

    Args:
        shapes: Shape of each array by name.
        signals: Names of the signals, each as long as the time axis.
        kpis: Names of the KPIs.
        end: How the run ended.
        time_unit: Unit of the time axis.
        x: Channels of the states.
        u: Channels of the inputs.
        y: Channels of the outputs.
        runs: Headers of the runs that the experiment consists of.
        y_states: For outputs that are states: the number of each state.
        y_shape: For other outputs: the shape of their array. Both are None without outputs.
        maneuver: Name of the run among several maneuvers; "" if there is only one.
    """

    shapes: dict[str, tuple[Size, ...]]
    signals: tuple[str, ...]
    kpis: tuple[str, ...]
    end: End
    time_unit: str
    x: tuple[_Words, ...]
    u: tuple[_Words, ...]
    y: tuple[_Words, ...]
    runs: tuple["_Header", ...] = ()
    y_states: tuple[Size, ...] | None = None
    y_shape: tuple[Size, Size] | None = None
    maneuver: str = ""

    def layout(self) -> dict[str, tuple[Sequence[int], str]]:
        """Return shape and type of each array in order, without those of the other runs."""
        found: dict[str, tuple[Sequence[int], str]] = {
            **{name: (self.shapes[name], dtype) for name, dtype in _DTYPES.items()},
            "signals": ((len(self.signals), *self.shapes["t"][:1]), "<f8"),
            "kpis": ((len(self.kpis),), "<f8"),
            "limits": ((len(self.x + self.u + self.y), 4), "<f8"),
        }
        return found if self.y_shape is None else {**found, "y": (self.y_shape, "<f8")}


class _Beginning(msgspec.Struct, frozen=True):
    """Part of a header that is read without the rest."""

    end: End


def encode(experiment: Experiment) -> bytes:
    """Return an experiment as bytes, uncompressed; equal experiments give equal bytes."""
    found = _header(experiment)
    header = canonical(to_plain(found)).encode()
    return b"".join((MAGIC, struct.pack("<I", len(header)), header, *_arrays(found, experiment)))


def decode(content: bytes) -> Experiment:
    """Return the experiment in bytes that `encode` returned.

    Raises:
        StudyError: If they are anything else.
    """
    try:
        if content[:8] != MAGIC:
            raise ValueError("it does not begin like one")
        (size,) = struct.unpack_from("<I", content, 8)
        header = msgspec.json.decode(content[12 : 12 + size], type=_Header)
        buffer = io.BytesIO(content[12 + size :])
        experiment = _experiment(header, buffer)
        if buffer.read(1):
            raise ValueError("something follows its arrays")
    except (*UNREADABLE, KeyError, struct.error, MemoryError, PrefcalError) as error:
        raise StudyError(f"a stored experiment cannot be read: {error}") from error
    return experiment


def end_of(beginning: bytes) -> End | None:
    """Return how an experiment ended, from the `beginning` of its packed bytes; None if unknown."""
    try:
        content = zlib.decompressobj().decompress(beginning, LONGEST_HEADER)
        (size,) = struct.unpack_from("<I", content, 8)
        return msgspec.json.decode(content[12 : 12 + size], type=_Beginning).end
    except (*UNREADABLE, zlib.error, struct.error):
        return None


def pack(content: bytes) -> bytes:
    """Compress bytes."""
    return zlib.compress(content, 6)


def unpack(content: bytes) -> bytes:
    """Decompress bytes up to a limit. Raises StudyError above it, or for invalid bytes."""
    stream = zlib.decompressobj()
    try:
        plain = stream.decompress(content, _MOST)
    except zlib.error as error:
        raise StudyError(f"a stored experiment cannot be decompressed: {error}") from error
    if not stream.eof or stream.unused_data:
        raise StudyError("a stored experiment is cut off, too large, or followed by something")
    return plain


def _header(experiment: Experiment) -> _Header:
    channels, y, x = experiment.channels, experiment.y, experiment.x
    states = [_state_like(curve, x) for curve in ([] if y is None else y.T)]
    # The outputs of most plants are states, so they take no space.
    known = tuple(state for state in states if state is not None)
    apart = y is not None and len(known) < len(states)
    return _Header(
        shapes={name: np.shape(getattr(experiment, name)) for name in _DTYPES},
        signals=tuple(sorted(map(str, experiment.signals))),
        kpis=tuple(experiment.kpis),
        end=experiment.end,
        time_unit=str(channels.time_unit),
        x=_words(channels.x),
        u=_words(channels.u),
        y=_words(channels.y),
        runs=tuple(map(_header, experiment.runs)),
        y_states=None if y is None or apart else known,
        y_shape=(y.shape[0], y.shape[1]) if y is not None and apart else None,
        maneuver=experiment.maneuver,
    )


def _words(channels: Sequence[Channel]) -> tuple[_Words, ...]:
    return tuple((str(c.name), str(c.unit), str(c.symbol)) for c in channels)


def _state_like(curve: np.ndarray, x: np.ndarray) -> int | None:
    return next((i for i in range(x.shape[1]) if curve.tobytes() == x[:, i].tobytes()), None)


def _arrays(header: _Header, experiment: Experiment) -> Iterator[bytes]:
    """Yield the bytes of all arrays in the order of `layout`, then those of the other runs."""
    channels = experiment.channels
    made: dict[str, Any] = {
        "signals": [experiment.signals[name] for name in header.signals],
        "kpis": [experiment.kpis[name] for name in header.kpis],
        # JSON cannot store limits, target and band, since they may be infinite.
        "limits": [
            [c.low, c.high, *(np.nan if v is None else v for v in (c.target, c.band))]
            for c in (*channels.x, *channels.u, *channels.y)
        ],
    }
    for name, (_, dtype) in header.layout().items():
        value = made[name] if name in made else getattr(experiment, name)
        yield np.ascontiguousarray(value, dtype=dtype).tobytes()
    for run, of_run in zip(experiment.runs, header.runs, strict=True):
        yield from _arrays(of_run, run)


def _experiment(header: _Header, buffer: io.BytesIO) -> Experiment:
    arrays = {name: _array(buffer, *block) for name, block in header.layout().items()}
    limits = iter(arrays["limits"].tolist())
    x, u, y = (
        tuple(_channel(words, next(limits)) for words in group) for group in (header.x, header.u, header.y)
    )
    outputs = arrays.get("y")
    if header.y_states is not None:
        if not all(i < arrays["x"].shape[1] for i in header.y_states):
            raise ValueError(f"outputs cannot be the states {list(header.y_states)}")
        shape = len(arrays["x"]), len(header.y_states)
        outputs = arrays["x"][:, list(header.y_states)].reshape(shape)
    return Experiment(
        **{name: arrays[name] for name in _DTYPES},
        channels=Channels(x, u, y, header.time_unit),
        end=header.end,
        kpis=dict(zip(header.kpis, arrays["kpis"].tolist(), strict=True)),
        signals=dict(zip(header.signals, arrays["signals"], strict=True)),
        y=outputs,
        runs=tuple(_experiment(run, buffer) for run in header.runs),
        maneuver=header.maneuver,
    )


def _array(buffer: io.BytesIO, shape: Sequence[int], dtype: str) -> np.ndarray:
    size = prod(shape) * np.dtype(dtype).itemsize
    content = buffer.read(size)
    if len(content) < size:
        raise ValueError("its arrays are cut off")
    return np.frombuffer(content, dtype=dtype).reshape(shape)


def _channel(words: _Words, numbers: Sequence[float]) -> Channel:
    name, unit, symbol = words
    low, high, *optional = numbers
    target, band = (None if np.isnan(v) else v for v in optional)
    return Channel(name, unit, low, high, target, band, symbol)
