"""Load a user's own Python file, named on the command line."""

import importlib.util
import logging
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from prefcal_env.errors import PrefcalError, ScenarioError
from prefcal_env.own_line import last_own, own_line

SAYS = logging.getLogger("prefcal.loading")
"""What says that a file takes long, at the level INFO; the command line listens."""
_SOON = 1.5
"""Seconds after which it is said what takes so long."""


def module_at(path: Path) -> ModuleType:
    """Execute the file at `path` as a module; it can import modules from its own folder.

    Raises:
        ScenarioError: If the file does not exist or cannot be imported.
    """
    if not path.is_file():
        raise ScenarioError(f"no file {str(path)!r} to load from")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses look up their module
    sys.path.insert(0, str(path.resolve().parent))  # as for a script: its own folder comes first
    try:
        # Not with the loader: it reuses compiled code if size and modification second agree.
        with _watched(path):
            exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit would end the command without a word
        # Say where in the user's file the error is, not where in prefcal.
        raise ScenarioError(f"cannot load {str(path)!r}: {_told(error, path)}") from error
    finally:
        sys.path.pop(0)
    return module


@contextmanager
def _watched(path: Path) -> Iterator[None]:
    """Say if the block, which executes the file at `path`, takes long; only in the command line."""
    main = threading.main_thread()
    if not SAYS.isEnabledFor(logging.INFO) or threading.current_thread() is not main:
        yield
        return

    def say() -> None:
        frame = sys._current_frames().get(main.ident or 0)
        found = "" if frame is None else last_own(traceback.extract_stack(frame))
        line = f", it is in {found}" if found else ""
        SAYS.info("loading %s takes a while%s (Ctrl-C stops)", path.name, line)

    timer = threading.Timer(_SOON, say)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _told(error: BaseException, path: Path) -> str:
    """Return an error in a user's file on one line, with the last line of the user's own code."""
    words = " ".join(str(error).split())
    if isinstance(error, SyntaxError):  # the message includes the line
        return words
    if not isinstance(error, (ImportError, PrefcalError)):
        words = f"{type(error).__name__}: {words}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if Path(f.filename).resolve() == path.resolve()]
    if not lines:
        return words
    return f"{words} (line {lines[-1]}), in {own_line(error)}"
