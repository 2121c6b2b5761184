"""How the bank grows from answer to answer, and what is said of a result."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from contracts.proposals import HALF, MIXED, RARE, RING
from prefcal_agents import Screening
from prefcal_agents.screening.agent import FROM, LEAST, MOST, Certificate, Evidence, evidence
from prefcal_agents.screening.bank import Growth, KeptStage, Simulations, near_leaders
from prefcal_agents.screening.findings import findings
from prefcal_agents.search import Region, latin_hypercube
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Preference, Reading
from prefcal_env.preferences.history import History
from support.simulated import SQUARE, in_chain


def trade_off(theta):
    """KPIs of `SQUARE` that contradict each other."""
    x, y = theta
    return {"a": 0.1 + (x - 0.2) ** 2, "b": 0.1 + (x - 0.9) ** 2, "c": 0.1 + (y - 0.4) ** 2}


def growth(n_simulated=100, simulate=trade_off, seed=3):
    return Growth(Simulations(simulate), SQUARE, n_simulated, seed)


def chain(grown, answers):
    """A record of the first simulated θ, each compared with the one before."""
    bank = grown.stage(History()).bank
    return in_chain(bank, range(len(answers) + 1), answers)


def same(one, other):
    """Whether two stages know the same."""
    return (
        np.array_equal(one.bank.thetas, other.bank.thetas)
        and np.array_equal(one.bank.kpis, other.bank.kpis)
        and np.array_equal(one.spread, other.spread)
        and np.array_equal(one.utilities.normals, other.utilities.normals)
        and np.array_equal(one.costs, other.costs)
    )


@pytest.fixture
def kept():
    """A record of 14 answers, the growth that has learned it, and what that keeps, as it is written."""
    grown = growth(100)
    record = chain(grown, [1, -1] * 7)
    grown.stage(record)
    return record, grown, msgspec.msgpack.encode(grown.worth_keeping(record))


@pytest.fixture
def anew(monkeypatch):
    """The number of experiments of each stage that is learned from the one before."""
    found, follow = [], Growth._follow
    monkeypatch.setattr(
        Growth, "_follow", lambda g, past, *rest: (found.append(past.answered), follow(g, past, *rest))[1]
    )
    return found


def recalling(content, **given):
    other = growth(100, **given)
    other.recall(msgspec.msgpack.decode(content, type=dict[bytes, KeptStage]))
    return other


def test_a_later_session_recalls_the_same_stages_and_goes_on_with_the_same_ones(kept, anew):
    record, grown, content = kept
    again = recalling(content)
    for count in range(15, 4, -1):
        assert same(again.stage(record.until(count)), grown.stage(record.until(count)))
    assert anew == []
    longer = chain(grown, [1, -1] * 8)
    assert same(recalling(content).stage(longer), growth(100).stage(longer))
    assert anew[:2] == [16, 17]  # the second one began with the first answer
    assert anew[2:] == [*range(1, 18)]


@pytest.fixture
def longer():
    """A record of 26 answers, the growth that has learned it, and what that keeps."""
    grown = growth(100)
    record = chain(grown, [1, -1] * 13)
    grown.stage(record)
    return record, grown, msgspec.msgpack.encode(grown.worth_keeping(record))


def test_after_an_undo_of_many_answers_a_later_session_begins_at_the_latest_tenth_one(longer, anew):
    record, grown, content = longer
    for count, needed in ((27, []), (26, []), (22, []), (16, range(11, 17)), (10, [])):
        anew.clear()
        stage = recalling(content).stage(record.until(count))
        assert anew == [*needed]
        assert same(stage, grown.stage(record.until(count)))
    # The draws of all records: the last ten answers have draws of their own.
    for count, needed in ((27, []), (22, range(11, 17))):
        anew.clear()
        recalling(content).pool(record.until(count))
        assert anew == [*needed]


def test_what_an_undo_goes_back_to_outlasts_sessions_that_do_not_need_it(longer, anew):
    record, _, content = longer
    again = recalling(content)
    again.stage(record)
    third = recalling(msgspec.msgpack.encode(again.worth_keeping(record)))
    third.stage(record.until(12))
    assert anew == [11, 12]


def test_what_was_learned_of_other_kpis_or_of_another_record_is_not_recalled(kept, anew):
    record, _, content = kept

    def otherwise(theta):
        return trade_off(theta) | {"c": 0.2 + theta[0]}

    other = recalling(content, simulate=otherwise).stage(record)
    assert same(other, growth(100, otherwise).stage(record))
    undone = chain(growth(100), [1, -1] * 6 + [1, 1])
    anew.clear()
    assert same(recalling(content).stage(undone), growth(100).stage(undone))
    assert anew[0] == 15


def test_stages_that_a_session_never_needed_are_kept_for_the_next_one_if_they_are_of_its_record(kept):
    record, _, content = kept
    before = msgspec.msgpack.decode(content, type=dict[bytes, KeptStage])
    assert recalling(content).worth_keeping(record) == before
    undone = chain(growth(100), [1, -1] * 6 + [1, 1])  # the last answer is another one
    shared = {record.until(count).key for count in range(5, 15)}
    assert recalling(content).worth_keeping(undone).keys() == shared
    assert record.key in before


def test_a_stated_limit_is_measured_from_the_best_value_that_is_known_now():
    def far(theta):  # the more negative, the better: at least 0.5 is wanted
        return {"a": -theta[0], "b": theta[1]}

    far.reading = Reading(steps={"a": 0.0}, limits={"a": -0.5})
    grown = growth(100, far)
    record = chain(grown, [-1] * 7)
    stages = [grown.stage(record.until(k)) for k in (0, 8)]
    assert stages[1].scale.good[0] < stages[0].scale.good[0]
    for stage in stages:
        known = stage.utilities.limits[:, 0]
        assert np.isfinite(known).mean() > 0.8
        assert set(known[np.isfinite(known)]) == {-0.5 - stage.scale.good[0]}


def limits_of_draws(simulate, answers=()):
    """The limits on "a" of the draws after some answers."""
    grown = growth(100, simulate)
    known = grown.stage(chain(grown, answers) if answers else History()).utilities.limits[:, 0]
    return set(known[np.isfinite(known)])


@pytest.mark.parametrize("answers", [(), (1, -1, 1, 0)])
def test_limits_with_room_count_unless_that_costs_an_objective(answers):
    def roomy(theta):
        return {"a": 1.0 + theta[0], "b": 1.0 + theta[1]}

    def crowded(theta):  # where "a" leaves room, "b" misses its objective
        return {"a": 1.0 + theta[0], "b": 2.0 - theta[0]}

    limits = {"a": 1.8, "b": 1.25}
    for simulate, aims, expected in ((roomy, {}, 1.8), (roomy, {"a": 1.5}, 1.5), (crowded, {"a": 1.5}, 1.8)):
        simulate.reading = Reading(limits=limits, aims=aims)
        assert limits_of_draws(simulate, answers) == {expected}


def test_the_plan_simulates_a_quarter_first_then_a_third_then_a_little_after_each_answer():
    grown = growth(100)
    record = chain(grown, [1, -1] * 7)
    counts = np.array([len(grown.stage(record.until(k)).bank) for k in range(16)])
    # 20 + 8, nothing for an experiment that is compared with nothing, 20 + 12, then ten times 4.
    assert counts[:3].tolist() == [28, 28, 60]
    steps = np.diff(counts[2:])
    assert np.all(steps[:10] > 0)
    assert np.all(steps <= [4] * 10 + [0] * 3)
    assert counts[-1] >= 90  # a few θ are the same when rounded
    assert grown.simulations.count == counts[-1]
    stage = grown.stage(record)
    assert len(stage.spread) == 40
    assert np.all(np.diff(stage.spread) > 0)


def test_what_is_shown_joins_the_bank():
    grown = growth(20)
    record = chain(grown, [1, -1])
    other = record.with_pending(type(record.samples[0])((0.123, 0.456), (0.123, 0.456)))
    shown = other.with_answer(Answer(-1), 1)
    assert grown.stage(shown).bank.find((0.123, 0.456)) >= 0
    with pytest.raises(KeyError):
        grown.stage(record).bank.find((0.123, 0.456))


def test_a_stage_depends_on_the_record_alone_not_on_what_was_asked_before():
    used = growth()
    record = chain(used, [1, -1, -1, 1])
    for count in (5, 2, 4):
        used.stage(record.until(count))
    undone = record.undone()
    again = undone.with_pending(record.samples[4]).with_answer(Answer(-1), 3)
    for now in (record, undone, again, record.retracted(2), again.retracted(1)):
        assert same(used.stage(now), growth().stage(now))
    assert not same(used.stage(record), used.stage(again))
    assert not same(used.stage(record), used.stage(record.retracted(2)))


def test_answers_to_follow_ups_teach_but_bring_no_new_theta():
    grown = growth()
    record = chain(grown, [1, 1, 1])
    before, count = grown.stage(record), grown.simulations.count
    after = grown.stage(record.with_follow_up(Answer(1), 3, 0))
    assert grown.simulations.count == count
    assert np.array_equal(after.bank.thetas, before.bank.thetas)
    assert not np.array_equal(after.costs, before.costs)
    lead = [np.mean(s.costs[:, 0] < s.costs[:, 3]) for s in (before, after)]
    assert lead[1] >= lead[0]


@pytest.mark.parametrize("known", [{}, {"late": 0.0}], ids=["absent", "constant"])
def test_a_kpi_that_appears_after_the_first_answer_is_learned(known):
    first = growth().stage(History()).bank.thetas.tolist()

    def simulate(theta):
        late = {"late": 0.1 + abs(np.sin(40 * theta.sum()))}
        return trade_off(theta) | (known if theta.tolist() in first else late)

    grown = growth(simulate=simulate)
    begun = grown.stage(History())
    assert begun.scale.names == ("a", "b", "c")
    begin = chain(grown, [0])
    stage = grown.stage(begin)
    assert stage.scale.names == ("a", "b", "c", "late")
    late = stage.bank.kpis[:, stage.bank.names.index("late")]
    new = [row for row in np.argsort(-late) if row >= len(begun.bank)][:24:2]
    record = in_chain(stage.bank, [0, 1, *new], [0, None, *[-1] * (len(new) - 1)])
    assert np.array_equal(grown.stage(record.until(2)).bank.thetas, stage.bank.thetas)
    after = grown.stage(record).utilities.normals
    assert after.shape == (1024, 4)
    assert np.mean(np.argmax(after, axis=1) == 3) > 0.5  # it counts most


# Where to simulate next: near the leaders.

PART = MIXED.narrowed({"gain": (0.1, 0.2), "horizon": (4, 6)})
FROZEN = MIXED.narrowed({"weight": (0.31, 0.31)})
CUBE = KnobSpace([Knob(name, 0.0, 1.0) for name in "abc"])


def near(space, costs=None, count=60, seed=0, z=None):
    """Points near the leaders of `costs` of a start that fills the space, and that start."""
    z = latin_hypercube(space, 80, 1) if z is None else z
    rng = np.random.default_rng(seed)
    costs = rng.random((8, len(z))) if costs is None else costs(z)
    return near_leaders(space, z, costs, count, rng), z


@pytest.mark.parametrize("space", [MIXED, PART, FROZEN, HALF, RING, RARE], ids="mpfhrx")
def test_points_are_inside_what_is_searched_and_allowed(space):
    points, _ = near(space)
    low, high = space.corners
    assert points.shape == (60, 3)
    assert np.all((points >= low) & (points <= high))
    assert Region(space).allows(points).all()  # θ that rounding takes over an edge: `Growth`


def test_points_are_near_those_that_lead():
    goal = np.array([0.3, 0.6, 0.7])
    z = latin_hypercube(CUBE, 400, 1)
    points, _ = near(CUBE, lambda z: np.linalg.norm(z - goal, axis=1)[None], 200, z=z)
    apart, before = (np.linalg.norm(p - goal, axis=1) for p in (points, z))
    assert np.median(apart) < np.quantile(before, 0.1)
    assert np.mean(apart < np.sort(before)[2]) > 0.05  # some are better than all but two


def test_each_draw_has_leaders_of_its_own():
    goals = np.array([[0.2, 0.2], [0.8, 0.8]])
    z = latin_hypercube(SQUARE, 400, 1)
    costs = np.linalg.norm(z[None] - goals[:, None], axis=2)
    points = near_leaders(SQUARE, z, costs, 300, np.random.default_rng(0))
    apart = np.linalg.norm(points[None] - goals[:, None], axis=2)
    assert np.all(np.mean(apart < 0.2, axis=1) > 0.35)
    assert np.mean(apart.min(axis=0) < 0.25) > 0.9


def test_steps_shrink_as_the_leaders_agree():
    rng, goal = np.random.default_rng(0), np.full(3, 0.5)
    spread = []
    for width in (0.4, 0.04):
        z = goal + width * (rng.random((50, 3)) - 0.5)
        points, _ = near(CUBE, lambda z: rng.random((8, len(z))), 200, z=z)
        spread.append(points.std(axis=0).mean())
    assert spread[1] < 0.3 * spread[0]


def test_leaders_that_are_all_the_same_are_left_by_a_small_step():
    z = np.full((1, 3), 0.5)
    points, _ = near(CUBE, lambda z: np.zeros((2, 1)), 100, z=z)
    assert np.abs(points - 0.5).max() < 0.06
    assert points.std(axis=0) == pytest.approx(np.full(3, 0.01), rel=0.3)


def test_the_same_seed_gives_the_same_points():
    (one, _), (same, _), (other, _) = (near(HALF, seed=seed) for seed in (4, 4, 5))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


KNOWN = Evidence(10, 0.01, 0.002, 2.0, -0.4, True, 0.3, (0.5, 0.5), 1000)
WON, SAME, LOST = -1, 0, 1
"""What the challenger did."""


def both(theta):
    """Two KPIs that one θ, the corner at zero, has best."""
    return {"a": 0.1 + theta[0], "b": 0.1 + theta[1] ** 2}


class Limited:
    """A simulation of both KPIs with upper limits on them."""

    def __init__(self, limits):
        self.reading = Reading(limits=limits)

    def __call__(self, theta):
        return both(theta)


def grown():
    return Growth(Simulations(both), SQUARE, 100, 0)


def from_worst(growth):
    """Rows of the first bank, the worst one first."""
    return np.argsort(-growth.stage(History()).bank.thetas.sum(axis=1))


def after(growth, rows, answers, best):
    """The evidence about row `best` of the first bank after a chain of answers."""
    record = in_chain(growth.stage(History()).bank, rows, answers)
    stage = growth.stage(record)
    theta = growth.stage(History()).bank.thetas[best]
    given = growth.posterior(record)
    return evidence(stage, stage.bank.find(theta), record, given, explained=growth.explains(record))


def answered(agent, count):
    """The agent after `count` answers of a person who wants the smaller sum of both KPIs."""
    for _ in range(count + 1):
        query = agent.ask()
        if query.incumbent is None:
            agent.tell(query, Answer(None))
        else:
            new, old = (sum(both(side.theta).values()) for side in (query.challenger, query.incumbent))
            agent.tell(query, Preference(int(np.sign(new - old))))
    return agent


def test_nobody_is_said_to_prefer_what_is_no_better_in_any_kpi():
    growth = grown()
    *_, second, best = from_worst(growth)
    found = after(growth, [second, best], [WON], best)
    first = growth.stage(History()).bank
    kpis = growth.stage(in_chain(first, [second, best], [WON])).bank.kpis
    dominated = np.all(kpis >= first.kpis[best], axis=1)
    assert dominated.any()
    assert found.better <= 1 - dominated.mean()


def test_of_the_worst_it_is_said_that_most_are_better_and_of_the_best_that_few_are():
    growth = grown()
    worst, *_, best = from_worst(growth)
    poor, good = (after(growth, [worst, best], [WON], row) for row in (worst, best))
    assert poor.better > 0.5 > 0.2 > good.better
    assert poor.wide > 0.7 > good.wide
    assert poor.chance > 0.9 > good.chance


def test_a_result_holds_longer_with_every_challenger_that_it_beats_until_one_wins():
    growth = grown()
    rows = from_worst(growth)[::-1]  # the best one first
    chain = rows[[20, 0, 1, 2, 3]]
    held = [after(growth, chain[: k + 2], [WON, SAME, LOST, SAME][: k + 1], rows[0]).held for k in range(4)]
    assert held[0] == 0
    assert 0 < held[1] < held[2]
    assert after(growth, chain, [WON, SAME, LOST, WON], rows[0]).held == 0


def test_answers_that_follow_from_the_kpis_are_predicted_and_contradictions_are_not():
    growth = Growth(Simulations(lambda t: {"a": 0.1 + t[0], "b": 1 + 5 * t[0]}), SQUARE, 100, 0)
    rows = np.argsort(-growth.stage(History()).bank.thetas[:, 0])[[0, 5, 10, 15, 19]]
    sensible = after(growth, rows, [WON] * 4, rows[-1])
    absurd = after(growth, rows, [WON, LOST, LOST, WON], rows[-1])
    assert absurd.predicted < np.log(1 / 3) < sensible.predicted < 0


def test_nothing_is_promised_that_was_shown_or_that_failed():
    growth = Growth(
        Simulations(lambda t: both(t) if t[0] > 0.5 else {"a": np.inf, "b": np.inf}), SQUARE, 100, 0
    )
    rows = from_worst(growth)
    bank = growth.stage(History()).bank
    usable = rows[~bank.hopeless[rows]]
    found = after(growth, usable[-3:], [WON, WON], usable[-1])
    assert found.promising not in {tuple(bank.thetas[row]) for row in usable[-3:]}
    assert found.promising[0] > 0.5


@pytest.mark.parametrize("badly", [{"predicted": np.log(1 / 3) - 0.01}, {"explained": False}])
def test_if_answers_do_not_follow_from_the_kpis_no_number_is_stated(badly):
    said = Certificate.of(replace(KNOWN, **badly))
    assert not said.explained
    assert said.share is None
    assert said.chance is None
    assert Certificate.of(KNOWN).explained


def test_the_share_is_a_whole_percentage_between_the_least_and_all():
    sure, vague = replace(KNOWN, held=50.0), replace(KNOWN, better=1.0, wide=1.0, held=0.0, answers=2)
    assert Certificate.of(sure).share == LEAST
    assert Certificate.of(vague).share == 1.0
    assert Certificate.of(KNOWN).share * 100 == pytest.approx(round(Certificate.of(KNOWN).share * 100))


@pytest.mark.parametrize(("spread", "least"), [(1000, 0.01), (300, 0.01), (99, 0.03), (28, 0.11), (1, 0.95)])
def test_few_simulated_experiments_cannot_show_that_few_are_better(spread, least):
    """By the rule of three: with s = 3 / N, none of N is better by chance in 5 % of all cases."""
    said = Certificate.of(replace(KNOWN, held=50.0, spread=spread))
    assert said.share == pytest.approx(least)
    low, middle, _ = said.experiments
    assert low <= middle
    if spread < 300:
        assert low <= spread, "as good as the best of more experiments than there were"


def test_the_share_by_hand():
    said = Certificate.of(Evidence(10, 0.099, 0.009, 2.0, -0.5, True, 0.5, (), 1000))
    size = 10 ** (1.583 + 0.382 * -1 - 0.177 * np.log(10) - 0.169 * 2 + 0.615 * -2 - 0.364 * -0.5)
    assert said.share == pytest.approx(np.ceil(100 * size) / 100)
    assert said.chance == pytest.approx(1 / (1 + np.exp(-0.2))), "half of the draws, which are a little low"


def test_it_is_enough_after_six_and_eight_answers_if_share_and_chance_are_small():
    good = replace(KNOWN, answers=6, better=0.0, wide=0.0)
    assert Certificate.of(good).share <= 0.1
    assert Certificate.of(good).enough
    assert Certificate.of(replace(good, answers=8)).enough
    for less in ({"answers": 5}, {"answers": 7}, {"chance": 0.45}, {"wide": 0.1}, {"explained": False}):
        assert not Certificate.of(replace(good, **less)).enough
    assert Certificate.of(replace(good, chance=0.43)).enough, "which states just below 50 %"


def test_an_agent_has_enough_only_while_its_best_misses_no_objective(monkeypatch):
    agents = [
        Screening(SQUARE, simulate=simulate, n_simulated=60, n_max=8, seed=3)
        for simulate in (both, Limited({"a": 5.0}), Limited({"a": 0.05}))
    ]
    for agent in agents:
        answered(agent, 5)
    assert not any(agent.has_enough(agent.history) for agent in agents)
    monkeypatch.setattr(Certificate, "of", lambda found: Certificate(0.1, 0.95, 0.5, (), None, enough=True))
    assert [agent.has_enough(agent.history) for agent in agents] == [True, True, False]
    assert not agents[0].has_enough(agents[0].history.until(2)), "one answer says nothing"
    assert not agents[0].done, "the study decides whether to go on"


def test_the_number_of_random_experiments_by_hand():
    said = Certificate.of(Evidence(10, 0.099, 0.009, 2.0, -0.5, True, 0.5, (), 1000))
    size = 1.583 + 0.382 * -1 - 0.177 * np.log(10) - 0.169 * 2 + 0.615 * -2 - 0.364 * -0.5
    for number, chance in zip(said.experiments[:2], (0.05, 0.5), strict=True):
        share = 10 ** (size - 0.544 * (np.log(chance / (1 - chance)) - np.log(0.01 / 0.99)))
        assert (1 - share) ** number == pytest.approx(0.5), "so many find nothing better half of the time"
    assert said.experiments[0] < said.experiments[1] < said.experiments[2] == MOST
    poor, *_ = Certificate.of(replace(KNOWN, better=1.0, wide=1.0, held=0.0, answers=2)).experiments
    assert poor == 1
    assert Certificate.of(replace(KNOWN, explained=False)).experiments is None


def test_the_chance_grows_with_that_of_the_draws_and_is_never_sure():
    chances = [Certificate.of(replace(KNOWN, chance=p)).chance for p in (0.0, 0.1, 0.5, 0.9, 1.0)]
    assert chances == sorted(chances)
    assert 0.02 < chances[0] < chances[-1] < 0.98


def test_an_agent_says_nothing_at_first_and_the_same_after_a_restart():
    agents = [Screening(SQUARE, simulate=both, n_simulated=60, n_max=8, seed=3) for _ in range(2)]
    first = answered(agents[0], FROM - 1)
    assert first.certificate is None
    said = answered(agents[1], 5).certificate
    assert said is not None
    assert said.explained
    again = Screening(SQUARE, simulate=both, n_simulated=60, n_max=8, seed=3)
    assert answered(again, 5).certificate == said


def test_what_an_agent_says_of_a_sensible_person_is_true():
    agent = answered(Screening(SQUARE, simulate=both, n_simulated=100, n_max=12, seed=1), 10)
    thetas = np.random.default_rng(0).random((2000, 2))
    sums = np.array([sum(both(theta).values()) for theta in thetas])
    assert np.mean(sums < sum(both(agent.best).values())) <= agent.certificate.share < 0.5


def test_where_experiments_measure_other_kpis_than_those_simulated_nothing_is_said():
    agent = Screening(SQUARE, simulate=both, n_simulated=60, n_max=8, seed=0)
    for _ in range(4):
        query = agent.ask()
        told = [
            {k: 1.3 * v for k, v in both(side.theta).items()}
            for side in (query.challenger, query.incumbent)
            if side
        ]
        agent.tell(
            query, Answer(None if len(told) < 2 else Preference.CHALLENGER, outcomes=(*told, None)[:2])
        )
    assert agent.certificate is None


def test_given_candidates_are_all_there_is_from_the_first_question_to_the_last():
    space = KnobSpace([Knob("row", 1, 40, integer=True)])
    rows = np.array([3, 4, 9, 12, 13, 20, 21, 22, 29, 31, 37, 38, 40, 2, 7], dtype=float)
    asked = []

    def numbers(theta):
        asked.append(theta[0])
        return {"a": (7 * theta[0]) % 41, "b": (11 * theta[0]) % 41}

    numbers.candidates = rows[:, None]
    agent = Screening(space, simulate=numbers, n_max=len(rows), seed=1)
    shown = []
    while not agent.done:
        query = agent.ask()
        assert set(agent.bank.thetas[:, 0]) == set(rows)
        shown.append(query.challenger.theta[0])
        # The first one wins every time: the KPIs explain nothing, and all challengers lose.
        agent.tell(query, None if query.incumbent is None else Preference.INCUMBENT)
    assert sorted(shown) == sorted(rows)
    assert sorted(asked) == sorted(rows)
    assert findings(agent).trend is None
