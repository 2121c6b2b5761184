"""What a screening agent says of its result and its reasons, robust studies, and its simulations."""

import math
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contracts.proposals import MIXED
from prefcal_agents import Screening
from prefcal_agents.result import decisive, turn, wishes
from prefcal_agents.screening import findings as said_of
from prefcal_agents.screening.agent import Certificate
from prefcal_agents.screening.bank import ENOUGH, Growth, Simulations
from prefcal_agents.screening.findings import chances, findings, reason_for
from prefcal_env.errors import SettingsError, SimulationError
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Reading
from prefcal_env.preferences.history import History
from support.agents import quick
from support.simulated import SQUARE, everything, in_chain


def by_first(query):
    """The answer of a person who looks at the KPI "first"; the others matter little."""
    if query.incumbent is None:
        return None
    costs = [
        quick(s.theta)["first"] + 0.01 * quick(s.theta)["others"] for s in (query.challenger, query.incumbent)
    ]
    return int(np.sign(costs[0] - costs[1]))


def trade_off(theta):
    x, y = theta
    return {"a": 0.1 + x, "b": 1.1 - x, "c": 0.1 + y, "same": 1.0}


def staged(answers=()):
    """A stage after a chain of answers about the first rows of the bank."""
    grown = Growth(Simulations(trade_off), SQUARE, 100, 0)
    bank = grown.stage(History()).bank
    rows = range(len(answers) + 1)
    return grown.stage(in_chain(bank, rows, answers) if answers else History())


@pytest.mark.parametrize("seed", range(3))
def test_what_is_said_of_a_pair_is_true_of_it(seed):
    agent, said = Screening(MIXED, simulate=quick, n_simulated=60, n_max=6, seed=seed), 0
    while not agent.done:
        query, reason = agent.ask(), findings(agent).reason
        if query.incumbent is None:
            assert reason is None
        elif reason is not None:
            new, best = quick(query.challenger.theta), quick(query.incumbent.theta)
            assert all(new[name] < best[name] for name in reason.better_in)
            assert all(new[name] > best[name] for name in reason.worse_in)
            assert 0 <= reason.chance <= 1
            said += bool(reason.better_in or reason.worse_in)
        agent.tell(query, by_first(query))
    assert said >= 4
    assert findings(agent).reason is None


def test_a_pair_is_described_by_the_kpis_that_differ_and_no_others():
    stage = staged()
    order = np.argsort(stage.bank.thetas[:, 0])
    low, high = int(order[0]), int(order[-1])
    y = stage.bank.thetas[:, 1]
    reason = reason_for(stage, low, high, History())
    assert "a" in reason.better_in
    assert "b" in reason.worse_in
    assert ("c" in reason.better_in, "c" in reason.worse_in) == (y[low] < y[high], y[low] > y[high])
    assert "same" not in (*reason.better_in, *reason.worse_in)
    back = reason_for(stage, high, low, History())
    assert (back.better_in, back.worse_in) == (reason.worse_in, reason.better_in)


def test_a_difference_counts_from_where_one_in_ten_of_the_drawn_people_notices_it():
    stage = staged()
    reason = reason_for(stage, 0, 1, History())
    for name, steps in zip(stage.scale.names, stage.utilities.steps.T, strict=True):
        assert np.mean(steps < reason.noticed[name]) == pytest.approx(0.1, abs=0.01)


def test_an_experiment_compared_with_itself_is_better_in_nothing():
    stage = staged()
    reason = reason_for(stage, 4, 4, History())
    assert reason.better_in == reason.worse_in == ()
    assert reason.chance < 0.2  # it would have to be noticeably better


def test_chances_are_probabilities_and_follow_the_costs():
    stage = staged((-1, 1, -1))
    found = chances(stage, 2, History())
    assert found.shape == (len(stage.bank),)
    assert np.all((found >= 0) & (found <= 1))
    below = (stage.costs < stage.costs[:, [2]]).mean(axis=0)
    assert np.all(found <= below + 0.2)
    assert np.corrcoef(found, below)[0, 1] > 0.95


