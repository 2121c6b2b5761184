"""Walk through the checklist of a release, as far as a machine can.

    python benchmarks/release/checklist.py [--out dist]  # all of it: some minutes
    python benchmarks/release/checklist.py --tag v1.2.3  # in the workflow: only what is written

Compares the version in every file that names it, builds the site as it is published, strictly and
with the version, and lets check.py build both distributions and try them without the repository.
What needs an account is printed at the end. Exits with 1 if anything is wrong.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
BY_HAND = """
By hand, each needs an account (CONTRIBUTING.md, "Switched off until an owner switches it on"):
- Tag this commit v{version} and push the tag. The workflow `release` builds and checks again, and waits.
- Approve the environment `pypi` of that run. Once before: the trusted publisher, and PUBLISH = yes.
- The workflow `docs` publishes the site of this version beside the others. Once before: the branch
  `gh-pages` is served, and PUBLISH_DOCS = yes.
- Once, when the repository has a public address: [project.urls], and absolute links for the README.
- Archive the release where it gets a DOI, and add `doi` to CITATION.cff for the next one."""


def project(folder: Path) -> dict[str, Any]:
    """Return what the pyproject.toml in `folder` says of the project."""
    found: dict[str, Any] = tomllib.loads((folder / "pyproject.toml").read_text("utf-8"))["project"]
    return found


def faults(root: Path, tag: str = "") -> Iterator[str]:
    """Yield a sentence for each file that does not name the version of `pyproject.toml` as it should."""
    version, benchmark = project(root)["version"], project(root / "benchmarks")
    if tag and tag != f"v{version}":
        yield f"the tag is {tag}, but the version {version}"
    if benchmark["version"] != version:
        yield f"benchmarks/pyproject.toml has version {benchmark['version']}, pyproject.toml {version}"
    if f"prefcal=={version}" not in benchmark["dependencies"]:
        yield f"benchmarks/pyproject.toml does not need prefcal=={version}"
    cited = (root / "CITATION.cff").read_text("utf-8")
    if not re.search(rf"^version: {re.escape(version)}$", cited, re.M):
        yield f"CITATION.cff does not say 'version: {version}'"
    dated = re.search(r"^date-released: [\"']?(\d{4}-\d\d-\d\d)", cited, re.M)
    if dated is None:
        yield "CITATION.cff has no 'date-released: YEAR-MONTH-DAY'"
    heading = rf"^## \[{re.escape(version)}\] - (\d{{4}}-\d\d-\d\d)$"
    found = re.search(heading, (root / "CHANGELOG.md").read_text("utf-8"), re.M)
    if found is None:
        yield f"CHANGELOG.md has no heading '## [{version}] - YEAR-MONTH-DAY'"
    elif dated is not None and found[1] != dated[1]:
        yield f"CHANGELOG.md dates the version {found[1]}, CITATION.cff {dated[1]}"


def run(what: str, *words: str, **environment: str) -> None:
    """Run a step; end with exit code 1 if it fails."""
    print(f"== {what}", flush=True)
    done = subprocess.run(words, cwd=ROOT, env=os.environ | environment, check=False)
    if done.returncode:
        sys.exit(f"failed: {what}")


def main() -> None:
    """Walk through the list; exit with 1 at the first step that is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", default="dist", help="empty folder for the distributions (dist)")
    parser.add_argument("--tag", default="", help="compare what is written with this tag, and end")
    given = parser.parse_args()
    print("== the version, in every file that names it", flush=True)
    if found := list(faults(ROOT, given.tag)):
        sys.exit("\n".join(found))
    if given.tag:
        return
    print("== a clean checkout", flush=True)
    listed = ("git", "status", "--porcelain")
    if left := subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout:
        sys.exit(f"commit first:\n{left}")
    if (ROOT / given.out).is_dir() and any((ROOT / given.out).iterdir()):
        sys.exit(f"{given.out} is not empty: name another folder with --out")
    version = project(ROOT)["version"]
    with tempfile.TemporaryDirectory() as site:
        words = ("-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", site)
        # As `mike deploy` builds it: with the choice of versions.
        as_mike = {"MIKE_DOCS_VERSION": version, "NO_MKDOCS_2_WARNING": "1"}
        run("the site, with versions and no warning", sys.executable, *words, **as_mike)
        run("its pages", sys.executable, "benchmarks/site/pages.py", site)
    check = ("benchmarks/release/check.py", "--out", given.out)
    run("both distributions, without the repository", sys.executable, *check)
    print(BY_HAND.format(version=version))


if __name__ == "__main__":
    main()
