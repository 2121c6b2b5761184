"""A user's own scenarios: how they are named, and the file that is loaded."""

import ast
import importlib.util
import json
import logging
import os
import re
import sys
import sysconfig
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from hashlib import sha256
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path
from types import ModuleType
from typing import Any

import prefcal_env
import prefcal_scenarios
from prefcal_env.errors import PrefcalError, ScenarioError
from prefcal_env.optional import ENDINGS
from prefcal_env.wording import last_own, ours, own_line

from .names import KEPT_PLANT, TABLES, is_described, is_own

# --- Names of scenarios: a plain name, or a name followed by its configuration in JSON.

_QUOTED = re.compile(rb"""["']([^"'\r\n\0]{1,200})["']""")
_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+(.+)$", re.MULTILINE)
_LARGE = 10_000_000  # bytes of a file above which reading it would take long


def split_source(source: str) -> tuple[str, dict[str, Any] | None]:
    """Split 'overtake {"lanes_count": 3}' into the name and its configuration, None if absent.

    Raises:
        ScenarioError: If the text after the name is not a JSON object.
    """
    name, brace, rest = source.partition("{")
    if not brace:
        return source, None
    return name.strip(), _parsed(brace + rest, f"the configuration of {name.strip()!r}")


def joined_source(name: str, config: Mapping[str, Any]) -> str:
    """Return the source of the scenario called `name` with configuration `config`."""
    return f"{name} {json.dumps(config, ensure_ascii=False, sort_keys=True)}"


def fingerprint(source: str) -> str:
    """Return 16 hexadecimal digits that change with the files that describe a scenario.

    These are the file of the scenario, those that it or its configuration names, and the modules beside
    a Python file that it imports. For a built-in scenario, whose code belongs to the
    version of prefcal, it depends on name and configuration. Where the files are is irrelevant.
    """
    name, config = split_source(source)
    digest = sha256()
    for key, value in {"": name, **dict(sorted((config or {}).items()))}.items():
        text = value if isinstance(value, str) else json.dumps(value, sort_keys=True)
        path, rest = file_in(text)
        digest.update(f"{key}\0{rest}\0".encode())
        for file in [] if path is None else _described_by(path):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def files_of(source: str) -> list[Path]:
    """Return the files that describe a scenario, those of `fingerprint`, as far as they are there."""
    name, config = split_source(source)
    named = [file_in(text)[0] for text in (name, *(config or {}).values()) if isinstance(text, str)]
    return list(dict.fromkeys(file for path in named if path is not None for file in _described_by(path)))


def runs_code(source: str) -> bool:
    """Return whether a user's own scenario may run a user's code, which may never end: all but plain data."""
    files, plain = files_of(source), (".toml", KEPT_PLANT, *TABLES)
    known = is_described(source) and files  # other files, and those that are not found, may be code
    return is_own(source) and not (known and all(each.name.lower().endswith(plain) for each in files))


def file_in(text: str) -> tuple[Path | None, str]:
    """Return the file that "own.py:name" or "tank.toml" names, and the rest."""
    before, _, after = text.rpartition(":")
    for path, rest in ((text, Path(text).suffix), (before, after)):
        if path.endswith((".py", ".toml", KEPT_PLANT, *ENDINGS, *TABLES)) and Path(path).is_file():
            return Path(path), rest
    return None, text


def _described_by(path: Path) -> list[Path]:
    """Return a file and those that it names, and so on, each once: modules may import each other."""
    found = {path: None}
    waiting = [path]
    while waiting:
        new = [file for file in _named_in(waiting.pop(), path.parent) if file not in found]
        found |= dict.fromkeys(new)
        waiting += new
    return [*found]


def _named_in(path: Path, top: Path) -> list[Path]:
    """Return the files that a TOML file names, the modules that a Python file imports, or a table's plant.

    Modules are looked for beside the file, and in the folder `top` of the scenario. The plant of a record is
    there as soon as its scenario was loaded.
    """
    if path.suffix not in (".py", ".toml"):
        kept = path.with_suffix(KEPT_PLANT)
        return [kept] if path.suffix in TABLES and kept.is_file() else []
    text = path.read_text(encoding="utf-8", errors="replace")
    if path.suffix == ".toml":
        endings = "|".join(map(re.escape, (".py", KEPT_PLANT, *ENDINGS, *TABLES)))
        words = re.findall(rf"[\w./-]+(?:{endings})\b", text)
    else:
        names = [re.findall(r"\w[\w.]*", line) for line in _IMPORT.findall(text)]
        paths = [
            name.replace(".", "/") for line in names for name in (*line, *(f"{line[0]}/{n}" for n in line))
        ]
        words = [f"{name}{ending}" for name in paths for ending in (".py", "/__init__.py")]
    places = dict.fromkeys(folder / word for word in words for folder in (path.parent, top))
    return [place for place in places if place.is_file()]