def test_somebody_who_often_sees_no_difference_is_expected_to_see_one_less_often():
    stage = staged()
    order = np.argsort(stage.bank.thetas[:, 0] + stage.bank.thetas[:, 1])
    pair = int(order[0]), int(order[-1])
    ties = in_chain(stage.bank, range(5), (0, 0, -1, 0))
    sure = reason_for(stage, *pair, History()).chance
    assert reason_for(stage, *pair, ties).chance == pytest.approx(2 / 5 * sure)


@pytest.fixture(scope="module")
def ended():
    agent = Screening(MIXED, simulate=quick, n_simulated=100, n_max=8, seed=0)
    nothing = everything(agent, over=True)
    assert (nothing.influences, nothing.stakes, nothing.menu, nothing.wishes) == ((), None, (), ())
    while not agent.done:
        query = agent.ask()
        stakes = everything(agent).stakes
        assert (stakes is None) == (query.incumbent is None)
        agent.tell(query, by_first(query))
        if stakes is not None and stakes < 0.05:
            assert agent.best_index == query.incumbent.index
    return agent


def test_turning_the_decisive_answer_gives_what_was_foretold(ended):
    said = everything(ended)
    named = decisive(said.influences, ended.best_index)
    assert named is not None
    agent = ended.copy()
    agent.history = turn(ended.history, named.answer)
    assert agent.best_index == named.reversed != ended.best_index
    assert said.stakes is None  # nothing is asked any more


def test_the_menu_holds_others_with_what_they_gain(ended):
    best = quick(ended.best)
    for other in everything(ended).menu:
        theta = np.array(other.theta)
        assert ended.bank.find(theta) is not None
        assert not np.array_equal(theta, ended.best)
        assert all(quick(theta)[name] < best[name] for name in other.better_in)


def test_what_decided_is_what_was_wanted(ended):
    assert dict(everything(ended).wishes)["first"] > 0.85


def test_what_is_noticed_only_beyond_a_kept_limit_is_a_bound_and_no_wish(ended):
    past = ended.history.past
    stage, pool = ended.stage(ended.history), ended.growth.pool(past)
    best = stage.bank.find(ended.best)
    own = quick(ended.best)["first"]
    ((certainty, value),) = wishes(pool, past, stage.spread, best).values()
    assert own < value
    for limit, bound in ((0.5 * own, False), (own, True), (0.5 * (own + value), True), (value, False)):
        named = (("first", certainty),)
        # What is aimed at leaves room to a limit, and is what a draw of the person goes by.
        for limits, aims in (({"first": limit}, {}), ({"first": 2 * value}, {"first": limit})):
            simulations = SimpleNamespace(reading=Reading(limits=limits, aims=aims))
            told = said_of._wishes(SimpleNamespace(simulations=simulations), stage, pool, past, best)
            assert told == {"wishes": () if bound else named, "bounds": named if bound else ()}


def test_a_result_without_a_given_start_is_compared_with_nothing(ended):
    assert ended.best_index != 0
    assert everything(ended).smaller is None


def test_a_requested_theta_that_was_not_simulated_says_nothing():
    agent = Screening(MIXED, simulate=quick, n_simulated=60, n_max=6, seed=0)
    for _ in range(3):
        query = agent.ask()
        agent.tell(query, by_first(query))
    agent.ask()
    free = KnobSpace.decode(MIXED, np.full(len(MIXED), 0.123))
    agent.replace_pending(MIXED.decode(MIXED.snap(MIXED.encode(free))))
    assert everything(agent).stakes is None


SPACE = KnobSpace([Knob("gain", 0.0, 1.0), Knob("filter", 0.0, 1.0)])


def kept_first(counts, runs):
    """Which runs of each θ are kept: as many as given, from the first on."""
    return np.array([[run <= count for run in runs] for count in counts], dtype=bool).reshape(-1, len(runs))


