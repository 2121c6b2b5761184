"""Measure how often what Taste says of real people comes true.

    python benchmarks/campaigns/real_people.py             # 146 people who chose trains: some minutes
    python benchmarks/campaigns/real_people.py coffee      # 118 people who rated coffees, compared in pairs
    python benchmarks/campaigns/real_people.py --people 20

Each person's answers are in random order. After 0, 3, 5 and 8 of them, the others that were not used
are predicted: how many are right, what was stated, and the mean logarithm of what was stated of the
true answer. Beside it stand a coin, and a ridge logit on the same answers. What the sets are, and
where they come from: benchmarks/campaigns/data/README.md.
"""

import argparse
import csv
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before numpy: one person is one thread

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from rich.progress import track
from scipy.special import expit

from prefcal_agents import Taste
from prefcal_bench.results.words import markdown

DATA = Path(__file__).parent / "data"
AFTER = (0, 3, 5, 8)
"""Numbers of answers after which the others are predicted."""
_PREDICTED = 20  # largest number of answers of a person that are predicted
_LEAST = 3  # smallest number of them
_SURE = 0.9
_PENALTY = 3.0  # variance of the coefficients of the logit, in spreads of the attributes
_ATTRIBUTES = ("price", "time", "change", "comfort")


@dataclass(frozen=True, eq=False, slots=True)
class Choices:
    """What one person chose of two things, n times."""

    first: Float[np.ndarray, "n k"]  # attributes of one, lower is better, shape (n, k)
    second: Float[np.ndarray, "n k"]  # those of the other, shape (n, k)
    answers: Int[np.ndarray, " n"]  # -1 if the first one was chosen, 1 if the second one was, shape (n,)

    def some(self, rows: Int[np.ndarray, " r"]) -> "Choices":
        """Return the choices `rows`."""
        return Choices(self.first[rows], self.second[rows], self.answers[rows])


def trains() -> list[Choices]:
    """Return the people who chose between two train journeys."""
    people: dict[str, list[dict[str, str]]] = {}
    with (DATA / "train.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            people.setdefault(row["id"], []).append(row)
    return [_journeys(rows) for rows in people.values()]


def _journeys(rows: list[dict[str, str]]) -> Choices:
    a, b = (np.array([[float(r[f"{name}_{s}"]) for name in _ATTRIBUTES] for r in rows]) for s in "AB")
    return Choices(a, b, np.array([-1 if r["choice"] == "A" else 1 for r in rows]))


def coffees() -> list[Choices]:
    """Return the people who rated coffees, as choices between two that they rated differently.

    Nobody knows whether hotter or stronger is better, so each attribute enters both ways.
    """
    with (DATA / "coffee.csv").open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    levels = np.array([[float(v) for v in name.split("-")] for name in head])
    kpis = np.hstack([levels, -levels])
    return [_compared(kpis, np.array(row, dtype=float), seed) for seed, row in enumerate(rows)]


def _compared(kpis: Float[np.ndarray, "m k"], ratings: Float[np.ndarray, " m"], seed: int) -> Choices:
    pairs = np.random.default_rng(seed).permuted(np.array(np.triu_indices(len(ratings), 1)), axis=0).T
    pairs = pairs[ratings[pairs[:, 0]] != ratings[pairs[:, 1]]]
    np.random.default_rng(seed).shuffle(pairs)
    a, b = pairs[: max(AFTER) + _PREDICTED].T
    return Choices(kpis[a], kpis[b], np.sign(ratings[b] - ratings[a]).astype(np.int64))


SETS = {"train": trains, "coffee": coffees}


def stated(known: Choices, asked: Choices, seed: int) -> Float[np.ndarray, " n"]:
    """Return the probability that Taste states of each second one to be chosen, given `known`."""
    table = [_kpis(row) for row in np.vstack([known.first, known.second, asked.first, asked.second])]
    pairs = [(_kpis(a), _kpis(b)) for a, b in zip(known.first, known.second, strict=True)]
    taste = Taste.learn(known.answers.tolist(), pairs, seed, usual=table)
    found = [taste.predict(_kpis(a), _kpis(b)) for a, b in zip(asked.first, asked.second, strict=True)]
    return np.array([each.worse / (each.better + each.worse) for each in found])  # nobody said "the same"


def _kpis(row: Float[np.ndarray, " k"]) -> dict[str, float]:
    return {f"k{number:02}": float(value) for number, value in enumerate(row)}


def by_logit(known: Choices, asked: Choices, spread: Float[np.ndarray, " k"]) -> Float[np.ndarray, " n"]:
    """Return the same by a ridge logit in the differences of attributes, by Newton's method."""
    x, weights = (known.first - known.second) / spread, np.zeros(len(spread))
    for _ in range(25):
        p = expit(x @ weights)
        slope = x.T @ ((known.answers > 0) - p) - weights / _PENALTY
        weights += np.linalg.solve((x.T * (p * (1 - p))) @ x + np.eye(len(weights)) / _PENALTY, slope)
    return np.asarray(expit((asked.first - asked.second) / spread @ weights))


Predicted = dict[int, tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Bool[np.ndarray, " n"]]]
"""By the number of answers: what Taste and the logit state, and whether the second one was chosen."""


def replay(spread: Float[np.ndarray, " k"], job: tuple[int, Choices]) -> Predicted:
    """Return what is predicted of one person, whose number is the seed."""
    seed, person = job
    order = np.random.default_rng(seed).permutation(len(person.answers))
    rest = person.some(order[max(AFTER) : max(AFTER) + _PREDICTED])
    known = {count: person.some(order[:count]) for count in AFTER}
    true = rest.answers > 0
    return {n: (stated(k, rest, seed), by_logit(k, rest, spread), true) for n, k in known.items()}


def lines(found: Iterable[Predicted]) -> list[str]:
    """Return the lines of the table: a number of answers a row."""
    people = list(found)
    columns = ["answers", "right", "stated", "above 0.9: share", "right there", "log score", "logit", "coin"]
    cells = []
    for count in AFTER:
        p, q, true = (np.concatenate([each[count][part] for each in people]) for part in range(3))
        sure, right = np.maximum(p, 1 - p), np.where(p == 0.5, 0.5, (p > 0.5) == true)
        above = sure > _SURE
        there = f"{right[above].mean():.3f}" if above.any() else "-"
        scores = [_score(p, true), _score(q, true), np.log(0.5)]
        numbers = [right.mean(), sure.mean(), above.mean()]
        cells.append([f"{count}", *map("{:.3f}".format, numbers), there, *map("{:.3f}".format, scores)])
    return markdown(columns, cells)


def _score(p: Float[np.ndarray, " n"], true: Bool[np.ndarray, " n"]) -> float:
    return float(np.mean(np.log(np.clip(np.where(true, p, 1 - p), 1e-9, 1))))


def main(name: str, most: int, jobs: int) -> None:
    """Print the table of a set."""
    everyone = SETS[name]()
    spread = np.vstack([np.vstack([each.first, each.second]) for each in everyone]).std(axis=0)
    people = [each for each in everyone if len(each.answers) >= max(AFTER) + _LEAST][:most]
    with ProcessPoolExecutor(jobs) as pool:
        found = pool.map(partial(replay, spread), enumerate(people))
        told = list(track(found, description=f"{len(people)} people of {name}", total=len(people)))
    print("\n".join(lines(told)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("set", nargs="?", choices=SETS, default="train", help="default: train")
    parser.add_argument("--people", type=int, default=1000, metavar="N", help="N people at most")
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="N people at a time")
    options = parser.parse_args()
    main(options.set, options.people, options.jobs)
