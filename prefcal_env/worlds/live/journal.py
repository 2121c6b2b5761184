"""Keep the old values of a live plant on the disk while prefcal changes them."""

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from hashlib import sha256
from math import isfinite
from pathlib import Path

from platformdirs import user_data_path

from prefcal_env.disk import synchronize, write_durably
from prefcal_env.errors import LiveError


@dataclass(frozen=True, slots=True)
class Journal:
    """File that holds the old values of a plant from before the first write until they are back.

    If prefcal is killed, the next start finds the file and restores the values.

    Args:
        path: Path of the file; its folder is created.
    """

    path: Path

    @classmethod
    def of(cls, address: str) -> "Journal":
        """Return the journal of the plant at `address`, in the user's data folder."""
        name = sha256(address.encode()).hexdigest()[:16]
        return cls(user_data_path("prefcal", appauthor=False) / "live" / f"{name}.json")

    def save(self, old: Mapping[str, float]) -> None:
        """Write the old values by name; they are on the disk when this returns.

        Raises:
            LiveError: If the file cannot be written; then nothing may be changed on the plant.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_durably(self.path, json.dumps({"old": dict(old)}).encode())
        except OSError as error:
            raise LiveError(
                f"cannot save the plant's values in {self.path}: {error.strerror or error}. "
                "Nothing was written to the plant"
            ) from error

    def load(self) -> dict[str, float] | None:
        """Return the values to restore, by name; None if there are none.

        Raises:
            LiveError: If the file is damaged.
        """
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
            old = {str(name): float(value) for name, value in content["old"].items()}
            if not all(map(isfinite, old.values())):
                raise ValueError("not all of them are numbers")
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            raise LiveError(
                f"cannot read the plant's old values in {self.path}: restore them by hand, then "
                f"remove the file ({error})"
            ) from error
        return old

    def clear(self) -> None:
        """Remove the file, since the plant has its values again."""
        self.path.unlink(missing_ok=True)
        synchronize(self.path.parent)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other prefcal processes away from the plant inside the block.

        Raises:
            LiveError: If another process uses the plant.
        """
        lock = self.path.with_suffix(".lock")
        with ExitStack() as held:
            try:
                lock.parent.mkdir(parents=True, exist_ok=True)
                # SQLite locks a file on every system, and the lock ends with its process.
                connection = sqlite3.connect(lock, timeout=0.0, isolation_level=None)
                held.enter_context(closing(connection))
                connection.execute("BEGIN EXCLUSIVE")
            except (OSError, sqlite3.Error) as error:
                raise LiveError(
                    f"another prefcal runs on this plant, or {lock} cannot be written: end the "
                    f"other run first ({error})"
                ) from error
            yield
