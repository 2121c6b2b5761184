"""`prefcal verify`: what it prints, and when it ends with an error."""

import json

import pytest

LAG = {"K": 2.0, "T_i": 20.0, "T_d": 3.0, "T_f": 3.0, "b": 0.5, "T_t": 20.0}


@pytest.fixture
def best(tmp_path):
    """Write the best.json of a study of the heat exchanger."""

    def write(**changes):
        content = {"format": 1, "scenario": "lag", "theta": LAG, "settings": {}, **changes}
        (tmp_path / "best.json").write_text(json.dumps(content))
        return "best.json"

    return write


def test_a_table_beside_the_tuning_before_with_statement_margins_and_worst_runs(prefcal, best):
    before = {"what": "current tuning", "theta": {**LAG, "K": 1.0}}
    code, out, err = prefcal("verify", best(before=before), "--runs", "20", "--jobs", "1")
    assert code == 0, err
    words = " ".join(out.split())
    for text in (
        "20 of 20 runs keep the stated limits",
        "below 14 % with 95 % confidence",
        "Stated limits: a safe end, no KPI has an objective",
        "phase margin",
        "the unconstrained law",
        "What hurts most, one at a time:",
        "Worst runs, of seed 0:",
        "Varied: time constant of temperature 0.9 to 1.1",
        "Sampling jitter is not varied",
    ):
        assert text in words
    assert "current" in words


def test_json_holds_every_run_and_a_bad_tuning_is_no_error(prefcal, best):
    theta = {**LAG, "K": 7.0, "T_i": 8.0}
    words = ("--runs", "10", "--json", "--jobs", "1", "--only", "parameter,dead time")
    code, out, err = prefcal("verify", best(theta=theta), *words, "--range", "dead time=0.5:0.8")
    assert code == 0, err
    found = json.loads(out)
    assert len(found["runs"]) == 10
    assert len(found["alone"]) == 2 * len(found["factors"])
    delay = next(f for f in found["factors"] if f["name"] == "dead time")
    assert (delay["low"], delay["high"]) == pytest.approx((9.0, 10.8))
    assert found["margins"]["M_s"] is None or found["margins"]["M_s"] > 2


@pytest.mark.parametrize(
    ("changes", "words", "says"),
    [
        ({"theta": {"K": 2.0}}, (), "must name the knobs"),
        ({"scenario": "camel"}, (), "no scenario is called 'camel'"),
        ({}, ("--runs", "0"), "runs must be"),
        ({}, ("--range", "noise"), "--range must look like"),
        ({}, ("--only", "nosie"), "nothing that varies is called 'nosie'. Did you mean 'noise'?"),
    ],
)
def test_errors_of_use_say_what_is_wrong(prefcal, best, changes, words, says):
    code, _, err = prefcal("verify", best(**changes), *words)
    assert code != 0
    assert says in " ".join(err.split())
