"""The θ that promises most where KPIs explain the answers."""

import numpy as np
import pytest

from prefcal_agents import GLISp
from prefcal_agents.acquisition.penalty import unsafe_penalty
from prefcal_agents.glisp.kpi_fit import kpi_fits, most_promising
from prefcal_env.knobs.constraints import LinearConstraint
from prefcal_env.knobs.knob import Knob
from prefcal_env.knobs.space import KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import History, Sample
from support.studies import by, drive

SQUARE = KnobSpace([Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)])


def kpis_of(theta):
    """Two KPIs; the person minds the first one, whose best θ is (0.3, 0.6)."""
    return {"off": abs(theta[0] - 0.3) + abs(theta[1] - 0.6), "other": theta[0]}


def record_of(space, count, *, unsafe=lambda theta: False):
    """Return random θ, each compared with the best one before it."""
    history, rng = History(), np.random.default_rng(1)
    while history.answered < count:
        z = space.snap(rng.random(len(space)))
        theta, best = space.decode(z), history.incumbent
        if not space.allows(theta):
            continue
        off = kpis_of(theta)["off"]
        rival = None if best is None else kpis_of(history.samples[best].theta)["off"]
        answer = None if rival is None else int(np.sign(off - rival))
        marks = (Mark.CHALLENGER_UNSAFE,) if unsafe(theta) else ()
        history = history.with_pending(Sample.of(space, z))
        told = Answer(answer, marks=marks, outcomes=(kpis_of(theta), None))
        history = history.with_answer(told, best)
    return history


def proposed(space, history, seed=0):
    fit = kpi_fits(seed).after(history)
    penalty = unsafe_penalty(history, 30.0, 0.9)
    z = most_promising(space, history, fit, penalty, np.random.default_rng(seed))
    return space.decode(space.snap(z))


def test_it_comes_closer_to_what_the_person_wants():
    history = record_of(SQUARE, 15)
    best = kpis_of(history.samples[history.incumbent].theta)["off"]
    found = [kpis_of(proposed(SQUARE, history, seed))["off"] for seed in range(5)]
    assert np.median(found) < 0.7 * best


def test_the_same_generator_gives_the_same_theta():
    history = record_of(SQUARE, 8)
    first, again, other = (proposed(SQUARE, history, seed) for seed in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("count", [2, 11])
def test_no_theta_runs_twice_as_long_as_there_is_another(count):
    space = KnobSpace([Knob("a", 0, 3, integer=True), Knob("b", 0, 2, integer=True)])
    history, z = History(), [(a, b) for a in range(4) for b in range(3)]
    for theta in map(np.array, z[:count]):
        best = history.incumbent
        told = Answer(None if best is None else 1, outcomes=(kpis_of(theta), None))
        history = history.with_pending(Sample.of(space, space.encode(theta))).with_answer(
            told, best
        )
    assert tuple(proposed(space, history).astype(int)) in z[count:]


def test_constraints_hold():
    space = KnobSpace(
        [Knob("a", 0.0, 1.0), Knob("b", 0.0, 1.0)],
        constraints=[LinearConstraint("sum", {"a": 1.0, "b": 1.0}, 0.8)],
    )
    history = record_of(space, 12)
    for seed in range(4):
        assert space.allows(proposed(space, history, seed))


def test_places_that_are_likely_unsafe_come_last():
    history = record_of(SQUARE, 30, unsafe=lambda theta: theta[0] < 0.45)
    assert all(proposed(SQUARE, history, seed)[0] > 0.4 for seed in range(4))


def cost(theta):
    return (theta[0] - 0.3) ** 2 + 1e-3 * (theta[1] - 0.8) ** 2


def gap(seed):
    """What is left after 20 experiments of a person who notices every difference."""
    agent = GLISp(SQUARE, n_init=5, n_max=20, seed=seed)
    drive(agent, by(cost), kpis=lambda new: {"off": abs(new[0] - 0.3), "spent": abs(new[1] - 0.8)})
    return cost(agent.best)


@pytest.mark.xfail(reason="version 12 comes to 1.5e-4; version 11 came to the bound")
def test_studies_with_kpis_come_to_the_optimum_with_it():
    # 20 random samples come to 5e-4 (median of 1000 times).
    assert np.median([gap(seed) for seed in range(6)]) < 1e-4
