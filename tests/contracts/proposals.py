"""What every agent must propose, whether it is told preferences or scores.

Part of the suites `agents` and `value_agents`.
"""

from functools import partial

import numpy as np
import pytest

from prefcal_env.errors import ProtocolError, SettingsError
from prefcal_env.knobs import Constraint, Knob, KnobSpace, LinearConstraint
from prefcal_env.preferences.answer import Query, Suggestion

MIXED = KnobSpace(
    [Knob("gain", 0.01, 10.0, scale="log10"), Knob("horizon", 2, 9, integer=True), Knob("weight", -5.0, 3.0)]
)
SMALL = KnobSpace([Knob("a", 1, 4, integer=True), Knob("b", 1, 1000, scale="log10", integer=True)])
TINY = KnobSpace([Knob("a", 0, 2, integer=True), Knob("b", 1, 2, integer=True)])

HALF = KnobSpace(MIXED.knobs, [LinearConstraint("sum", {"gain": 1, "horizon": 1}, 6)])
RING = KnobSpace(
    MIXED.knobs, [Constraint("ring", lambda knobs: abs(knobs["weight"] ** 2 + knobs["horizon"] - 8) - 1)]
)
RARE = KnobSpace(
    MIXED.knobs,
    [
        Constraint("gain", lambda knobs: abs(np.log10(knobs["gain"])) - 0.03, vectorized=True),
        Constraint("weight", lambda knobs: abs(knobs["weight"] - knobs["horizon"] / 5) - 0.1, True),
    ],
)
"""Some 0.05 % of the box."""
STAIRS = KnobSpace(SMALL.knobs, [Constraint("stairs", lambda knobs: 50 * knobs["a"] - knobs["b"])])


def latent(theta):
    """A cost in which every knob matters."""
    return float(np.sum((np.log1p(np.abs(theta)) - 1.0) ** 2) + 0.1 * theta[0])


def judge(query):
    """The answer of someone who knows `latent`."""
    if query.incumbent is None:
        return None
    return int(np.sign(latent(query.challenger.theta) - latent(query.incumbent.theta)))


def reply(agent, query):
    """The answer or the score of someone who knows `latent`."""
    return latent(query.challenger.theta) if agent.by_value else judge(query)


def run(agent, answers=None):
    """Answer until done, or with each of `answers`; return the queries.

    Fixed answers are about new experiments: follow-ups confirm the best, and are left out.
    """
    if answers is None:
        return answered(agent, [partial(reply, agent)] * (agent.n_max + 1))
    queries = []
    for answer in answers:
        queries += answered(agent, [answer])
        while not agent.done and agent.ask().further:
            query = agent.ask()
            agent.tell(query, -1 if query.challenger.index == agent.best_index else 1)
    return queries


def answered(agent, answers):
    """Answer with each of `answers`, a function of the query or a value; return the queries."""
    queries = []
    for answer in answers:
        if agent.done:
            break
        queries.append(agent.ask())
        agent.tell(queries[-1], answer(queries[-1]) if callable(answer) else answer)
    return queries


def test_the_same_seed_gives_the_same_study_and_another_one_does_not(make_agent):
    a, b, c = (run(make_agent(MIXED, n_init=4, n_max=8, seed=s)) for s in (3, 3, 4))
    assert a == b
    assert a != c


def test_a_stale_query_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    stale = agent.ask()
    agent.tell(stale, reply(agent, stale))
    before = agent.state
    with pytest.raises(ProtocolError, match="open query is"):
        agent.tell(stale, reply(agent, stale))
    with pytest.raises(ProtocolError):
        agent.tell(Query(Suggestion(1, np.array([1.0, 3.0, 0.0]))), 0)
    assert agent.state == before


@pytest.mark.parametrize("space", [MIXED, SMALL])
def test_theta_stays_in_the_box_integers_are_whole_and_none_runs_twice(make_agent, space):
    agent = make_agent(space, n_init=5, n_max=16, seed=2)
    thetas = [space.check(q.challenger.theta) for q in run(agent)]
    assert len({theta.tobytes() for theta in thetas}) == 16


@pytest.mark.unchecked
@pytest.mark.parametrize("space", [HALF, RING, RARE, STAIRS], ids=["half", "ring", "rare", "stairs"])
def test_every_proposal_is_allowed_by_the_constraints(make_agent, space):
    agent = make_agent(space, n_init=4, n_max=9, seed=2)
    thetas = [space.check_allowed(q.challenger.theta) for q in run(agent)]
    assert len({theta.tobytes() for theta in thetas}) == 9
    assert space.allows(agent.best)


def test_a_space_with_fewer_theta_than_experiments_is_tried_in_full(make_agent):
    agent = make_agent(TINY, n_init=4, n_max=50)
    assert agent.n_max == 6
    thetas = {tuple(q.challenger.theta) for q in run(agent)}
    assert thetas == {(a, b) for a in (0, 1, 2) for b in (1, 2)}
    assert agent.done
    with pytest.raises(ProtocolError, match="every one of the 6 θ"):
        agent.ask()


@pytest.mark.parametrize(
    "options",
    [
        {"n_init": 8, "n_max": 7},
        {"n_init": 0},
        {"n_init": 2.5},
        {"n_max": "many"},
        {"n_max": None},
        {"seed": -1},
        {"seed": 0.5},
        {"seed": None},
    ],
)
def test_impossible_counts_and_seeds_are_refused(make_agent, options):
    with pytest.raises(SettingsError) as refusal:
        make_agent(MIXED, **options)
    assert next(iter(options)) in str(refusal.value)
