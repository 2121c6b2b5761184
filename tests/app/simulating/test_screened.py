"""What is read from a screening agent, when, and what of it front ends get."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from prefcal_agents.screening import findings
from prefcal_agents.screening.agent import Certificate, Screening
from prefcal_agents.screening.findings import Findings, Reason, RobustResult, Winner
from prefcal_app.session import Choice, Phase, actions
from prefcal_app.session.study import ENOUGH, why_over
from prefcal_app.simulating import chance_left, offer, promise, told
from prefcal_app.simulating.why import percent, robust, robust_study, why
from prefcal_app.summary import NONE_SAFE
from prefcal_app.view.end import reasons, screening_view, smaller_view
from prefcal_env.errors import KnobError, ProtocolError, ScenarioError, StaleError
from prefcal_env.experiments.experiment import End
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.plants.plant import Plant
from prefcal_env.preferences.answer import Answer, Preference
from prefcal_scenarios import KPI, Scenario
from prefcal_scenarios.described.pid_scenario import pid_scenario
from prefcal_scenarios.runs import screened
from support.interviews import begin, proceed, reopened, worked
from support.looks import toy
from support.screened import explained, let_say, screening, simulated

WANTED = np.array([0.5, 21.0, 1.0])
REASON = Reason(0.3, ("t_f",), ("final",))


@pytest.fixture
def chances(monkeypatch):
    """Let the agent say this; it gives all that were asked."""
    return let_say(monkeypatch, chance_of_better=0.5, reason=REASON, certificate=None)


def answered(interview, *choices):
    for choice in choices:
        interview.do(actions.Answer(interview.now().question.id, choice))
        explained(interview)
    return interview


def test_other_agents_have_none():
    interview = begin(toy)
    proceed(interview)
    assert not interview.known.screens
    assert interview.known.wait_for_findings(9.0)
    assert interview.known.screened() is interview.known.findings is None


def test_it_comes_with_the_question_and_no_request_computes_it(chances):
    interview = screening()
    proceed(interview)
    assert interview.known.findings.reason == REASON
    asked = len(chances)
    for _ in range(3):
        assert promise(interview.known.findings) == ""
        assert interview.known.outlook is None
    worked(interview)  # what its answer can change is worked out afterward
    assert len(chances) == asked


def test_after_a_request_it_is_worked_out_anew_in_the_background(chances):
    interview = screening()
    proceed(interview)
    interview.do(actions.AskFor(WANTED))
    proceed(interview)
    assert interview.known.screened() is None  # the same record, and yet another challenger
    assert interview.known.screened(current=False) is not None
    version = interview.now().version
    assert interview.work()
    assert interview.known.screened().pending.theta == tuple(WANTED)
    assert interview.now().version == version + 1  # pages are told
    worked(interview)  # what its answer can change
    assert interview.now().version <= version + 2
    assert interview.known.screened().pending.theta == tuple(WANTED)


def test_it_is_about_the_open_question_alone(chances):
    interview = explained(screening())
    before = interview.known.screened()
    interview.do(actions.Answer(interview.now().question.id, Choice.LEFT))
    assert interview.known.screened() is None
    assert interview.known.findings is None
    assert interview.known.screened(current=False) is before
    assert explained(interview).known.screened() is not before


def test_before_an_answer_that_teaches_nothing_is_promised(monkeypatch):
    let_say(monkeypatch, chance_of_better=0.05, certificate=None)
    interview = explained(screening())
    assert promise(interview.known.findings) == offer(interview.known.findings) == ""
    assert interview.known.outlook is None
    answered(interview, Choice.CANNOT_TELL)
    assert interview.known.outlook is None
    answered(interview, Choice.LEFT)
    assert offer(interview.known.findings)
    n = len(interview.known.screened().bank)
    assert interview.known.outlook.promise.lower().endswith(
        f"the chance that the most promising of the {n} simulated is better than the best so far is 5 %."
    )


def test_at_the_end_it_is_worked_out_for_the_last_answer(chances):
    interview = explained(screening(n_max=3))
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT)
    assert interview.known.findings.reason is None
    assert "is 50 %" in interview.known.outlook.promise


def test_experiments_in_which_a_kpi_is_finite_are_known_by_number(chances):
    def settle(theta, seed=0):
        made = simulated.run(theta, seed=seed)
        return made.with_kpis({**made.kpis, "ts": np.inf if theta[0] > 0.46 else 2.0})

    kpis = (*simulated.kpis, KPI("ts", "settling time", "s", better="lower"))
    interview = explained(screening(replace(simulated, run=settle, kpis=kpis), n_max=4))
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT)
    shown = interview.known._find_answered()
    finite = [k + 1 for k, each in shown.items() if each.theta[0] <= 0.46]
    assert interview.known._list_reaching(["ts", "final"]) == finite
    assert 0 < len(finite) < len(shown)
    assert interview.known._list_reaching([]) == interview.known._list_reaching(["ts", "unknown"]) == []


def test_an_error_leaves_the_question_and_is_not_tried_forever(monkeypatch):
    def broken(agent, known):
        raise ValueError("singular")

    monkeypatch.setattr(findings, "_explain_query", broken)
    interview = screening()
    now = proceed(interview)
    assert now.phase is Phase.QUESTION
    worked(interview)
    assert interview.now().question == now.question
    assert interview.known.screened() is interview.known.findings is None
    assert interview.known.is_told, "nobody waits for it"


def test_a_look_records_nothing_and_a_question_about_it_comes_at_once():
    interview = explained(screening())
    events = len(list(interview.file.events()))
    found = interview.look_at(WANTED)
    assert found == toy.run(WANTED)
    assert len(list(interview.file.events())) == events
    assert interview.do(actions.AskFor(WANTED)).phase is Phase.QUESTION  # without another run


def test_a_look_at_one_that_was_shown_reads_its_experiment():
    interview = explained(screening())
    shown = interview.past.experiment(0)
    assert interview.look_at(shown.theta) == shown


def test_only_what_is_simulated_can_be_looked_at():
    interview = begin(toy)
    proceed(interview)
    with pytest.raises(ScenarioError, match="simulated unseen"):
        interview.look_at(WANTED)
    with pytest.raises(KnobError, match="T_s"):
        explained(screening()).look_at(np.array([9.0, 21.0, 1.0]))


def test_rows_of_the_bank_are_found_by_theta():
    interview = explained(screening())
    known = interview.known.screened()
    index = interview.now().question.challenger.index
    theta = np.array(interview.now().state.history.samples[index].theta)
    row = known.row(theta)
    assert toy.space.close(theta, known.bank.thetas[[row]]).all()
    names = known.bank.names
    found = dict(zip(names, known.bank.kpis[row], strict=True))
    assert found == pytest.approx(screened(simulated, simulated.run(theta)), rel=0.1, abs=0.01)
    assert known.row(theta * [0.5, 1.0, 1.0]) is None
    first = known.bank.thetas[5]
    assert known.row(first) == 5


@pytest.mark.parametrize(("chance", "said", "offers"), [(0.08, "8 %", True), (0.1, "10 %", False)])
def test_below_ten_percent_it_offers_to_stop_and_else_only_says_what_is_left(chance, said, offers):
    found = Findings(False, 940, chance_of_better=chance)
    text = (
        f"The chance that the most promising of the 940 simulated is better than the best so far is {said}."
    )
    assert promise(found) == text
    assert offer(found) == (f"{text} Stop here, or go on?" if offers else "")


@pytest.mark.parametrize(
    ("chance", "text"),
    [(0.0, "below 1 %"), (0.001, "below 1 %"), (0.5, "50 %"), (0.999, "above 99 %"), (1.0, "above 99 %")],
)
def test_nothing_reads_as_sure(chance, text):
    assert percent(chance) == text


CERTIFIED = Certificate(0.06, 0.95, 0.3, (1.0,))


def certified(certificate, chance=0.08, simulated=940):
    return Findings(False, simulated, chance_of_better=chance, certificate=certificate)


def test_why_a_study_is_over_does_not_contradict_what_is_said_of_its_result():
    # "Little is left" stood beside a chance of 30 % that the most promising one is noticeably better.
    assert why_over(ENOUGH, certified(CERTIFIED)) == ("fewer than 6 % of random θ are noticeably better")
    unsaid = certified(replace(CERTIFIED, share=None))
    assert why_over(ENOUGH) == why_over(ENOUGH, unsaid) == "few random θ are noticeably better"
    assert why_over("stopped", certified(CERTIFIED)) == "at your request"


def test_from_the_second_answer_on_it_states_what_holds_for_people_unlike_the_draws():
    assert promise(certified(CERTIFIED)) == (
        "The chance that the most promising of the 940 simulated is noticeably better than the best so far "
        "is 30 %. Of θ drawn at random, fewer than 6 % are noticeably better (with 95 % probability)."
    )
    early = promise(certified(replace(CERTIFIED, share=1.0)))
    assert early.endswith("so far is 30 %. The answers are too few to say how many of θ drawn at random are.")
    assert offer(certified(CERTIFIED)) == "", "not the draws' own chance decides"
    assert offer(certified(replace(CERTIFIED, chance=0.05), 0.5)).endswith("Stop here, or go on?")
    # The chance that is said decides whether the end offers more questions, too; what is not said does not.
    assert chance_left(certified(CERTIFIED)) == CERTIFIED.chance
    assert chance_left(certified(None)) == 0.08
    assert chance_left(certified(Certificate(None, 0.95, None, ()))) is None
    assert chance_left(certified(CERTIFIED, chance=None)) is None


@pytest.mark.parametrize(
    ("experiments", "words"),
    [
        ((3.4, 123.0, 1000.0), "about 120 random experiments (90 %: 3 to more than 1,000)."),
        ((112.0, 1000.0, 1000.0), "more than 1,000 random experiments (90 %: 110 to more than 1,000)."),
        ((1.0, 9.6, 88.0), "about 10 random experiments (90 %: 1 to 88)."),
    ],
)
def test_it_says_how_many_random_experiments_the_result_is_equal_to(experiments, words):
    said = replace(CERTIFIED, experiments=experiments)
    assert promise(certified(said)).endswith(
        "(with 95 % probability). That bound is a careful one: it is for the hardest kind of person, too. "
        f"Over all kinds together, the best so far is as good as the best of {words}"
    )
    assert "random experiments" not in promise(certified(replace(said, share=1.0)))
    better_is_known = promise(certified(replace(said, chance=0.94), simulated=9))
    assert better_is_known.startswith("The chance that the most promising of the 9 simulated is noticeably")
    assert "random experiments" not in better_is_known


LIMITED = "with varied plants"
VARIED = f"{LIMITED} (not sensors, actuators or task)"


@pytest.mark.parametrize(
    ("kept", "costs", "words"),
    [
        (300, (), "Robustness costs nothing: no simulated θ that does not hold promises more."),
        (
            300,
            (("t_f", 4.3, 3.6),),
            "Robustness costs about 19 % of time to steady state t_f (4.3 h instead of 3.6 h): what",
        ),
        (
            300,
            (("t_f", np.inf, 3.6),),
            "Robustness costs time to steady state t_f (never instead of 3.6 h): what",
        ),
        (
            300,
            (("t_f", 2.0, 0.0),),
            "Robustness costs time to steady state t_f (2 h instead of 0 h): what promises",
        ),
        (
            300,
            (("t_f", 4.3, 3.6), ("u_max", -8.0, -10.0), ("e", 9.0, 1.0)),
            "Robustness costs about 19 % of time to steady state t_f (4.3 h instead of 3.6 h) and about 20 % "
            "of u max (−8 instead of −10): what",
        ),
        (300, (("t_f", 3.61, 3.6),), "Robustness costs less than 1 % of each KPI: what promises most"),
        (12, (("t_f", 4.3, 3.6),), "None of the simulated θ was found to hold in more of the same runs"),
    ],
)
def test_what_robustness_costs_is_said_of_a_result_that_holds(kept, costs, words):
    kpi = KPI("t_f", "time to steady state t_f", "h", better="lower")
    scenario = Scenario("s", "S", KnobSpace([Knob("K", 0, 1)]), lambda theta, seed=0: None, kpis=(kpi,))
    said = list(robust(RobustResult(kept, costs), scenario))
    limited = replace(scenario, kpis=(replace(kpi, at_most=5.0),))
    with_limits = next(robust(RobustResult(kept, costs), limited))
    if kept == 300:
        assert said[0].startswith(f"The result holds: all 300 runs {VARIED} end safely and reach what")
        assert with_limits == (
            f"The result keeps all limits that it meets nominally in all 300 runs {LIMITED}."
        )
    else:
        fails = "The result does not hold in 288 of 300 runs"
        assert said[0].startswith(f"{fails} {VARIED}: 12 end safely and reach")
        assert with_limits == f"{fails} {LIMITED}: 12 keep all limits that it meets nominally."
        more = "Another simulated θ holds in 40 of the same runs"
        assert [*robust(RobustResult(kept, most=40), limited)] == [with_limits, f"{more}."]
        assert [*robust(RobustResult(kept, costs, most=40, other=(0.25,)), limited)] == [
            with_limits,
            f"{more}; as modeled it has time to steady state t_f 3.6 h (result: 4.3 h). "
            "A study with --start K=0.25 compares it.",
        ]
    assert len(said) == (3 if kept == 300 else 2)
    assert kept < 300 or "verify varies sensors, actuators and task, too" in said[1]
    assert said[-1].startswith(words)


def test_the_price_of_a_result_that_holds_in_more_runs_but_not_in_all_is_said_too():
    kpi = KPI("t_f", "time t_f", "h", at_most=5.0)
    scenario = Scenario("s", "S", KnobSpace([Knob("K", 0, 1)]), lambda theta, seed=0: None, kpis=(kpi,))
    beside = RobustResult(299, (("t_f", 4.3, 3.6),), other=(0.5,), others_kept=279, losses=(("t_f", 21),))
    price = (
        "Robustness costs about 19 % of time t_f (4.3 h instead of 3.6 h): what promises most nominally does "
        "not hold (K=0.5): 21 of the same 300 runs fail (time t_f ≤ 5 h missed in 21)."
    )
    assert [*robust(beside, scenario)][-1] == price
    # What won by the answers is named with its count, what the result costs, and what it overrules.
    won = Winner(9, 279, (("t_f", 4.1, 3.9),), (7, 8, 9))
    (_, told, none) = robust(replace(beside, won=won), scenario)
    assert told == (
        "Experiment 10 won by the answers, but holds in 279 of the same 300 runs. The result in its place "
        "costs about 5 % of time t_f (4.1 h instead of 3.9 h) and overrules the answers about experiments 8, "
        "9 and 10."
    )
    assert none.startswith("None of the simulated θ"), "one price is enough"
    worse = RobustResult(300, won=Winner(2, 279, (), (2,)))
    assert [*robust(worse, scenario)][1:] == [
        "Experiment 3 won by the answers, but holds in 279 of the same 300 runs. The result in its place "
        "overrules the answer about experiment 3.",
        "The varied runs vary what prefcal verify varies.",
    ]
    misses = replace(beside, won=Winner(2, None))
    assert [*robust(misses, scenario)][1] == (
        "Experiment 3 won by the answers, but misses other stated limits as modeled."
    )
    assert [*robust(misses, scenario)][-1] == price, "that one has another reason to be no result"


def test_a_robust_study_that_was_left_says_how_its_best_so_far_holds():
    kpi = KPI("t_f", "time to steady state t_f", "h", at_most=5.0)
    scenario = Scenario("s", "S", KnobSpace([Knob("K", 0, 1)]), lambda theta, seed=0: None, kpis=(kpi,))
    left = certified(CERTIFIED)
    unknown = (f"Whether the result holds in 300 runs {LIMITED} was not worked out.",)
    assert robust_study(None, scenario) == robust_study(left, scenario) == unknown
    said = robust_study(replace(left, kept=300), scenario)
    assert said[0].startswith("The result keeps all limits that it meets nominally in all")
    assert len(said) == 2  # and what they vary
    counts = {3: 87, 2: 219}
    assert robust_study(None, scenario, best=1, counts=counts) == unknown
    fewer, other, varied = robust_study(None, scenario, best=3, counts=counts)
    assert fewer.endswith(f" in 213 of 300 runs {LIMITED}: 87 keep all limits that it meets nominally.")
    assert other == ("Experiment 3 holds in 219: the study was left before it chose between them by that.")
    assert (varied, len(said)) == (said[1], 2)
    assert len(robust_study(None, scenario, best=2, counts=counts)) == 2
    assert robust_study(replace(left, kept=300), scenario, best=3, counts=counts) == said, "known by now"
    over = replace(left, over=True, robustness=RobustResult(300))
    assert robust_study(over, scenario) == tuple(robust(RobustResult(300), scenario))


def test_which_limits_a_robust_result_meets_nominally_is_said_by_name():
    kpis = (
        KPI("t_f", "time t_f", at_most=5.0),
        KPI("peak", "peak", at_most=1.0),
        KPI("J", "J", better="lower"),
    )
    scenario = Scenario("s", "S", KnobSpace([Knob("K", 0, 1)]), lambda theta, seed=0: None, kpis=kpis)
    ran = toy.run(WANTED)

    def said(kept, **values):
        return next(robust(RobustResult(kept), scenario, ran.with_kpis(values)))

    keeps = "The result keeps the limit"
    assert said(300, t_f=4.0, peak=0.5) == f"{keeps}s on time t_f and peak in all 300 runs {LIMITED}."
    assert said(300, t_f=4.0, peak=2.0) == (
        "The result does not hold: it misses peak already nominally. It keeps the limit on time t_f in all "
        f"300 runs {LIMITED}."
    )
    assert said(12, t_f=6.0, peak=0.5) == (
        f"The result does not hold in 288 of 300 runs {LIMITED}: 12 keep the limit on peak. It misses time "
        "t_f even nominally."
    )
    assert said(300, t_f=6.0, peak=2.0) == (
        "The result does not hold: it meets no stated limit. It misses time t_f and peak even nominally. All "
        f"300 runs {LIMITED} end safely and reach what the nominal run reaches, no more."
    )


def test_a_robust_result_that_misses_what_another_keeps_is_not_said_to_hold():
    kpis = KPI("t_f", "time t_f", at_most=5.0), KPI("peak", "peak", at_most=1.0)
    scenario = Scenario("s", "S", KnobSpace([Knob("K", 0, 1)]), lambda theta, seed=0: None, kpis=kpis)
    nominal = toy.run(WANTED).with_kpis({"t_f": 6.0, "peak": 0.5})
    found = RobustResult(300, outdone=True)
    kept, _ = robust(found, scenario, nominal)  # then what varies, and no price
    lost = "nominally, and a simulated θ misses fewer limits."
    assert kept == (
        f"The result does not hold: it misses time t_f {lost} It keeps peak in all 300 runs {LIMITED}."
    )
    margin = replace(scenario, kpis=(KPI("M_s", "M_s", better="lower", at_most=2.0, margin=True),))
    assert next(robust(found, margin, nominal.with_kpis({"M_s": 3.0}))) == (
        f"The result does not hold: it misses M_s {lost}"
    )
    assert next(robust(found, margin)) == f"The result does not hold: it misses a stated limit {lost}"
    held = RobustResult(300, (("t_f", 4.3, 3.6),), among=True, other=(0.5,))
    assert [*robust(held, scenario)][-1] == (
        "Robustness costs about 19 % of time t_f (4.3 instead of 3.6): what promises most nominally, of what "
        "keeps the stated limits, does not hold (K=0.5)."
    )
    losses = (("peak", 80), ("t_f", 9), ("J", 3), ("", 2))
    limited = replace(scenario, kpis=(*kpis, KPI("J", "index J", better="lower")))
    failing = replace(held, others_kept=212, losses=losses)
    assert [*robust(failing, limited)][-1].endswith(
        "does not hold (K=0.5): 88 of the same 300 runs fail (peak ≤ 1 missed in 80; time t_f ≤ 5 missed "
        "in 9; index J infinite in 3)."
    )
    one = replace(held, others_kept=299, losses=(("", 1),))
    assert [*robust(one, limited)][-1].endswith("(K=0.5): 1 of the same 300 runs fails (no finite KPI in 1).")
    assert [*robust(replace(held, costs=()), scenario)][-1] == (
        "Robustness costs nothing: no simulated θ that keeps the stated limits nominally but does not hold "
        "promises more."
    )


def test_a_question_of_a_robust_study_says_how_both_sides_hold():
    kpi = KPI("t_f", "time t_f", "h", at_most=5.0)
    scenario = Scenario("s", "S", KnobSpace([Knob("K", 0, 1)]), lambda theta, seed=0: None, kpis=(kpi,))
    new, best = (toy.run(WANTED).with_kpis({"t_f": value}) for value in (4.0, 4.5))
    said = why(Reason(0.5, ("t_f",), (), kept=300, against=187), scenario, shown=new, best=best)
    assert said == (
        "This one has lower time t_f (chance that you prefer it: 50 %). "
        f"It keeps the limit on time t_f in all 300 runs {LIMITED}. "
        f"The best so far does not hold in 113 of 300 runs {LIMITED}: 187 keep the limit on time t_f."
    )


def test_the_chance_of_a_better_one_counts_what_does_not_hold_and_says_so():
    found = certified(CERTIFIED)
    assert "hold" not in promise(found)
    assert " drawn at random, whether they hold or not, fewer than " in promise(replace(found, kept=300))
    of = (
        f"The chance that the most promising of the {found.simulated} simulated, whether it holds or not, is "
    )
    assert promise(replace(found, kept=300)).startswith(of)
    assert promise(replace(found, kept=300, certificate=None)).startswith(of)


def test_a_robust_result_says_what_was_not_varied_in_the_words_of_a_verification():
    scenario = pid_scenario(Plant.of(([1.0], [10.0, 1.0]), delay=1.0))
    factors = [factor.name for factor in scenario.source.varied().factors]
    said = list(robust(RobustResult(300, ()), scenario))[1]
    assert said.startswith(
        "The varied runs vary all time constants, gain of u, dead time and the seed of the noise; prefcal "
    )
    assert "lag of the actuators, backlash, sampling jitter" in said
    assert all(name in said for name in factors)
    # Terminal, report and sheet, which have no keys, show the sentence, too.
    assert "prefcal verify also varies" in said


def test_where_answers_do_not_follow_from_the_kpis_it_says_no_number():
    said = "How much is left to gain is not said: "
    for by_knobs, reason in (
        (True, "the values of the knobs predict the answers even better than the KPIs, by which it is told."),
        (False, "what was learned from the other answers predicts each one no better than chance."),
    ):
        found = certified(replace(CERTIFIED, share=None, chance=None, by_knobs=by_knobs))
        assert promise(found) == said + reason
        assert offer(found) == ""


def test_at_the_end_it_says_what_was_wanted_and_what_the_result_rests_on(monkeypatch):
    let_say(monkeypatch, certificate=CERTIFIED)
    interview = explained(screening(n_max=5))
    while interview.now().phase is not Phase.OVER:
        assert interview.known.outlook is None or interview.known.outlook.result == ()
        answered(interview, Choice.LEFT)
    worked(interview)
    said = interview.known.outlook.result
    assert any(words.startswith(("The result rests on the answer", "No single answer")) for words in said)
    assert set(said) <= set(interview.known.outlook.sentences)
    assert interview.known.is_told
    unexplained = replace(CERTIFIED, share=None, chance=None)
    found = replace(interview.known.findings, certificate=unexplained)
    assert told(found, simulated, interview.past.experiment, index=None, nominal=None) == (), (
        "whatever is said of KPIs would be wrong"
    )
    interview.do(actions.GoOn(1))
    assert proceed(interview).phase is Phase.QUESTION
    assert interview.known.outlook is None or interview.known.outlook.result == ()


def test_a_study_that_a_person_ends_is_told_of_its_result_as_well():
    interview = explained(screening())
    answered(interview, Choice.LEFT)
    interview.do(actions.Finish())
    worked(interview)
    assert interview.known.findings.over
    assert interview.known.findings.complete
    interview.do(actions.GoOn())
    worked(interview)
    assert interview.now().question is not None
    assert not interview.known.findings.over
    assert interview.known.outlook is None or interview.known.outlook.result == ()


def test_an_error_in_what_is_said_of_a_result_leaves_the_rest(monkeypatch):
    def broken(agent, known):
        raise ValueError("singular")

    monkeypatch.setattr(findings, "_explain_result", broken)
    interview = explained(screening(n_max=3))
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT)
    worked(interview)
    assert interview.known.is_told
    assert interview.now().state.concluded is None, "another time it may succeed"
    assert interview.known.outlook.promise
    assert len(interview.known.screened().bank) > 0


def test_at_the_end_a_smaller_change_than_from_the_given_start_is_looked_for(chances):
    start = [0.5, 10.0, 1.0]
    agent = partial(Screening, n_simulated=80, start=[start])
    interview = explained(begin(simulated, n_max=3, agent=agent))
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT if interview.now().question.left.challenger else Choice.RIGHT)
    assert not interview.known.is_told
    worked(interview)
    screened, said = interview.known.screened(), interview.known.findings
    assert interview.known.is_told
    best = np.array(interview.now().state.history.samples[interview.now().incumbent].theta)
    found = said.smaller
    assert found is not None
    assert set(found.theta) <= {*best, *start}
    assert screened.row(np.array(found.theta)) is not None  # the page can show it
    words = told(said, simulated, interview.past.experiment, index=None, nominal=None)
    assert any("can stay as before" in each for each in words)
    assert tuple(smaller_view(interview, said)) == found.theta


def ended(**more):
    """A study that is over, with what carries its result."""
    interview = explained(screening(n_max=3, **more))
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT)
    return interview


def test_a_choice_after_a_look_is_an_answer_and_leaves_the_study_over(tmp_path):
    interview = ended(path=tmp_path / "a.prefcal")
    best, given = interview.now().incumbent, interview.known.counts.comparisons
    interview.look_at(WANTED)
    now = interview.do(actions.Choose(WANTED, best))
    assert now.phase is Phase.OVER  # without another run, and without a question to the person
    assert now.state.ended == "all compared"
    assert now.incumbent == 3
    assert interview.past.experiment(3).theta.tolist() == WANTED.tolist()
    assert interview.known.counts.comparisons == given + 1
    assert now.state.requested == {3}
    interview.file.close()
    again = reopened(simulated, tmp_path / "a.prefcal")
    assert again.now().incumbent == 3, "it is as durable as any answer"
    asked = again.do(actions.Undo(again.now().version)).question
    assert (asked.challenger.index, asked.incumbent.index) == (3, best), "and can be undone as any"
    again.do(actions.Give(asked.id, Answer(Preference.INCUMBENT)))
    assert proceed(again).incumbent == best


def test_a_choice_keeps_the_reason_of_the_end(monkeypatch):
    monkeypatch.setattr(Screening, "has_enough", lambda agent, history: len(history.lessons) >= 2)
    agent = partial(Screening, n_simulated=40)
    interview = explained(begin(simulated, n_max=9, agent=agent, stops=True))
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT)
    interview.look_at(WANTED)
    now = interview.do(actions.Choose(WANTED, interview.now().incumbent))
    assert (now.state.ended, now.state.n_max) == ("little is left to gain", 9)
    assert now.state.history.answered == 4


def test_a_choice_that_was_not_looked_at_is_only_asked_for():
    interview = ended()
    now = interview.do(actions.Choose(WANTED, interview.now().incumbent))
    assert now.phase is Phase.RUNNING
    asked = proceed(interview).question
    assert asked.challenger.experiment.theta.tolist() == WANTED.tolist()
    assert interview.known.counts.comparisons == 2


def test_a_choice_beside_another_best_or_of_what_was_tried_changes_nothing():
    interview = ended()
    best, version = interview.now().incumbent, interview.now().version
    other = interview.past.experiment(1 - min(best, 1)).theta
    interview.look_at(WANTED)
    with pytest.raises(StaleError, match="another experiment is the best"):
        interview.do(actions.Choose(WANTED, best + 1))
    with pytest.raises(ProtocolError, match="compared already"):
        interview.do(actions.Choose(other, best))
    with pytest.raises(KnobError):
        interview.do(actions.Choose(np.array([9.0, 21.0, 1.0]), best))
    assert (interview.now().version, interview.now().phase) == (version, Phase.OVER)


def test_a_study_whose_runs_are_all_unsafe_is_as_good_as_nothing(monkeypatch):
    # "As good as the best of 40 random experiments" stood at the end of one.
    let_say(monkeypatch, certificate=replace(CERTIFIED, experiments=(3.4, 123.0, 1000.0)))
    ended = replace(simulated, run=lambda theta, seed=0: replace(toy.run(theta), end=End.UNSAFE))
    interview = explained(screening(ended, n_max=3))
    assert interview.known.outlook.sentences == (NONE_SAFE,)
    assert screening_view(interview, interview.now(), "", blind=False)["offer"] == ""
    while interview.now().phase is not Phase.OVER:
        answered(interview, Choice.LEFT)
    worked(interview)
    assert interview.known.none_safe
    assert interview.known.outlook.lines == (NONE_SAFE,)
    assert reasons(interview) == [NONE_SAFE]
    assert interview.known.why_over == "all compared"
    calm = explained(screening(n_max=3))
    assert not calm.known.none_safe
