"""What every session of tests has: checked shapes, a cache of its own, and a browser to ask for.

Every annotated shape and type of ours is checked while the tests run. A wrong shape stops the test
where it first appears. Compiled modules, and what they compile, stay as they are: a wrapped function
does not compile. Tests with "refused" in their names, and those marked `unchecked`, hand over wrong
shapes on purpose.
"""

import os

# Two workers share two cores: with threads of their own they wait for each other, twice as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
from platformdirs import user_cache_path

# Sessions share what is compiled, although `_cache_home` gives each one a cache of its own.
os.environ.setdefault("NUMBA_CACHE_DIR", str(user_cache_path("prefcal", appauthor=False)))

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import hypothesis
import jaxtyping
import matplotlib as mpl
import pytest

from support.type_checker import Test, jaxtyped

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "prefcal_env": ROOT,
    "prefcal_agents": ROOT / "agents",
    "prefcal_scenarios": ROOT / "scenarios",
    "prefcal_app": ROOT / "app",
}
UNCHECKED = "JAXTYPING_DISABLE" in os.environ
"""Whether nothing is checked: CI does so on its second Python."""

mpl.use("Agg")
# A busy machine is no failure.
# The same examples every time: a run judges the change, not the dice. To search for new failures:
# pytest --hypothesis-profile explore
hypothesis.settings.register_profile("explore", deadline=None)
hypothesis.settings.register_profile("prefcal", deadline=None, derandomize=True)
hypothesis.settings.load_profile("prefcal")


@pytest.fixture(scope="session", autouse=True)
def _cache_home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the cache in a folder of the session, which its workers share: no test reads yours."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MPLCONFIGDIR", mpl.get_cachedir())  # finding all fonts takes seconds
        for name in ("XDG_CACHE_HOME", "WIN_PD_OVERRIDE_LOCAL_APPDATA"):
            patch.setenv(name, str(folder / "cache"))
        yield


@pytest.fixture(scope="module")
def running_browser() -> Iterator[Any]:
    """Chromium, headless."""
    from support.browser import chromium

    with chromium() as browser:
        yield browser


@pytest.fixture
def browser(running_browser: Any) -> Iterator[Any]:
    """The same chromium for every test; its pages are closed in the end, else they go on asking."""
    yield running_browser
    for context in running_browser.contexts:
        context.close()


def checked_modules(packages: Mapping[str, Path]) -> list[str]:
    """Names of the modules that hold plain Python; no packages, whose names would cover all."""
    names = []
    for package, folder in packages.items():
        for path in sorted((folder / package).rglob("*.py")):
            name = ".".join(path.relative_to(folder).with_suffix("").parts)
            compiled = "import numba" in path.read_text(encoding="utf-8")
            if path.stem != "__init__" and not compiled:
                names.append(name)
    return names


def check_shapes(packages: Mapping[str, Path]) -> None:
    """Check the shapes in these packages, which are in these folders, once they are imported."""
    if not UNCHECKED:
        jaxtyping.jaxtyped = jaxtyped  # the hook's decorator
        jaxtyping.install_import_hook(checked_modules(packages), "support.type_checker.check")


check_shapes(PACKAGES)


def pytest_configure(config: pytest.Config) -> None:
    """Announce the marker."""
    config.addinivalue_line("markers", "unchecked: hands over wrong shapes on purpose")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Check shapes in the first calls, unless the test wants to see how wrong ones are refused."""
    wanted = item.get_closest_marker("unchecked") or "refused" in item.name
    jaxtyping.config.update("jaxtyping_disable", UNCHECKED or bool(wanted))
    Test.number += 1
    try:
        return (yield)
    finally:
        jaxtyping.config.update("jaxtyping_disable", UNCHECKED)
