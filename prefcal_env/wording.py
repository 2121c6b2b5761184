"""Phrase messages for people, and find the line of their own code that raised an error."""

import site
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cache
from pathlib import Path

from .errors import PrefcalError, ScenarioError

_ALIKE = 0.6  # difflib's own threshold: "Ts" finds "T_s", "nowhere" finds nothing


def did_you_mean(word: str, names: Iterable[str]) -> str:
    """Return " Did you mean 'cstr'?", or nothing if no name resembles `word`.

    Ignores case, spaces, hyphens and underscores, and finds "K_p" as the last part of
    "controller.K_p".
    """
    whole: dict[str, str] = {}
    last: dict[str, str] = {}
    for name in names:
        whole.setdefault(_plain(name), name)
        last.setdefault(_plain(name.rpartition(".")[2]), name)
    typed = _plain(word)
    for plain in (whole, last):
        found = get_close_matches(typed, plain, n=3, cutoff=_ALIKE)
        # Transposed letters come first: "glips" means "glisp", although "glis" is more similar.
        found.sort(key=lambda name: sorted(name) != sorted(typed))
        if found:
            return f" Did you mean {plain[found[0]]!r}?"
    return ""


def and_more(count: int) -> str:
    """Return " (and 2 more)" if a message names the first of 3; nothing if there is only one."""
    return f" (and {count - 1} more)" if count > 1 else ""


def labeled(name: str, unit: str) -> str:
    """Return a name with its unit, for headings and axes in plain text."""
    return f"{name} [{unit}]" if unit else name


def place_in_code(function: object) -> str:
    """Return where a function is defined, such as " (own.py:12)"; "" if Python cannot tell."""
    code = getattr(function, "__code__", None)
    return "" if code is None else f" ({Path(code.co_filename).name}:{code.co_firstlineno})"


def brief(value: object) -> str:
    """Return the type and the beginning of a value, for messages."""
    return "None" if value is None else f"{type(value).__name__} {value!r:.60}"


def _plain(name: str) -> str:
    return "".join(name.casefold().split()).replace("_", "").replace("-", "")


# --- Find the line of a user's own code that raised an error, so that they can fix it.


def own_line(error: BaseException) -> str:
    """Return the last line of the user's code in the traceback, "own.py:12: x = 1 / 0", or ""."""
    return last_own(traceback.extract_tb(error.__traceback__))


def last_own(frames: traceback.StackSummary) -> str:
    """Return the last line of the user's code among `frames`, "own.py:12: x = 1 / 0", or ""."""
    others = {*_installed(), *(Path(folder).resolve() for each in ours().values() for folder in each)}
    own = [frame for frame in frames if _is_own(frame.filename, others)]
    if not own:
        return ""
    source = f": {own[-1].line}" if own[-1].line else ""
    return f"{Path(own[-1].filename).name}:{own[-1].lineno}{source}"


def locate(error: Exception) -> Exception:
    """Return `error` with a note of its line; noted now, since the file may change later."""
    line = own_line(error)
    if line and not getattr(error, "__notes__", None):
        error.add_note(line)
    return error


def as_exception(error: BaseException, what: str = "run") -> Exception:
    """Return what the user's code raised as an exception with its line, see `locate`.

    Anything else, such as SystemExit, would end the thread or the process that handles it.
    """
    if isinstance(error, Exception):
        return locate(error)
    did = "called exit" if isinstance(error, SystemExit) else f"raised {type(error).__name__}"
    known = ScenarioError(f"{what} {did}: {_text(error)}".removesuffix(": "))
    return locate(known.with_traceback(error.__traceback__))


def in_words(error: BaseException) -> str:
    """Return an error as one text for people, with the line that `locate` found, if any.

    Errors of prefcal are shown as they are; others are prefixed with the name of their type.
    """
    words = _text(error) if isinstance(error, PrefcalError) else described(error)
    line = next(iter(getattr(error, "__notes__", ())), "")
    words = f"{words} (in {line})" if line else words
    return whole(words)


def described(error: BaseException) -> str:
    """Return the name of an error's type and its message."""
    return whole(f"{type(error).__name__}: {_text(error)}".removesuffix(": "))


def whole(words: str) -> str:
    """Return `words` with lone surrogates, for example from a file name, escaped.

    Neither a study file nor a stream can hold them.
    """
    return words.encode(errors="backslashreplace").decode()


def _text(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:  # of people's own classes
        return "it has no readable message"


def ours() -> Mapping[str, Iterable[str]]:
    """Return the folders of the packages of prefcal and its extensions that are loaded, by name."""
    return {
        name: module.__path__
        for name, module in sys.modules.copy().items()  # other threads import meanwhile
        if name.startswith("prefcal_") and "." not in name and hasattr(module, "__path__")
    }


def _is_own(filename: str, others: Iterable[Path]) -> bool:
    if filename.startswith("<"):  # not a file: dynamically compiled code or a frozen module
        return False
    path = Path(filename).resolve()
    return not any(path.is_relative_to(folder) for folder in others)


@cache
def _installed() -> tuple[Path, ...]:
    """Return the folders of Python and of installed packages."""
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    folders = {*map(sysconfig.get_path, names), site.getusersitepackages()}
    return tuple(Path(folder).resolve() for folder in folders)
