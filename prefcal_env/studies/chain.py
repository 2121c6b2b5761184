"""The hash chain: each event vouches for all before it."""

from hashlib import sha256

START = "0" * 64
"""What the first event follows."""


def link(before: str, seq: int, at: str, kind: str, body: str, payload: bytes | None) -> str:
    """Hash of an event, in hex, given the hash `before` and its uncompressed `payload`.

    Each part goes in with its length, so that nothing can move from one part to the next. The
    payload is hashed uncompressed: another zlib may compress it to other bytes.
    """
    digest = sha256()
    content = b"" if payload is None else sha256(payload).digest()
    for part in (before.encode(), str(seq).encode(), at.encode(), kind.encode(), body.encode(),
                 content):  # fmt: skip
        digest.update(len(part).to_bytes(8, "little"))
        digest.update(part)
    return digest.hexdigest()