class Fast:
    """Faster with a larger gain, of which those above `edge` do not hold for long."""

    def __init__(self, edge=0.6, kept=5):
        self.edge, self.kept = edge, kept

    def __call__(self, theta):
        gain, filtered = theta
        return {"time": 2.0 - gain, "noise": 1.0 + 0.2 * gain - 0.1 * filtered}

    def holds(self, thetas, runs):
        return kept_first([self.kept if theta[0] > self.edge else ENOUGH for theta in thetas], runs)

    def losses(self, theta, runs):
        failed = int((~self.holds([theta], runs)).sum())
        return {"noise": 1, "time": failed}


class Plain(Fast):
    holds = None


class Quiet(Fast):
    losses = None


def studied(simulate, seed=0, n_max=7, start=None):
    """A finished study of a person who wants it fast."""
    agent = Screening(SPACE, simulate=simulate, n_simulated=200, n_max=n_max, seed=seed, start=start)
    while not agent.done:
        query, answer = agent.ask(), None
        if query.incumbent is not None:
            answer = int(np.sign(query.incumbent.theta[0] - query.challenger.theta[0]))
        agent.tell(query, answer)
    return agent


def test_the_result_holds_whatever_was_shown():
    for seed in range(3):
        assert 0.5 < studied(Fast(), seed).best[0] <= 0.6
        assert studied(Plain(), seed).best[0] > 0.9


def test_the_last_questions_show_what_holds():
    for seed in range(3):
        assert studied(Fast(edge=0.1), seed).samples[-3:, 0].max() <= 0.1


def test_it_follows_from_seed_and_record():
    assert np.array_equal(studied(Fast(), 1).samples, studied(Fast(), 1).samples)


def test_what_holds_everywhere_is_chosen_as_if_nothing_was_asked():
    assert np.array_equal(studied(Fast(edge=1.0)).samples, studied(Plain()).samples)


def test_where_nothing_holds_a_study_goes_on():
    agent = studied(Fast(edge=-1.0, kept=40))
    found = everything(agent).robustness
    assert (found.kept, found.most) == (40, 0)
    assert len(agent.samples) == 7


class Shares(Fast):
    """Nothing holds in all runs, and the faster, the fewer: beyond a gain of `edge`, hardly any."""

    def holds(self, thetas, runs):
        chances = [0.98 if theta[0] <= self.edge else 0.3 for theta in thetas]
        lots = [np.random.default_rng([run, 1]).random() for run in runs]
        return np.array([[lot < chance for lot in lots] for chance in chances]).reshape(-1, len(runs))


def test_where_nothing_holds_in_all_runs_the_result_holds_in_most():
    for seed in range(3):
        agent = studied(Shares(), seed)
        found = everything(agent).robustness
        assert 0.4 < agent.best[0] <= 0.6, "the fastest of those that keep most"
        assert (found.kept > 280, found.most) == (True, 0)
        # What it costs is beside what promises most, a gain near 1, which holds in few.
        ((name, ours, theirs),) = found.costs
        assert (name, ours, theirs) == ("time", 2.0 - agent.best[0], 2.0 - found.other[0])
        assert theirs < ours
        assert 50 < found.others_kept < 130


def test_what_won_by_the_answers_is_named_with_what_the_result_costs_and_overrules():
    for simulate in (Shares(), Fast()):
        agent = studied(simulate, start=[[0.95, 0.5]], n_max=3)
        found = everything(agent).robustness
        fastest = int(agent.samples[:, 0].argmax())
        assert found.won.index == fastest != agent.best_index
        kept = simulate.holds([agent.samples[fastest]], range(1, ENOUGH + 1)).sum()
        assert found.won.kept == kept < found.kept
        assert found.won.costs[0] == ("time", 2.0 - agent.best[0], 2.0 - agent.samples[fastest, 0])
        lost = [v.challenger for v in agent.history.verdicts() if v.loser == agent.best_index]
        assert [*found.won.overruled] == sorted(lost)
        assert agent.best_index in lost, "it lost when it was shown"
        assert (found.costs, found.others_kept) == ((), None), "one price is enough"
    other = everything(studied(Limited(), start=[[0.95, 0.5]], n_max=3)).robustness
    assert other.won.kept is None, "it misses a limit that the result keeps"


