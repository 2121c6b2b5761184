"""Write files whole or not at all, and, where something follows from them, durably."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path


def beside(target: Path) -> Path:
    """Return a new name next to `target` for a file that is not complete yet.

    The name is random. A process id is the same every time in a container, so a file that a
    killed process left behind would block it forever.
    """
    return target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")


@contextmanager
def whole_file(target: Path) -> Iterator[Path]:
    """Yield a path to write to; what is there in the end takes the place of `target`.

    A reader sees either the old file or the new one, and an error leaves no partial file. Raises
    OSError if there is nothing in the end, or it cannot take its place.
    """
    part = beside(target)
    try:
        yield part
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


def write_durably(target: Path, content: bytes) -> None:
    """Write a file; once this returns, it survives a crash of the machine. Raises OSError."""
    with whole_file(target) as part:
        write_new(part, content)
    synchronize(target.parent)


def write_new(path: Path, content: bytes) -> None:
    """Write a new file to the disk; its name is durable after `synchronize`. Raises OSError."""
    with path.open("xb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def synchronize(folder: Path) -> None:
    """Write a new name to the disk; without this, a power failure could lose the file."""
    if os.name != "posix":  # elsewhere a folder cannot be opened
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def digest_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits. Raises OSError."""
    return sha256(path.read_bytes()).hexdigest()
