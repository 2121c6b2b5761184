import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from prefcal_agents import GLISp
from prefcal_agents.lessons import Marks
from prefcal_agents.search import Penalized, Penalty, SafetyModel, unsafe_penalty
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer, Mark
from support.histories import studied
from support.latent import CAMEL
from support.studies import drive

NEW, OLD = Mark.CHALLENGER_UNSAFE, Mark.INCUMBENT_UNSAFE
NEW_GOOD, OLD_GOOD = Mark.CHALLENGER_GOOD_ENOUGH, Mark.INCUMBENT_GOOD_ENOUGH
SQUARE = KnobSpace([Knob("a", -2.0, 2.0), Knob("b", -1.0, 1.0)])
SAMPLES = np.random.default_rng(0).random((9, 3))
points = st.tuples(*[st.floats(0, 1)] * 3).map(np.array)


def history(*answers):
    return studied([(0.1 * h, 0.5) for h in range(len(answers))], answers=answers)


def marked(book):
    """Numbers of the samples looked at, and of the unsafe ones."""
    marks = Marks.of(book)
    numbers = np.round(10 * marks.samples[:, 0]).astype(int)
    return [numbers.tolist(), numbers[marks.unsafe].tolist()]


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        (
            [None, Answer(1, marks=(NEW, OLD_GOOD)), -1, Answer(1, marks=(OLD, NEW_GOOD))],
            [[0, 1, 2, 3], [1, 2]],
        ),
        ([None, None, 1], [[0, 1, 2], []]),  # shown without the mark: safe, whatever was answered
        ([None], [[], []]),  # the first query shows nothing, but its mark counts
        ([Answer(None, marks=(NEW,))], [[0], [0]]),
        ([None, Answer(1, marks=(OLD,)), Answer(1, marks=(OLD_GOOD,)), 1], [[0, 1, 2, 3], [0]]),
    ],
)
def test_one_mark_is_enough_and_is_of_its_side_s_sample(answers, expected):
    assert marked(history(*answers)) == expected


def test_marks_of_a_retracted_answer_no_longer_count():
    book = history(None, Answer(1, marks=(NEW,)), Answer(1, marks=(NEW, OLD_GOOD)))
    assert marked(book.retracted(1)) == [[0, 2], [2]]


def test_marks_of_a_further_comparison_count_too():
    book = history(None, 1, 1).with_follow_up(Answer(1, marks=(NEW, OLD_GOOD)), 2, 1)
    assert marked(book) == [[0, 1, 2], [2]]
    assert marked(book.retracted(0, follow_up=True)) == [[0, 1, 2], []]


def differences(f, z, step=1e-6):
    steps = step * np.eye(len(z))
    return (f(z + steps) - f(z - steps)) / (2 * step)


@given(points, st.lists(st.booleans(), min_size=9, max_size=9))
def test_a_chance_lies_between_0_and_1_and_its_gradient_agrees_with_differences(z, labels):
    chance = SafetyModel.of(SAMPLES, np.array(labels))
    assert 0 < chance(z[None])[0] < 1
    assert chance.gradient(z) == pytest.approx(differences(chance, z), rel=1e-4, abs=1e-7)


def test_a_chance_agrees_with_the_labels_and_forgets_them_far_away():
    labels = np.array([True, False, True])
    centers = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    chance = SafetyModel.of(centers, labels)
    assert np.array_equal(chance(centers) > 0.5, labels)
    assert chance(np.array([[1e3, 1e3]]))[0] == pytest.approx(3 / 5, abs=1e-3)  # (2+1) to (1+1)


def test_many_samples_are_learned_from_in_full():
    samples = np.random.default_rng(2).random((150, 2))
    labels = samples[:, 0] > 0.5
    chance = SafetyModel.of(samples, labels)
    assert len(chance.alpha) == 150
    assert np.mean((chance(samples) > 0.5) == labels) > 0.95


