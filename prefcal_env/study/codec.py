"""Encode experiments as bytes: a JSON header, then little-endian arrays. Nothing is pickled."""

import struct
import zlib
from collections.abc import Sequence
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


class _Channel(msgspec.Struct, frozen=True, array_like=True):
    """Texts of a channel; its limits, target and band are in an array."""

    name: str
    unit: str
    symbol: str


class _Header(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """Everything about an experiment except its arrays.

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
    x: tuple[_Channel, ...]
    u: tuple[_Channel, ...]
    y: tuple[_Channel, ...]
    runs: tuple["_Header", ...] = ()
    y_states: tuple[Size, ...] | None = None
    y_shape: tuple[Size, Size] | None = None
    maneuver: str = ""


class _Beginning(msgspec.Struct, frozen=True):
    """Part of a header that is read without the rest."""

    end: End


def encode(experiment: Experiment) -> bytes:
    """Return an experiment as bytes, uncompressed; equal experiments give equal bytes."""
    arrays: list[bytes] = []
    header = canonical(to_plain(_header(experiment, arrays))).encode()
    return b"".join((MAGIC, struct.pack("<I", len(header)), header, *arrays))


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
        reader = _Reader(memoryview(content)[12 + size :])
        experiment = _experiment(header, reader)
        reader.check_end()
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


def _header(experiment: Experiment, arrays: list[bytes]) -> _Header:
    """Return the header; the bytes of the arrays are appended to `arrays` in the same order."""
    shapes = {}
    for name, dtype in _DTYPES.items():
        array = np.ascontiguousarray(getattr(experiment, name), dtype=dtype)
        shapes[name] = array.shape
        arrays.append(array.tobytes())
    signals, kpis = sorted(experiment.signals), tuple(experiment.kpis)
    arrays += [_bytes(experiment.signals[name]) for name in signals]
    arrays.append(_bytes([experiment.kpis[name] for name in kpis]))
    channels = experiment.channels
    arrays += [_bytes(_numbers(c)) for c in (*channels.x, *channels.u, *channels.y)]
    y_states, y_shape = _outputs(experiment, arrays)
    return _Header(
        shapes=shapes,
        signals=tuple(map(str, signals)),
        kpis=kpis,
        end=experiment.end,
        time_unit=str(channels.time_unit),
        x=_words(channels.x),
        u=_words(channels.u),
        y=_words(channels.y),
        runs=tuple(_header(run, arrays) for run in experiment.runs),
        y_states=y_states,
        y_shape=y_shape,
        maneuver=experiment.maneuver,
    )


def _bytes(values: Any) -> bytes:
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def _words(channels: Sequence[Channel]) -> tuple[_Channel, ...]:
    return tuple(_Channel(str(c.name), str(c.unit), str(c.symbol)) for c in channels)


def _numbers(channel: Channel) -> list[float]:
    """Return limits, target and band; JSON cannot store them, since they may be infinite."""
    optional = (np.nan if v is None else v for v in (channel.target, channel.band))
    return [channel.low, channel.high, *optional]


def _outputs(
    experiment: Experiment, arrays: list[bytes]
) -> tuple[tuple[int, ...] | None, tuple[int, int] | None]:
    """Return which states the outputs are, or else the shape of their array, now in `arrays`."""
    y = experiment.y
    if y is None:
        return None, None
    states = [_state_like(y[:, j], experiment.x) for j in range(y.shape[1])]
    known = tuple(state for state in states if state is not None)
    if len(known) == len(states):  # as for most plants, so their outputs take no space
        return known, None
    arrays.append(_bytes(y))
    return None, (y.shape[0], y.shape[1])


def _state_like(curve: np.ndarray, x: np.ndarray) -> int | None:
    return next((i for i in range(x.shape[1]) if curve.tobytes() == x[:, i].tobytes()), None)


class _Reader:
    """Reader that takes arrays from a buffer, one after the other."""

    def __init__(self, buffer: memoryview) -> None:
        self._buffer, self._at = buffer, 0

    def take(self, shape: Sequence[int], dtype: str = "<f8") -> np.ndarray:
        size = prod(shape) * np.dtype(dtype).itemsize
        if self._at + size > len(self._buffer):
            raise ValueError("its arrays are cut off")
        array = np.frombuffer(self._buffer[self._at : self._at + size], dtype=dtype)
        self._at += size
        return array.reshape(shape)

    def check_end(self) -> None:
        if self._at != len(self._buffer):
            raise ValueError("something follows its arrays")


def _experiment(header: _Header, reader: _Reader) -> Experiment:
    arrays = {name: reader.take(header.shapes[name], d) for name, d in _DTYPES.items()}
    dense = len(arrays["t"])
    signals = {name: reader.take([dense]) for name in header.signals}
    values = reader.take([len(header.kpis)]).tolist()
    x, u, y = (
        tuple(_channel(words, reader.take([4]).tolist()) for words in group)
        for group in (header.x, header.u, header.y)
    )
    outputs = _read_outputs(header, arrays["x"], reader)
    return Experiment(
        **arrays,
        channels=Channels(x, u, y, header.time_unit),
        end=header.end,
        kpis=dict(zip(header.kpis, values, strict=True)),
        signals=signals,
        y=outputs,
        runs=tuple(_experiment(run, reader) for run in header.runs),
        maneuver=header.maneuver,
    )


def _read_outputs(header: _Header, x: np.ndarray, reader: _Reader) -> np.ndarray | None:
    if header.y_shape is not None:
        return reader.take(header.y_shape)
    if header.y_states is None:
        return None
    if not all(i < x.shape[1] for i in header.y_states):
        raise ValueError(f"outputs cannot be the states {list(header.y_states)}")
    return x[:, list(header.y_states)].reshape(len(x), len(header.y_states))


def _channel(words: _Channel, numbers: Sequence[float]) -> Channel:
    low, high = numbers[:2]
    target, band = (None if np.isnan(v) else v for v in numbers[2:])
    return Channel(words.name, words.unit, low, high, target, band, words.symbol)
