"""Connections to a study file, and giving a finished file its name."""

import os
import sqlite3
from pathlib import Path


def connect(path: Path | str) -> sqlite3.Connection:
    """Open `path`, with full synchronisation; no schema in it is trusted to run code."""
    connection = sqlite3.connect(path, timeout=5.0, isolation_level=None, check_same_thread=False)
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA synchronous = FULL")
    return connection


def publish(source: Path, target: Path) -> None:
    """Give `source` the name `target`, never in place of a file that is there."""
    try:
        os.link(source, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if target.exists():
            raise
        os.rename(source, target)
