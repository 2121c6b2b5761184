from dataclasses import replace
from pathlib import Path

import pytest

from prefcal_bench.cells.roster import AGENTS, Entry
from prefcal_bench.cells.suite import Suite
from prefcal_bench.problems import PROBLEMS
from prefcal_env.errors import SettingsError

OWN = Path(__file__).parents[1] / "bench_support" / "agents.py"
LOOP = OWN.with_name("loop.py")
BOTH = Suite(
    ("GLISp", "GLIS"),
    ("camel", "overtake", "cstr", "cstr-guidelines"),
    ("perfect", "lexicographic", "noisy10"),
    seeds=2,
    n_init=2,
    n_max=4,
)


def test_all_combinations_that_make_sense_are_there_and_no_others():
    pairs = {(c.agent, c.problem, c.calibrator) for c in BOTH.cells}
    assert pairs == {
        ("GLISp", "camel", "perfect"),
        ("GLISp", "camel", "noisy10"),
        ("GLISp", "cstr", "perfect"),
        ("GLISp", "cstr-guidelines", "lexicographic"),
        ("GLISp", "cstr", "noisy10"),
        ("GLISp", "overtake", "lexicographic"),
        ("GLISp", "overtake", "noisy10"),
        ("GLIS", "camel", "perfect"),
        ("GLIS", "cstr", "perfect"),
    }
    assert len(BOTH.cells) == len(set(BOTH.cells)) == 2 * len(pairs)
    assert {(c.n_init, c.n_max) for c in BOTH.cells} == {(2, 4)}


def test_cells_come_seed_by_seed():
    assert [c.seed for c in BOTH.cells] == [0] * 9 + [1] * 9


def test_what_is_left_out_is_said():
    no_value = "it learns from exact values, which the answers do not follow"
    assert len(BOTH.left_out) == 2
    for where, words in zip(("overtake", "cstr-guidelines"), BOTH.left_out, strict=True):
        assert words.startswith(f"GLIS on {where}: {no_value}")
    noisy = replace(BOTH, calibrators=("noisy10",))
    assert f"GLIS on camel: {no_value}" in noisy.left_out
    only = replace(BOTH, problems=("camel",), calibrators=("lexicographic",))
    assert only.cells == ()
    assert only.left_out[0].startswith("GLISp on camel: ")
    assert only.left_out[0].endswith("answer there")


def test_agents_that_simulate_run_where_experiments_have_kpis():
    suite = replace(
        BOTH,
        agents=("Screening", "GLISp"),
        seeds=1,
        problems=("camel", "servo", f"{LOOP}:PROBLEM", "cstr-guidelines"),
        calibrators=("perfect", "lexicographic", "weights"),
    )
    simulating = [c.problem for c in suite.cells if c.agent == "Screening"]
    assert simulating == ["servo", "cstr-guidelines"]
    assert suite.left_out == tuple(
        f"Screening on {name}: it simulates experiments for their KPIs, and there are none"
        for name in ("camel", f"{LOOP}:PROBLEM")
    )
    assert Suite.full().baseline == "GLISp"


def test_tastes_answer_on_closed_loops_and_tell_a_value_if_they_have_one():
    suite = replace(
        BOTH,
        problems=("servo", "camel", "overtake"),
        seeds=1,
        calibrators=("weights", "weights-noisy10", "priorities", "perfect"),
    )
    pairs = [(c.agent, c.problem, c.calibrator) for c in suite.cells]
    assert pairs == [
        ("GLISp", "servo", "weights"),
        ("GLIS", "servo", "weights"),
        ("GLISp", "servo", "weights-noisy10"),
        ("GLISp", "servo", "priorities"),
        ("GLISp", "camel", "perfect"),
        ("GLIS", "camel", "perfect"),
        ("GLISp", "overtake", "weights"),
        ("GLIS", "overtake", "weights"),
        ("GLISp", "overtake", "weights-noisy10"),
        ("GLISp", "overtake", "priorities"),
    ]
    assert suite.left_out == ()


def test_problems_of_a_file_and_random_loops_are_in_a_suite():
    suite = replace(
        BOTH,
        problems=(f"{LOOP}:SCENARIO", f"{LOOP}:PROBLEM", "loop-4"),
        seeds=1,
        calibrators=("perfect", "limits"),
    )
    assert {(c.problem, c.calibrator) for c in suite.cells} == {
        (f"{LOOP}:SCENARIO", "limits"),
        (f"{LOOP}:PROBLEM", "perfect"),
        ("loop-4", "limits"),
    }


def test_an_agent_that_is_not_installed_is_left_out_with_a_word(monkeypatch):
    far = Entry("Far", lambda: 1 / 0, packages={"not_there": "not"}, extra="x")
    monkeypatch.setattr("prefcal_bench.cells.roster.AGENTS", {**AGENTS, "Far": far})
    suite = replace(BOTH, agents=("GLISp", "Far"))
    assert suite.left_out == ("Far needs not_there: pip install 'prefcal-bench[x]'",)
    assert {c.agent for c in suite.cells} == {"GLISp"}


def test_all_are_compared_with_the_first_agent_that_runs():
    assert BOTH.baseline == "GLISp"
    assert replace(BOTH, agents=("RandomSearch", "GLISp")).baseline == "RandomSearch"
    blind = replace(BOTH, agents=("GLIS", "RandomSearch"), problems=("overtake",))
    assert blind.baseline == "RandomSearch"  # GLIS sees values, and there are none


def test_the_quick_suite_is_part_of_the_full_one_and_needs_nothing_installed():
    quick, full = Suite.quick(), Suite.full()
    parts = [{(c.agent, c.problem, c.calibrator) for c in each.cells} for each in (quick, full)]
    assert parts[0] <= parts[1]
    assert all(not AGENTS[agent].packages for agent in quick.agents)
    assert "Screening" in {c.agent for c in quick.cells if c.calibrator == "weights"}  # the default
    assert full.problems == PROBLEMS
    assert full.seeds == 20


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"agents": ("GLISp", "Glis")}, "no agent is called 'Glis'"),
        ({"agents": ()}, "agents must be one or more"),
        ({"agents": ("GLISp", "GLISp")}, "agents must be one or more different"),
        ({"problems": ("camel", "dromedary")}, "no problem is called 'dromedary'. Expected lag,"),
        ({"problems": (f"{LOOP}:NUMBER",)}, "must name a Scenario or a Problem"),
        ({"calibrators": ("weihgts",)}, "Did you mean 'weights'"),
        ({"calibrators": ("", "perfect")}, "no calibrator is called ''. Expected perfect,"),
        ({"seeds": 0}, "seeds"),
        ({"n_max": 1}, "n_max"),
        ({"n_init": 5}, "n_max must not be below n_init"),
    ],
)
def test_an_impossible_suite_says_what_is_wrong(change, words):
    with pytest.raises(SettingsError, match=words):
        replace(BOTH, **change)
