"""Tables of worth: of each kind of taste, of families of people, and of their questions."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from prefcal_bench.results.paired import interval, markdown, mean_of, ratio_of

from .courses import Courses, largest_fall
from .plan import NOISES, OTHERS, Selection

ANSWERS = (0, 3, 5, 10, 20, 50)
FIRST, WITHIN = 10, 5
"""Questions among which ties are counted, and within which a pair should not come again."""
_NOISY_AT = 20


def families(courses: Courses, choice: Selection) -> Iterator[str]:
    """Yield for each group of loops the headline, and the questions of every family.

    The headline is the mean over the families that do not share the learner's form.
    """
    counted = [taste for taste in choice.tastes if taste in OTHERS]
    for group, names in choice.loops.items():
        rows = list(_headlines(courses, choice.agents, counted, names))
        title = f"**{', '.join(counted)}**, {group} loops: mean (worst family) after answers"
        if rows:
            yield from ("", title, "", *markdown(["agent", *map(str, ANSWERS)], rows))
        head = [
            "agent",
            "taste",
            f"ties among the first {FIRST}",
            f"pairs asked again within {WITHIN}",
            "pairs asked again",
        ]
        rows = list(_questions(courses, choice, names))
        if rows:
            yield from ("", f"Questions, {group} loops", "", *markdown(head, rows))


def loops(courses: Courses, choice: Selection) -> Iterator[str]:
    """Yield the worth of all agents, a row for each kind of taste, by group of loops."""
    for group, names in choice.loops.items():
        rows = [
            [taste, *row] for taste in choice.tastes for row in _worths(courses, choice.agents, taste, names)
        ]
        yield from ("", f"{group} loops: worth after answers", "")
        yield from markdown(["taste", "agent", "studies", *map(str, ANSWERS)], rows)


def noise(courses: Courses, choice: Selection) -> Iterator[str]:
    """Yield what wrong answers leave of the worth, and how far it falls."""
    for group, names in choice.loops.items():
        rows = [
            row
            for kind in choice.noisy
            for agent in choice.agents
            for end in ("", *NOISES)
            for row in _noisy_row(courses, agent, kind, end, names)
        ]
        yield from ("", f"Wrong answers, {group} loops, after {_NOISY_AT} answers", "")
        yield from markdown(["agent", "taste", "worth", "of that without", "largest fall"], rows)


def hidden(courses: Courses, choice: Selection) -> Iterator[str]:
    """Yield the worth to people whose KPIs are withheld."""
    for group, names in choice.loops.items():
        rows = _worths(courses, choice.agents, "hidden", names)
        yield from ("", f"**hidden**, {group} loops: worth after answers", "")
        yield from markdown(["agent", "studies", *map(str, ANSWERS)], rows)


def _worths(courses: Courses, agents: Sequence[str], taste: str, names: Sequence[str]) -> Iterator[list[str]]:
    for agent in agents:
        found = [courses.at(agent, taste, answers, names) for answers in ANSWERS]
        if found[0]:
            yield [agent, str(len(found[0])), *(interval(mean_of(one)) for one in found)]


def _noisy_row(
    courses: Courses, agent: str, kind: str, end: str, names: Sequence[str]
) -> Iterator[list[str]]:
    """Yield one row of the table; none without studies."""
    curves = courses.along(agent, f"{kind}{end}", _NOISY_AT, names)
    if curves:
        ours = {study: float(curve[-1]) for study, curve in curves.items()}
        sure = courses.at(agent, kind, _NOISY_AT, names)
        kept = interval(ratio_of(ours, sure), 2) if end else ""
        fall = f"{100 * largest_fall(curves.values()):.0f} %"
        yield [agent, f"{kind}{end}", interval(mean_of(ours)), kept, fall]


def _headlines(
    courses: Courses, agents: Sequence[str], tastes: Sequence[str], names: Sequence[str]
) -> Iterator[list[str]]:
    """Yield for each agent the mean after so many answers, if every family has so many."""
    for agent in agents:
        cells = []
        for answers in ANSWERS:
            found = {t: mean_of(courses.at(agent, t, answers, names)) for t in tastes}
            worths = {taste: worth.value for taste, worth in found.items() if worth is not None}
            cells.append(_headline(worths) if worths and len(worths) == len(tastes) else "–")
        if any(cell != "–" for cell in cells):
            yield [agent, *cells]


def _headline(worths: Mapping[str, float]) -> str:
    """Return the geometric mean, in which every family counts the same, and the worst family."""
    worst, mean = min(worths, key=worths.__getitem__), np.exp(np.mean(np.log([*worths.values()])))
    return f"{mean:.0f} ({worst} {worths[worst]:.0f})"


def _questions(courses: Courses, choice: Selection, names: Sequence[str]) -> Iterator[list[str]]:
    for agent in choice.agents:
        for taste in choice.tastes:
            asked = courses.questions(agent, taste, FIRST, names)
            if asked:
                ties = np.mean([answer == 0 for one in asked for *_, answer in one[:FIRST]])
                soon, ever = (again(asked, within) for within in (WITHIN, None))
                yield [agent, taste, *(f"{100 * share:.0f} %" for share in (ties, soon, ever))]


def again(studies: Sequence[Sequence[tuple[int, int, int]]], within: int | None) -> float:
    """Return the share of questions whose pair was asked among the `within` before, or ever."""
    repeated = [
        {a, b} in [{c, d} for c, d, _ in asked[max(k - within, 0) if within else 0 : k]]
        for asked in studies
        for k, (a, b, _) in enumerate(asked)
    ]
    return float(np.mean(repeated)) if repeated else 0.0