def test_a_start_that_keeps_more_runs_than_all_that_is_shown_stays_the_result():
    agent = studied(Shares(edge=0.05), start=[[0.05, 0.5]], n_max=3)
    assert agent.best[0] <= 0.05


def test_a_result_says_if_another_theta_keeps_more_runs():
    agent = studied(Shares(edge=0.05), start=[[0.5, 0.5], [0.6, 0.5]], n_max=2)
    found = everything(agent).robustness
    assert 50 < found.kept < 130
    assert found.most > 280
    assert found.other[0] <= 0.05
    assert sorted(name for name, *_ in found.costs) == ["noise", "time"]
    for name, ours, theirs in found.costs:
        assert (ours, theirs) == tuple(Plain()(theta)[name] for theta in (agent.best, found.other))


def test_the_price_is_what_the_best_nominal_one_is_better_in():
    agent = studied(Fast())
    found = everything(agent).robustness
    assert found.kept == ENOUGH
    ((name, ours, theirs),) = found.costs
    assert (name, ours) == ("time", 2.0 - agent.best[0])
    assert 1.0 <= theirs < ours, "nothing takes less than 1 s"
    assert theirs == 2.0 - found.other[0], "which it names"
    assert (found.others_kept, found.losses) == (Fast().kept, (("time", ENOUGH - Fast().kept), ("noise", 1)))
    plain = everything(studied(Quiet())).robustness
    assert (plain.others_kept, plain.losses) == (Fast().kept, ()), "a function need not say why"
    assert everything(studied(Fast(edge=1.0))).robustness.costs == ()
    assert everything(studied(Plain())).robustness is None


def test_a_tuning_of_the_persons_own_is_shown_and_one_that_holds_takes_its_place():
    agent = studied(Fast(), start=[[0.95, 0.5]])
    assert agent.samples[0].tolist() == [0.95, 0.5]
    assert agent.best[0] <= 0.6
    assert everything(agent).robustness.kept == ENOUGH


class Limited(Fast):
    """With a limit on the noise that only a gain below `edge` keeps; what misses it holds easily."""

    reading = Reading(limits={"noise": 1.1})

    def __call__(self, theta):
        return {"time": 2.0 - theta[0], "noise": 1.0 + (theta[0] > self.edge)}

    def holds(self, thetas, runs):
        good = (theta[0] > self.edge or theta[0] < 0.4 for theta in thetas)
        return kept_first([ENOUGH if each else self.kept for each in good], runs)


def test_what_misses_a_limit_that_others_keep_does_not_hold_however_little_is_left_to_lose(monkeypatch):
    for seed in range(3):
        agent = studied(Limited(), seed)
        assert 0.3 < agent.best[0] < 0.4
        found = everything(agent).robustness
        assert (found.kept, found.outdone, found.among) == (ENOUGH, False, True)
        assert [name for name, _, theirs in found.costs if theirs >= 1.4] == ["time"], "none faster keeps it"
    monkeypatch.setattr(said_of, "others", lambda costs, logs, usable, result: range(len(costs[0])))
    assert max(other.theta[0] for other in everything(agent).menu) < 0.4


def test_where_no_theta_keeps_all_limits_each_holds_by_those_that_it_keeps():
    agent = studied(Limited(edge=-1.0))
    assert agent.best[0] > 0.9
    found = everything(agent).robustness
    assert (found.kept, found.outdone, found.among) == (ENOUGH, False, False)


