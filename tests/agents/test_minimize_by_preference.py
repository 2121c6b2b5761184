import numpy as np
import pytest

from prefcal_agents import GLISp, LatinHypercube, RandomSearch, minimize_by_preference
from prefcal_env.errors import PreferenceError, SettingsError
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer, Preference

SPACE = KnobSpace([Knob("gain", 0.1, 10.0, scale="log10"), Knob("steps", 2, 30, integer=True)])


def prefer(a, b):
    cost_a, cost_b = (abs(np.log10(x[0])) + abs(x[1] - 12) / 10 for x in (a, b))
    return int(np.sign(cost_a - cost_b))


@pytest.mark.parametrize("agent", [GLISp, RandomSearch, LatinHypercube])
def test_the_result_holds_the_study_in_physical_units(agent):
    found = minimize_by_preference(prefer, SPACE, agent=agent, n_max=12, seed=3)
    assert found.samples.shape == (12, 2)
    assert len(found.answers) == 11
    best = found.samples[0]
    for challenger, answer in zip(found.samples[1:], found.answers, strict=True):
        assert answer.preference == prefer(challenger, best)
        best = challenger if answer.preference is Preference.CHALLENGER else best
    assert np.array_equal(found.best, best)
    assert SPACE.check(found.best) is not None


def test_theta_comes_close_to_the_best_one():
    found = minimize_by_preference(prefer, SPACE, n_max=30)
    assert found.best[0] == pytest.approx(1.0, rel=0.2)
    assert found.best[1] == pytest.approx(12, abs=1)


def test_the_start_is_half_of_a_short_study():
    found = minimize_by_preference(prefer, SPACE, n_max=8)
    strata = np.floor(4 * np.log10(found.samples[:4, 0] / 0.1) / 2)
    assert sorted(strata) == [0, 1, 2, 3]


def test_the_result_cannot_be_changed_and_neither_can_the_study_by_the_judge():
    def vandal(a, b):
        answer = prefer(a, b)
        a[:], b[:] = 0, 0
        return answer

    found = minimize_by_preference(vandal, SPACE, n_max=6)
    assert np.array_equal(found.samples, minimize_by_preference(prefer, SPACE, n_max=6).samples)
    with pytest.raises(ValueError, match="read-only"):
        found.best[0] = 1


def test_abstentions_and_full_answers_are_accepted():
    found = minimize_by_preference(lambda a, b: None, SPACE, n_max=5)
    assert [a.preference for a in found.answers] == [None] * 4
    strong = minimize_by_preference(lambda a, b: Answer(-1, strength=2), SPACE, n_max=5)
    assert np.array_equal(strong.best, strong.samples[-1])


@pytest.mark.parametrize(
    "options", [{"n_max": 1}, {"n_max": 4, "n_init": 5}, {"n_init": 0}, {"seed": "x"}]
)
def test_impossible_options_are_refused(options):
    with pytest.raises(SettingsError):
        minimize_by_preference(prefer, SPACE, **options)


def test_a_judge_that_is_no_function_or_gives_no_answer_is_refused():
    with pytest.raises(SettingsError):
        minimize_by_preference(3, SPACE)
    with pytest.raises(PreferenceError):
        minimize_by_preference(lambda a, b: "left", SPACE, n_max=4)


@pytest.mark.parametrize("n_max", [2, 3, 5])
def test_even_the_shortest_study_returns_what_won(n_max):
    space = KnobSpace([Knob("x", -1, 1), Knob("n", 1, 6, integer=True)])

    def prefer(a, b):  # np.sign gives a float, which is an answer too
        return np.sign(a @ a - b @ b)

    found = minimize_by_preference(prefer, space, n_max=n_max)
    assert len(found.samples) == n_max
    assert min(s @ s for s in found.samples) == found.best @ found.best
