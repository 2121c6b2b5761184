"""Short texts for knobs and references, as on the command line."""

import pytest

from prefcal_env.errors import ScenarioError
from prefcal_env.knobs import Knob
from prefcal_scenarios.described.description import knob_of, listed, named_numbers


@pytest.mark.parametrize(
    ("text", "knob"),
    [
        ("K_p=0.1:100:log", Knob("K_p", 0.1, 100, scale="log10")),
        ("T_i=1:60 s", Knob("T_i", 1, 60, "s")),
        ("T_i = 1:60 [s]", Knob("T_i", 1, 60, "s")),
        ("K=0.1:100:log %/(K min)", Knob("K", 0.1, 100, "%/(K min)", scale="log10")),
        ("N=3:40:int", Knob("N", 3, 40, integer=True)),
        ("N=1:100:log:int steps", Knob("N", 1, 100, "steps", scale="log10", integer=True)),
        ("pid.K[1]=-5:-1e-1", Knob("pid.K[1]", -5, -0.1)),
    ],
)
def test_a_knob_is_read(text, knob):
    assert knob_of(text) == knob


@pytest.mark.parametrize("text", ["K_p", "=1:2", "K_p=", "K_p=1", "K_p=1:b", "K_p=1:2:lin", "K=:"])
def test_a_knob_that_is_misspelled_is_refused_with_an_example(text):
    with pytest.raises(ScenarioError, match=r"LOW:HIGH.*K_p=0\.1:100:log %/m"):
        knob_of(text)


def test_names_are_split_at_commas_but_not_inside_of_brackets():
    assert listed(["level, valve", "A[1,2]"]) == ["level", "valve", "A[1,2]"]


def test_references_are_read():
    assert named_numbers(["level=2", "flow=0.5, T = -3"], "--reference") == {
        "level": 2.0,
        "flow": 0.5,
        "T": -3.0,
    }


@pytest.mark.parametrize("text", ["level", "level=", "=2", "level=high", "level=nan"])
def test_a_reference_that_is_misspelled_is_refused_with_an_example(text):
    with pytest.raises(ScenarioError, match="--reference level=2, or, for an FMU"):
        named_numbers([text], "--reference")