def test_where_no_theta_keeps_all_limits_only_those_that_miss_the_fewest_can_hold():
    class Strict(Limited):
        reading = Reading(limits={"noise": 1.1, "time": 0.5})  # nothing is as fast as that

        def holds(self, thetas, runs):
            return kept_first([ENOUGH for _ in thetas], runs)  # who misses both has nothing to lose

    for seed in range(3):
        agent = studied(Strict(), seed)
        assert 0.4 < agent.best[0] <= 0.6, "the fastest of those that keep the noise"
        found = everything(agent).robustness
        # Others miss more, but nothing keeps all limits: no price is beside what does.
        assert (found.kept, found.outdone, found.among) == (ENOUGH, False, False)


def test_a_result_that_misses_a_limit_says_so_if_nothing_that_was_shown_holds():
    class Lost(Limited):
        def holds(self, thetas, runs):
            return kept_first([ENOUGH if theta[0] > self.edge else self.kept for theta in thetas], runs)

    agent = studied(Lost(), start=[[0.7, 0.5], [0.9, 0.5]], n_max=2)
    found = everything(agent).robustness
    assert agent.best[0] > 0.6
    assert (found.kept, found.outdone, found.costs) == (ENOUGH, True, ())
    kept = everything(studied(Lost())).robustness
    assert (kept.kept, kept.outdone) == (5, False), "what is stated counts before what varies"


def test_a_study_does_not_end_by_itself_while_its_best_does_not_hold(monkeypatch):
    monkeypatch.setattr(Certificate, "of", lambda found: Certificate(0.1, 0.95, 0.5, (), None, enough=True))
    enough = [
        agent.has_enough(agent.history)
        for agent in (studied(Plain()), studied(Fast(edge=1.0)), studied(Fast(edge=-1.0, kept=ENOUGH - 1)))
    ]
    assert enough == [True, True, False]


def test_what_does_not_hold_is_not_on_the_menu(monkeypatch):
    monkeypatch.setattr(said_of, "others", lambda costs, logs, usable, result: range(len(costs[0])))
    offered = np.array([other.theta for other in everything(studied(Fast())).menu])
    assert len(offered) > 10
    assert offered[:, 0].max() <= 0.6


def test_what_never_reaches_what_the_result_reaches_is_not_on_the_menu(monkeypatch):
    monkeypatch.setattr(said_of, "others", lambda costs, logs, usable, result: np.flatnonzero(usable))
    agent = studied(Stuck(edge=1.0))
    offered = np.array([other.theta for other in everything(agent).menu])
    assert agent.best[0] >= 0.2
    assert len(offered) > 10
    assert offered[:, 0].min() >= 0.2


class Stuck(Fast):
    """Never there with a small gain."""

    def __call__(self, theta):
        return {**super().__call__(theta), "reached": np.inf if theta[0] < 0.2 else 1.0}


def test_what_never_arrives_does_not_take_the_place_of_what_promises_more():
    assert studied(Stuck(edge=0.2)).samples[1:, 0].min() > 0.15


def test_a_reason_says_how_the_challenger_holds():
    agent = Screening(SPACE, simulate=Fast(), n_simulated=100, n_max=4)
    agent.tell(agent.ask(), None)
    assert findings(agent).reason.kept == ENOUGH


def test_two_given_tunings_are_compared_with_how_each_of_them_holds():
    agent = Screening(SPACE, simulate=Fast(), n_simulated=100, start=[[0.9, 0.5], [0.5, 0.5]])
    agent.tell(agent.ask(), None)
    reason = findings(agent).reason
    assert (reason.kept, reason.against) == (ENOUGH, 5)
    assert (reason.better_in, reason.worse_in) == (("noise",), ("time",))
    assert agent.simulations.count <= len(agent.bank) + 2, "no more is simulated than the two"


def test_a_result_says_how_the_first_experiment_held():
    agent = studied(Fast(), start=[[0.9, 0.5]])
    found = everything(agent).robustness
    assert (found.kept, found.first) == (ENOUGH, 5)
    other = everything(studied(Limited(), start=[[0.9, 0.5]])).robustness
    assert (other.kept, other.first) == (ENOUGH, None), "it misses a limit that the best keeps"
    fastest = studied(Fast(), start=[[0.6, 1.0]], n_max=3)
    assert fastest.best_index == 0
    assert everything(fastest).robustness.first is None, "there is nothing to compare with"


