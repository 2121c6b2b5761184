"""Experiments as bytes: a header in JSON, then the arrays, little-endian. Nothing is pickled."""

import json
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from prefcal_env.end import End
from prefcal_env.errors import PrefcalError, StudyError
from prefcal_env.experiment import Channel, Channels, Experiment

from .events import canonical

MAGIC = b"prefcal1"
_MOST = 1 << 30
"""Bytes of one experiment that are read at most: whoever sent the file may want to fill memory."""
LONGEST_HEADER = 1 << 16
"""Bytes in which most headers are whole."""
_FLOATS = ("theta", "t", "x", "u", "t_control", "u_control", "y_ref", "solve_time")
_DTYPES = {**dict.fromkeys(_FLOATS, "<f8"), "iterations": "<i8", "solved": "|b1"}


def encode(experiment: Experiment) -> bytes:
    """The bytes of an experiment, uncompressed; equal experiments with equal times, equal bytes."""
    arrays: list[bytes] = []
    header = canonical(_header(experiment, arrays)).encode()
    return b"".join((MAGIC, struct.pack("<I", len(header)), header, *arrays))


def decode(content: bytes) -> Experiment:
    """Read what `encode` gave.

    Raises:
        StudyError: anything else.
    """
    try:
        if content[:8] != MAGIC:
            raise ValueError("it does not begin like one")
        (size,) = struct.unpack_from("<I", content, 8)
        header = json.loads(content[12 : 12 + size].decode())
        reader = _Reader(memoryview(content)[12 + size :])
        experiment = _experiment(header, reader)
        reader.check_end()
    except (
        ValueError, TypeError, KeyError, AttributeError, IndexError, OverflowError, struct.error,
        RecursionError, MemoryError, PrefcalError,
    ) as error:  # fmt: skip
        raise StudyError(f"a stored experiment cannot be read: {error}") from error
    return experiment


def end_of(beginning: bytes) -> End | None:
    """Read how an experiment ended off the `beginning` of its packed bytes; None if that fails."""
    try:
        content = zlib.decompressobj().decompress(beginning, LONGEST_HEADER)
        (size,) = struct.unpack_from("<I", content, 8)
        return End(json.loads(content[12 : 12 + size].decode())["end"])
    except (zlib.error, struct.error, ValueError, TypeError, KeyError, RecursionError):
        return None


def pack(content: bytes) -> bytes:
    """Compress."""
    return zlib.compress(content, 6)


def unpack(content: bytes) -> bytes:
    """Decompress, up to a bound. Raises StudyError if that is exceeded, or at other bytes."""
    stream = zlib.decompressobj()
    try:
        plain = stream.decompress(content, _MOST)
    except zlib.error as error:
        raise StudyError(f"a stored experiment cannot be decompressed: {error}") from error
    if not stream.eof or stream.unused_data:
        raise StudyError("a stored experiment is cut off, too large, or followed by something")
    return plain


def _header(experiment: Experiment, arrays: list[bytes]) -> dict[str, Any]:
    """What is no array; the bytes of the arrays are appended to `arrays` in the same order."""
    shapes = {}
    for name, dtype in _DTYPES.items():
        array = np.ascontiguousarray(getattr(experiment, name), dtype=dtype)
        shapes[name] = list(array.shape)
        arrays.append(array.tobytes())
    signals = sorted(experiment.signals)
    arrays += [np.ascontiguousarray(experiment.signals[k], dtype="<f8").tobytes() for k in signals]
    kpis = list(experiment.kpis)
    arrays.append(np.array([experiment.kpis[k] for k in kpis], dtype="<f8").tobytes())
    channels = experiment.channels
    return {
        **_outputs(experiment, arrays),
        "shapes": shapes,
        "signals": signals,
        "kpis": kpis,
        "end": experiment.end.value,
        "time_unit": channels.time_unit,
        "channels": {k: [_channel(c) for c in getattr(channels, k)] for k in ("x", "u", "y")},
        "runs": [_header(run, arrays) for run in experiment.runs],
    }


def _outputs(experiment: Experiment, arrays: list[bytes]) -> dict[str, Any]:
    """Which states the outputs are, or their shape; nothing if they were not recorded."""
    y = experiment.y
    if y is None:
        return {}
    states = [_state_like(y[:, j], experiment.x) for j in range(y.shape[1])]
    if None not in states:  # as of most plants: they need no room
        return {"y": {"states": states}}
    arrays.append(np.ascontiguousarray(y, dtype="<f8").tobytes())
    return {"y": {"shape": list(y.shape)}}


def _state_like(curve: np.ndarray, x: np.ndarray) -> int | None:
    return next((i for i in range(x.shape[1]) if curve.tobytes() == x[:, i].tobytes()), None)


def _channel(channel: Channel) -> list[Any]:
    numbers = (channel.low, channel.high, channel.target, channel.band)
    # repr, since limits may be infinite, which JSON has no number for.
    texts = [None if v is None else repr(float(v)) for v in numbers]
    return [channel.name, channel.unit, channel.symbol, *texts]


class _Reader:
    """Takes arrays off a buffer, one after the other."""

    def __init__(self, buffer: memoryview) -> None:
        self._buffer, self._at = buffer, 0

    def take(self, shape: list[Any], dtype: str) -> np.ndarray:
        if not all(isinstance(n, int) and not isinstance(n, bool) and n >= 0 for n in shape):
            raise ValueError(f"{shape} is no shape")
        count = 1
        for n in shape:
            count *= n
        size = count * np.dtype(dtype).itemsize
        if self._at + size > len(self._buffer):
            raise ValueError("its arrays are cut off")
        array = np.frombuffer(self._buffer[self._at : self._at + size], dtype=dtype)
        self._at += size
        return array.reshape(shape)

    def check_end(self) -> None:
        if self._at != len(self._buffer):
            raise ValueError("something follows its arrays")


def _experiment(header: Mapping[str, Any], reader: _Reader) -> Experiment:
    arrays = {name: reader.take(header["shapes"][name], d) for name, d in _DTYPES.items()}
    dense = len(arrays["t"])
    signals = {str(name): reader.take([dense], "<f8") for name in header["signals"]}
    values = reader.take([len(header["kpis"])], "<f8").tolist()
    stored = header.get("y")  # absent in files from before outputs were recorded
    outputs = None if stored is None else _read_outputs(stored, arrays["x"], reader)
    x, u, y = (tuple(map(_read_channel, header["channels"][k])) for k in ("x", "u", "y"))
    return Experiment(
        **arrays,
        channels=Channels(x, u, y, str(header["time_unit"])),
        end=End(header["end"]),
        kpis=dict(zip(map(str, header["kpis"]), values, strict=True)),
        signals=signals,
        y=outputs,
        runs=tuple(_experiment(run, reader) for run in header["runs"]),
    )


def _read_outputs(stored: Mapping[str, Any], x: np.ndarray, reader: _Reader) -> np.ndarray:
    if "shape" in stored:
        return reader.take(stored["shape"], "<f8")
    states = stored["states"]
    if not all(isinstance(i, int) and 0 <= i < x.shape[1] for i in states):
        raise ValueError(f"outputs cannot be the states {states}")
    return x[:, [int(i) for i in states]].reshape(len(x), len(states))


def _read_channel(values: list[Any]) -> Channel:
    name, unit, symbol, *texts = values
    low, high, target, band = (None if v is None else float(v) for v in texts)
    if low is None or high is None:
        raise ValueError("a channel without limits")
    return Channel(str(name), str(unit), low, high, target, band, str(symbol))
