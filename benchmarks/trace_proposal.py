"""Count our files that one proposal and its answer enter, and how often they alternate.

    python benchmarks/trace_proposal.py              # GLISp on a test function, and an interview
    python benchmarks/trace_proposal.py --files      # every file too, with its number of calls

Two counts, both of calls of Python functions in our three packages, returns not counted:

    crossings       consecutive calls in different files: the path that a reader follows
    between files   calls whose caller is our code in another file, without calls that come through
                    other libraries (for example, scipy calling an objective)

Both depend on the study: other seeds and functions give up to a quarter more or less, so compare
two revisions with the same command. From experiment 20 on GLISp alternates between two kinds of
proposals, hence two rows each. To trace another revision, put its checkout first in PYTHONPATH.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy is loaded
os.environ.setdefault("JAXTYPING_DISABLE", "1")

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

from same_studies import HARTMAN3, by, hartman3

import prefcal_agents
import prefcal_env
import prefcal_scenarios
from prefcal_agents import GLISp

PACKAGES = [Path(str(p.__file__)).parent for p in (prefcal_env, prefcal_agents, prefcal_scenarios)]
TESTS = PACKAGES[0].parent / "tests"
N_INIT, N_MAX, SEED = 6, 50, 0
TRACED = (30, 31)  # experiments, from 1


@dataclass(frozen=True, slots=True)
class Trace:
    """Trace of one piece of work.

    Args:
        calls: Number of calls by file.
        functions: Number of different functions.
        crossings: Number of consecutive calls in different files.
        between: Number of calls from our code in another file.
    """

    calls: Counter[str]
    functions: int
    crossings: int
    between: int


@cache
def own(path: str) -> str | None:
    """Return the short name of one of our files; None for all others."""
    for package in PACKAGES:
        if path.startswith(f"{package}{os.sep}"):
            return str(Path(path).relative_to(package.parent))
    return None


def trace(work: Callable[[], object]) -> Trace:
    """Run `work`, and watch every call."""
    calls: Counter[str] = Counter()
    functions, seen = set(), Counter[str]()
    last: str | None = None

    def watch(frame: FrameType, event: str, _: Any) -> None:
        nonlocal last
        here = own(frame.f_code.co_filename) if event == "call" else None
        if here is None:
            return
        calls[here] += 1
        functions.add(frame.f_code)
        caller = None if frame.f_back is None else own(frame.f_back.f_code.co_filename)
        seen["between"] += caller is not None and caller != here
        seen["crossings"] += last is not None and last != here
        last = here

    sys.setprofile(watch)
    try:
        work()
    finally:
        sys.setprofile(None)
    return Trace(calls, len(functions), seen["crossings"], seen["between"])


def in_agent() -> Iterator[tuple[str, Trace]]:
    """Trace ask and tell of GLISp on hartman3."""
    agent, reply = GLISp(HARTMAN3, n_init=N_INIT, n_max=N_MAX, seed=SEED), by(hartman3)

    def work() -> None:
        query = agent.ask()
        agent.tell(query, reply(query))

    for experiment in range(1, max(TRACED) + 1):
        if experiment in TRACED:
            yield f"GLISp, experiment {experiment}", trace(work)
        else:
            work()


def in_interview() -> Iterator[tuple[str, Trace]]:
    """Trace an answer and the question after it, in an interview about the toy of the tests."""
    sys.path.insert(0, str(TESTS))
    from scenarios.toy_scenario import toy
    from support.interviews import begin, judge, proceed

    def make(space: Any, **options: Any) -> GLISp:
        return GLISp(space, **{**options, "n_init": N_INIT})

    interview = begin(toy, n_max=N_MAX, seed=SEED, agent=make)

    def work() -> None:
        question = interview.now().question
        assert question is not None
        interview.answer(question.id, judge(question, toy.cost))
        proceed(interview)

    proceed(interview)
    for experiment in range(2, max(TRACED) + 1):  # the first is compared with nothing
        if experiment in TRACED:
            yield f"interview, experiment {experiment}", trace(work)
        else:
            work()


def table(traces: dict[str, Trace]) -> str:
    """Return Markdown."""
    lines = ["| traced | files | functions | calls | crossings | between files |"]
    lines += ["| --- " * 6 + "|"]
    for name, one in traces.items():
        numbers = (len(one.calls), one.functions, one.calls.total(), one.crossings, one.between)
        lines.append(f"| {name} | {' | '.join(f'{n:,}' for n in numbers)} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--files", action="store_true", help="list every file with its calls")
    args = parser.parse_args()
    traces = {**dict(in_agent()), **dict(in_interview())}
    print(table(traces))
    for name, one in traces.items() if args.files else ():
        print(f"\n{name}")
        for file, count in one.calls.most_common():
            print(f"{count:7,}  {file}")


if __name__ == "__main__":
    main()
