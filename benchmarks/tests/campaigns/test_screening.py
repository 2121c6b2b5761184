"""The campaign that judges Screening: what it runs, and its figures by hand."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench_support.worths import study
from prefcal_bench import Cell, Result, Store
from prefcal_bench.problems import CSTR_BROAD, problem
from prefcal_bench.results.statistics import mean_of, ratio_of

ROOT = Path(__file__).parents[3]


@pytest.fixture(autouse=True)
def script(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module


def rising(agent, worth, loop="servo", seed=0, n_max=11, **changes):
    """A study whose worth is 1 at first and `worth` from the first answer on."""
    values = (1.0,) + (float(worth),) * (n_max - 1)
    return study(agent, loop, seed, values, n_max=n_max, n_init=5, **changes)


def small(script, **changes):
    values = {
        "agents": script("screening").AGENTS,
        "loops": {"named": ("servo", "lag")},
        "tastes": ("weights",),
        "noisy": ("weights",),
        "seeds": 2,
        "case_seeds": 1,
        "case_agents": ("Screening",),
        "longest": 20,
    }
    return SimpleNamespace(**(values | changes))


def test_each_part_runs_what_it_compares(script):
    suites = script("screening").suites
    found = {n: [] for n in (11, 21, 51)}
    for suite in suites("loops", small(script)):
        assert suite.n_init == min(10, suite.n_max // 2)
        found[suite.n_max] += suite.agents
    assert found[11] == ["Screening"]
    assert found[21] == ["Screening", "BOPE"]
    assert found[51] == ["EqualWeights", "GLISp", "GLISp.no-outcomes", "RandomSearch"]
    longest = list(suites("loops", small(script, longest=50)))
    assert [s.n_max for s in longest if "Screening" in s.agents] == [11, 21, 51]
    noisy = list(suites("noise", small(script)))
    assert {s.calibrators for s in noisy} == {("weights", "weights-noisy10", "weights-noisy20")}
    (reactor,) = suites("reactor", small(script))
    assert (reactor.problems, reactor.calibrators, reactor.n_max) == (("cstr",), ("perfect",), 12)


def test_held_out_loops_are_those_that_nobody_develops_on(script):
    groups = script("screening").GROUPS
    assert groups["held-out"] == tuple(f"loop-{n}" for n in range(900, 915))
    assert groups["rough-held-out"] == tuple(f"rough-{n}" for n in range(900, 915))
    assert not {*groups["rough"]} & {*groups["rough-held-out"]}
    assert len(groups["named"]) == 12
    assert "rough" not in script("screening").options_of([]).loops
    assert script("screening").options_of(["--loops", "servo", "cases"]).loops == {
        "cases": ("cstr", "overtake"),
        "chosen": ["servo"],
    }


def test_the_shortest_studies_with_so_many_answers_count(script):
    at = script("screening_tables").at
    some = [rising("Screening", 4), rising("Screening", 9, n_max=21), rising("Screening", 2, "lag")]
    assert at(some, "Screening", "weights", 10, ("servo",)) == {("servo", 0): 4.0}
    assert at(some, "Screening", "weights", 11, ("servo", "lag")) == {("servo", 0): 9.0}
    assert at(some, "Screening", "weights", 0, ("lag",)) == {("lag", 0): 1.0}
    assert at(some, "Screening", "weights", 30, ("servo",)) == {}
    assert at(some, "GLISp", "weights", 0, ("servo",)) == {}
    # Answers count, and not experiments.
    asked = study("BOPE", worth=(1, 2, 8), questions=(0, 2, 4), n_max=3, comparisons=())
    along = script("screening_tables").along([asked], "BOPE", "weights", 2, ("servo",))
    assert list(along["servo", 0]) == [1, 1, 2]


def test_every_loop_counts_the_same_and_ratios_are_paired():
    ours = {("a", 0): 4.0, ("a", 1): 16.0, ("b", 0): 1.0}
    assert mean_of(ours).value == pytest.approx(np.sqrt(8.0))
    theirs = {("a", 0): 2.0, ("a", 1): 8.0, ("c", 0): 5.0}
    ratio = ratio_of(ours, theirs)
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((2.0, 2.0, 2.0))
    assert mean_of({}) is None


def test_the_fall_is_that_of_the_median_from_its_peak_so_far(script):
    fall = script("screening_tables").largest_fall
    up, down = np.array([1.0, 8.0, 9.0]), np.array([1.0, 8.0, 2.0])
    assert fall([up, up, down]) == 0
    assert fall([up, down, down]) == 0.75


def test_the_headline_is_about_families_of_another_form_with_the_worst_one_beside_it(script):
    others = script("screening_tables").OTHERS
    worths = dict(zip(others, (400, 1600, 1600, 1600), strict=True))
    results = [rising("Screening", worth, taste=taste) for taste, worth in worths.items()]
    results.append(rising("Screening", 9999, taste="trade"))  # the learner has that form
    choice = small(script, tastes=("trade", *others), loops={"rough": ("servo",)})
    lines = list(script("screening_tables").loops(results, choice))
    assert "mean (worst family) after answers" in lines[1]
    assert lines[5] == "| Screening | 1 (ideal 1)" + " | 1131 (ideal 400)" * 3 + " | – | – |"


def test_questions_are_counted_with_ties_and_pairs_that_come_again(script):
    asked = (
        (1, 0, 0),
        (0, 1, 0),
        (2, 1, -1),
        (3, 2, 0),
        (4, 2, 1),
        (5, 2, 1),
        (6, 2, 1),
        (7, 2, 1),
        (2, 1, -1),
        (8, 2, 1),
        (9, 2, 0),
    )
    again = script("screening_tables").again
    assert again([asked], 5) == pytest.approx(1 / 11)  # (0, 1) at once; (2, 1) six later
    assert again([asked], None) == pytest.approx(2 / 11)
    assert again([], 5) == 0
    one = study("Screening", worth=(1.0,) * 12, comparisons=asked, questions=range(12))
    lines = script("screening_tables").loops([one], small(script))
    assert "| Screening | weights | 30 % | 9 % | 18 % |" in lines


def test_noise_is_measured_against_the_same_people_without_mistakes(script):
    results = [
        rising("Screening", worth, taste=f"weights{end}", n_max=21)
        for end, worth in (("", 100), ("-noisy10", 60), ("-noisy20", 30))
    ]
    choice = small(script, loops={"named": ("servo",)}, agents=("Screening",))
    lines = list(script("screening_tables").noise(results, choice))
    assert "| Screening | weights-noisy10 | 60 | 0.60 | 0 % |" in lines
    assert "| Screening | weights-noisy20 | 30 | 0.30 | 0 % |" in lines


def test_the_reactor_is_judged_by_its_index_after_8_and_12(script):
    cell = Cell("Screening", "cstr", "perfect", 0, 6, 12)
    gaps = (1.0,) * 7 + (0.704 - CSTR_BROAD,) + (0.5,) * 3 + (0.698 - CSTR_BROAD,)
    thetas = ((0.25, 26.0, -1.0),) * 12
    result = Result(cell, thetas, gaps, gaps, tuple(range(12)), thetas[0])
    lines = script("screening_tables").reactor([result], small(script))
    assert lines[-1] == "| Screening | 1 | 0.7040 | 0.7040 | 0.6980 | 0.6980 |"


def test_the_overtaking_counts_random_theta_that_are_not_better(script, monkeypatch, tmp_path):
    cases = script("screening_tables")
    where = problem("overtake")
    paper = tuple(map(float, where.paper))
    cell = Cell("Screening", "overtake", "lexicographic", 0, 5, 10)
    result = Result(cell, (paper,) * 10, None, None, tuple(range(10)), paper)
    choice = small(script, fresh=4, out=tmp_path)
    lines = cases.overtaking([result], choice)
    ours = where.outcome(where.paper)
    drawn = [where.outcome(theta) for theta in cases.thetas(where.scenario, "fresh", 4)]
    lost = sum(where.referee.prefer(ours.experiment, one.experiment) == 1 for one in drawn)
    share = f"{1 - lost / 4:.4f}"
    assert lines[-1] == f"| Screening | 1 | {share} | {share} | 0 | 1 | 0 |"
    monkeypatch.setattr(cases, "_shares", None)  # what is in the file does not run again
    assert cases.overtaking([result], choice) == lines


@pytest.fixture
def of_servo(script, tmp_path):
    """Run the campaign on one taste on the servo, by random search alone."""
    words = [
        "--parts",
        "loops",
        "--loops",
        "servo",
        "--tastes",
        "weights",
        "--agents",
        "RandomSearch",
        "--seeds",
    ]
    return lambda seeds, *more: script("screening").main([*words, seeds, "--out", str(tmp_path), *more])


def test_the_script_reports_what_is_in_a_folder(of_servo, tmp_path, capsys):
    store = Store(tmp_path)
    for seed in range(2):
        values = (1.0,) + (4.0 ** (seed + 1),) * 50
        store.add(study("RandomSearch", "servo", seed, values, n_max=51, n_init=10))
    assert of_servo("2", "--report") == 0
    page = (tmp_path / "screening.md").read_text()
    assert "| weights | RandomSearch | 2 | 1 [1, 1] | 8 [4, 16] |" in page
    assert page in capsys.readouterr().out
    assert (tmp_path / "raw.parquet").exists()


def test_again_drops_the_results_of_the_chosen_agents_alone(script, of_servo, tmp_path, monkeypatch):
    campaign, store, ran = script("screening"), Store(tmp_path), []
    kept, dropped = (
        study(agent, "servo", worth=(1.0,) * 51, n_max=51, n_init=10)
        for agent in ("EqualWeights", "RandomSearch")
    )
    for result in (kept, dropped):
        store.add(result)
    monkeypatch.setattr(campaign, "run_suite", lambda suite, *_: ran.append(suite))
    of_servo("1", "--again")
    assert [suite.agents for suite in ran] == [("RandomSearch",)]
    assert store.find(kept.cell)[0] == kept
    assert store.find(dropped.cell)[0] is None
