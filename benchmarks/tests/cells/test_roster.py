from pathlib import Path

import pytest

from prefcal_bench.cells.roster import AGENTS, Entry, entry, in_order
from prefcal_env.errors import MissingExtraError, ScenarioError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Agent

SPACE = KnobSpace([Knob("a", 0, 1), Knob("b", -1, 1)])
OWN = Path(__file__).parents[1] / "bench_support" / "agents.py"
LACKING = Entry("Far", lambda: 1 / 0, packages={"sys": "sys", "not_there": "not"}, extra="x")


@pytest.mark.parametrize("name", AGENTS)
def test_every_agent_is_made_or_says_what_is_missing(name):
    one = entry(name)
    assert one.name == name
    if one.missing:
        assert "pip install 'prefcal-bench[" in one.missing
        pytest.skip(one.missing)
    agent = one.make(SPACE, 2, 4, 0, lambda theta: {"a": theta[0]})
    query = agent.ask()
    assert len(query.challenger.theta) == 2
    assert query.incumbent is None
    agent.tell(query, 1.5 if one.by_value else None)
    assert (agent.ask().incumbent is None) == one.by_value
    assert one.version
    assert hasattr(Agent, "ask")


def test_what_is_not_installed_is_said_and_not_imported():
    assert LACKING.missing == "Far needs not_there: pip install 'prefcal-bench[x]'"
    assert LACKING.version == ""
    with pytest.raises(MissingExtraError, match=r"prefcal-bench\[x\]"):
        LACKING.make(SPACE, 1, 2, 0)


def test_an_own_agent_is_told_what_its_tell_asks_for():
    assert [entry(f"{OWN}:{name}").by_value for name in ("Own", "Sees")] == [False, True]
    assert entry(f"{OWN}:Own").make(SPACE, 2, 4, 0).n_max == 4
    assert [entry(f"{OWN}:{name}").simulates for name in ("Own", "Simulates")] == [False, True]


def test_agents_that_simulate_say_so_and_glisp_stays_the_first():
    assert {name for name, one in AGENTS.items() if one.simulates} == {"Screening", "EqualWeights"}
    assert next(iter(AGENTS)) == "GLISp"
    assert in_order(["EqualWeights", "Screening", "GLIS"]) == ("Screening", "GLIS", "EqualWeights")


@pytest.mark.parametrize(
    ("name", "error", "words"),
    [
        ("glisp", SettingsError, "Expected GLISp,"),
        ("own.py", SettingsError, "say which agent in it"),
        ("nowhere.py:Own", ScenarioError, "no file 'nowhere.py'"),
        (f"{OWN}:Missing", SettingsError, "must name an agent's class"),
        (f"{OWN}:np", SettingsError, "must name an agent's class"),
        (f"{OWN}:Path", SettingsError, "must have a method tell"),
    ],
)
def test_what_is_no_agent_says_so(name, error, words):
    with pytest.raises(error, match=words):
        entry(name)


def test_a_file_that_does_not_import_says_so(tmp_path):
    (tmp_path / "own.py").write_text("import no_such_package\n")
    with pytest.raises(ScenarioError, match="no_such_package"):
        entry(f"{tmp_path / 'own.py'}:Mine")


def test_a_changed_file_is_loaded_anew(tmp_path):
    own = tmp_path / "own.py"
    for number in (1, 22):
        own.write_text(
            f"class Mine:\n    number = {number}\n    def tell(self, q, answer): ...\n"
            "    def __init__(self, space, **k): ...\n"
        )
        assert entry(f"{own}:Mine").make(SPACE, 1, 2, 0).number == number


def test_tables_name_learning_agents_first_then_own_ones_then_blind_searches():
    names = ["RandomSearch", "own.py:B", "LatinHypercube", "GLIS", "own.py:A", "GLISp"]
    expected = ("GLISp", "GLIS", "own.py:A", "own.py:B", "LatinHypercube", "RandomSearch")
    assert in_order(names) == in_order(reversed(names)) == expected
