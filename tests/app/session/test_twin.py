"""In an interview with a twin, the model is simulated and the plant runs what is shown."""

import numpy as np
import pytest

from prefcal_app.session import actions
from prefcal_app.simulating import Simulator, twin_of
from prefcal_env.errors import StudyError
from prefcal_env.preferences.answer import as_read
from support.interviews import answer_all, proceed
from support.twins import model, plant, twinned


def simulator():
    return Simulator(twin_of(plant, model), jobs=0)


def test_the_plant_is_shown_and_the_model_simulated():
    interview = twinned(simulator())
    now = proceed(interview)
    bank = interview.known.screened().bank
    shown = {sample.theta for sample in now.state.history.samples}
    rough = bank.names.index("rough")
    for theta, kpis, failed in zip(bank.thetas, bank.kpis, bank.failed, strict=True):
        if np.isinf(kpis).all() or failed or tuple(theta) in shown:
            continue
        assert kpis[rough] == as_read(0.6 * theta[0] ** 2)
    for experiment in (now.question.left.experiment, now.question.right.experiment):
        assert experiment.kpis["rough"] == experiment.theta[0] ** 2
    assert "simulated on the twin, 2 shown" in now.simulated.line


def test_answers_tell_what_was_measured():
    interview = twinned(simulator())
    answer_all(interview, lambda number: None)
    now = interview.now()
    bank = interview.known.screened(current=False).bank
    rough = bank.names.index("rough")
    told = now.state.history.samples[:-1]  # the last question was chosen before its answer
    measured = {s.theta: s.theta[0] ** 2 for s in told}
    found = 0
    for theta, kpis in zip(bank.thetas, bank.kpis, strict=True):
        if tuple(theta) in measured and np.isfinite(kpis).all():
            assert kpis[rough] == as_read(measured[tuple(theta)])
            found += 1
    assert found > 1


def test_a_look_at_a_simulated_theta_shows_the_model_and_runs_nothing_on_the_plant():
    interview = twinned(simulator())
    now = proceed(interview)
    shown = {sample.theta for sample in now.state.history.samples}
    bank = interview.known.screened().bank
    theta = next(
        t
        for t, k in zip(bank.thetas, bank.kpis, strict=True)
        if np.isfinite(k).all() and tuple(t) not in shown
    )
    looked = interview.look_at(theta)
    assert looked.kpis["rough"] == pytest.approx(0.6 * theta[0] ** 2)
    interview.do(actions.AskFor(theta))
    now = proceed(interview)
    assert now.question.challenger.experiment.kpis["rough"] == pytest.approx(theta[0] ** 2)


def test_without_its_twin_a_study_does_not_simulate_on_the_plant():
    with pytest.raises(StudyError, match="needs its twin 'model'"):
        twinned(None)
