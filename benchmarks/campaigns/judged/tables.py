"""Tables of worth in Markdown, and the bars that Screening is measured against."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from prefcal_bench.results.statistics import Estimate

from .courses import Courses, largest_fall, mean_of, ratio_of
from .plan import EQUAL, NOISES, SCREENING, SEEING_ALL, THETA, Choice

ANSWERS = (0, 3, 5, 10, 20, 50)
WORTHS = {3: 200.0, 5: 400.0, 10: 1000.0}
"""Bar of worth by number of answers."""
SPARSE = ("priorities", "narrow")
"""Tastes on which it has to be above equal weights."""
_NOISY_AT, _HIDDEN_AT = 20, 50
_KEPT = dict(zip(NOISES, (1 / 2, 1 / 3), strict=True))
_FALL = 1 / 3


@dataclass(frozen=True)
class Bar:
    """One bar: what is measured, the figure, the bar as text, and whether it is met."""

    what: str
    figure: str
    bar: str
    met: bool


@dataclass(frozen=True)
class Report:
    """A part's tables as lines of Markdown, and its bars."""

    lines: list[str]
    bars: list[Bar]


def loops(courses: Courses, choice: Choice) -> Report:
    """Return the worth of all agents, a row for each kind of taste, by group of loops."""
    report, head = Report([], []), ["taste", "agent", "studies", *map(str, ANSWERS)]
    for group, names in choice.loops.items():
        rows = [
            [taste, *row]
            for taste in choice.tastes
            for row in _worths(courses, choice.agents, taste, names)
        ]
        report.lines.extend(["", f"{group} loops: worth after answers", "", *markdown(head, rows)])
        for taste in choice.tastes:
            if taste in SEEING_ALL:
                report.bars.extend(_worth_bars(courses, group, taste, names))
    return report


def noise(courses: Courses, choice: Choice) -> Report:
    """Return what wrong answers leave of the worth, and how far it falls."""
    report, head = Report([], []), ["agent", "taste", "worth", "of that without", "largest fall"]
    for group, names in choice.loops.items():
        rows = []
        for kind in choice.noisy:
            for agent in choice.agents:
                for end in ("", *NOISES):
                    rows += _noisy_row(courses, agent, kind, end, names)
            report.bars.extend(_noise_bars(courses, group, kind, names))
        report.lines.extend(["", f"Wrong answers, {group} loops, after {_NOISY_AT} answers", ""])
        report.lines.extend(markdown(head, rows))
    return report


def hidden(courses: Courses, choice: Choice) -> Report:
    """Return the worth to people whose KPIs are withheld, against GLISp on θ alone."""
    report = Report([], [])
    for group, names in choice.loops.items():
        rows = list(_worths(courses, choice.agents, "hidden", names))
        report.lines.extend(["", f"**hidden**, {group} loops: worth after answers", ""])
        report.lines.extend(markdown(["agent", "studies", *map(str, ANSWERS)], rows))
        both = (courses.at(a, "hidden", _HIDDEN_AT, names) for a in (SCREENING, THETA))
        ratio = ratio_of(*both)
        if ratio is not None:
            what = f"hidden, {group}: {SCREENING} / {THETA} after {_HIDDEN_AT} answers"
            report.bars.append(Bar(what, interval(ratio, 2), "at least 1", ratio.value >= 1))
    return report


def _worths(
    courses: Courses, agents: Sequence[str], taste: str, names: Sequence[str]
) -> Iterator[list[str]]:
    for agent in agents:
        found = [courses.at(agent, taste, answers, names) for answers in ANSWERS]
        if found[0]:
            cells = [interval(mean_of(one)) for one in found]
            yield [agent, str(len(found[0])), *cells]


def _worth_bars(courses: Courses, group: str, taste: str, names: Sequence[str]) -> Iterator[Bar]:
    for answers, bar in WORTHS.items():
        ours = courses.at(SCREENING, taste, answers, names)
        found, where = mean_of(ours), f"{taste}, {group}, after {answers} answers"
        if found is None:
            return
        yield Bar(f"worth: {where}", interval(found), f"at least {bar:.0f}", found.value >= bar)
        ratio = ratio_of(ours, courses.at(EQUAL, taste, answers, names))
        if ratio is not None and taste in SPARSE:
            sure = ratio.low is not None and ratio.low > 1
            yield Bar(f"ratio to {EQUAL}: {where}", interval(ratio, 2), "surely above 1", sure)


def _noisy_row(
    courses: Courses, agent: str, kind: str, end: str, names: Sequence[str]
) -> list[list[str]]:
    """Return one row of the table; none without studies."""
    curves = courses.along(agent, f"{kind}{end}", _NOISY_AT, names)
    if not curves:
        return []
    ours = {study: float(curve[-1]) for study, curve in curves.items()}
    sure = courses.at(agent, kind, _NOISY_AT, names)
    kept = interval(ratio_of(ours, sure), 2) if end else ""
    fall = f"{100 * largest_fall(curves.values()):.0f} %"
    return [[agent, f"{kind}{end}", interval(mean_of(ours)), kept, fall]]


def _noise_bars(courses: Courses, group: str, kind: str, names: Sequence[str]) -> Iterator[Bar]:
    sure = courses.at(SCREENING, kind, _NOISY_AT, names)
    for end, bar in _KEPT.items():
        curves = courses.along(SCREENING, f"{kind}{end}", _NOISY_AT, names)
        kept = ratio_of({study: float(curve[-1]) for study, curve in curves.items()}, sure)
        if kept is None:
            continue
        where, fall = f"{kind}{end}, {group}", largest_fall(curves.values())
        what = f"share of the worth without mistakes: {where}, after {_NOISY_AT} answers"
        yield Bar(what, interval(kept, 2), f"at least {bar:.2f}", kept.value >= bar)
        what = f"largest fall of the median: {where}"
        yield Bar(what, f"{100 * fall:.0f} %", f"at most {100 * _FALL:.0f} %", fall <= _FALL)


def bars_table(bars: Sequence[Bar]) -> list[str]:
    """Return the bars as a table, with how many are met."""
    rows = [[bar.what, bar.figure, bar.bar, "yes" if bar.met else "**no**"] for bar in bars]
    met = sum(bar.met for bar in bars)
    count = f"{met} of {len(bars)} bars are met."
    return [count, "", *markdown(["what", "measured", "bar", "met"], rows)]


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return a table in Markdown."""
    return [f"| {' | '.join(cells)} |" for cells in (head, ["---"] * len(head), *rows)]


def interval(found: Estimate | None, digits: int = 0) -> str:
    """Return a number with its 95 % interval, as far as it is known."""
    if found is None:
        return "–"
    if found.low is None:
        return f"{found.value:.{digits}f}"
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"
