"""The rules of the house hold for the benchmark and its scripts, too."""

from pathlib import Path

import pytest

from support.rules import (
    assert_a_star_imports_every_public_name,
    assert_every_public_name_loads,
    assert_every_subpackage_is_there,
    assert_folders_stay_small,
    assert_imports_point_down,
    circle,
    long_functions,
    modules_of,
)

BENCHMARKS = Path(__file__).parents[1]
PACKAGE, TESTS = BENCHMARKS / "prefcal_bench", BENCHMARKS / "tests"
BELOW = ("prefcal_env", "prefcal_agents", "prefcal_scenarios", "prefcal_app")
LAYERS = (
    {"extras", "global_random", "loops", "peers", "people", "replay", "reproduce", "rl"},
    {"problems"},
    {"cells"},
    {"results"},
    {"published"},
    {"cli"},
)
LEARNERS = ("prefcal_bench.rl", "prefcal_bench.peers")
ALONE = {
    "torch": LEARNERS,
    "stable_baselines3": "prefcal_bench.rl",
    "glis": "prefcal_bench.peers",
    "optuna": "prefcal_bench.peers",
    "botorch": "prefcal_bench.peers",
    "gpytorch": "prefcal_bench.peers",
}
"""Foreign packages that one place alone may import, or two."""
FILES = modules_of({"prefcal_bench": PACKAGE})
SCRIPTS = [
    # Python starts a script with its own folder first in the path, so that names the modules.
    (".".join(parts[1:] or parts), path)
    for path in sorted(BENCHMARKS.rglob("*.py"))
    if not {PACKAGE, TESTS} & {*path.parents}
    for parts in [path.relative_to(BENCHMARKS).with_suffix("").parts]
]


@pytest.mark.parametrize(("module", "path"), FILES, ids=[name for name, _ in FILES])
def test_imports_point_down(module, path):
    assert_imports_point_down(module, path, BELOW, LAYERS, ALONE)


@pytest.mark.parametrize("files", [FILES, SCRIPTS], ids=["package", "scripts"])
def test_no_import_goes_in_a_circle(files):
    assert circle(files) is None


def test_folders_and_functions_stay_small_enough_to_be_seen_at_once():
    assert_folders_stay_small(BENCHMARKS, [TESTS])
    assert long_functions(BENCHMARKS, [TESTS]) == []


def test_what_the_package_exports_is_there_and_known_to_type_checkers():
    assert_every_public_name_loads("prefcal_bench", PACKAGE)
    assert_a_star_imports_every_public_name("prefcal_bench")
    assert_every_subpackage_is_there("prefcal_bench", PACKAGE)


def test_the_folder_of_the_package_is_none_itself():
    assert not (BENCHMARKS / "__init__.py").exists()
