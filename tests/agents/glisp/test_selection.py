"""Selections follow from the history alone; the noise test finds wrong answers."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from prefcal_agents import GLISpSettings
from prefcal_agents.agent import Setup
from prefcal_agents.glisp.fits import (
    FEW,
    MANY,
    Dataset,
    ModelSelection,
    NoiseTest,
    Selection,
    choose_shape,
    evidence_of_mistakes,
    train,
)
from prefcal_agents.lessons import Preferences
from prefcal_agents.surrogate import Shape
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import History, contradictory
from support.histories import in_cube

START = 4
QUICK = GLISpSettings()
ROUND = Shape(1.0, (1.0, 1.0))


def cost(z):
    return float(np.sum((z - 0.3) ** 2))


def history_of(count, *, kpis_from=None, wrong=(), further=(), n=2, cost=cost):
    """Return random samples, each compared with the best before it.

    Args:
        count: Number of samples.
        kpis_from: Number of the first sample that has a KPI, which explains all answers.
        wrong: Numbers of the samples about which the answer is wrong.
        further: Numbers of experiments after which a further answer contradicts an earlier one.
        n: Number of knobs.
        cost: Cost of a sample.
    """
    history, costs = History(), []
    for k, z in enumerate(np.random.default_rng(7).random((count, n))):
        costs.append(cost(z))
        best = history.incumbent
        answer = None if best is None else int(np.sign(costs[k] - costs[best]))
        answer = -answer if k in wrong else answer
        told = kpis_from is not None and k >= kpis_from
        pair = ({"off": costs[k]}, None) if told else None
        history = history.with_pending(in_cube(z)).with_answer(Answer(answer, outcomes=pair), best)
        if history.answered in further:
            history = history.with_follow_up(Answer(-answer), k, best)
    return history


def selecting(options=QUICK, *, n=2, n_init=START):
    space = KnobSpace([Knob(name, 0.0, 1.0) for name in "abcd"[:n]])
    return ModelSelection(Setup(space, n_init, 0, options, n_max=MANY))


HISTORY = history_of(11, kpis_from=0, wrong=(6, 9), further=(7, 10))


def changed(history, change, index):
    """Return `history` after an undo, a retraction, an answer, or cut short."""
    if change == "undo":
        return history.undone() if history.answered > 1 else history
    if change == "retract" and not history.comparisons[index % history.answered].retracted:
        return history.retracted(index % history.answered)
    if change == "tell" and history.answered < 12:
        best = history.incumbent
        z = np.array([index / 11, 0.5])
        return history.with_pending(in_cube(z)).with_answer(Answer((-1, 0, 1)[index % 3]), best)
    if change == "further" and history.answered > 1:
        return history.with_follow_up(Answer(1), history.answered - 1, 0)
    return history.until(max(1, history.answered - index % 3)) if change == "until" else history


CHANGES = st.sampled_from(["undo", "retract", "tell", "further", "until"])
LOOKS = st.sampled_from(["after", "KPIs", "nothing"])
STEPS = st.lists(st.tuples(CHANGES, st.integers(0, 11), LOOKS), min_size=1, max_size=6)


def same(one, other):
    """Return whether two fits know the same."""
    if one is None or other is None:
        return one is other
    return np.array_equal(one.utilities.normals, other.utilities.normals)


@settings(max_examples=12)
@given(STEPS)
@pytest.mark.unchecked  # for speed
def test_selections_are_those_of_a_fresh_one_in_any_order_of_calls(steps):
    models, history = selecting(), HISTORY
    models.after(history)
    for change, index, look in steps:
        history = changed(history, change, index)
        if look == "KPIs":
            assert same(models.kpi_fit(history), selecting().kpi_fit(history))
        elif look != "nothing":
            assert models.after(history) == selecting().after(history)
    assert models.after(history) == selecting().after(history)


def test_nothing_is_selected_during_the_start():
    models = selecting()
    for count in range(1, START):
        selection = models.after(HISTORY.until(count))
        assert selection.shape == ROUND
        assert (selection.noise, selection.is_noisy) == (None, False)


def validated(options=QUICK):
    """Return the numbers of experiments, up to 27, after which another shape was chosen."""
    history, models = history_of(27), selecting(options)
    shapes = [models.after(history.until(k)).shape for k in range(28)]
    return {k for k in range(1, 28) if shapes[k] != shapes[k - 1]}


def test_the_shape_is_validated_if_the_surrogate_makes_the_next_proposal():
    found = validated()
    assert min(found) >= START
    assert {k % 2 for k in found if k < FEW} == {0, 1}
    assert {k % 2 for k in found if k >= FEW} == {0}


def test_without_the_process_the_shape_is_validated_after_every_experiment():
    found = validated(replace(QUICK, process=False))
    assert {k % 2 for k in found if k >= FEW} == {0, 1}


def test_a_shape_may_be_validated_at_given_numbers_only():
    assert validated(replace(QUICK, validate_at=(8, 16))) <= {8, 16}


@pytest.mark.parametrize("process", [True, False])
def test_every_knob_has_its_turn_in_the_cross_validation(process, monkeypatch):
    seen = set()

    def noted(shape, score, knob, judge):
        seen.add(knob)
        return shape

    monkeypatch.setattr("prefcal_agents.glisp.fits.rescale_knob", noted)
    history, models = history_of(FEW + 8, n=4), selecting(replace(QUICK, process=process), n=4)
    models.after(history.until(FEW))
    seen.clear()
    models.after(history)
    assert seen == {0, 1, 2, 3}


def test_only_answers_that_contradict_each_other_are_called_noisy():
    """However little the surrogate expects them: a cost that jumps looks like mistakes, too."""
    contradicting = history_of(30, wrong=(7, 12, 16, 21, 27), further=(8, 13, 17, 22))
    agreeing = replace(contradicting, follow_ups=())
    assert contradictory(contradicting.verdicts())
    assert not contradictory(agreeing.verdicts())
    calmly = replace(QUICK, validate_at=())
    noisy, calm = (selecting(calmly).after(h) for h in (contradicting, agreeing))
    assert noisy.noise.suspects
    assert noisy.is_noisy
    assert not calm.is_noisy
    sure = selecting(replace(calmly, error_rate=0.0)).after(contradicting)
    assert (sure.noise, sure.is_noisy) == (None, False)


def test_kpis_that_explain_the_answers_are_used_and_may_be_left_out():
    assert selecting().kpi_fit(HISTORY) is not None
    assert selecting(replace(QUICK, kpis=False)).kpi_fit(HISTORY) is None
    assert selecting().kpi_fit(history_of(11)) is None  # none are known


def test_a_data_set_is_strict_once_an_answer_says_which_is_better():
    vague = History()
    for k, answer in enumerate((None, 0, None, 0)):
        vague = vague.with_pending(in_cube([k / 4, 0.5])).with_answer(Answer(answer), 0 if k else None)
    assert not Dataset.of(vague).is_strict
    clear = vague.with_follow_up(Answer(1), 3, 0)
    assert Dataset.of(clear).is_strict
    assert not Dataset.of(clear.retracted(0, follow_up=True)).is_strict


# From the data set and the selection to Ĵ.


WIDE = Shape(0.5, (1.0, 1.0))
TRUSTED = Selection(ROUND, None, is_noisy=False)
NOISY = Selection(ROUND, NoiseTest(WIDE, 5.0), is_noisy=True)


def data_of(count=16, wrong=()):
    """Return random samples, each compared with the latest two."""
    history, costs = History(), []
    for k, z in enumerate(np.random.default_rng(2).random((count, 2))):
        costs.append(float(np.sum((z - [0.3, 0.6]) ** 2)))
        answers = [int(np.sign(costs[k] - costs[j])) for j in range(max(k - 2, 0), k)] or [None]
        answers[-1] = -answers[-1] if k in wrong else answers[-1]
        history = history.with_pending(in_cube(z))
        history = history.with_answer(Answer(answers[-1]), k - 1 if k else None)
        if len(answers) > 1:
            history = history.with_follow_up(Answer(answers[0]), k, k - 2)
    return Dataset.of(history)


def trained(data, selection, **settings):
    return train(data, selection, replace(QUICK, **settings))


def agrees(surrogate, preferences):
    """Return for each answer whether Ĵ agrees with it."""
    values = surrogate(preferences.samples)
    return preferences.b * (values[preferences.first] - values[preferences.second]) > 0


def test_answers_that_are_trusted_are_all_kept():
    data = data_of()
    surrogate = trained(data, TRUSTED)
    assert surrogate.shape == ROUND
    assert np.all(agrees(surrogate, data.preferences))


def test_if_answers_may_be_wrong_those_that_others_contradict_are_not_kept():
    right, data = data_of(), data_of(wrong=(7, 12))
    surrogate = trained(data, NOISY)
    assert surrogate.shape == WIDE  # the shape of the noise test
    assert not np.all(agrees(surrogate, data.preferences))
    assert np.mean(agrees(surrogate, right.preferences)) > 0.9


def test_the_error_rate_counts_only_if_answers_may_be_wrong():
    data = data_of(wrong=(7, 12))

    def changes(selection):
        low, high = (trained(data, selection, error_rate=e) for e in (0.01, 0.3))
        return not np.array_equal(low.beta, high.beta)

    assert changes(NOISY)
    assert not changes(TRUSTED)


RATE = 0.1


def compared(flipped=(), *, seed=0, count=30, cost=lambda z: np.sum((z - 0.4) ** 2, axis=1)):
    """Random samples, each compared with an earlier one; the answers of `flipped` are wrong."""
    rng = np.random.default_rng(seed)
    samples, challengers = rng.random((count, 2)), np.arange(1, count)
    rivals = np.array([int(rng.integers(k)) for k in challengers], dtype=np.int64)
    costs = cost(samples)
    b = np.sign(costs[challengers] - costs[rivals]).astype(np.int64)
    b[[k - 1 for k in flipped]] *= -1
    return Preferences(samples, challengers, rivals, b, np.ones(count - 1))


def noise_of(preferences):
    """Return the noise test of these comparisons, the first of a study."""
    shape = choose_shape(preferences, ROUND, RATE, answered=30, first=True)
    return NoiseTest(shape, evidence_of_mistakes(preferences, shape, RATE))


def only_ties():
    known = compared()
    return Preferences(known.samples, known.first, known.second, 0 * known.b, known.weights)


def test_mistakes_are_suspected_and_consistent_answers_are_not():
    right = [noise_of(compared(seed=seed)).suspects for seed in range(4)]
    wrong = [noise_of(compared((5, 11, 16, 20, 27), seed=seed)).suspects for seed in range(6)]
    assert not any(right)
    assert sum(wrong) >= 4


@pytest.mark.parametrize(("evidence", "suspects"), [(-3.0, False), (1.0, False), (1.01, True)])
def test_a_suspicion_takes_more_than_one_nat(evidence, suspects):
    assert NoiseTest(ROUND, evidence).suspects is suspects


def test_ties_are_no_evidence_and_leave_the_shape():
    assert evidence_of_mistakes(only_ties(), ROUND, RATE) == 0
    assert choose_shape(only_ties(), ROUND, RATE, answered=30, first=True) == ROUND


def test_only_the_first_test_may_choose_any_epsilon():
    known, far = compared(count=60), Shape(5.6, (1.0, 1.0))
    assert choose_shape(known, far, RATE, answered=30, first=True).epsilon < 3.2
    assert choose_shape(known, far, RATE, answered=31, first=False).epsilon >= 3.2


def test_the_knobs_take_turns_and_one_that_hardly_matters_comes_to_count_less():
    known = compared(count=MANY, cost=lambda z: np.sin(9 * z[:, 1]))
    shape = ROUND
    for answered in range(30, 40):
        shape = choose_shape(known, shape, RATE, answered=answered, first=False)
        assert np.prod(shape.scales) == pytest.approx(1.0)
        assert max(shape.scales) <= 16 * min(shape.scales)
    assert shape.scales[1] > 2 * shape.scales[0]


def test_beyond_many_comparisons_the_shape_stays():
    assert len(compared(count=MANY + 2)) == MANY + 1
    known, far = compared(count=MANY + 2), Shape(5.6, (1.0, 1.0))
    assert choose_shape(known, far, RATE, answered=MANY + 2, first=False) == far
