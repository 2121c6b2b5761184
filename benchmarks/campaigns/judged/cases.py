"""The reactor by its index, and the overtaking against fresh random θ and the paper's optimum."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from prefcal_bench import Result
from prefcal_bench.problems import CSTR_BROAD, Outcome, Problem, prefer, problem
from prefcal_env.preferences.answer import Preference
from prefcal_scenarios.tastes.sample import thetas

from .plan import OVERTAKING_SHOWN, SCREENING
from .tables import Bar, Report, markdown

_INDEX = {8: 0.705, 12: 0.697}
"""Bar of the median index by number of experiments shown."""
_WORST_INDEX = 0.75
_SHARE, _PREFERRED = 0.985, 0.95
_VERDICTS = {
    Preference.CHALLENGER: "better",
    Preference.TIE: "a tie",
    Preference.INCUMBENT: "worse",
}


def reactor(results: Iterable[Result]) -> Report:
    """Return the index of the returned θ after 8 and 12 experiments; it is not among the KPIs."""
    by_agent = _by_agent(results)
    rows, bars = [], []
    for agent, found in by_agent.items():
        row = [agent, str(len(found))]
        for shown, bar in _INDEX.items():
            index = np.array([_index(result, shown) for result in found])
            median, worst = float(np.median(index)), float(index.max())
            row += [f"{median:.4f}", f"{worst:.4f}"]
            if agent == SCREENING:
                what = f"reactor: median index after {shown} shown"
                bars.append(Bar(what, f"{median:.4f}", f"at most {bar:g}", median <= bar))
        if agent == SCREENING:
            what = f"reactor: worst index after {max(_INDEX)} shown"
            met = worst <= _WORST_INDEX
            bars.append(Bar(what, f"{worst:.4f}", f"at most {_WORST_INDEX:g}", met))
        rows.append(row)
    head = ["agent", "seeds"]
    head += [f"{what} after {shown}" for shown in _INDEX for what in ("median", "worst")]
    return Report(["", "Reactor: index of the returned θ", "", *markdown(head, rows)], bars)


def _index(result: Result, shown: int) -> float:
    assert result.gaps is not None
    return result.gaps[min(shown, len(result.gaps)) - 1] + CSTR_BROAD


def overtaking(results: Iterable[Result], fresh: int, file: Path) -> Report:
    """Return the share of fresh random θ that the returned θ beat, and who beats the paper's.

    Args:
        results: Studies of the overtaking.
        fresh: Number of random θ, which no agent and no taste has seen.
        file: File that keeps the verdicts, so that they are computed once.
    """
    by_agent = _by_agent(results)
    bests = {result.best for found in by_agent.values() for result in found}
    verdicts = _verdicts(sorted(bests), fresh, file)
    rows, bars = [], []
    for agent, found in by_agent.items():
        shares = [verdicts[_key(result.best)]["at least as good"] for result in found]
        paper = [verdicts[_key(result.best)]["paper"] for result in found]
        counts = [str(paper.count(word)) for word in _VERDICTS.values()]
        median, least = float(np.median(shares)), min(shares)
        rows.append([agent, str(len(found)), f"{median:.4f}", f"{least:.4f}", *counts])
        if agent == SCREENING:
            preferred = paper.count("better")
            where = f"overtaking, {OVERTAKING_SHOWN} shown"
            bars.append(Bar(f"{where}: median share of random θ that are not better",
                            f"{median:.4f}", f"at least {_SHARE:g}", median >= _SHARE))  # fmt: skip
            bars.append(Bar(f"{where}: preferred to the paper's optimum",
                            f"{preferred} of {len(paper)}", f"at least {100 * _PREFERRED:.0f} %",
                            preferred >= _PREFERRED * len(paper)))  # fmt: skip
    head = ["agent", "seeds", f"not worse than random θ ({fresh}): median", "least",
            *(f"than the paper's: {word}" for word in _VERDICTS.values())]  # fmt: skip
    title = f"Overtaking: the returned θ after {OVERTAKING_SHOWN} experiments"
    return Report(["", title, "", *markdown(head, rows)], bars)


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
        known[_key(best)] = {
            "at least as good": share, "paper": _VERDICTS[_verdict(where, run, paper)],
        }  # fmt: skip
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
