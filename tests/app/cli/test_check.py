"""`prefcal check`: what it finds, what it prints, and how it ends."""

import json

import pytest

from prefcal_env.wording import in_words, locate, own_line
from toy_study import TOY_FILE

pytestmark = pytest.mark.usefixtures("own_process")
HEAD = f"""
from dataclasses import replace
import sys
sys.path.insert(0, {str(TOY_FILE.parent)!r})
import numpy as np
import toy_scenario as t
from prefcal_env import Channels, Constraint, KnobSpace, Panel, Rig
from prefcal_scenarios import KPI
count = []
"""
OVEN = """
[rig.outputs]
temperature = { unit = "°C" }
[rig.inputs]
power = { unit = "%", low = 0, high = 100 }
[reference]
temperature = 200
[knobs]
K_p = "0.5:20:log %/K"
"""


@pytest.fixture
def check(prefcal, tmp_path):
    """Write own.py with the toy scenario, changed, and check it; gives code and JSON."""

    def run(text, *words):
        (tmp_path / "own.py").write_text(HEAD + text, encoding="utf-8")
        code, out, err = prefcal("check", "own.py:own", "--json", *words)
        assert "Traceback" not in err
        return code, json.loads(out)

    return run


def found(result, what):
    return next((c["ok"], c["words"]) for c in result["checks"] if c["what"] == what)


def test_a_knob_that_does_nothing_is_named(check):
    text = """
def idle(theta, seed=0):
    made = t.toy.run([theta[0], theta[1], 1.0], seed=seed)
    return replace(made, theta=theta)
own = replace(t.toy, run=idle)
"""
    code, result = check(text)
    assert code == 0
    ok, words = found(result, "knob 'gain'")
    assert ok is None
    assert words.startswith("no KPI and no input changes over its range, 0")
    assert words.endswith("with the others as they are: is it used?")
    assert [c["what"] for c in result["checks"] if c["what"].startswith("knob ")] == ["knob 'gain'"]
    _, result = check("own = t.toy")
    assert not [c for c in result["checks"] if c["what"].startswith("knob ")]


def test_an_own_file_without_settings_is_told_that_nothing_can_be_exported(check, prefcal):
    code, result = check("own = replace(t.toy, settings=None)")
    ok, words = found(result, "settings")
    assert (code, ok) == (0, None)  # a note, no error
    assert words.startswith(
        "none, so best.json will hold no controller, and prefcal export cannot write it: "
    )
    assert "settings=lambda theta: as_data(make(theta))" in words
    assert found(check("own = t.toy")[1], "settings")[0] is True
    _, out, _ = prefcal("check", "lag", "--json")  # nobody can add to what is built in
    assert "settings" not in [c["what"] for c in json.loads(out)["checks"]]


def test_a_loop_that_is_not_stable_has_no_margin_rather_than_a_missed_one(check):
    text = """
kpi = KPI("M_s", "M_s", at_most=2.0, better="lower", margin=True)
def run(theta, seed=0):
    made = t.toy.run(theta, seed=seed)
    return made.with_kpis({**made.kpis, "M_s": np.inf})
own = replace(t.toy, run=run, kpis=(*t.toy.kpis, kpi))
"""
    said = "the loop is not stable with this θ, so it has no such margin; lower is better"
    assert found(check(text)[1], "KPI 'M_s'") == (None, said)


def test_a_scenario_in_order_passes_and_is_drawn(check, tmp_path):
    code, result = check("own = t.toy")
    assert (code, result["ok"]) == (0, True)
    assert result["theta"] == {"T_s": 0.875, "N_p": 22, "gain": 1.0}
    assert found(result, "knobs")[1].startswith("3: T_s (")
    assert found(result, "panel 'valve'")[0]
    assert found(result, "same again")[0]
    assert found(result, "calibrator 'latent'") == (True, "the same experiment twice: tie")
    assert found(result, "reference 'paper'")[0]
    assert found(result, "controller") == (True, "Proportional")
    assert (tmp_path / result["picture"]).read_bytes()[:4] == b"\x89PNG"


