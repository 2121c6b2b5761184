"""Tables of the campaign that judges Screening, one function for each of its parts.

A part's function takes its results and the options of `screening.py`, and returns lines of
Markdown.
"""

import json
from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich.console import Console
from rich.progress import track

from prefcal_bench import Result
from prefcal_bench.people.sample import thetas
from prefcal_bench.problems import CSTR_BROAD, Outcome, Problem, prefer, problem
from prefcal_bench.results.campaign import after_answers
from prefcal_bench.results.statistics import Pair, mean_of, ratio_of
from prefcal_bench.results.words import interval, markdown
from prefcal_env.preferences.answer import Preference

OTHERS = ("ideal", "majority", "ranks", "curves")
"""People with eyes whose form the learner does not have; the headline is about them."""
NOISES = ("-noisy10", "-noisy20")
ANSWERS = (0, 3, 5, 10, 20, 50)
FIRST, WITHIN = 10, 5  # questions among which ties are counted, and within which a pair should not come again
_NOISY_AT = 20
REACTOR_SHOWN, OVERTAKING_SHOWN = 12, 10
_SHOWN = (8, REACTOR_SHOWN)  # numbers of experiments after which the reactor's index is told
_VERDICTS = {Preference.CHALLENGER: "better", Preference.TIE: "a tie", Preference.INCUMBENT: "worse"}
Results = Sequence[Result]


# Studies of an agent with a kind of taste, after so many answers.


def shortest(
    results: Results, agent: str, taste: str, answers: int, loops: Sequence[str]
) -> dict[Pair, Result]:
    """Return the shortest studies with so many answers and a worth, by loop and seed."""
    mine = [r for r in results if (r.cell.agent, r.cell.calibrator) == (agent, taste) and r.worth is not None]
    n_max = min((r.cell.n_max for r in mine if r.cell.n_max > answers), default=None)
    chosen = (r for r in mine if r.cell.n_max == n_max and r.cell.problem in loops)
    return {(r.cell.problem, r.cell.seed): r for r in chosen}


def along(
    results: Results, agent: str, taste: str, answers: int, loops: Sequence[str]
) -> dict[Pair, Float[np.ndarray, " answers+1"]]:
    """Return the worth after 0, 1, ... answers; empty without studies of so many."""
    return {
        pair: after_answers(np.array(r.worth), np.array(r.questions), answers)
        for pair, r in shortest(results, agent, taste, answers, loops).items()
    }


def at(results: Results, agent: str, taste: str, answers: int, loops: Sequence[str]) -> dict[Pair, float]:
    """Return the worth after so many answers."""
    return {pair: float(c[-1]) for pair, c in along(results, agent, taste, answers, loops).items()}


def largest_fall(curves: Iterable[Float[np.ndarray, " N"]]) -> float:
    """Return the largest share that the median over the studies loses from its peak so far."""
    median = np.median(np.array(list(curves)), axis=0)
    return float(np.max(1 - median / np.maximum.accumulate(median)))


# Closed loops, by group.


def loops(results: Results, options: Namespace) -> Iterator[str]:
    """Yield for each group the headline and the questions; then the worth by kind of taste.

    The headline is the mean over the families that do not share the learner's form.
    """
    counted = [taste for taste in options.tastes if taste in OTHERS]
    ties, pairs = f"ties among the first {FIRST}", "pairs asked again"
    heads = ["agent", "taste", ties, f"{pairs} within {WITHIN}", pairs]
    for group, names in options.loops.items():
        title = f"**{', '.join(counted)}**, {group} loops: mean (worst family) after answers"
        rows = list(_headlines(results, options.agents, counted, names))
        yield from markdown(["agent", *map(str, ANSWERS)], rows, title) if rows else ()
        rows = list(_questions(results, options, names))
        yield from markdown(heads, rows, f"Questions, {group} loops") if rows else ()
    for group, names in options.loops.items():
        heads = ["taste", "agent", "studies", *map(str, ANSWERS)]
        tastes = options.tastes
        rows = [[t, *row] for t in tastes for row in _worths(results, options.agents, t, names)]
        yield from markdown(heads, rows, f"{group} loops: worth after answers")


def noise(results: Results, options: Namespace) -> Iterator[str]:
    """Yield what wrong answers leave of the worth, and how far it falls."""
    for group, names in options.loops.items():
        rows = [
            row
            for kind in options.noisy
            for agent in options.agents
            for end in ("", *NOISES)
            for row in _noisy_row(results, agent, kind, end, names)
        ]
        title = f"Wrong answers, {group} loops, after {_NOISY_AT} answers"
        yield from markdown(["agent", "taste", "worth", "of that without", "largest fall"], rows, title)


def hidden(results: Results, options: Namespace) -> Iterator[str]:
    """Yield the worth to people whose KPIs are withheld."""
    for group, names in options.loops.items():
        rows = list(_worths(results, options.agents, "hidden", names))
        title = f"**hidden**, {group} loops: worth after answers"
        yield from markdown(["agent", "studies", *map(str, ANSWERS)], rows, title)


