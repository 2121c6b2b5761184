import json
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_bench import Cell, Result, digest
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


# Results of cells.

SHORT = Cell("RandomSearch", "camel", "perfect", 0, 1, 2)
RESULT = Result(SHORT, ((0.1, -0.0), (1.0, 2.0)), (3.0, 0.5), (3.0, 0.5), (0, 1), (1.0, 2.0))
NUMBERS = st.floats(allow_nan=False)


def through_json(result):
    return Result.from_dict(json.loads(json.dumps(result.to_dict(), allow_nan=False)))


@given(
    rows=st.lists(st.tuples(st.tuples(NUMBERS, NUMBERS), NUMBERS, st.integers(0, 99)), min_size=1),
    costs=st.booleans(),
    seconds=st.none() | st.floats(0, 9),
)
def test_a_result_goes_through_json_to_the_last_bit(rows, costs, seconds):
    thetas, gaps, questions = zip(*rows, strict=True)
    numbers = tuple(gaps) if costs else None
    result = Result(SHORT, thetas, numbers, numbers, questions, thetas[0], seconds=seconds)
    assert through_json(result) == result
    assert repr(through_json(result)) == repr(result)  # == takes -0.0 for 0.0


@given(
    worths=st.lists(st.floats(1, 9e3), min_size=2, max_size=2),
    kpis=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=2, max_size=2),
    verdict=st.sampled_from([-1, 0, 1]),
)
def test_a_result_on_a_loop_goes_through_json_to_the_last_bit(worths, kpis, verdict):
    result = replace(
        RESULT,
        gaps=None,
        visited=None,
        worth=tuple(worths),
        kpi_names=("error", "effort"),
        kpis=tuple(kpis),
        comparisons=((1, 0, verdict),),
    )
    assert through_json(result) == result
    assert repr(through_json(result)) == repr(result)


def test_how_many_were_simulated_is_kept_and_older_results_stay_as_they_were():
    simulating = replace(RESULT, simulated=1000)
    assert through_json(simulating) == simulating
    assert digest([simulating]) != digest([RESULT])
    assert "simulated" not in RESULT.to_dict()
    # Computed before there were agents that simulate.
    assert digest([RESULT]).startswith("5e94f809e8983159")


def test_a_failure_goes_through_json():
    failed = Result.failed(SHORT, "the pump does not answer")
    assert through_json(failed) == failed
    assert failed.thetas == failed.gaps == failed.best == ()
    assert Result.failed(SHORT, "").failure  # a failure without words is one all the same


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"gaps": [1.0]}, "gaps must have 2"),
        ({"visited": [1.0, 2.0, 3.0]}, "visited must have 2"),
        ({"questions": []}, "questions must have 2"),
        ({"worth": [1.0]}, "worth must have 2"),
        ({"worth": [1.0, "nan"]}, "NaN"),
        ({"kpis": [[1.0]]}, "kpis must have 2 rows, got 1"),
        ({"comparisons": [[1, 0]]}, "cannot be read"),
        ({"gaps": [1.0, "nan"]}, "NaN"),
        ({"best": [np.nan, 1.0]}, "NaN"),
        ({"failure": "but it has experiments"}, "say why"),
        ({"thetas": [], "gaps": [], "visited": [], "questions": []}, "say why"),
        ({"thetas": 7}, r"cannot be read: Expected `array`, got `int` - at `\$.thetas`"),
        ({"gaps": ["low", "high"]}, "cannot be read"),
        ({"cell": {}}, "missing required field `agent`"),
        ({"more": 1}, "a result must have"),
    ],
)
def test_what_does_not_fit_is_not_taken_for_a_result(change, word):
    with pytest.raises(SettingsError, match=word):
        Result.from_dict(RESULT.to_dict() | change)


RESULTS = [
    Result(
        Cell(a, "camel", "perfect", s, 1, 2), ((0.1,), (0.2,)), (2.0, s + 0.1), (2.0, s + 0.1), (0, 1), (0.2,)
    )
    for a in ("A", "B")
    for s in range(11)
]


def test_the_order_of_the_results_does_not_matter_and_their_numbers_do():
    total = digest(RESULTS)
    assert len(bytes.fromhex(total)) == 32
    mixed = random.Random(0).sample(RESULTS, len(RESULTS))
    assert digest(mixed) == total
    bit = replace(RESULTS[3], gaps=(2.0, RESULTS[3].gaps[1] + 1e-15))
    assert digest([*RESULTS[:3], bit, *RESULTS[4:]]) != total
    assert digest(RESULTS[:-1]) != total


def test_worth_kpis_and_comparisons_matter():
    plain = RESULTS[0]
    richer = [
        replace(plain, worth=(1.0, 2.0)),
        replace(plain, worth=(1.0, 2.0 + 1e-15)),
        replace(plain, kpi_names=("error",), kpis=((1.0,), (np.inf,))),
        replace(plain, comparisons=((1, 0, -1),)),
    ]
    assert len({digest([one]) for one in (plain, *richer)}) == 5


def test_times_and_the_words_of_a_failure_do_not_matter_but_that_it_failed():
    first, *rest = RESULTS
    assert digest([replace(first, seconds=0.1), *rest]) == digest(RESULTS)
    failed, other = (Result.failed(first.cell, why) for why in ("object at 0x7f11", "at 0x7f22"))
    assert digest([failed, *rest]) == digest([other, *rest]) != digest(RESULTS)
