"""The strategy table, and the search for the next sample."""

from dataclasses import replace

import numpy as np
import pytest

from prefcal_agents import GLISp, GLISpSettings
from prefcal_agents.agent import Setup
from prefcal_agents.glisp.agent import STRATEGY, propose, propose_start
from prefcal_agents.glisp.fits import FEW, Dataset, Fit, NoiseTest, Selection, kpi_fits, most_promising
from prefcal_agents.lessons import cube_of
from prefcal_agents.search import Acquisition, latin_hypercube
from prefcal_agents.surrogate import PreferenceGP, Shape, Surrogate
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History
from support.histories import in_cube, studied
from support.studies import drive

pytestmark = pytest.mark.unchecked  # for speed: the contract suite checks the shapes

SQUARE = KnobSpace([Knob("a", 0.0, 1.0, step=0), Knob("b", 0.0, 1.0, step=0)])
SHAPE = Shape(1.0, (1.0, 1.0))
PROCESS, ACQUISITION = "process", "acquisition"
ODD, EVEN = FEW + 1, FEW + 2  # numbers of experiments: the process proposes after ODD


def bowl(z):
    return float(np.sum((np.array(z) - [0.3, 0.6]) ** 2))


def history_of(count, *, ties=False, further=False, unsafe=False):
    """Return random samples, each compared with the best before it, with a KPI that explains all.

    With `unsafe`, samples in the right half are marked so.
    """
    points = np.random.default_rng(1).random((count, 2))
    risky = np.flatnonzero(points[:, 0] > 0.5) if unsafe else ()
    answers = [None, *[0] * count] if ties else None
    told = {"kpis": lambda z: {"off": bowl(z)}, "unsafe": risky}
    history = studied(points, bowl, answers=answers, **told)
    return history.with_follow_up(Answer(1), count - 1, 0) if further else history


def setup_of(**settings):
    return Setup(SQUARE, 4, 2, GLISpSettings(**settings))


def fit_of(history, setup, *, kpis=False, noisy=False):
    """Learn from `history`; KPIs explain it if `kpis`, and answers may be wrong if `noisy`."""
    selection = Selection(SHAPE, NoiseTest(SHAPE, 5.0 if noisy else -5.0), noisy)
    known = kpi_fits(setup.seed)(history) if kpis else None
    return Fit(Dataset.of(history), selection, known)


def objective_of(setup, fit):
    return next(rule for rule in STRATEGY if rule.holds(setup, fit)).objective(setup, fit)


def kind(objective):
    """Return the name of what is minimized."""
    assert isinstance(objective, Acquisition)
    return PROCESS if isinstance(objective.surrogate, PreferenceGP) else ACQUISITION


@pytest.mark.parametrize(
    ("count", "settings", "given", "expected"),
    [
        # The process takes turns with the surrogate, later on.
        (9, {}, {}, ACQUISITION),
        (FEW - 1, {}, {}, ACQUISITION),
        (FEW, {}, {}, ACQUISITION),
        (ODD, {}, {}, PROCESS),
        (EVEN, {}, {}, ACQUISITION),
        (ODD, {}, {"noisy": True}, PROCESS),
        (ODD, {"process": False}, {}, ACQUISITION),
    ],
)
def test_the_first_row_that_holds_says_what_is_minimized(count, settings, given, expected):
    setup = setup_of(**settings)
    assert kind(objective_of(setup, fit_of(history_of(count), setup, **given))) == expected


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("count", [9, ODD])
def test_kpis_that_explain_the_answers_come_first(count, noisy):
    setup, history = setup_of(), history_of(count)
    fit = fit_of(history, setup, kpis=True, noisy=noisy)
    rng = np.random.default_rng([setup.seed, count])
    expected = most_promising(setup, history, fit.kpis, None, rng)
    assert np.array_equal(propose(setup, fit), expected)
    without = propose(setup, replace(fit, kpis=None))
    assert not np.array_equal(without, expected)


def test_if_all_are_ties_no_process_is_trained():
    setup = setup_of()
    fit = fit_of(history_of(ODD, ties=True), setup)
    assert kind(objective_of(setup, fit)) == ACQUISITION


def test_the_paper_minimizes_its_acquisition_at_every_step():
    setup = Setup(SQUARE, 4, 2, GLISpSettings.paper())
    for count in (9, FEW, ODD, EVEN):
        objective = objective_of(setup, fit_of(history_of(count), setup))
        assert kind(objective) == ACQUISITION
        assert isinstance(objective.surrogate, Surrogate)


@pytest.mark.parametrize(
    ("given", "noisy", "error_rate"),
    [({}, False, 0.0), ({"further": True}, False, 0.003), ({"further": True}, True, 0.1)],
    ids=["one answer each", "further answers", "mistakes"],
)
def test_the_process_takes_answers_for_wrong_as_often_as_they_may_be(given, noisy, error_rate):
    setup, points = setup_of(), np.random.default_rng(5).random((20, 2))
    fit = fit_of(history_of(ODD, **given), setup, noisy=noisy)
    values = objective_of(setup, fit).surrogate(points)
    for rate in (0.0, 0.003, 0.1):
        same = np.array_equal(values, PreferenceGP.of(fit.data.preferences, rate)(points))
        assert same is (rate == error_rate)


def test_the_same_fit_gives_the_same_sample_and_another_seed_another():
    setup, history = setup_of(), history_of(9)
    fit = fit_of(history, setup)
    z = propose(setup, fit)
    assert np.array_equal(z, propose(setup, fit))
    assert not np.array_equal(z, propose(replace(setup, seed=3), fit))
    assert np.all((z >= 0) & (z <= 1))
    assert not np.any(np.all(cube_of(history) == z, axis=1))
    assert bowl(z) < 0.5


def test_the_start_is_a_latin_hypercube():
    setup, history = setup_of(), History()
    for planned in latin_hypercube(SQUARE, 4, 2):
        z = propose_start(setup, history)
        assert np.array_equal(z, planned)
        history = history.with_pending(in_cube(z)).with_answer(Answer(1 if history.answered else None), None)


def test_marks_keep_the_start_away_too():
    setup = setup_of()
    early, unsafe = replace(setup, n_init=30), 0
    for count in range(8, 14):
        plain = propose_start(early, history_of(count))
        if plain[0] > 0.6:
            unsafe += 1
            assert propose_start(early, history_of(count, unsafe=True))[0] < plain[0]
    assert unsafe


def test_a_study_without_a_strict_answer_goes_on_with_new_samples():
    agent = GLISp(SQUARE, n_init=2, n_max=9, seed=2)
    drive(agent, lambda new, old: 0, 8, kpis=lambda theta: {"off": bowl(theta)})
    assert agent.ask().challenger.theta.tolist() not in agent.samples.tolist()[:8]
