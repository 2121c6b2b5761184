"""Keep files beside a study that only save time: each may be lost, damaged or foreign at any moment.

They hold nothing that does not follow from the study. A reader checks that a file is whole and was made
from the same record by the same code; if not, everything is computed again.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

from prefcal_env.disk import whole_file

SUFFIX = ".prefcal"
"""Suffix of a study file."""
SIMULATED, LEARNED = "simulated", "learned"
"""Kinds of these files: the KPIs of simulated θ, and what an agent has learned."""
_LONGEST_HEAD = 128  # bytes of the first line: what the file is, and what its content follows from


def beside_study(study: Path, kind: str) -> Path:
    """Return the file of this kind beside the file of a study."""
    stem = study.stem if study.suffix == SUFFIX else study.name
    return study.with_name(f"{stem}.{kind}")


def head_of(kind: str, key: str) -> bytes:
    """Return the first line of a file of this kind, whose content follows from `key`."""
    return f"prefcal {kind} 1 {key}\n".encode()


def is_ours(path: Path) -> bool:
    """Return whether the file is of one of these kinds, or is empty or missing."""
    try:
        if path.exists() and not path.is_file():  # to open a pipe would wait for its other end
            return False
        with path.open("rb") as file:
            head = file.read(_LONGEST_HEAD)
    except FileNotFoundError:
        return True
    except (OSError, ValueError):
        return False
    return not head or re.match(rb"prefcal (simulated|learned) 1 ", head) is not None


def all_beside(study: Path) -> Iterator[tuple[str, Path]]:
    """Yield kind and path of each of these files beside a study, unless it is something else."""
    for kind in (SIMULATED, LEARNED):
        path = beside_study(study, kind)
        if is_ours(path):
            yield kind, path


def read_learned(study: Path, key: str) -> bytes:
    """Return what was kept under `key`; empty if nothing was, or it is damaged."""
    head = head_of(LEARNED, key)
    # Whatever else there is, such as a folder, a pipe without a writer or too long a name, is nothing.
    with suppress(OSError, ValueError):
        path = beside_study(study, LEARNED)
        if path.is_file():
            content = path.read_bytes()
            checksum, kept = content[len(head) : len(head) + 32], content[len(head) + 32 :]
            if content.startswith(head) and sha256(kept).digest() == checksum:
                return kept
    return b""


def write_learned(study: Path, key: str, content: bytes) -> None:
    """Keep content under `key` in place of all that was kept; without room, nothing is kept.

    It is not written to the disk at once, which would take as long as an answer does: a power failure
    may damage it, and its checksum tells.
    """
    with suppress(OSError, ValueError):
        path = beside_study(study, LEARNED)
        if is_ours(path):
            with whole_file(path) as part:
                part.write_bytes(head_of(LEARNED, key) + sha256(content).digest() + content)
