"""Print the numbers that tell whether one person can keep the project in mind, beside their targets.

It counts by the rules of tests/test_imports.py and traces calls as the tests of the traces do.
"""

import argparse
import ast
import importlib
import sys
import tempfile
import tokenize
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "benchmarks"
SOURCE = {".py", ".js", ".css", ".html", ".j2"}
"""Endings of the files that count as source: Python, the page and the report."""
FORMULAS = ("Source: ", "eq. ")  # what a file with formulas says: where one comes from
PRAGMAS = ("# type:", "# noqa", "# pragma", "#!")
FOLDER, MEMBERS = 12, 20  # modules of a folder and public members of a class that a person can take in
Function = ast.FunctionDef | ast.AsyncFunctionDef


class Count(NamedTuple):
    """One number, its target, and the places that count."""

    what: str
    value: float
    target: float
    where: tuple[str, ...] = ()
    least: bool = False  # whether the target is the smallest good value instead of the largest

    @property
    def met(self) -> bool:
        """Return whether the number is as good as its target."""
        return self.value >= self.target if self.least else self.value <= self.target


def lines(files: Iterable[Path]) -> int:
    return sum(len(file.read_bytes().splitlines()) for file in files)


def sources(*folders: Path) -> list[Path]:
    found = (f for folder in folders for f in folder.rglob("*") if f.suffix in SOURCE and f.is_file())
    return [f for f in found if not f.name.endswith(".min.js")]  # plotly.js is not ours to read


def sizes(imports: Any) -> Iterator[Count]:
    """Yield how much there is to read."""
    product = lines(sources(*imports.FOLDERS.values()))
    rest = lines(f for f in sources(BENCHMARKS) if BENCHMARKS / "tests" not in f.parents)
    yield Count("source lines: five packages, scripts, page", product + rest, 52_000)
    yield Count("source lines of the product, without benchmarks/", product, 42_000)
    yield Count(
        "lines of tests, without those of the benchmark", lines((ROOT / "tests").rglob("*.py")), 32_000
    )


def ways(traces: Any) -> Iterator[Count]:
    """Yield through how many files calls go, and how often they cross from one to another."""
    found = [
        (f"proposal {experiment}, {make.func.__name__}", traces.proposal(make, experiment), 20, 300)
        for make, experiment in traces.PROPOSALS
    ]
    found += [
        (f"answer to next question, {name}", traces.answer(a), 25, 300) for name, a in traces.AGENTS.items()
    ]
    for name, agent in traces.AGENTS.items():
        with tempfile.TemporaryDirectory() as folder:
            found += [(f"own KPI, file to screen, {name}", traces.own_kpi(Path(folder), agent), 30, 500)]
    for what, trace, files, crossings in found:
        yield Count(f"{what}: files", trace.files, files)
        yield Count(f"{what}: crossings", trace.crossings, crossings)
        if what.startswith("answer"):
            yield Count(f"{what}: functions", trace.functions, 440)
            yield Count(f"{what}: stack in the median", trace.stack, 12)


def parts(imports: Any) -> Iterator[Count]:
    """Yield what there is to know, and what hides in functions."""
    package = BENCHMARKS / "prefcal_bench"
    files = [*(path for _, path in imports.FILES), *sorted(package.rglob("*.py"))]
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in files}
    classes = [n for tree in trees.values() for n in ast.walk(tree) if isinstance(n, ast.ClassDef)]
    yield _counted("class names that exist twice", Counter(c.name for c in classes), 1, 8)
    members = Counter({f"{c.name}:{c.lineno}": len(public_members(c)) for c in classes})
    yield _counted(f"classes with more than {MEMBERS} public members", members, MEMBERS, 0)
    yield Count("public names at the three doors", len(imports.public_names()), 60)
    late = Counter({_name(path): late_imports(tree) for path, tree in trees.items()})
    worst = tuple(f"{path} {count}" for path, count in late.most_common() if count)
    yield Count("imports inside functions", late.total(), 120, worst)
    scripts = (path for path in BENCHMARKS.rglob("*.py") if BENCHMARKS / "tests" not in path.parents)
    modules = [*files, *scripts]
    folders = Counter(_name(path.parent) for path in {*modules} if path.stem != "__init__")
    yield _counted(f"folders above {FOLDER} modules", folders, FOLDER, 0)
    yield Count("floors inside a package", max(map(len, imports.LAYERS.values())), imports.FLOORS)
    skip = f"# fmt: {'skip'}"  # not this line
    every = {*modules, *(ROOT / "tests").rglob("*.py"), *(BENCHMARKS / "tests").rglob("*.py")}
    yield Count(skip, sum(path.read_text(encoding="utf-8").count(skip) for path in every), 0)
    formulas = [path for path in trees if any(m in path.read_text(encoding="utf-8") for m in FORMULAS)]
    share = 1000 * sum(map(comments, formulas)) / lines(formulas)
    yield Count("comments per 1,000 lines in files with formulas", round(share), 40, least=True)


def _counted(what: str, counts: Counter[str], most: int, target: int) -> Count:
    where = tuple(f"{name} {count}" for name, count in counts.most_common() if count > most)
    return Count(what, len(where), target, where)


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def public_members(found: ast.ClassDef) -> set[str]:
    """Return the public methods, fields and attributes that a class states."""
    names = {node.name for node in found.body if isinstance(node, Function)}
    names |= {ast.unparse(node.target) for node in found.body if isinstance(node, ast.AnnAssign)}
    stored = (n for n in ast.walk(found) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store))
    names |= {node.attr for node in stored if ast.unparse(node.value) == "self"}
    return {name for name in names if not name.startswith("_")}


def late_imports(tree: ast.Module) -> int:
    """Return the number of import statements inside functions, those of nested ones once."""
    functions = [node for node in ast.walk(tree) if isinstance(node, Function)]
    inner = [node for function in functions for node in ast.walk(function)]
    return len({node for node in inner if isinstance(node, ast.Import | ast.ImportFrom)})


def comments(file: Path) -> int:
    """Return the number of lines with a comment for people."""
    with file.open("rb") as content:
        found = [
            token.string for token in tokenize.tokenize(content.readline) if token.type == tokenize.COMMENT
        ]
    return sum(not text.startswith(PRAGMAS) for text in found)


def rows(*, traced: bool = True) -> list[Count]:
    """Return all numbers; without `traced`, those that need no study to run."""
    sys.path[:0] = [str(ROOT / "tests")]
    imports = importlib.import_module("test_imports")
    found = [*sizes(imports), *parts(imports)]
    return [*found, *ways(importlib.import_module("support.traces"))] if traced else found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--where", action="store_true", help="name the places that count, the worst first")
    where = parser.parse_args().where
    for row in rows():
        sign = "≥" if row.least else "≤"
        print(
            f"{row.what:<58} {row.value:>7,} {sign} {row.target:>6,}  {'' if row.met else 'missed'}".rstrip()
        )
        for place in row.where if where else ():
            print(f"    {place}")


if __name__ == "__main__":
    main()
