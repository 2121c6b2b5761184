"""A study of a scenario with constraints: it is taken up again, with their names alone on file."""

from dataclasses import replace

import pytest

from prefcal_app.cli.choices import open_study
from prefcal_app.session import Interview
from prefcal_env.errors import StudyError
from prefcal_env.knobs import Constraint, KnobSpace, LinearConstraint
from toy_study import toy_scenario

GIVEN = {"scenario": "toy", "calibrator": "human", "n_init": 3, "n_max": 6}


def constrained(*names):
    """The toy, with a constraint of each name."""
    known = {
        "slow": LinearConstraint("slow", {"T_s": 1.0}, 0.8),
        "short": Constraint("short", lambda knobs: knobs["N_p"] * knobs["T_s"] - 12),
    }
    scenario = toy_scenario()
    space = KnobSpace(scenario.space.knobs, [known[name] for name in names])
    return replace(scenario, space=space)


def begin(scenario, path):
    file, _, _ = open_study({**GIVEN, "study": str(path)}, scenario)
    return Interview(scenario, file, ahead=False)


@pytest.mark.parametrize("now", [(), ("slow",), ("slow", "short")])
def test_a_study_keeps_the_constraints_that_it_was_begun_with(tmp_path, now):
    path = tmp_path / "mine.prefcal"
    begin(constrained("short"), path).file.close()
    with pytest.raises(StudyError, match=r"expected \['short'\], got \["):
        begin(constrained(*now), path)