def test_a_kpi_that_is_not_a_number_is_no_randomness(check):
    text = "def run(theta, seed=0):\n    return t.run(theta).with_kpis({'a': np.nan})\n"
    _, result = check(f"{text}own = replace(t.toy, run=run, kpis=())")
    assert found(result, "same again") == (True, "the same θ and seed give the same experiment")


def test_theta_and_the_picture_can_be_chosen(check, tmp_path):
    code, result = check("own = t.toy", "--theta", "paper", "--out", "new.png")
    assert (code, result["theta"]["T_s"]) == (0, 0.31)
    assert (tmp_path / "new.png").exists()
    assert check("own = t.toy", "--theta", "T_s=1, N_p=9, gain=2")[1]["theta"]["N_p"] == 9


@pytest.mark.parametrize(
    ("text", "what", "words"),
    [
        (
            "own = replace(t.toy, panels=(Panel('levl <h>'),))",
            "panel 'levl <h>'",
            "Did you mean 'level <h>'?",
        ),
        ("own = replace(t.toy, kpis=(KPI('tf', 't'),))", "KPIs", "no run returns the KPI 'tf'"),
        ("own = replace(t.toy, cost=lambda e: np.nan)", "cost", "nan"),
        ("own = replace(t.toy, cost=lambda e: e.kpis['no'])", "cost", "in own.py:10: own ="),
        ("own = replace(t.toy, calibrators={'me': lambda seed: 3})", "calibrator 'me'", "prefer"),
        (
            "def run(theta, seed=0):\n    e = t.run(theta)\n    count.append(1)\n"
            "    return replace(e, x=e.x + len(count))\nown = replace(t.toy, run=run)",
            "same again",
            "give another experiment: x differ",
        ),
        (
            "def run(theta, seed=0):\n    return t.run([1.0, 9, 2.0])\nown = replace(t.toy, run=run)",
            "θ of the experiment",
            "ran N_p = 9, but 22 was to be run",
        ),
        (
            "def run(theta, seed=0):\n    return t.run(theta).nothing\nown = replace(t.toy, run=run)",
            "run",
            "(in own.py:11: return t.run(theta).nothing)",
        ),
        ("def run(theta, seed=0):\n    exit(1)\nown = replace(t.toy, run=run)", "run", "exit"),
        (
            "def run(theta, seed=0):\n    t.run(theta)\nown = replace(t.toy, run=run)",
            "run",
            "got NoneType: is a return missing?",
        ),
        (
            "def run(theta, seed=0):\n    if theta[0] == 0.31:\n        1 / 0\n"
            "    return t.run(theta)\nown = replace(t.toy, run=run)",
            "reference 'paper'",
            "in own.py:12: 1 / 0",
        ),
        ("own = replace(t.toy, controller=lambda theta: 3)", "controller", "no T_s and no move"),
        ("own = 1 / 0", "scenario", "(line 10), in own.py:10: own = 1 / 0"),
        ("own = replace(t.toy, panels=(Panel('level', 'z'),))", "scenario", "got 'z'"),
    ],
)
def test_what_is_wrong_is_named_with_its_place_and_fails_the_command(check, text, what, words):
    code, result = check(text)
    assert (code, result["ok"]) == (1, False)
    ok, said = found(result, what)
    assert ok is False
    assert words in said


@pytest.mark.parametrize("end", ["UNSAFE", "FAILED"])
def test_a_check_whose_own_run_or_every_reference_is_interrupted_is_not_in_order(check, end):
    stop = f"return replace(e, end=End.{end}) if {{}} else e"
    text = f"from prefcal_env import End\ndef run(theta, seed=0):\n    e = t.run(theta)\n    {stop}\n"
    two = "{'paper': np.array([0.31, 9, 2.0]), 'other': np.array([1.0, 9, 2.0])}"
    own = f"own = replace(t.toy, run=run, references={two})"
    code, result = check(text.format("theta[1] == 22") + own)
    assert (code, result["ok"]) == (1, False)
    assert found(result, "run")[0] is False
    assert f"ended: {end.lower()}" in found(result, "run")[1]
    code, result = check(text.format("theta[1] == 9") + own)
    assert (code, found(result, "run")[0]) == (1, True)
    assert found(result, "references") == (False, "each of them is interrupted: none of them works here")
    code, result = check(text.format("theta[0] == 0.31") + own)
    assert (code, found(result, "reference 'paper'")) == (0, (None, f"ended: {end.lower()}"))


