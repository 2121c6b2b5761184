"""Every annotated shape and type of ours is checked while the tests run.

A wrong shape stops the test where it first appears. Compiled modules, and what they compile, stay
as they are: a wrapped function does not compile. Tests with "refused" in their names, and those
marked `unchecked`, hand over wrong shapes on purpose.
"""

import os

# Two workers share two cores: with threads of their own they wait for each other, twice as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Iterator
from pathlib import Path

import hypothesis
import jaxtyping
import matplotlib as mpl
import pytest

from support.type_checker import jaxtyped

TESTS = Path(__file__).parent
ROOT = TESTS.parent
PACKAGES = {
    "prefcal_env": ROOT,
    "prefcal_agents": ROOT / "agents",
    "prefcal_scenarios": ROOT / "scenarios",
}
COMPILED_ELSEWHERE = {"prefcal_env.plants.integrate"}
WHOLE_STUDIES = {
    "agents/acquisition/test_expected_improvement",
    "agents/acquisition/test_penalty",
    "agents/glisp/test_questions",
    "agents/models/test_learned_cost",
    "agents/test_peers",
    "env/experiments/test_worst_case",
    "env/test_environments",
    "scenarios/app/cli/test_cli",
    "scenarios/app/cli/test_config",
    "scenarios/app/cli/test_earlier",
    "scenarios/app/cli/test_outcomes",
    "scenarios/app/cli/test_own",
    "scenarios/app/cli/test_pace",
    "scenarios/app/cli/test_processor",
    "scenarios/app/cli/test_respace",
    "scenarios/app/cli/test_studies",
    "scenarios/app/reproduce/test_reproduce",
    "scenarios/app/session/test_further",
    "scenarios/app/session/test_interview",
    "scenarios/app/session/test_pacing",
    "scenarios/app/session/test_resuming",
    "scenarios/cases/overtake/test_robust",
    "scenarios/test_failed_runs",
    "test_own_plant",
}
"""Files of tests that make the same calls thousands of times: checking each takes most of their
time, and the tests of the parts check the same shapes."""
UNCHECKED = "JAXTYPING_DISABLE" in os.environ
"""Whether nothing is checked: CI does so on its second Python."""

mpl.use("Agg")
# A busy machine is no failure.
# In CI the same examples every time: a run there judges the change, not the dice.
hypothesis.settings.register_profile("prefcal", deadline=None, derandomize="CI" in os.environ)
hypothesis.settings.load_profile("prefcal")


def checked_modules() -> list[str]:
    """Names of our modules that hold plain Python; no packages, whose names would cover all."""
    names = []
    for package, folder in PACKAGES.items():
        for path in sorted((folder / package).rglob("*.py")):
            name = ".".join(path.relative_to(folder).with_suffix("").parts)
            compiled = "import numba" in path.read_text(encoding="utf-8")
            if path.stem != "__init__" and not compiled and name not in COMPILED_ELSEWHERE:
                names.append(name)
    return names


if not UNCHECKED:
    jaxtyping.jaxtyped = jaxtyped  # the hook's decorator
    jaxtyping.install_import_hook(checked_modules(), "support.type_checker.check")


def pytest_configure(config: pytest.Config) -> None:
    """Announce the marker."""
    config.addinivalue_line("markers", "unchecked: hands over wrong shapes on purpose")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Check shapes, unless the test wants to see how wrong ones are refused."""
    wanted = item.get_closest_marker("unchecked") or "refused" in item.name
    whole = item.path.relative_to(TESTS).with_suffix("").as_posix() in WHOLE_STUDIES
    jaxtyping.config.update("jaxtyping_disable", UNCHECKED or whole or bool(wanted))
    try:
        return (yield)
    finally:
        jaxtyping.config.update("jaxtyping_disable", UNCHECKED)
