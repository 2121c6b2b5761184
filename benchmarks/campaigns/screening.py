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

import screening_tables as tables
from rich.console import Console
from screening_tables import NOISES, OTHERS, OVERTAKING_SHOWN, REACTOR_SHOWN

from prefcal_bench.cells.cell import Result
from prefcal_bench.cells.engine import Processes
from prefcal_bench.cells.roster import entry
from prefcal_bench.cells.runner import run_suite
from prefcal_bench.cells.store import Store
from prefcal_bench.cells.suite import Suite
from prefcal_bench.cli.display import BenchDisplay
from prefcal_bench.published import write_raw
from prefcal_env.errors import PrefcalError
from prefcal_scenarios.names import CLOSED_LOOPS

PARTS = ("loops", "noise", "hidden", "reactor", "overtaking")
SCREENING, GLISP, RANDOM, PEER = "Screening", "GLISp", "RandomSearch", "BOPE"
AGENTS = (SCREENING, "EqualWeights", GLISP, "GLISp.no-outcomes", RANDOM, PEER)
GROUPS = {
    "held-out": tuple(f"loop-{number}" for number in range(900, 915)),
    "named": tuple(name for name in CLOSED_LOOPS if not name.startswith("mpc-")),
    "cases": ("cstr", "overtake"),
    "rough": tuple(f"rough-{number}" for number in range(8)),
    "rough-held-out": tuple(f"rough-{number}" for number in range(900, 915)),
}
"""Loops by group. Nobody develops or tunes an agent on those that are held out."""
DEVELOPED = ("rough",)  # groups on which agents are developed: they run only if asked for
TASTES = ("weights", "priorities", "limits", "narrow", "rising", "trade", "order", *OTHERS)
"""The first five notice every difference, at least in the end. The learner has trade-offs and
orders, too."""
_NOISY = ("weights", "priorities")
_N_INIT = 10


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return the options of the command line; `loops` are the names of loops by group."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    groups = [group for group in GROUPS if group not in DEVELOPED]
    of_loops = f"groups ({', '.join(GROUPS)}) or names of loops"
    of_noise = "kinds of taste of the part noise"
    of_quick = "one seed of one loop; random search on the cases"
    add = parser.add_argument
    add("--out", type=Path, default=Path("prefcal-screening"), metavar="FOLDER")
    add("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    add("--agents", nargs="+", choices=AGENTS, default=list(AGENTS))
    add("--loops", nargs="+", default=groups, metavar="GROUP", help=of_loops)
    add("--tastes", nargs="+", choices=TASTES, default=list(TASTES))
    add("--noisy", nargs="+", choices=TASTES, default=list(_NOISY), help=of_noise)
    add("--seeds", type=int, default=4, help="seeds of each loop and taste")
    add("--case-seeds", type=int, default=20, help="seeds of reactor and overtaking")
    of_longest = "most answers that Screening gets on the loops"
    add("--longest", type=int, choices=(10, 20, 50), default=20, help=of_longest)
    add("--fresh", type=int, default=1000, help="random θ of the overtaking")
    add("--jobs", type=int, default=1, help="processes")
    add("--again", action="store_true", help="drop the agents' results first")
    add("--report", action="store_true", help="run nothing, report what is there")
    add("--quick", action="store_true", help=of_quick)
    options = parser.parse_args(words)
    named = [name for name in options.loops if name not in GROUPS]
    options.loops = {name: GROUPS[name] for name in options.loops if name in GROUPS}
    options.loops |= {"chosen": named} if named else {}
    options.case_agents = options.agents
    if options.quick:
        options.agents, options.case_agents, options.loops = AGENTS[:-1], (RANDOM,), {"named": ("lag",)}
        options.tastes, options.noisy = _NOISY, _NOISY[1:]
        options.seeds, options.case_seeds, options.longest, options.fresh = 1, 1, 20, 20
    return options


def suites(part: str, options: argparse.Namespace) -> Iterator[Suite]:
    """Yield the suites of a part: one for each number of experiments.

    Agents of which the number of experiments changes no experiment run once, for the longest.
    """
    if part in ("reactor", "overtaking"):
        case = {
            "reactor": ("cstr", "perfect", REACTOR_SHOWN),
            "overtaking": ("overtake", "lexicographic", OVERTAKING_SHOWN),
        }
        where, calibrator, n_max = case[part]
        yield _suite(options.case_agents, (where,), (calibrator,), options.case_seeds, n_max)
        return
    tastes = {
        "loops": tuple(options.tastes),
        "noise": tuple(f"{kind}{end}" for kind in options.noisy for end in ("", *NOISES)),
        "hidden": ("hidden",),
    }[part]
    by_budget: dict[int, list[str]] = {}
    for agent in options.agents:
        for n_max in _budgets(part, agent, options.longest):
            by_budget.setdefault(n_max, []).append(agent)
    loops = tuple(loop for group in options.loops.values() for loop in group)
    for n_max, agents in sorted(by_budget.items()):
        yield _suite(agents, loops, tastes, options.seeds, n_max)


def _budgets(part: str, agent: str, longest: int) -> tuple[int, ...]:
    """Return the numbers of experiments of an agent's studies; none if it is not in the part."""
    if part == "noise":
        return {SCREENING: (21,), GLISP: (51,)}.get(agent, ())
    if part == "hidden":
        return () if agent == PEER else (51,)
    if agent == SCREENING:  # it plans ahead for the number that is shown
        return tuple(answers + 1 for answers in (10, 20, 50) if answers <= longest)
    return (21,) if agent == PEER else (51,)


def _suite(
    agents: Sequence[str], loops: Sequence[str], tastes: Sequence[str], seeds: int, n_max: int
) -> Suite:
    n_init = min(_N_INIT, n_max // 2)  # as `prefcal bench` chooses it
    return Suite(tuple(agents), tuple(loops), tastes, seeds, n_init, n_max)


def run(todo: Sequence[Suite], store: Store, options: argparse.Namespace) -> None:
    """Run the missing studies of all suites."""
    if options.again:
        for cell in {cell for suite in todo for cell in suite.cells}:
            store.path(cell).unlink(missing_ok=True)
    with BenchDisplay(Console(stderr=True)) as display:
        for suite in todo:
            for words in suite.left_out:
                display.say(f"Left out: {words}")
            run_suite(suite, store, None if options.quick else Processes(options.jobs), display)


def stored(todo: Sequence[Suite], store: Store) -> list[Result]:
    """Return the stored results of suites, each once."""
    cells = dict.fromkeys(cell for suite in todo for cell in suite.cells)
    found = (store.find(cell)[0] for cell in cells)
    return [result for result in found if result is not None]


def main(words: Sequence[str] | None = None) -> int:
    """Run the missing studies and write the page; return 1 if a study failed."""
    options = options_of(words)
    store, todo = Store(options.out), {part: list(suites(part, options)) for part in options.parts}
    if not options.report:
        try:
            run([suite for some in todo.values() for suite in some], store, options)
        except KeyboardInterrupt:
            print(f"Stopped; finished studies are kept in {options.out}.", file=sys.stderr)
            return 130
    results = {part: stored(some, store) for part, some in todo.items()}
    flat = list({r.cell: r for some in results.values() for r in some}.values())
    missing = (entry(agent).missing for agent in options.agents)
    failed = (f"{result.cell}: {result.failure}" for result in flat if result.failure)
    absent = [f"- {words}" for words in (*missing, *failed) if words]
    lines = [line for part, some in results.items() for line in getattr(tables, part)(some, options)]
    text = "\n".join(["## Tables", *lines, "", "## Not run or failed", "", *absent, ""])
    (options.out / "screening.md").write_text(text, encoding="utf-8")
    write_raw(flat, options.out / "raw.parquet")
    print(text)
    return 1 if any(result.failure for result in flat) else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except PrefcalError as error:
        sys.exit(str(error))
