"""verification.json: what is written is read, but only of the best.json beside it."""

from dataclasses import replace

import pytest

from prefcal_env.disk import digest_of
from prefcal_env.errors import ScenarioError
from prefcal_env.experiments.experiment import End
from prefcal_scenarios.verification.plants import Factor
from prefcal_scenarios.verification.result import BEST, FILE, Verified, VerifiedRun, WorstRun

FOUND = Verified(
    statement="299 of 299 runs keep the stated limits.",
    limits_kept="Stated limits: a safe end.",
    share=1.0,
    bound=0.01,
    runs=299,
    planned=299,
    baseline="current tuning",
    kpis=(("overshoot [%]", "≤ 5", "1", "0", "2", "7", "5", "9"),),
    margins=(("phase margin [°]", "60", "44"),),
    basis="The unconstrained law.",
    effects=("dead time (4.8 to 7.2 s): overshoot by 40 % of its range in all runs",),
    worst=(WorstRun("within the limits", {"dead time": 7.1}, 3, "acceptable"),),
    varied=("dead time 4.8 to 7.2 s",),
    left_out=("Sampling jitter is not varied.",),
    scenario="lag",
    version="1.0",
    best="",
)


FACTORS = (
    Factor("jitter", "sensor", 0.0, 0.0, 0.1),
    Factor.around("dead time", "dead time", 0.2, 6.0, "s"),
    Factor("noise", "sensor", 0.0, 0.0, 0.002, "of the step"),
    *(Factor.around(f"gain {k}", "parameter", 0.1) for k in range(5)),
)


def run_of(problems=()):
    values = {"jitter": 3.082e-5, "dead time": 7.03456, "noise": 0.00117234}
    values |= {f"gain {k}": 1.0 + 0.01 * k for k in range(5)}
    return VerifiedRun(values, 3, End.TIME_UP, {}, problems)


def test_a_worst_run_names_what_moved_most_within_its_range_with_units():
    worst = WorstRun.of(run_of(("overshoot misses its objective",)), FACTORS)
    assert worst.words == "overshoot misses its objective"
    assert worst.text == (
        "dead time 7.03 s, noise 0.00117 of the step, gain 4 1.04, gain 3 1.03, gain 2 1.02, "
        "gain 1 1.01 and 2 others"
    )
    assert WorstRun("", {"dead time": 7.1}, 3).text == "dead time 7.1"


def test_a_worst_run_that_keeps_the_limits_is_only_the_most_different():
    assert WorstRun.of(run_of(), FACTORS).words == "most different from nominal, within the limits"


@pytest.fixture
def folder(tmp_path):
    (tmp_path / BEST).write_text("{}")
    return tmp_path


def test_what_is_written_is_read(folder):
    assert Verified.read(folder) is None
    found = replace(FOUND, best=digest_of(folder / BEST))
    found.write(folder)
    assert Verified.read(folder) == found


def test_a_verification_of_another_tuning_is_none(folder):
    replace(FOUND, best=digest_of(folder / BEST)).write(folder)
    (folder / BEST).write_text("{ }")
    assert Verified.read(folder) is None


@pytest.mark.parametrize("text", ["", "[]", '{"statement": "fine"}'])
def test_a_damaged_file_is_said(folder, text):
    (folder / FILE).write_text(text)
    with pytest.raises(ScenarioError, match=r"verification\.json"):
        Verified.read(folder)