def fingerprint_of_code() -> str:
    """Return 16 hexadecimal digits that change with the loaded code of prefcal and of the user.

    Files beside the user's code that it names between quotes, such as tables, count, too.
    """
    digest = sha256()
    for package in (prefcal_env, prefcal_scenarios):
        for folder in map(Path, package.__path__):
            for path in sorted(folder.rglob("*.py")):  # the version is the same between releases
                found = path.stat()
                digest.update(f"{path.name}\0{found.st_size}\0{found.st_mtime_ns}\n".encode())
    for path in sorted(set(_loaded())):
        code = _content(path)
        digest.update(code)
        for file in sorted(set(_quoted_in(code, path.parent))):
            digest.update(_content(file))
    return digest.hexdigest()[:16]


def _content(path: Path) -> bytes:
    """Return the content of a file, or size and time of a large one; nothing if it is gone."""
    with suppress(OSError):
        found = path.stat()
        large = found.st_size > _LARGE
        return f"{found.st_size} {found.st_mtime_ns}".encode() if large else path.read_bytes()
    return b""


def _loaded() -> Iterator[Path]:
    """Yield the files of loaded modules that belong to the user: neither installed nor prefcal."""
    kinds = ("stdlib", "platstdlib", "purelib", "platlib")
    installed = tuple(os.path.realpath(sysconfig.get_path(kind)) + os.sep for kind in kinds)
    packages = ours()
    for name, module in sys.modules.copy().items():  # other threads import meanwhile
        path = os.path.realpath(getattr(module, "__file__", None) or "")
        if name == "__main__" or name.partition(".")[0] in packages or path.startswith(installed):
            continue
        if os.path.isfile(path):
            yield Path(path)


def _quoted_in(code: bytes, folder: Path) -> Iterator[Path]:
    """Yield the files that `code` names, beside it or where prefcal was started."""
    for word in {found.decode(errors="replace") for found in _QUOTED.findall(code)}:
        for path in (folder / word, Path(word)):
            with suppress(OSError):
                if path.suffix and path.is_file():
                    yield path.resolve()


def with_config_of(source: str, path: Path | None) -> str:
    """Return `source` with the configuration from a JSON file, or unchanged if `path` is None.

    Raises:
        ScenarioError: If the file cannot be read or holds no JSON object, or if `source` already
            has a configuration.
    """
    if path is None:
        return source
    name, config = split_source(source)
    if config is not None:
        raise ScenarioError(f"{source!r} has a configuration: leave out --config {path}")
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"cannot read the configuration {str(path)!r}: {error}") from error
    return joined_source(name, _parsed(text, f"the configuration {str(path)!r}"))


def _parsed(text: str, what: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{what} is not JSON: {error}") from error
    if not isinstance(found, dict):
        raise ScenarioError(f'{what} must be a JSON object, {{"lanes_count": 3}}, got {text!r:.80}')
    return found


# --- Load a user's own Python file, named on the command line.

SAYS = logging.getLogger("prefcal.loading")
"""What says that a file takes long, at the level INFO; the command line listens."""
_SOON = 1.5  # seconds after which it is said what takes so long


def module_at(path: Path) -> ModuleType:
    """Execute the file at `path` as a module; it can import modules from its own folder.

    Raises:
        ScenarioError: If the file does not exist, has the name of a library that it needs, or cannot be
            imported.
    """
    if not path.is_file():
        raise ScenarioError(f"no file {str(path)!r} to load from")
    if _hides_itself(path):
        raise ScenarioError(
            f"cannot load {str(path)!r}: it has the same name as the library {path.stem!r}, which it hides: "
            "rename the file"
        )
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


def _hides_itself(path: Path) -> bool:
    """Return whether the file at `path` has the name of a library that it, or prefcal, imports."""
    name, imported = path.stem, set[str]()
    with suppress(SyntaxError, ValueError):  # executing it says what is wrong
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add((node.module or "").partition(".")[0])
    needed = set[str]()  # libraries that prefcal may still have to import
    with suppress(PackageNotFoundError):
        listed = (re.split(r"[^\w-]", each)[0] for each in requires("prefcal") or ())
        needed = {each.lower().replace("-", "_") for each in listed} - sys.modules.keys()
    return name in imported or (name in needed and _elsewhere(name, path))


def _elsewhere(name: str, path: Path) -> bool:
    """Return whether an import finds `name` outside of the folder of the file at `path`."""
    own = os.path.realpath(path.parent)
    return PathFinder.find_spec(name, [p for p in sys.path if os.path.realpath(p or ".") != own]) is not None


def _hidden(words: str, path: Path) -> str:
    """Return what to rename if an error names a library that a file beside `path` hides; else ""."""
    for name in dict.fromkeys(re.findall(r"'(\w+)[.']", words)):
        for beside in (path.parent / f"{name}.py", path.parent / name / "__init__.py"):
            if beside.is_file() and _elsewhere(name, path):
                what = beside.name if beside.stem == name else f"the folder {name}"
                return f": {what} hides the library {name!r}: rename it"
    return ""


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
    words += _hidden(words, path)
    if isinstance(error, SyntaxError):  # the message includes the line
        return words
    if not isinstance(error, (ImportError, PrefcalError)):
        words = f"{type(error).__name__}: {words}"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if Path(f.filename).resolve() == path.resolve()]
    if not lines:
        return words
    return f"{words} (line {lines[-1]}), in {own_line(error)}"
