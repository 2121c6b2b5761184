"""What is stated of real people is replayed and counted rightly."""

import importlib
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture
def people(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks" / "campaigns")
    return importlib.import_module("real_people")


def test_the_sets_are_whole(people):
    trains, coffees = people.trains(), people.coffees()
    assert (len(trains), len(coffees)) == (235, 118)
    assert sum(len(each.answers) for each in trains) == 2929
    assert {each.first.shape[1] for each in trains} == {4}
    assert {each.first.shape[1] for each in coffees} == {6}
    first = trains[0]
    assert first.first[0].tolist() == [2400, 150, 0, 1]
    assert first.second[0].tolist() == [4000, 150, 0, 1]
    assert first.answers[0] == -1


def test_a_coffee_is_chosen_by_its_rating(people):
    ratings = np.arange(27.0)
    levels = np.arange(27.0)[:, None]
    chosen = people._compared(levels, ratings, 0)
    assert len(chosen.answers) == 28
    assert np.array_equal(chosen.answers, np.sign(chosen.second - chosen.first)[:, 0])
    assert set(chosen.answers) == {-1, 1}


def test_somebody_who_looks_at_the_price_is_foretold(people):
    rng = np.random.default_rng(0)
    first, second = rng.uniform(1.0, 5.0, (2, 16, 4))
    person = people.Choices(first, second, np.where(first[:, 0] < second[:, 0], -1, 1))
    found = people.replay(np.ones(4), (3, person))
    assert set(found) == {0, 3, 5, 8}
    stated, logit, true = found[8]
    assert len(stated) == len(logit) == len(true) == 8
    assert np.mean((stated > 0.5) == true) >= 0.75
    assert np.mean((logit > 0.5) == true) >= 0.5


def test_the_table_counts(people):
    sure = np.array([0.95, 0.05, 0.6, 0.5]), np.full(4, 0.5), np.array([True, True, True, False])
    head, _, row, *_ = people.lines([dict.fromkeys(people.AFTER, sure)])
    cells = dict(
        zip(*([cell.strip() for cell in line.strip("|").split("|")] for line in (head, row)), strict=True)
    )
    assert float(cells["right"]) == pytest.approx(0.625)
    assert float(cells["stated"]) == pytest.approx(0.75)
    assert float(cells["above 0.9: share"]) == 0.5
    assert float(cells["right there"]) == 0.5
    assert float(cells["log score"]) == pytest.approx(np.mean(np.log([0.95, 0.05, 0.6, 0.5])), abs=5e-4)
    assert float(cells["logit"]) == float(cells["coin"]) == pytest.approx(-0.693)
