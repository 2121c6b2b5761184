"""Exchange messages with a worker process: letter, length, checksums, and bytes."""

import struct
from enum import Enum
from typing import IO
from zlib import crc32

_HEAD = struct.Struct("<cQI")
"""Letter, length, and checksum of the content."""
_SUM = struct.Struct("<I")
"""Checksum of the head: a wrong length would be waited for."""


class Kind(Enum):
    """The kind of a message."""

    REQUESTS = b"R"
    """To the process: what to run, a list of pickled requests; the first message is the work."""
    READY = b"L"
    """From it: the work is loaded."""
    RESULTS = b"E"
    """From it: the next pickled results, and the seconds that they took."""
    ERROR = b"X"
    """From it: why the work cannot be loaded, or where its code was when it was ended."""


Message = tuple[Kind, bytes]


def send(pipe: IO[bytes], kind: Kind, content: bytes = b"") -> None:
    """Write one message. Raises OSError if the reader is gone."""
    head = _HEAD.pack(kind.value, len(content), crc32(content))
    pipe.write(head + _SUM.pack(crc32(head)) + content)
    pipe.flush()


def receive(pipe: IO[bytes]) -> Message | None:
    """Read the next message; None if the writer is gone, even in the middle of a message.

    Raises:
        ValueError: If it is no message: the user's code wrote to, or read from, the pipe.
    """
    read = pipe.read(_HEAD.size + _SUM.size)
    if len(read) < _HEAD.size + _SUM.size:
        return None
    head = read[: _HEAD.size]
    if _SUM.pack(crc32(head)) != read[_HEAD.size :]:
        raise ValueError("no message")
    kind, size, checksum = _HEAD.unpack(head)
    content = pipe.read(size)
    if len(content) < size:
        return None
    if crc32(content) != checksum:
        raise ValueError("a damaged message")
    return Kind(kind), content
