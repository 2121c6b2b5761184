from functools import partial

import numpy as np
import pytest

from prefcal_agents import GLISp, RandomSearch, Screening, minimize_by_preference
from prefcal_agents.baselines import LatinHypercube
from prefcal_env.errors import PreferenceError, SettingsError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Preference

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


def test_a_single_experiment_and_a_judge_that_gives_no_answer_are_refused():
    with pytest.raises(SettingsError, match="n_max"):
        minimize_by_preference(prefer, SPACE, n_max=1)
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


def simulate(theta):
    """Two KPIs whose sum is the cost of `prefer`."""
    return {"gain": abs(np.log10(theta[0])), "steps": abs(theta[1] - 12) / 10}


def test_with_a_simulation_few_are_shown_and_many_simulated():
    shown, run = set(), []

    def judged(a, b):
        shown.update({tuple(a), tuple(b)})
        return prefer(a, b)

    def counted(theta):
        run.append(tuple(theta))
        return simulate(theta)

    found = minimize_by_preference(judged, SPACE, simulate=counted, n_simulated=200)
    assert found.samples.shape == (11, 2)
    assert len(found.answers) == 10
    assert shown == set(map(tuple, found.samples))
    assert len(set(run)) == len(run) <= 200
    assert {tuple(theta) for theta in found.simulated.thetas} == set(run) >= shown
    assert found.simulated.names == ("gain", "steps")
    assert found.best.tolist() == min(found.samples.tolist(), key=lambda t: sum(simulate(t).values()))
    better = [sum(simulate(theta).values()) for theta in found.simulated.thetas]
    assert np.mean(np.array(better) < sum(simulate(found.best).values())) < 0.05


def test_without_a_simulation_nothing_is_said_to_be_simulated():
    assert minimize_by_preference(prefer, SPACE, n_max=4).simulated is None


def test_the_numbers_shown_and_simulated_and_the_start_may_be_chosen():
    found = minimize_by_preference(prefer, SPACE, simulate=simulate, n_simulated=30, n_max=4, start=(2.0, 20))
    assert found.samples[0] == pytest.approx([2.0, 20])
    assert len(found.samples) == 4
    assert 4 < len(found.simulated) <= 31


@pytest.mark.parametrize("agent", [GLISp, RandomSearch, partial(GLISp, n_init=3)])
def test_an_agent_that_cannot_simulate_is_refused(agent):
    with pytest.raises(SettingsError, match="takes no simulate"):
        minimize_by_preference(prefer, SPACE, simulate=simulate, agent=agent)


def test_screening_is_also_chosen_by_name_but_not_without_a_simulation():
    options = {"simulate": simulate, "n_simulated": 40, "n_max": 3}
    named = minimize_by_preference(prefer, SPACE, agent=Screening, **options)
    assert np.array_equal(named.samples, minimize_by_preference(prefer, SPACE, **options).samples)
    with pytest.raises(SettingsError, match="needs simulate"):
        minimize_by_preference(prefer, SPACE, agent=Screening, n_max=3)


def test_a_result_shows_its_samples_with_headings_and_marks_the_best():
    pytest.importorskip("pandas")
    space = KnobSpace([Knob("gain", 0, 1, "1/s"), Knob("<b>", 0, 1)])
    result = minimize_by_preference(lambda a, b: -1 if a[0] < b[0] else 1, space, n_max=4)
    frame = result.to_frame()
    assert list(frame.columns) == ["gain [1/s]", "<b>", "best"]
    assert frame.index.tolist() == [1, 2, 3, 4]
    (best,) = frame[frame["best"]]["gain [1/s]"]
    assert best == frame["gain [1/s]"].min() == result.best[0]
    assert "4 experiments, 3 answers" in result._repr_html_()
    assert "<b>" not in result._repr_html_()


def test_experiments_may_run_at_once_and_their_results_are_compared():
    def run(theta):
        return {"cost": float((theta[0] - 0.3) ** 2)}

    def prefer(a, b):
        return int(np.sign(a["cost"] - b["cost"]))

    space = KnobSpace([Knob("gain", 0.0, 1.0)])
    found = minimize_by_preference(prefer, space, run=run, at_once=3, n_max=8)
    assert len({tuple(theta) for theta in found.samples}) == 8
    assert run(found.best) == min(map(run, found.samples), key=lambda kpis: kpis["cost"])
    with pytest.raises(SettingsError, match="without run"):
        minimize_by_preference(prefer, space, at_once=3, n_max=8)
    kpis = {"simulate": lambda theta: {"a": float(theta[0])}}
    with pytest.raises(SettingsError, match="with simulate or twin, at_once must be 1, got 3"):
        minimize_by_preference(prefer, space, run=run, at_once=3, n_max=8, **kpis)
