"""Measure Screening where people tune, against screening without learning and other agents.

    python benchmarks/campaigns/screening.py --out results            # all parts: many hours
    python benchmarks/campaigns/screening.py --out results --parts loops --loops held-out --seeds 4
    python benchmarks/campaigns/screening.py --out results --parts loops --loops rough-held-out
    python benchmarks/campaigns/screening.py --out results --agents Screening --again
    python benchmarks/campaigns/screening.py --quick --out look       # less than a minute

Studies that are in the folder do not run again: the same line resumes after an interruption, and
studies of more seeds or agents join. An agent whose code changed without a new version needs
`--again`, which first drops the results of `--agents` in the chosen parts; resume without it.

loops       worth after 0, 3, 5, 10, 20 and 50 answers, for each kind of taste; first the mean over
            the families that do not share the learner's form, with the worst one
noise       the same tastes with 10 and 20 % wrong answers: what is left, and how far it falls
hidden      people whose KPIs are withheld, against GLISp on θ alone
reactor     index after 8 and 12 experiments; the index is not among the KPIs
overtaking  share of fresh random θ that are not better, and verdicts on the paper's optimum

Every question that a person sees is an answer, repeated ones too.
All figures of worth are geometric means in which every loop counts the same, with 95 % bootstrap
intervals over the seeds of each loop. The folder gets raw.parquet (every comparison, see
docs/own_agent.md), screening.md with all tables, and a file for each study in results/.
Of each agent, the shortest studies with so many answers count.
"""

import argparse
import os
import sys

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one study is one thread

from collections.abc import Iterator, Sequence
from pathlib import Path

from judged import cases, tables
from judged.courses import Courses
from judged.plan import AGENTS, DEVELOPED, GROUPS, RANDOM, TASTES, Selection, suites
from rich.console import Console

from prefcal_bench.cells.engine import Processes
from prefcal_bench.cells.result import Result
from prefcal_bench.cells.roster import entry
from prefcal_bench.cells.runner import run_suite
from prefcal_bench.cells.store import Store
from prefcal_bench.cells.suite import Suite
from prefcal_bench.cli.display import BenchDisplay
from prefcal_bench.published import write_raw
from prefcal_env.errors import PrefcalError

PARTS = ("loops", "noise", "hidden", "reactor", "overtaking")
_NOISY = ("weights", "priorities")
_GROUPS = [group for group in GROUPS if group not in DEVELOPED]
_QUICK_LOOPS = {"named": ("lag",)}


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("prefcal-screening"), metavar="FOLDER")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--agents", nargs="+", choices=AGENTS, default=list(AGENTS))
    parser.add_argument(
        "--loops",
        nargs="+",
        default=_GROUPS,
        metavar="GROUP",
        help=f"groups ({', '.join(GROUPS)}) or names of loops",
    )
    parser.add_argument("--tastes", nargs="+", choices=TASTES, default=list(TASTES))
    parser.add_argument(
        "--noisy", nargs="+", choices=TASTES, default=list(_NOISY), help="kinds of taste of the part noise"
    )
    parser.add_argument("--seeds", type=int, default=4, help="seeds of each loop and taste")
    parser.add_argument("--case-seeds", type=int, default=20, help="seeds of reactor and overtaking")
    parser.add_argument(
        "--longest",
        type=int,
        choices=(10, 20, 50),
        default=20,
        help="most answers that Screening gets on the loops",
    )
    parser.add_argument("--fresh", type=int, default=1000, help="random θ of the overtaking")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--again", action="store_true", help="drop the agents' results first")
    parser.add_argument("--report", action="store_true", help="run nothing, report what is there")
    parser.add_argument(
        "--quick", action="store_true", help="one seed of one loop; random search on the cases"
    )
    return parser.parse_args(words)


def choice_of(options: argparse.Namespace) -> Selection:
    """Return what the options select."""
    if options.quick:
        return Selection(AGENTS[:-1], dict(_QUICK_LOOPS), _NOISY, _NOISY[1:], 1, 1, (RANDOM,), 20)
    loops: dict[str, Sequence[str]] = {n: GROUPS[n] for n in options.loops if n in GROUPS}
    named = [name for name in options.loops if name not in GROUPS]
    loops |= {"chosen": named} if named else {}
    return Selection(
        options.agents,
        loops,
        options.tastes,
        options.noisy,
        options.seeds,
        options.case_seeds,
        options.agents,
        options.longest,
    )


def run(todo: Sequence[Suite], store: Store, options: argparse.Namespace) -> None:
    """Run the missing studies of all suites."""
    if options.again:
        for cell in {cell for suite in todo for cell in suite.cells}:
            store.path(cell).unlink(missing_ok=True)
    with BenchDisplay(Console(stderr=True)) as display:
        for suite in todo:
            for words in suite.left_out:
                display.say(f"Left out: {words}")
            workers = None if options.quick else Processes(options.jobs)
            run_suite(suite, store, workers, display)


def stored(todo: Sequence[Suite], store: Store) -> list[Result]:
    """Return the stored results of suites, each once."""
    cells = dict.fromkeys(cell for suite in todo for cell in suite.cells)
    found = (store.find(cell)[0] for cell in cells)
    return [result for result in found if result is not None]


def lines_of(
    options: argparse.Namespace, choice: Selection, results: dict[str, list[Result]]
) -> Iterator[str]:
    """Yield the tables of each part."""
    for part, some in results.items():
        if part == "reactor":
            yield from cases.reactor(some)
        elif part == "overtaking":
            fresh = 20 if options.quick else options.fresh
            yield from cases.overtaking(some, fresh, options.out / "overtaking.json")
        else:
            courses = Courses.of(some)
            if part == "loops":
                yield from tables.families(courses, choice)
            yield from getattr(tables, part)(courses, choice)


def main(words: Sequence[str] | None = None) -> int:
    """Run the missing studies and write the page; return 1 if a study failed."""
    options = options_of(words)
    choice, store = choice_of(options), Store(options.out)
    todo = {part: list(suites(part, choice)) for part in options.parts}
    every = [suite for some in todo.values() for suite in some]
    if not options.report:
        try:
            run(every, store, options)
        except KeyboardInterrupt:
            print(f"Stopped; finished studies are kept in {options.out}.", file=sys.stderr)
            return 130
    results = {part: stored(some, store) for part, some in todo.items()}
    flat = list({r.cell: r for some in results.values() for r in some}.values())
    missing = (entry(agent).missing for agent in choice.agents)
    failed = (f"{result.cell}: {result.failure}" for result in flat if result.failure)
    absent = [f"- {words}" for words in (*missing, *failed) if words]
    lines = ["## Tables", *lines_of(options, choice, results)]
    text = "\n".join([*lines, "", "## Not run or failed", "", *absent, ""])
    (options.out / "screening.md").write_text(text, encoding="utf-8")
    write_raw(flat, options.out / "raw.parquet")
    print(text)
    return 1 if any(result.failure for result in flat) else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except PrefcalError as error:
        sys.exit(str(error))
