"""The table in the terminal."""

import io

import pytest
from rich.console import Console

from bench_support.campaigns import duel, ends, failed, grid, result
from bench_support.worths import study
from prefcal_bench.cells.duels import PAPER
from prefcal_bench.results import print_table


def printed(results, duels=(), width=120, **options):
    text = io.StringIO()
    print_table(Console(file=text, width=width), results, duels, **options)
    return text.getvalue()


def test_it_shows_medians_ratios_and_scores():
    text = printed(grid({"GLISp": 1.0, "Own": 10.0}, problems=("bowl",), seeds=6))
    assert "Gap after 3 experiments, perfect calibrator" in text
    (line,) = [line for line in text.splitlines() if " Own " in line]
    for cell in ("0.035", "0.022 to 0.048", "×10 (10 to 10)", "0–0–6", "0.031"):
        assert cell in line
    assert "each at least 1e-9" in " ".join(text.split())


@pytest.mark.parametrize(("seeds", "least"), [(2, "0.50"), (5, "0.062"), (6, None)])
def test_too_few_seeds_to_tell_who_is_nearer_are_named(seeds, least):
    text = " ".join(printed(grid({"GLISp": 1.0, "Own": 10.0}, seeds=seeds)).split())
    warning = f"With {seeds} seeds no p can be below {least}: which agent is nearer may be chance."
    assert (warning in text) == (least is not None)
    assert ("may be chance" in text) == (least is not None)


def test_closed_loops_have_a_table_of_worth_for_each_taste_before_the_gaps():
    loops = [
        study(a, loop, s, (2, 4, 4, w))
        for a, w in (("GLISp", 8), ("Own", 90))
        for loop in ("servo", "boost")
        for s in range(2)
    ]
    text = printed([*loops, *grid({"GLISp": 1.0})])
    assert text.index("Worth: weights") < text.index("Gap after 3 experiments")
    (line,) = [line for line in text.splitlines() if line.strip().startswith("Own")]
    assert line.split() == [
        "Own",
        "4.0",
        "[4.0,",
        "4.0]",
        "90",
        "[90,",
        "90]",
        "90",
        "3",
        "100",
        "%",
        "[100,",
        "100]",
        "×1.00",
    ]
    assert "servo" not in text


def test_a_narrow_terminal_cuts_no_name_off():
    text = printed(grid({"GLISp": 1.0, "LatinHypercube": 10.0}), width=80)
    assert "LatinHypercube" in text
    assert max(map(len, text.splitlines())) <= 80
    assert "…" not in text


def test_of_the_duels_it_shows_those_with_the_paper_and_the_baseline():
    duels = [duel("GLISp", PAPER, 0, -1), duel("A", "GLISp", 0, 1), duel("A", "B", 0, 1)]
    text = printed([result("A", "road", 0, None)], duels)
    assert "Who is preferred: road, lexicographic calibrator" in text
    rows = [line.split() for line in text.splitlines() if "% to" in line]
    assert [row[0] for row in rows] == ["GLISp", "A"]


def test_many_failures_are_counted_and_the_first_shown():
    text = printed([failed("A", "p", s) for s in range(9)])
    assert "Failed (9)" in text
    assert "and 4 more" in text


def test_without_results_it_says_so():
    assert "No results yet." in printed([])


def test_names_neither_steer_the_terminal_nor_mark_up():
    text = printed(ends("[red]A\x1b[2J", "p", [0.1]))
    assert "[red]A" in text
    assert "\x1b[2J" not in text
