"""Every wrong call is one line in one style, which names what was meant and where the rest is."""

import shlex
from pathlib import Path

import pytest

from support import twins
from toy_study import TOY, TOY_FILE

PLANT, MODEL = (f"{twins.__file__}:{name}" for name in ("plant", "model"))
RIG = f"{Path(__file__).parents[3] / 'docs' / 'rig_example.py'}:oven"
START = "calibrate TOY --calibrator synthetic --agent random --n-init 2 --study mine --start"
CALLS = [
    ("calibrate", "name a scenario: cstr, overtake", "calibrate --help"),
    ("report", "name a study", "prefcal studies list", "report --help"),
    ("studies show", "name a study", "studies show --help"),
    ("calibrate cst", "Did you mean 'cstr'?", "prefcal scenarios"),
    ("calibrate CSTR", "Did you mean 'cstr'?"),
    ("calibrate nowhere", "no scenario is called 'nowhere'"),
    (f"calibrate {TOY_FILE}:nothing", "got nothing of that name; in that file there is toy"),
    (f"calibrate {TOY_FILE}:not_a_scenario", "must name a prefcal_scenarios.Scenario"),
    ("calibrate missing.py:toy", "no file"),
    ("calibrate TOY --agent glips", "--agent must be one of screening", "Did you mean 'glisp'?"),
    ("calibrate TOY --calibrator synthtic", "--calibrator must be one of human, ", "'synthetic'?"),
    ("calibrate lag --calibrator ideel", " more for scenario 'lag'", "'ideal'?"),
    ("calib", "no such command 'calib'. Did you mean 'calibrate'?"),
    ("nonsense", "no such command 'nonsense'", "calibrate, choose, new, identify, check, look, report, "),
    ("calibrate TOY --nmax 3", "no such option: --nmax", "--n-max"),
    ("calibrate TOY --n-max x", "--n-max: expected an integer, got x"),
    ("calibrate TOY more", "more", "calibrate --help"),
    ("calibrate TOY --port 99999", "--port", "65535"),
    ("calibrate TOY --n-init 9 --n-max 5", "--n-max must be at least --n-init"),
    ("calibrate TOY --n-max 1000000000", "--n-max must be at most 10000, got 1000000000"),
    ("calibrate cstr --simulate 99999999999999999999", "--simulate must be at most 100000, got"),
    ("calibrate TOY --at-once 1000000", "--at-once must be at most 256, got 1000000"),
    ("calibrate TOY --seed 99999999999999999999", "--seed must be at most 9223372036854775807"),
    ("verify best.json --runs 1000000000", "--runs must be at most 100000, got"),
    ("verify best.json --jobs 1000000", "--jobs must be at most 256, got 1000000"),
    ("look a.csv b.csv --port 99999", "--port", "65535"),
    ("calibrate TOY --n-max 0", "--n-max must be at least 1, got 0"),
    ("calibrate TOY --seed -1", "--seed must be at least 0, got -1"),
    (f"calibrate TOY --calibrator synthetic --out {TOY_FILE}", "--out must be a folder"),
    ("calibrate TOY --agent glis --calibrator human", "needs no answers"),
    ("calibrate TOY --agent glis --calibrator synthetic", "needs no answers"),
    ("calibrate overtake --agent glis", "'overtake' has none"),
    (
        "calibrate TOY --agent random --questions-per-experiment 2",
        "only the agent glisp takes --questions-per-experiment",
    ),
    ("calibrate TOY --agent random --no-outcomes", "only the agent glisp takes --no-outcomes"),
    ("calibrate cstr --no-outcomes", "not 'screening': leave it out, or choose --agent glisp"),
    ("calibrate cstr --agent glisp --simulate 500", "only the agent screening takes --simulate"),
    ("calibrate lag --agent glisp --robust", "only the agent screening takes --robust"),
    ("calibrate cstr --agent screening --simulate 0", "needs simulations"),
    ("calibrate cstr --simulate -1", "--simulate must be at least 0, got -1"),
    ("calibrate cstr --n-init 4", "--agent screening has no initial experiments"),
    ("calibrate TOY --agent screening", "does not let experiments run unseen: leave --simulate"),
    ("calibrate TOY --simulate 500", "state Scenario(..., simulated=True)"),
    (f"calibrate {RIG} --simulate 500", "is a rig, and nothing runs on it unseen"),
    (f"calibrate {PLANT} --twin {PLANT}", "the twin 'plant' does not let experiments run unseen"),
    (f"calibrate {PLANT} --twin nothing", "no scenario is called 'nothing'"),
    (f"calibrate {PLANT} --twin {MODEL} --agent glisp", "only the agent screening takes --twin"),
    (f"calibrate {PLANT} --twin {MODEL} --simulate 0", "only the agent screening takes --twin"),
    ("calibrate TOY --cost mine.py:cost", "add --calibrator synthetic"),
    ("calibrate TOY --agent glis --cost no.py:cost", "no file 'no.py'"),
    ("calibrate TOY --agent glis --cost mine.py:other", "nothing of that name"),
    ("calibrate TOY --agent glis --cost mine.py:three", "got 3"),
    ("calibrate TOY --agent glis --cost mine.py", "path/to/own.py:NAME"),
    (f"{START} paper?", "one of the references"),
    (f"{START} Ts=1,N_p=5,gain=1", "Did you mean 'T_s'?"),
    (f"{START} T_s=0.5,N_p=30", "['gain'] are missing"),
    (f"{START} T_s=0.5,N_p=30,gain=1,size=2", "knob must be one of"),
    (f"{START} T_s=0.5,N_p=30,gain=1,T_s=1", "given twice"),
    (f"{START} T_s=fast,N_p=30,gain=1", "'T_s' must be a number, got 'fast'"),
    (f"{START} T_s=0.5,N_p,gain=1", "expected KNOB=VALUE, got 'N_p'"),
    (f"{START} T_s=3,N_p=30,gain=1", "'T_s' must be in [0.25, 1.5] h, got 3"),
    (f"{START} T_s=nan,N_p=30,gain=1", "must be finite"),
    ("calibrate mine.py", "say which scenario in it, mine.py:NAME"),
    ("calibrate oven.toml --knob K=1:2 --knob K=1:3", "--knob gives 'K' twice"),
    ("calibrate cstr --stop-time 3", "--stop-time describes an FMU"),
    ("calibrate cstr --config config.json", "takes no configuration"),
    (
        "calibrate lag --agent screening --calibrator synthetic --cost error --at-once 2",
        "choose --agent glisp",
    ),
    ("check TOY --theta T_s=1", "every knob needs a value"),
    ("check TOY --out a.jpg", "ends in .png"),
    ("check TOY --out no/a.png", "must be in an existing folder, got 'no/a.png'"),
    ("new mcp", "Did you mean 'mpc'?"),
    ("new pid a.toml", "a.py, got 'a.toml'"),
    ("new rig rig", "rig.toml, got 'rig'"),
    ("look a.csv", "name two runs or more"),
    ("studies show nowhere", "there is no study 'nowhere'"),
    ("studies verify nowhere", "there is no study 'nowhere'"),
    ("report nowhere", "there is no study 'nowhere'"),
    ("studies export x --format y", "--format", "json"),
]


