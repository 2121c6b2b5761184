"""What every synthetic calibrator must satisfy; each is one parameter of the tests here."""

from collections.abc import Callable
from typing import Any

import pytest

from prefcal_env.experiments.experiment import End, Experiment
from prefcal_env.preferences.answer import Answer, Calibrator, Preference
from support.short_runs import short_run

Make = Callable[[], Any]

EXPERIMENTS = [
    short_run([0.1], value=1.0),
    short_run([0.2], value=1.05),
    short_run([0.3], value=3.0),
    short_run([0.4], value=0.5, end=End.UNSAFE),
    short_run([0.5], value=0.5, duration=0.5, end=End.UNSAFE),
    short_run([0.6], value=0.2, end=End.SETTLED),
]
PAIRS = [(a, b) for a in EXPERIMENTS for b in EXPERIMENTS]


def satisfies_the_protocol(make: Make) -> None:
    assert isinstance(make(), Calibrator)


def answers_every_pair(make: Make) -> None:
    for a, b in PAIRS:
        assert isinstance(Answer.of(make().prefer(a, b)).preference, Preference)


def answers_alike_when_asked_again(make: Make) -> None:
    one, other = make(), make()
    first = [one.prefer(a, b) for a, b in PAIRS]
    assert [one.prefer(a, b) for a, b in PAIRS] == first
    assert [other.prefer(a, b) for a, b in reversed(PAIRS)] == first[::-1]


def answers_the_opposite_the_other_way_round(make: Make) -> None:
    for a, b in PAIRS:
        assert make().prefer(a, b) == -make().prefer(b, a)


def finds_an_experiment_as_good_as_itself(make: Make) -> None:
    for e in EXPERIMENTS:
        assert make().prefer(e, e) is Preference.TIE


def leaves_the_experiments_alone(make: Make) -> None:
    a, b = EXPERIMENTS[:2]
    copies: list[Experiment] = [short_run([0.1], value=1.0), short_run([0.2], value=1.05)]
    make().prefer(a, b)
    assert [a, b] == copies


CONTRACT = (
    satisfies_the_protocol,
    answers_every_pair,
    answers_alike_when_asked_again,
    answers_the_opposite_the_other_way_round,
    finds_an_experiment_as_good_as_itself,
    leaves_the_experiments_alone,
)
calibrator_contract = pytest.mark.parametrize("clause", CONTRACT, ids=lambda c: c.__name__)
