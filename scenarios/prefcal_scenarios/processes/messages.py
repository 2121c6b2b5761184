"""Exchange messages with the process of the user's code: one letter, a length, and bytes."""

import struct
from enum import Enum
from typing import IO

_HEAD = struct.Struct("<cQ")


class Kind(Enum):
    """The kind of a message."""

    RUN = b"R"
    """To the process: what to run, for example θ, seed and space as JSON."""
    READY = b"L"
    """From it: the user's code is loaded."""
    EXPERIMENT = b"E"
    """From it: the bytes of an experiment, or of several."""
    ERROR = b"X"
    """From it: what the code raised, as JSON."""


Message = tuple[Kind, bytes]


def send(pipe: IO[bytes], kind: Kind, content: bytes = b"") -> None:
    """Write one message. Raises OSError if the reader is gone."""
    pipe.write(_HEAD.pack(kind.value, len(content)) + content)
    pipe.flush()


def receive(pipe: IO[bytes]) -> Message | None:
    """Read the next message; None if the writer is gone, even in the middle of a message."""
    head = pipe.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    kind, size = _HEAD.unpack(head)
    content = pipe.read(size)
    return (Kind(kind), content) if len(content) == size else None
