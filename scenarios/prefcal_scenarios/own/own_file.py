"""A user's own Python file, named on the command line."""

import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

from prefcal_env.errors import PrefcalError, ScenarioError

from .own_line import own_line


def module_at(path: Path) -> ModuleType:
    """Execute the file at `path` as a module; modules beside it can be imported.

    Raises:
        ScenarioError: there is no such file, or it does not import.
    """
    if not path.is_file():
        raise ScenarioError(f"no file {str(path)!r} to load from")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules.setdefault(path.stem, module)  # dataclasses look their module up
    sys.path.insert(0, str(path.resolve().parent))  # for modules beside it, as a script has it
    try:
        # Not by the loader: its compiled copy counts as new for as long as size and second agree.
        exec(compile(path.read_bytes(), str(path), "exec"), module.__dict__)
    except Exception as error:
        # Whatever the user's own file raises: where in it, not where in prefcal.
        raise ScenarioError(f"cannot load {str(path)!r}: {_told(error, path)}") from error
    finally:
        sys.path.pop(0)
    return module


def _told(error: Exception, path: Path) -> str:
    """An error of somebody's own file in one line, with its line there, and the last own one."""
    words = " ".join(str(error).split())
    if isinstance(error, SyntaxError):  # it says its line
        return words
    if not isinstance(error, (ImportError, PrefcalError)):
        words = f"{type(error).__name__}: {words}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if Path(f.filename).resolve() == path.resolve()]
    if not lines:
        return words
    return f"{words} (line {lines[-1]}), in {own_line(error)}"
