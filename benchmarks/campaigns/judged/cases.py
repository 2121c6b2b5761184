"""The reactor by its index, and the overtaking against fresh random θ and the paper's optimum."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from prefcal_bench.cells.result import Result
from prefcal_bench.people.sample import thetas
from prefcal_bench.problems import CSTR_BROAD, Outcome, Problem, prefer, problem
from prefcal_bench.results.paired import markdown
from prefcal_env.preferences.answer import Preference

from .plan import OVERTAKING_SHOWN

_SHOWN = (8, 12)
"""Numbers of experiments after which the reactor's index is told."""
_VERDICTS = {Preference.CHALLENGER: "better", Preference.TIE: "a tie", Preference.INCUMBENT: "worse"}


def reactor(results: Iterable[Result]) -> list[str]:
    """Return the index of the returned θ after 8 and 12 experiments; it is not among the KPIs."""
    rows = []
    for agent, found in _by_agent(results).items():
        after = [np.array([_index(result, shown) for result in found]) for shown in _SHOWN]
        cells = [f"{value:.4f}" for index in after for value in (np.median(index), index.max())]
        rows.append([agent, len(found), *cells])
    head = [f"{what} after {shown}" for shown in _SHOWN for what in ("median", "worst")]
    title = "Reactor: index of the returned θ"
    return ["", title, "", *markdown(["agent", "seeds", *head], rows)]


def _index(result: Result, shown: int) -> float:
    assert result.gaps is not None
    return result.gaps[min(shown, len(result.gaps)) - 1] + CSTR_BROAD


def overtaking(results: Iterable[Result], fresh: int, file: Path) -> list[str]:
    """Return the share of fresh random θ that the returned θ beat, and who beats the paper's.

    Args:
        results: Studies of the overtaking.
        fresh: Number of random θ, which no agent and no taste has seen.
        file: File that keeps the verdicts, so that they are computed once.
    """
    by_agent = _by_agent(results)
    bests = {result.best for found in by_agent.values() for result in found}
    verdicts, rows = _verdicts(sorted(bests), fresh, file), []
    for agent, found in by_agent.items():
        shares = [verdicts[_key(result.best)]["at least as good"] for result in found]
        paper = [verdicts[_key(result.best)]["paper"] for result in found]
        counts = [paper.count(word) for word in _VERDICTS.values()]
        rows.append([agent, len(found), f"{np.median(shares):.4f}", f"{min(shares):.4f}", *counts])
    head = [
        "agent",
        "seeds",
        f"not worse than random θ ({fresh}): median",
        "least",
        *(f"than the paper's: {word}" for word in _VERDICTS.values()),
    ]
    title = f"Overtaking: the returned θ after {OVERTAKING_SHOWN} experiments"
    return ["", title, "", *markdown(head, rows)]


def _verdicts(bests: Sequence[tuple[float, ...]], fresh: int, file: Path) -> dict[str, Any]:
    """Return by θ the share of random θ that are not better, and the verdict on the paper's."""
    known = json.loads(file.read_text()) if file.exists() else {}
    known = known if known.get("fresh") == fresh else {"fresh": fresh}
    where = problem("overtake")
    new = [best for best in bests if _key(best) not in known]
    ours = [where.outcome(np.array(best)) for best in new]
    assert where.paper is not None
    paper = where.outcome(where.paper)
    shares = _shares(where, ours, fresh) if new else []
    for best, run, share in zip(new, ours, shares, strict=True):
        known[_key(best)] = {"at least as good": share, "paper": _VERDICTS[_verdict(where, run, paper)]}
    file.write_text(json.dumps(known, indent=1))
    return known


def _shares(where: Problem, ours: Sequence[Outcome], fresh: int) -> list[float]:
    """Return for each of `ours` the share of fresh random θ that are not better."""
    assert where.scenario is not None
    drawn, losses = thetas(where.scenario, "fresh", fresh), np.zeros(len(ours))
    for theta in track(drawn, "random θ of the overtaking", console=Console(stderr=True)):
        other = where.outcome(theta)
        losses += [_verdict(where, run, other) is Preference.INCUMBENT for run in ours]
    return [float(share) for share in 1 - losses / fresh]


def _verdict(where: Problem, ours: Outcome, other: Outcome) -> Preference:
    assert where.referee is not None
    return prefer(where.referee, ours, other)


def _by_agent(results: Iterable[Result]) -> dict[str, list[Result]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        if not result.failure:
            found.setdefault(result.cell.agent, []).append(result)
    return found


def _key(theta: Sequence[float]) -> str:
    return " ".join(map(repr, theta))