THETAS = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])


class ManyAtOnce:
    """A simulation that runs all θ of a batch at once, and remembers the batches."""

    def __init__(self, simulate=quick):
        self.simulate, self.batches = simulate, []

    def __call__(self, theta):
        raise AssertionError("many is there")

    def many(self, thetas):
        self.batches.append([tuple(theta) for theta in thetas])
        return (self.simulate(theta) for theta in thetas)


def test_each_theta_is_simulated_once_and_results_come_in_order():
    calls = []

    def simulate(theta):
        calls.append(tuple(theta))
        return {"sum": theta.sum()}

    simulations = Simulations(simulate)
    assert [o["sum"] for o in simulations(THETAS[[0, 1, 0]])] == [3.0, 7.0, 3.0]
    assert [o["sum"] for o in simulations(THETAS[[2, 1]])] == [11.0, 7.0]
    assert calls == [(1.0, 2.0), (3.0, 4.0), (5.0, 6.0)]
    assert (simulations.count, simulations.failed) == (3, 0)


def test_minus_zero_is_the_theta_of_zero():
    simulations = Simulations(quick)
    simulations(np.array([[0.0, 1.0], [-0.0, 1.0]]))
    assert simulations.count == 1


def test_many_gets_only_what_is_new_and_its_results_are_those_of_one_by_one():
    many = ManyAtOnce()
    simulations = Simulations(many)
    simulations(THETAS[:2])
    assert simulations(THETAS) == Simulations(quick)(THETAS)
    assert many.batches == [[(1.0, 2.0), (3.0, 4.0)], [(5.0, 6.0)]]


def test_a_function_that_writes_into_theta_changes_nothing():
    def vandal(theta):
        found = quick(theta)
        theta[:] = np.nan
        return found

    thetas = THETAS.copy()
    for simulate in (vandal, ManyAtOnce(vandal)):
        assert Simulations(simulate)(thetas) == Simulations(quick)(THETAS)
        assert np.array_equal(thetas, THETAS)


@pytest.mark.parametrize("wrong", [None, 3, "cstr", {"a": 1}])
def test_what_is_no_function_is_refused(wrong):
    with pytest.raises(SettingsError, match="simulate must be a function of θ"):
        Simulations(wrong)
    broken = ManyAtOnce()
    broken.many = 3
    with pytest.raises(SettingsError, match="simulate must be a function of θ"):
        Simulations(broken)


@pytest.mark.parametrize(
    "result", [3.5, 0.0, "fast", [("a", 1.0)], np.zeros(2), {"a": "fast"}, {1: 2.0}, {"a": [1.0]}]
)
def test_a_result_that_is_no_kpis_is_refused_with_its_theta(result):
    for simulate in (lambda theta: result, ManyAtOnce(lambda theta: result)):
        with pytest.raises(SimulationError, match=r"(?s)mapping from names of KPIs.*\[1. 2.\]"):
            Simulations(simulate)(THETAS)


def test_a_result_that_is_no_kpis_ends_the_batch_and_what_was_found_is_kept():
    ran = []

    def simulate(theta):
        ran.append(theta[0])
        return 3.5 if theta[0] == 3.0 else quick(theta)

    simulations = Simulations(simulate)
    with pytest.raises(SimulationError, match=r"\[3. 4.\]"):
        simulations(THETAS)
    assert ran == [1.0, 3.0]
    assert simulations(THETAS[:1]) == [quick(THETAS[0])]
    assert ran == [1.0, 3.0]  # nothing ran again


@pytest.mark.parametrize("results", [[], [{"a": 1.0}], [{"a": 1.0}] * 4, None, 3])
def test_a_batch_with_another_number_of_results_is_refused(results):
    simulate = ManyAtOnce()
    simulate.many = lambda thetas: results
    with pytest.raises(SimulationError, match=r"simulate.many must return the KPIs of"):
        Simulations(simulate)(THETAS)


