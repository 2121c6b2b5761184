"""The headline over families of people, and what their questions were like."""

from collections.abc import Iterator, Sequence

import numpy as np

from .courses import Courses, mean_of
from .plan import OTHERS, SCREENING, Choice
from .tables import ANSWERS, Bar, Report, markdown

FIRST, WITHIN = 10, 5
"""Questions among which ties are counted, and within which a pair should not come again."""
_MEAN, _WORST = 1000.0, 500.0
"""Bars after ten answers, over the families that do not share the learner's form."""


def families(courses: Courses, choice: Choice) -> Report:
    """Return for each group of loops the headline, and the questions of every family."""
    report = Report([], [])
    counted = [taste for taste in choice.tastes if taste in OTHERS]
    for group, names in choice.loops.items():
        rows = list(_headlines(courses, choice.agents, counted, names))
        title = f"**{', '.join(counted)}**, {group} loops: mean (worst family) after answers"
        if rows:
            report.lines.extend(["", title, "", *markdown(["agent", *map(str, ANSWERS)], rows)])
            report.bars.extend(_bars(courses, group, counted, names))
        head = ["agent", "taste", f"ties among the first {FIRST}",
                f"pairs asked again within {WITHIN}", "pairs asked again"]  # fmt: skip
        rows = list(_questions(courses, choice, names))
        if rows:
            report.lines.extend(["", f"Questions, {group} loops", "", *markdown(head, rows)])
    return report


def by_family(
    courses: Courses, agent: str, tastes: Sequence[str], answers: int, names: Sequence[str]
) -> dict[str, float]:
    """Return the worth after so many answers of each family that has studies of so many."""
    found = {t: mean_of(courses.at(agent, t, answers, names)) for t in tastes}
    return {taste: worth.value for taste, worth in found.items() if worth is not None}


def _headlines(
    courses: Courses, agents: Sequence[str], tastes: Sequence[str], names: Sequence[str]
) -> Iterator[list[str]]:
    for agent in agents:
        cells = []
        for answers in ANSWERS:
            worths = by_family(courses, agent, tastes, answers, names)
            cells.append(_cell(worths) if worths and len(worths) == len(tastes) else "–")
        if any(cell != "–" for cell in cells):
            yield [agent, *cells]


def _cell(worths: dict[str, float]) -> str:
    worst = min(worths, key=worths.__getitem__)
    return f"{_mean(worths):.0f} ({worst} {worths[worst]:.0f})"


def _mean(worths: dict[str, float]) -> float:
    """Return the geometric mean, in which every family counts the same."""
    return float(np.exp(np.mean(np.log(list(worths.values())))))


def _bars(
    courses: Courses, group: str, tastes: Sequence[str], names: Sequence[str]
) -> Iterator[Bar]:
    worths = by_family(courses, SCREENING, tastes, 10, names)
    if len(worths) < len(OTHERS):
        return
    mean, worst = _mean(worths), min(worths.values())
    where = f"families of another form, {group}, after 10 answers"
    yield Bar(f"mean worth: {where}", f"{mean:.0f}", f"at least {_MEAN:.0f}", mean >= _MEAN)
    yield Bar(f"worst of the {where}", f"{worst:.0f}", f"at least {_WORST:.0f}", worst >= _WORST)


def _questions(courses: Courses, choice: Choice, names: Sequence[str]) -> Iterator[list[str]]:
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
