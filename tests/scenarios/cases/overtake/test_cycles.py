"""Cycle counts of a target become timed steps."""

import pytest

from prefcal_env.envs.overtake.road.rules import Phase
from prefcal_env.errors import SettingsError
from prefcal_scenarios.cases.overtake import overtake
from prefcal_scenarios.cases.overtake.controller import controller
from prefcal_scenarios.cases.overtake.cycles import read_cycles

HEAD = "phase,N_p,N_u,iterations,cycles\n"


@pytest.fixture
def cycles(tmp_path):
    def read(text, clock_mhz=100.0):
        path = tmp_path / "cycles.csv"
        path.write_text(text, encoding="utf-8")
        return read_cycles(path, clock_mhz)

    return read


def test_cycles_and_the_clock_give_seconds(cycles):
    (step,) = cycles(HEAD + "overtaking,16,5,9,2500000\n")
    assert (step.iterations, step.seconds) == (9, pytest.approx(0.025))


def test_the_size_is_that_of_the_problem_that_runs(cycles):
    theta = overtake.references["paper, preferences"]  # N_p 16, ε_c 0.31
    two = cycles("phase, N_p, eps_c, iterations, cycles\n"
                 "lane keeping, 16, 0.31, 9, 100\novertaking, 16, 0.31, 9, 100\n")  # fmt: skip
    supervisor = controller(theta)
    for phase, step in zip(Phase, two, strict=True):
        mpc = supervisor._mpc[phase]
        assert (step.size.variables, step.size.N_p) == (len(mpc._cost.q), 16)
    assert two[0].size.rows < two[1].size.rows  # y_f is limited while overtaking


def test_one_row_may_give_N_u_and_another_the_knob(cycles):
    a, b = cycles("phase,N_p,N_u,ε_c,iterations,cycles\n"
                  "overtaking,20,10,,9,100\novertaking,20,,0.5,9,100\n")  # fmt: skip
    assert a == b


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phase,N_p,iterations\n", "missing: cycles, N_u .or ε_c."),
        ("", "must have the columns"),
        (HEAD, "a row for each timed step, got none"),
        (HEAD + "parking,16,5,9,100\n", "line 2: phase must be one of lane keeping, overtaking"),
        (HEAD + "overtaking,16,5,9,100\novertaking,9,5,9,100\n", r"line 3: N_p must be .* \[10, 3"),
        (HEAD + "overtaking,16,17,9,100\n", r"N_u must be a whole number in \[1, 16\], got '17'"),
        (HEAD + "overtaking,16,5,2.5,100\n", "iterations must be a whole number"),
        (HEAD + "overtaking,16,5,9,\n", "cycles must be a number .* got ''"),
        (HEAD + "overtaking,16,5\n", "iterations must be a whole number .* got ''"),
        (HEAD + "overtaking,16,5,9,-4\n", "cycles must be a number"),
        (HEAD + "overtaking,16,5,9,nan\n", "cycles must be a number"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(cycles, text, message):
    with pytest.raises(SettingsError, match=message):
        cycles(text)


@pytest.mark.parametrize("clock", [0.0, -1.0, float("inf"), float("nan")])
def test_a_clock_must_tick(cycles, clock):
    with pytest.raises(SettingsError, match="--clock-mhz must be positive and finite"):
        cycles(HEAD, clock)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path):
    with pytest.raises(SettingsError, match=r"cannot read .*none\.csv"):
        read_cycles(tmp_path / "none.csv", 100.0)
    (tmp_path / "bytes.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SettingsError, match="must be a CSV file in UTF-8"):
        read_cycles(tmp_path / "bytes.csv", 100.0)
