"""Runs that wait or are in progress: a stop is kept, and what is no longer due is forgotten."""

import numpy as np

from prefcal_app.session.volatile.underway import UnderWay
from prefcal_env.errors import RunError
from prefcal_env.study import Suggested
from toy_study import toy_scenario

TOY = toy_scenario()
A, B = (Suggested(i, (0.5, 0.5, 0.5), (0.25 + 0.25 * i, 20.0, 1.0)) for i in range(2))


def underway():
    return UnderWay(TOY.source, seed=0)


def test_a_run_that_waits_is_the_one_that_begins():
    runs = underway()
    runs.wait_for(A, [A])
    waiting = runs.of(A)
    assert runs.begin(np.array(A.theta)) is waiting
    assert runs.of(A) is waiting
    runs.end(np.array(A.theta), waiting.advance())
    assert runs.of(A) is None


def test_a_stop_is_not_forgotten_while_another_run_is_waited_for():
    runs = underway()
    runs.wait_for(A, [A, B])
    stopped = runs.of(A)
    runs.wait_for(B, [A, B])
    assert runs.of(A) is stopped
    assert runs.begin(np.array(A.theta)) is stopped


def test_a_run_that_is_no_longer_due_does_not_wait():
    runs = underway()
    runs.wait_for(A, [A])
    runs.wait_for(B, [B])
    assert runs.of(A) is None
    assert runs.of(B) is not None


def test_a_plant_is_read_anew_when_asked_for():
    runs = underway()
    runs.wait_for(A, [A])
    before = runs.of(A)
    runs.wait_for(A, [A])
    assert runs.of(A) is before
    runs.wait_for(A, [A], anew=True)
    assert runs.of(A) is not before


def test_what_a_failed_run_recorded_belongs_to_its_theta():
    runs = underway()
    run = runs.begin(np.array(A.theta))
    run.partial = TOY.run(np.array(A.theta))
    runs.end(np.array(A.theta), RunError("it was stopped", "stopped"))
    runs.begin(np.array(B.theta))
    runs.end(np.array(B.theta), RunError("it was stopped", "stopped"))
    assert [*runs.partial.values()] == [run.partial]
    runs.wait_for(A, [A])
    assert not runs.partial