def test_a_middle_that_a_constraint_forbids_gives_way_to_an_allowed_theta(check):
    space = "KnobSpace(t.SPACE.knobs, [Constraint('late', lambda k: k['T_s'] - {})])"
    code, result = check(f"own = replace(t.toy, space={space.format(0.5)}, references={{}})")
    assert code == 0
    assert 0.4 < result["theta"]["T_s"] <= 0.5
    code, result = check(f"own = replace(t.toy, space={space.format(0.0)}, references={{}})")
    assert code == 1
    assert "constraints (late) allow none" in found(result, "scenario")[1]


def test_a_rig_is_checked_with_a_made_up_record(check):
    kpis = "kpis=(KPI('top', 'top'),)"
    rig = "Rig(t.CHANNELS, (2.0,), kpis=lambda e: {'{}': e.x.max()}, ranges={'valve': (0, 10)})"
    own = f"own = replace(t.toy, run={rig}, cost=None, calibrators={{}}, {kpis})"
    code, result = check(own.replace("{}", "top", 1).replace("{{", "{").replace("}}", "}"))
    assert (code, result["picture"]) == (0, None)
    assert "made-up record" in found(result, "run")[1]
    assert found(result, "reference 'paper'")[0] is None
    code, result = check(own.replace("{}", "peak", 1).replace("{{", "{").replace("}}", "}"))
    assert code == 1
    assert "no run returns the KPI 'top'" in found(result, "KPIs")[1]


def test_a_rig_with_a_format_of_time_stamps_is_checked_with_such_stamps(done, tmp_path):
    rig = '[rig]\ntime_unit = "min"\ntime_format = "%d/%m/%Y %H:%M"\n'
    (tmp_path / "oven.toml").write_text(rig + OVEN, encoding="utf-8")
    told = " ".join(done("check", "oven.toml").split())
    assert "60 instants over 59 min" in told


def test_people_get_a_table_and_what_to_do_next(prefcal, done, tmp_path):
    (tmp_path / "own.py").write_text(HEAD + "own = t.toy", encoding="utf-8")
    out = done("check", "own.py:own")
    assert "✓  panel 'level <h>'" in out
    assert "Picture: check-toy.png" in out
    assert "prefcal calibrate own.py:own" in out
    (tmp_path / "own.py").write_text(HEAD + "own = replace(t.toy, run=lambda theta, seed=0: 1/0)")
    code, out, _ = prefcal("check", "own.py:own")
    assert code == 1
    assert "✗  run" in out
    assert "Nothing else can be checked without a run" in out


def test_a_file_is_checked_and_the_next_command_is_told(done, tmp_path):
    (tmp_path / "oven.toml").write_text(OVEN, encoding="utf-8")
    out = done("check", "oven.toml", "--knob", "K_i=0.1:1:log 1/s")
    told = " ".join(out.split())
    assert "2: K_p (0.5 to 20 %/K, log), K_i (0.1 to 1 1/s, log)" in told
    assert "prefcal calibrate oven.toml --knob 'K_i=0.1:1:log 1/s'" in told


def test_the_last_own_line_of_an_error_is_found_below_other_peoples_code():
    def broken():
        json.loads("{")  # raises deep in the standard library

    with pytest.raises(ValueError, match="Expecting") as caught:
        broken()
    line = own_line(caught.value)
    assert line.startswith("test_check.py:")
    assert 'json.loads("{")' in line
    assert in_words(locate(caught.value)).endswith(f"(in {line})")
    assert len(locate(caught.value).__notes__) == 1
    assert own_line(ValueError("never raised")) == ""