def _worths(results: Results, agents: Sequence[str], taste: str, names: Sequence[str]) -> Iterator[list[str]]:
    for agent in agents:
        found = [at(results, agent, taste, answers, names) for answers in ANSWERS]
        if found[0]:
            yield [agent, str(len(found[0])), *(interval(mean_of(one)) for one in found)]


def _noisy_row(
    results: Results, agent: str, kind: str, end: str, names: Sequence[str]
) -> Iterator[list[str]]:
    """Yield one row of the table; none without studies."""
    curves = along(results, agent, f"{kind}{end}", _NOISY_AT, names)
    if curves:
        ours = {pair: float(curve[-1]) for pair, curve in curves.items()}
        kept = interval(ratio_of(ours, at(results, agent, kind, _NOISY_AT, names)), 2) if end else ""
        fall = f"{100 * largest_fall(curves.values()):.0f} %"
        yield [agent, f"{kind}{end}", interval(mean_of(ours)), kept, fall]


def _headlines(
    results: Results, agents: Sequence[str], tastes: Sequence[str], names: Sequence[str]
) -> Iterator[list[str]]:
    """Yield for each agent the mean after so many answers, if every family has so many.

    It is geometric, every family counts the same, and the worst one is beside it.
    """
    for agent in agents:
        cells = []
        for answers in ANSWERS:
            found = {taste: mean_of(at(results, agent, taste, answers, names)) for taste in tastes}
            worths = {taste: worth.value for taste, worth in found.items() if worth is not None}
            if not worths or len(worths) < len(tastes):
                cells.append("–")
                continue
            worst, mean = min(worths, key=worths.__getitem__), np.exp(np.mean(np.log([*worths.values()])))
            cells.append(f"{mean:.0f} ({worst} {worths[worst]:.0f})")
        if any(cell != "–" for cell in cells):
            yield [agent, *cells]


def _questions(results: Results, options: Namespace, names: Sequence[str]) -> Iterator[list[str]]:
    for agent in options.agents:
        for taste in options.tastes:
            studies = shortest(results, agent, taste, FIRST, names).values()
            if asked := [study.comparisons for study in studies if study.comparisons]:
                ties = np.mean([answer == 0 for one in asked for *_, answer in one[:FIRST]])
                shares = (ties, again(asked, WITHIN), again(asked, None))
                yield [agent, taste, *(f"{100 * share:.0f} %" for share in shares)]


def again(studies: Sequence[Sequence[tuple[int, int, int]]], within: int | None) -> float:
    """Return the share of questions whose pair was asked among the `within` before, or ever."""
    repeated = [
        {a, b} in [{c, d} for c, d, _ in asked[max(k - within, 0) if within else 0 : k]]
        for asked in studies
        for k, (a, b, _) in enumerate(asked)
    ]
    return float(np.mean(repeated)) if repeated else 0.0


# The paper's cases.


def reactor(results: Results, options: Namespace) -> list[str]:
    """Return the index of the returned θ after 8 and 12 experiments; it is not among the KPIs."""
    rows = []
    for agent, found in _by_agent(results).items():
        after = [np.array([_index(result, shown) for result in found]) for shown in _SHOWN]
        cells = [f"{value:.4f}" for index in after for value in (np.median(index), index.max())]
        rows.append([agent, len(found), *cells])
    heads = [f"{what} after {shown}" for shown in _SHOWN for what in ("median", "worst")]
    return markdown(["agent", "seeds", *heads], rows, "Reactor: index of the returned θ")


def _index(result: Result, shown: int) -> float:
    assert result.gaps is not None
    return result.gaps[min(shown, len(result.gaps)) - 1] + CSTR_BROAD


def overtaking(results: Results, options: Namespace) -> list[str]:
    """Return the share of fresh random θ that the returned θ beat, and who beats the paper's.

    No agent and no taste has seen the fresh θ. Verdicts are kept in the folder, so that they are
    computed once.
    """
    by_agent = _by_agent(results)
    bests = {result.best for found in by_agent.values() for result in found}
    verdicts, rows = _verdicts(sorted(bests), options.fresh, options.out / "overtaking.json"), []
    for agent, found in by_agent.items():
        shares = [verdicts[_key(result.best)]["at least as good"] for result in found]
        paper = [verdicts[_key(result.best)]["paper"] for result in found]
        counts = [paper.count(word) for word in _VERDICTS.values()]
        rows.append([agent, len(found), f"{np.median(shares):.4f}", f"{min(shares):.4f}", *counts])
    share = f"not worse than random θ ({options.fresh}): median"
    heads = ["agent", "seeds", share, "least", *(f"than the paper's: {word}" for word in _VERDICTS.values())]
    return markdown(heads, rows, f"Overtaking: the returned θ after {OVERTAKING_SHOWN} experiments")


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


def _by_agent(results: Results) -> dict[str, list[Result]]:
    found: dict[str, list[Result]] = {}
    for result in results:
        if not result.failure:
            found.setdefault(result.cell.agent, []).append(result)
    return found


def _key(theta: Sequence[float]) -> str:
    return " ".join(map(repr, theta))