def test_exchanging_the_labels_exchanges_the_chances():
    labels = np.arange(9) % 3 == 0
    there, back = SafetyModel.of(SAMPLES, labels), SafetyModel.of(SAMPLES, ~labels)
    z = np.random.default_rng(1).random((20, 3))
    assert there(z) == pytest.approx(1 - back(z))


class Bowl:
    def __call__(self, z):
        return np.sum(z * z, axis=1)

    def value_and_gradient(self, z):
        return self(z[None])[0], 2 * z


@given(points, st.floats(0.1, 0.99), st.floats(0, 50))
def test_the_gradient_of_a_steered_acquisition_agrees_with_differences(z, least, weight):
    chance = SafetyModel.of(SAMPLES, SAMPLES[:, 0] > 0.6)
    objective = Penalized(Bowl(), Penalty(chance, least, weight))
    slope = objective.value_and_gradient(z)[1]
    assert slope == pytest.approx(differences(objective, z), rel=1e-3, abs=1e-5)


def test_a_worry_costs_its_weight_at_most_and_nothing_where_all_is_well():
    chance = SafetyModel.of(SAMPLES, SAMPLES[:, 0] > 0.6)
    p, cost = chance(SAMPLES), Penalty(chance, 0.7, 5.0)(SAMPLES)
    assert p.min() < 0.7 < p.max()
    assert np.all(cost[p >= 0.7] == 0)
    assert np.all((cost[p < 0.7] > 0) & (cost[p < 0.7] < 5))
    best = SAMPLES[np.argmax(p)]
    assert not Penalty(chance, 0.7, 5.0).value_and_gradient(best)[1].any()


def test_unsafe_experiments_make_careful_for_a_while():
    few = history(None, Answer(1, marks=(NEW,)), 1, 1)
    more = history(None, Answer(1, marks=(NEW,)), Answer(1, marks=(NEW,)), 1)
    past = history(None, Answer(1, marks=(NEW,)), *[1] * 30)
    found = [unsafe_penalty(book, 30.0, 0.8).least for book in (few, more, past)]
    assert found == pytest.approx([0.9, 0.95, 0.8])


def test_without_unsafe_marks_or_a_weight_there_is_nothing_to_steer_by():
    unsafe = history(None, Answer(1, marks=(NEW, OLD_GOOD)))
    good = history(None, 1, 1, Answer(-1, marks=(NEW_GOOD,)))
    for book in (history(None, 1), good):
        assert unsafe_penalty(book, 30.0, 0.9) is None
    assert unsafe_penalty(unsafe, 0.0, 0.9) is None
    assert unsafe_penalty(unsafe, 30.0, 0.9) is not None


def study(unsafe, *, settings=None, n_max=24, seed=0, told=True):
    """θ of a study of the camel; `unsafe` says of a θ whether it is marked, and then it loses."""
    agent = GLISp(SQUARE, n_init=6, n_max=n_max, seed=seed, settings=settings)
    drive(
        agent,
        lambda new, old: int(unsafe(new)) - int(unsafe(old)) or CAMEL.prefer(new, old),
        unsafe=unsafe if told else lambda theta: False,
    )
    return agent


@pytest.mark.unchecked
def test_marks_keep_out_of_the_unsafe_half():
    def unsafe(theta):
        return theta[0] > 0  # one of the two minima, and up to 0.09 beside the other

    counts = []
    for told in (True, False):
        runs = [study(unsafe, seed=s, told=told) for s in range(3)]
        counts.append(sum(unsafe(theta) for agent in runs for theta in agent.samples[6:]))
        assert not any(unsafe(agent.best) for agent in runs)
    assert counts[1] > 0
    assert counts[0] <= counts[1] / 2


@pytest.mark.unchecked
def test_where_everything_is_marked_unsafe_proposals_go_on_and_spread_out():
    agent = study(lambda theta: True)
    assert len({theta.tobytes() for theta in agent.samples}) == 24
    assert np.all(np.ptp(agent.samples, axis=0) > [3.0, 1.5])
