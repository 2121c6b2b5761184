"""What every preference-based agent must satisfy.

A test file that imports everything from here and has a fixture `make_agent(space, **options)`
puts its agent through all of it. What an agent must remember stands in `agents_memory`.
"""

import numpy as np
import pytest

from prefcal_env.errors import KnobError, PreferenceError, ProtocolError, SettingsError
from prefcal_env.knobs import Constraint, Knob, KnobSpace, LinearConstraint
from prefcal_env.preferences.answer import Answer, Mark, Preference, Query, Suggestion

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


def run(agent, answers=None):
    """Answer until done, or with each of `answers`; return the queries.

    Fixed answers are about new experiments: follow-ups confirm the best, and are left out.
    """
    if answers is None:
        return answered(agent, [judge] * (agent.n_max + 1))
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


def test_asking_is_pure(make_agent):
    asked, silent = make_agent(MIXED, n_init=3, n_max=6), make_agent(MIXED, n_init=3, n_max=6)
    before = silent.state
    for _ in range(6):
        query = asked.ask()
        assert asked.ask() == query
        assert asked.ask() == query
        asked.tell(query, judge(query))
        query = silent.ask()
        silent.tell(query, judge(query))
    assert asked.state == silent.state
    assert make_agent(MIXED, n_init=3, n_max=6).state == before


def test_the_first_query_has_no_incumbent_and_any_answer_closes_it(make_agent):
    for answer in (-1, 0, 1, None, Answer(None, marks=(Mark.CHALLENGER_UNSAFE,))):
        agent = make_agent(MIXED, n_init=3, n_max=6)
        first = agent.ask()
        assert first.incumbent is None
        assert first.challenger.index == 0
        agent.tell(first, answer)
        assert agent.ask().incumbent == first.challenger
        assert np.array_equal(agent.best, first.challenger.theta)


def test_the_same_seed_gives_the_same_study_and_another_one_does_not(make_agent):
    a, b, c = (run(make_agent(MIXED, n_init=4, n_max=8, seed=s)) for s in (3, 3, 4))
    assert a == b
    assert a != c


@pytest.mark.parametrize("seed", range(3))
def test_a_sure_hand_is_never_shown_a_loser_as_the_best_and_gets_the_best_of_all(make_agent, seed):
    agent, lost, costs = make_agent(MIXED, n_init=4, n_max=14, seed=seed), set(), {}
    while not agent.done:
        query = agent.ask()
        costs[query.challenger.index] = latent(query.challenger.theta)
        assert agent.best_index not in lost
        if query.incumbent is not None:
            assert query.further or query.incumbent.index == agent.best_index
            pair = (query.challenger.index, query.incumbent.index)
            lost.add(max(pair, key=costs.__getitem__))
        agent.tell(query, judge(query))
    assert agent.best_index == min(costs, key=costs.__getitem__)


def test_nothing_is_proposed_nearer_than_the_resolution_of_its_knobs(make_agent):
    agent = make_agent(KnobSpace([Knob("a", 0, 1, step=0.25), Knob("b", 0, 3, step=1)]), n_init=4, n_max=18)
    run(agent)
    steps = agent.samples / [0.25, 1.0]
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert len({tuple(row) for row in np.round(steps)}) == len(steps) == 18


def test_a_stale_query_is_refused(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    stale = agent.ask()
    agent.tell(stale, 0)
    before = agent.state
    with pytest.raises(ProtocolError, match="open query is"):
        agent.tell(stale, 0)
    with pytest.raises(ProtocolError):
        agent.tell(Query(Suggestion(1, np.array([1.0, 3.0, 0.0]))), 0)
    assert agent.state == before


@pytest.mark.parametrize("answer", [2, -2, "a", 0.5, True, np.nan, [1]])
def test_an_answer_that_is_none_of_the_four_is_refused(make_agent, answer):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    query = agent.ask()
    with pytest.raises(PreferenceError):
        agent.tell(query, answer)
    assert agent.ask() == query


def test_a_bare_number_an_enum_and_an_answer_mean_the_same(make_agent):
    agents = [make_agent(MIXED, n_init=3, n_max=6) for _ in range(3)]
    for agent, answer in zip(agents, (-1, Preference.CHALLENGER, Answer(-1)), strict=True):
        run(agent, [None, answer])
    assert agents[0].state == agents[1].state == agents[2].state


def test_the_incumbent_is_the_winner_along_the_answers(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=9)
    queries = run(agent, [None, 1, -1, 0, None, -1])
    assert [q.incumbent and q.incumbent.index for q in queries] == [None, 0, 0, 2, 2, 2]
    assert agent.ask().incumbent.index == agent.best_index == 5
    assert np.array_equal(agent.best, queries[5].challenger.theta)


def test_there_is_no_best_before_the_first_answer(make_agent):
    with pytest.raises(ProtocolError, match="before the first answer"):
        _ = make_agent(MIXED, n_init=3, n_max=6).best


def test_done_after_n_max_experiments_and_then_nothing_more_is_asked(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=6)
    queries = run(agent)
    assert [q.challenger.index for q in queries] == list(range(6))
    assert agent.done
    for call in (agent.ask, lambda: agent.tell(queries[-1], 0)):
        with pytest.raises(ProtocolError, match="6 experiments are answered"):
            call()


def test_abstaining_moves_on_and_keeps_the_incumbent(make_agent):
    agent = make_agent(MIXED, n_init=3, n_max=12)
    queries = run(agent, [None] * 12)
    assert agent.done
    assert {q.incumbent.index for q in queries[1:]} == {0}
    assert len({q.challenger for q in queries}) == 12


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


def test_where_the_constraints_allow_nothing_asking_says_so(make_agent):
    impossible = Constraint("never", lambda knobs: knobs["weight"] ** 2 + 1, vectorized=True)
    with pytest.raises(KnobError, match=r"no θ was found.*'never' is 1"):
        make_agent(KnobSpace(MIXED.knobs, [impossible]), n_init=3, n_max=6).ask()


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


def test_something_that_is_no_space_is_refused(make_agent):
    with pytest.raises(SettingsError, match="KnobSpace"):
        make_agent([(0, 1)])
