"""Load a user's own Python file, named on the command line."""

import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

from prefcal_env.errors import PrefcalError, ScenarioError
from prefcal_env.own_line import own_line

from .loading import watched


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
        with watched(path):
            exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit would end the command without a word
        # Say where in the user's file the error is, not where in prefcal.
        raise ScenarioError(f"cannot load {str(path)!r}: {_told(error, path)}") from error
    finally:
        sys.path.pop(0)
    return module


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
