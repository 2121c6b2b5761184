"""Watch how long people's own files take to load: a word after a moment, and a time limit."""

import logging
import os
import sys
import threading
import traceback
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from prefcal_env.errors import ScenarioError
from prefcal_env.own_line import last_own

SAYS = logging.getLogger("prefcal.loading")
"""What says that a file takes long, at the level INFO; the command line listens."""
_SOON = 1.5
"""Seconds after which it is said what takes so long."""
_LIMIT = 600.0
"""Longest time for loading a file in seconds: long work belongs into a run."""
_GRACE = 2.0
"""Seconds for the file's code to end once it is interrupted."""


@contextmanager
def watched(path: Path) -> Iterator[None]:
    """Say if the block, which executes the file at `path`, takes long; only in the command line.

    Raises:
        ScenarioError: If it takes longer than the time limit.
    """
    main = threading.main_thread()
    if not SAYS.isEnabledFor(logging.INFO) or threading.current_thread() is not main:
        yield
        return
    over, late = threading.Event(), threading.Event()

    def line() -> str:
        frame = sys._current_frames().get(main.ident or 0)
        found = "" if frame is None else last_own(traceback.extract_stack(frame))
        return f", it is in {found}" if found else ""

    def watch() -> None:
        if over.wait(_SOON):
            return
        SAYS.info("loading %s takes a while%s (Ctrl-C stops)", path.name, line())
        if over.wait(_LIMIT):
            return
        late.set()
        interrupt_main()
        if not over.wait(_GRACE):  # in compiled code, or its errors are caught
            SAYS.info(_too_long(path))
            os._exit(2)

    threading.Thread(target=watch, name="prefcal-loading", daemon=True).start()
    try:
        yield
    except KeyboardInterrupt:
        if late.is_set():
            raise ScenarioError(_too_long(path)) from None
        raise
    finally:
        over.set()


def _too_long(path: Path) -> str:
    return (
        f"loading {path.name} took longer than {_LIMIT:g} s and was ended: move what takes long "
        "from its top into run"
    )