def test_if_all_fail_the_function_is_wrong_and_says_so_each_time_without_running_again():
    calls = []

    def broken(theta):
        calls.append(theta)
        raise KeyError(f"gain {len(calls)}")

    simulations = Simulations(broken)
    for _ in range(2):
        with pytest.raises(SimulationError, match=r"none of 3 θ; the last one: KeyError") as refusal:
            simulations(THETAS)
        assert refusal.value.__cause__.args == ("gain 3",)
    assert len(calls) == 3
    with pytest.raises(SimulationError, match="returned no KPI that is a number"):
        Simulations(lambda theta: {"a": np.nan})(THETAS)


def test_once_a_simulation_has_worked_a_batch_may_fail():
    simulations = Simulations(lambda theta: quick(theta) if theta[0] < 2 else None)
    simulations(THETAS[:1])
    assert simulations(THETAS[1:]) == [{}, {}]


def test_a_stop_by_the_person_is_passed_on_and_keeps_what_was_simulated():
    def stopped(theta):
        if theta[0] == 5.0:
            raise KeyboardInterrupt
        return quick(theta)

    simulations = Simulations(stopped)
    with pytest.raises(KeyboardInterrupt):
        simulations(THETAS)
    assert simulations.count == 2


def test_names_that_change_with_theta_are_refused_but_one_that_is_rare_is_not():
    thetas = np.arange(40.0).reshape(20, 2)
    with pytest.raises(SimulationError, match=r"same names for every θ.* 20 names"):
        Simulations(lambda theta: {f"peak at {theta[0]}": 1.0})(thetas)
    rare = Simulations(lambda theta: {f"peak at {theta[0]}": 1.0, "settling": 2.0})(thetas)
    assert all("settling" in outcome for outcome in rare)
    kinds = Simulations(lambda theta: {"abc"[int(theta[0]) % 3]: 1.0})(thetas)
    assert {name for outcome in kinds for name in outcome} == {"a", "b", "c"}


def test_threads_share_what_is_simulated_one_at_a_time_and_none_twice():
    calls, inside, most = [], [], []

    def slow(theta):
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.002)
        calls.append(tuple(theta))
        inside.pop()
        return {"sum": theta.sum()}

    simulations, thetas = Simulations(slow), np.arange(24.0).reshape(12, 2)
    found = {}
    orders = [np.random.default_rng(k).permutation(12) for k in range(4)]
    threads = [
        threading.Thread(target=lambda k=k: found.update({k: simulations(thetas[orders[k]])}))
        for k in range(4)
    ]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        assert 0 <= simulations.failed <= simulations.count <= 12  # while they are simulating
    assert sorted(calls) == [tuple(theta) for theta in thetas]
    assert max(most) == 1
    for k, order in enumerate(orders):
        assert [o["sum"] for o in found[k]] == thetas[order].sum(axis=1).tolist()


VALUES = st.one_of(st.floats(), st.sampled_from([0, 10**300, -(10**300), True, np.float32(1.5), np.int64(3)]))
RESULTS = st.one_of(st.none(), st.dictionaries(st.sampled_from("abc"), VALUES), st.just(OSError()))


@given(results=st.lists(RESULTS, min_size=1, max_size=9))
def test_any_kpis_are_kept_as_numbers_without_nan(results):
    def simulate(theta):
        found = results[int(theta[0])]
        if isinstance(found, OSError):
            raise found
        return found

    known = [
        {} if not isinstance(r, dict) else {n: float(v) for n, v in r.items() if not math.isnan(float(v))}
        for r in results
    ]
    simulations = Simulations(simulate)
    thetas = np.arange(float(len(results)))[:, None]
    if not any(known):
        with pytest.raises(SimulationError, match="worked for none"):
            simulations(thetas)
        return
    assert [dict(outcome) for outcome in simulations(thetas)] == known
    assert simulations.failed == sum(not k for k in known)
