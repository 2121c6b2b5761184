"""Every wrong call is one line in one style, which names what was meant and where the rest is."""

import pytest

from toy_study import TOY


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["calibrate"], ["name a scenario: cstr, overtake", "calibrate --help"]),
        (["report"], ["name a study", "prefcal studies list", "report --help"]),
        (["studies", "show"], ["name a study", "studies show --help"]),
        (["calibrate", "cst"], ["Did you mean 'cstr'?", "prefcal scenarios"]),
        (["calibrate", "CSTR"], ["Did you mean 'cstr'?"]),
        (["calibrate", TOY, "--agent", "glips"], ["--agent must be", "Did you mean 'glisp'?"]),
        (
            ["calibrate", TOY, "--calibrator", "synthtic"],
            ["--calibrator must be", "Did you mean 'synthetic'?"],
        ),
        (["calibrate", TOY, "--start", "Ts=1,N_p=5,gain=1"], ["Did you mean 'T_s'?"]),
        (["calib"], ["no such command 'calib'. Did you mean 'calibrate'?"]),
        (["nonsense"], ["no such command 'nonsense'", "calibrate, new, check, look, report, "]),
        (["calibrate", TOY, "--nmax", "3"], ["no such option: --nmax", "--n-max"]),
        (["calibrate", TOY, "--n-max", "x"], ["--n-max"]),
        (["calibrate", TOY, "more"], ["more", "calibrate --help"]),
        (["calibrate", TOY, "--port", "99999"], ["--port", "65535"]),
        (["studies", "export", "x", "--format", "y"], ["--format", "json"]),
        (["bench", "--problems", "cst"], ["Did you mean 'cstr'?"]),
        (["bench", "--agents", "GLIPs"], ["Did you mean 'GLISp'?"]),
        (["bench", "--seeds", "0"], ["--seeds"]),
        (["bench", "--jobs", "0"], ["jobs"]),
        (["bench", "--agents", "GLIS", "--problems", "cstr-guidelines"], ["nothing to run: GLIS"]),
        (["bench", "--n-init", "9", "--n-max", "5"], ["--n-max must be at least --n-init"]),
    ],
)
def test_a_wrong_call_is_one_line_that_helps(prefcal, tmp_path, words, said):
    code, out, err = prefcal(*words)
    assert code == 2
    assert out == ""
    assert err.startswith("prefcal: ")
    assert err.count("\n") == 1
    for part in said:
        assert part in err
    assert list(tmp_path.iterdir()) == []


def test_a_misspelled_study_is_recognized(prefcal, refused, tmp_path):
    words = ["calibrate", TOY, "--calibrator", "synthetic", "--agent", "random", "--n-max", "3"]
    assert prefcal(*words, "--study", "pump-test", "--out", "r")[0] == 0
    for command in (["studies", "show"], ["studies", "rm", "--yes"], ["report"]):
        assert "no study 'pumptest'. Did you mean 'pump-test'? `prefcal studies list`" in refused(
            *command, "pumptest"
        )
    err = prefcal(*words, "--from", "pump-tets", "--study", "second")[2]
    assert "Did you mean 'pump-test'?" in err


def test_options_are_named_as_they_are_typed(prefcal):
    synthetic = ["--calibrator", "synthetic", "--agent", "random", "--n-max", "3"]
    assert prefcal("calibrate", TOY, *synthetic, "--study", "mine", "--out", "r")[0] == 0
    for words, said in (
        (["--n-init", "2"], "started with --n-init 1, got --n-init 2"),
        (["--start", "T_s=1"], "started with no --start, got --start T_s=1"),
        (["--n-max", "2"], "--n-max must not be below the 3"),
        (["--no-outcomes"], "started with --no-outcomes off"),
    ):
        err = prefcal("calibrate", TOY, "--study", "mine", *words)[2]
        assert said in err
