from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_bench.cells.cell import Cell
from prefcal_bench.problems import problem
from prefcal_env.errors import ScenarioError, SettingsError

CELL = Cell("RandomSearch", "camel", "perfect", 0)
OTHERS = [
    replace(CELL, **change)
    for change in (
        {"agent": "LatinHypercube"},
        {"problem": "branin"},
        {"calibrator": "noisy10"},
        {"seed": 1},
        {"n_init": 9},
        {"n_max": 49},
    )
]


def test_the_key_of_a_cell_is_a_sha256_and_every_part_of_it_counts():
    assert len(bytes.fromhex(CELL.key)) == 32
    assert CELL.key == replace(CELL).key
    assert len({cell.key for cell in (CELL, *OTHERS)}) == 7


def test_another_version_of_the_problem_has_another_key(monkeypatch):
    before = CELL.key
    newer = replace(problem("camel"), version=2)
    monkeypatch.setattr("prefcal_bench.cells.cell.problem", lambda name: newer)
    assert CELL.key != before


def test_settings_of_an_agent_are_part_of_its_version():
    default, paper = (Cell(a, "camel", "perfect", 0) for a in ("GLISp", "GLISp.paper"))
    as_if = replace(paper, agent="GLISp")
    assert default.key == as_if.key != paper.key


def test_a_changed_file_of_an_own_agent_has_another_key(tmp_path):
    own = tmp_path / "own.py"
    own.write_text("class Mine:\n    def tell(self, query, answer): ...\n")
    cell = replace(CELL, agent=f"{own}:Mine")
    before = cell.key
    assert cell.key == before
    own.write_text(own.read_text() + "# changed\n")
    assert cell.key != before
    own.unlink()
    with pytest.raises(ScenarioError, match=r"no file .*own\.py"):
        _ = cell.key


@given(
    names=st.tuples(*[st.text(min_size=1)] * 3),
    seed=st.integers(0, 2**70),
    n_init=st.integers(1, 100),
    more=st.integers(1, 100),
)
def test_a_cell_goes_through_plain_data_unchanged(names, seed, n_init, more):
    cell = Cell(*names, seed, n_init, n_init + more)
    assert Cell.from_dict(cell.to_dict()) == cell


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"agent": ""}, "agent"),
        ({"seed": -1}, "seed"),
        ({"seed": True}, "seed"),
        ({"n_init": 0}, "n_init"),
        ({"n_max": 1}, "n_max"),
        ({"n_init": 51}, "n_max"),
    ],
)
@pytest.mark.unchecked
def test_an_impossible_cell_says_what_is_wrong(change, word):
    with pytest.raises(SettingsError, match=word):
        Cell.from_dict(CELL.to_dict() | change)
