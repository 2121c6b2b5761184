"""Where in a user's own code an error was raised: the line that they can mend."""

import site
import sysconfig
import traceback
from functools import cache
from pathlib import Path

from prefcal_env.errors import PrefcalError

_PACKAGES = ("prefcal_env", "prefcal_agents", "prefcal_scenarios")


def own_line(error: BaseException) -> str:
    """Return the last line of own code in the traceback, "own.py:12: x = 1 / 0"; "" if none."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if _is_own(frame.filename)]
    if not own:
        return ""
    source = f": {own[-1].line}" if own[-1].line else ""
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}{source}"


def located(error: Exception) -> Exception:
    """Return `error` with a note of its own line, written once: the file may change meanwhile."""
    line = own_line(error)
    if line and not getattr(error, "__notes__", None):
        error.add_note(line)
    return error


def in_words(error: BaseException) -> str:
    """Return an error in one text for people, with its own line if `located` has found one.

    Errors of prefcal speak for themselves, others need their name.
    """
    words = str(error) if isinstance(error, PrefcalError) else f"{type(error).__name__}: {error}"
    line = next(iter(getattr(error, "__notes__", ())), "")
    words = f"{words} (in {line})" if line else words
    return whole(words)


def whole(words: str) -> str:
    """Return `words` of foreign code with half characters, of a file's name say, spelled out.

    Neither a study nor a stream can hold them.
    """
    return words.encode(errors="backslashreplace").decode()


def _is_own(filename: str) -> bool:
    if filename.startswith("<"):  # not a file: compiled on the fly, or a frozen module
        return False
    path = Path(filename).resolve()
    return not any(path.is_relative_to(folder) for folder in _others())


@cache
def _others() -> tuple[Path, ...]:
    """Folders of Python, of installed packages, and of prefcal."""
    from importlib.util import find_spec

    names = ("stdlib", "platstdlib", "purelib", "platlib")
    folders = {*map(sysconfig.get_path, names), site.getusersitepackages()}
    for name in _PACKAGES:
        spec = find_spec(name)
        folders |= set(spec.submodule_search_locations or ()) if spec is not None else set()
    return tuple(Path(folder).resolve() for folder in folders)