@pytest.mark.parametrize(("line", "said"), [(line, said) for line, *said in CALLS])
def test_a_wrong_call_is_one_line_that_helps_and_leaves_nothing(prefcal, tmp_path, line, said):
    (tmp_path / "mine.py").write_text("three = 3\ncost = lambda e: e.theta[0]\n")
    (tmp_path / "config.json").write_text("{}")
    code, out, err = prefcal(*shlex.split(line.replace("TOY ", f"{TOY} ")))
    assert code == 2
    assert out == ""
    assert err.startswith("prefcal: ")
    assert err.count("\n") == 1
    for part in said:
        assert part in err
    assert {path.name for path in tmp_path.iterdir()} == {"mine.py", "config.json"}


@pytest.mark.parametrize(
    "line",
    [
        "look LONG.csv LONG.csv",
        "calibrate LONG.toml",
        "calibrate TOY --calibrator synthetic --agent random --n-max 3 --out LONG",
        "new pid LONG.toml",
        "verify LONG/best.json",
        "calibrate TOY --study ./LONG",
    ],
)
def test_a_name_that_no_file_can_have_is_one_line(prefcal, line):
    code, _, err = prefcal(*shlex.split(line.replace("TOY ", f"{TOY} ").replace("LONG", 300 * "a")))
    assert code in (1, 2)
    assert err.startswith("prefcal: ")
    assert err.count("\n") == 1
    assert "aaa" in err


def test_a_misspelled_study_is_recognized(prefcal, refused, tmp_path):
    words = ["calibrate", TOY, "--calibrator", "synthetic", "--agent", "random", "--n-max", "3"]
    assert prefcal(*words, "--study", "pump-test", "--out", "r")[0] == 0
    for command in (["studies", "show"], ["studies", "rm", "--yes"], ["report"]):
        assert "no study 'pumptest'. Did you mean 'pump-test'? `prefcal studies list`" in refused(
            *command, "pumptest"
        )
    err = prefcal(*words, "--start", "pump-tets:best", "--study", "second")[2]
    assert "Did you mean 'pump-test'?" in err
