"""Decorators that compile kernels, without unused entry points, and the cache of the results.

The compiled code lies in the user's cache folder (or in `NUMBA_CACHE_DIR`), in one folder for each
module of kernels and content of its sources. So installing again, or in another environment,
compiles nothing unless a source has changed; and then nothing stale is used, also if the change is
in a module that the kernels import. If the folder is not writable, each process compiles anew.
"""

import ast
import hashlib
import platform
import shutil
import sys
from functools import cache, partial
from importlib.util import resolve_name
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import llvmlite
import numba
import numpy as np
from numba.core.caching import FunctionCache, _CacheLocator
from platformdirs import user_cache_path

kernel: Any = partial(numba.njit, cache=True, no_cfunc_wrapper=True, error_model="numpy")
"""Decorator of a function called from Python; it is compiled once per machine."""

inner: Any = partial(kernel, no_cpython_wrapper=True, cache=False)
"""Decorator of a function that only kernels call: it is part of their compiled code."""

callback: Any = partial(numba.cfunc, cache=True)
"""Decorator of a C function with the given signature; it is compiled when it is defined."""

_config: Any = numba.config
inlined: Any = partial(numba.njit, inline="always")
"""Decorator of a function that is called in one place: it takes no compilation of its own."""

_OURS = "prefcal_"


class _KernelFolder(_CacheLocator):
    """Where numba keeps the compiled functions of a module of this project."""

    def __init__(self, function: Any) -> None:
        self._py_file, self._lineno = (function.__code__.co_filename, function.__code__.co_firstlineno)
        self._stamp = stamp(function.__module__)
        root = Path(_config.CACHE_DIR or user_cache_path("prefcal", appauthor=False))
        self._path = root / "kernels" / f"{function.__module__}-{self._stamp}"
        try:
            if not self._path.exists():
                _remove_old(self._path)
            self.ensure_cache_path()  # type: ignore[no-untyped-call]
        except OSError:
            self._path = Path(_temporary().name) / self._path.name

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Self | None:
        """Return the folder of a function, or None if numba's own rules apply."""
        known = str(py_func.__module__).startswith(_OURS) and Path(py_file).exists()
        return cls(py_func) if known else None

    def get_cache_path(self) -> str:
        """Return the folder."""
        return str(self._path)

    def get_source_stamp(self) -> str:
        """Return what changes with any source."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name apart."""
        return str(self._lineno)


# First in numba's list, which it goes through for every function that is to be cached. A version
# of numba without this list keeps the code beside the source files.
_listed: Any = getattr(getattr(FunctionCache, "_impl_class", None), "_locator_classes", [])
_listed.insert(0, _KernelFolder)


@cache
def stamp(module: str) -> str:
    """Return a hash of the sources of `module`, and of what compiles them.

    That includes the modules of this project that it imports, and what those import.
    """
    sources: dict[str, bytes] = {}
    open_ = [module]
    while open_:
        name = open_.pop()
        if name.startswith(_OURS) and name not in sources:
            sources[name], imported = _read(name)
            open_ += imported
    versions = (numba.__version__, llvmlite.__version__, np.__version__, platform.python_version())
    content = repr((versions, sys.implementation.cache_tag, sorted(sources.items())))
    return hashlib.sha256(content.encode()).hexdigest()[:16]


@cache
def _read(module: str) -> tuple[bytes, list[str]]:
    """Return the content of a loaded module, and the names of the loaded modules that it imports.

    The content includes the arrays in its folder, which may be constants of its kernels.
    """
    path = Path(str(sys.modules[module].__file__))
    source = path.read_bytes()
    arrays = b"".join(each.read_bytes() for each in sorted(path.parent.glob("*.npy")))
    package = sys.modules[module].__package__
    imported = []
    for node in ast.parse(source).body:
        if isinstance(node, ast.Import):
            imported += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            origin = resolve_name("." * node.level + (node.module or ""), package)
            within = [f"{origin}.{alias.name}" for alias in node.names]
            imported += [name if name in sys.modules else origin for name in within]
    return source + arrays, [name for name in imported if name in sys.modules]


def _remove_old(folder: Path) -> None:
    """Remove the code of older versions of the module of `folder`, except the latest ones."""
    module = folder.name.rpartition("-")[0]
    others = sorted(folder.parent.glob(f"{module}-*"), key=lambda each: each.stat().st_mtime)
    for old in others[:-3]:  # the others may serve other environments
        shutil.rmtree(old, ignore_errors=True)


@cache
def _temporary() -> TemporaryDirectory[str]:
    """Return a folder that is removed when this process ends."""
    return TemporaryDirectory(prefix="prefcal-")
