"""Every calibrator keeps the contract."""

from typing import Any

import pytest

from contracts.calibrators import calibrator_contract
from prefcal_env.calibrators import (
    BradleyTerry,
    Criterion,
    Flipping,
    HumanCalibrator,
    LatentCost,
    Lexicographic,
    Thurstone,
)
from prefcal_scenarios.cases.cstr import cstr
from support.short_runs import final_level

SUBJECTS: dict[str, Any] = {
    "latent cost": lambda: LatentCost(final_level),
    "latent cost with a tie band": lambda: LatentCost(final_level, tie_band=0.1),
    "latent cost, Thurstone": lambda: LatentCost(final_level, noise=Thurstone(0.5), seed=3),
    "latent cost, Bradley-Terry": lambda: LatentCost(final_level, noise=BradleyTerry(0.5)),
    "wrong in a fifth of the cases": lambda: Flipping(LatentCost(final_level), 0.2, seed=3),
    "a person": lambda: HumanCalibrator(LatentCost(final_level).prefer),
    "a person, sides shuffled": lambda: HumanCalibrator(LatentCost(final_level).prefer, shuffle=1),
    "lexicographic": lambda: Lexicographic([Criterion("level", final_level)]),
    "lexicographic with thresholds": lambda: Lexicographic(
        [
            Criterion("level", final_level, just_noticeable=1.0),
            Criterion("calm", lambda e: e.duration, lower_is_better=False),
        ]
    ),
}


@calibrator_contract
@pytest.mark.parametrize("subject", SUBJECTS)
def test_calibrator(clause, subject):
    clause(SUBJECTS[subject])


def test_the_cstr_room_has_calibrators_that_are_made_from_a_seed():
    assert set(cstr.calibrators) == {"synthetic", "lexicographic"}
    for make in cstr.calibrators.values():
        assert hasattr(make(seed=3), "prefer")
