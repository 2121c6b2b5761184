"""Banks of simulated θ and records about them, made by hand."""

import numpy as np

from prefcal_agents import Screening
from prefcal_agents.people import Bank
from prefcal_agents.screening.findings import Findings, findings
from prefcal_env.knobs import Knob, KnobSpace
from prefcal_env.preferences.answer import Answer
from prefcal_env.preferences.history import Comparison, History, KPIValues, Sample
from support.histories import in_cube

SQUARE = KnobSpace([Knob("x", 0.0, 1.0), Knob("y", 0.0, 1.0)])
"""A space in which θ and its point of the cube are the same."""


def bank_of(kpis, names="abcdefg"):
    """A bank with these KPIs, shape (m, k), of random points of `SQUARE`."""
    thetas = np.random.default_rng(5).random((len(kpis), 2))
    table = np.array(kpis, dtype=float)
    return Bank.of(thetas, thetas, KPIValues(tuple(names[: table.shape[1]]), table))


def random_bank(count=120, k=3, seed=0):
    """A bank of `count` θ whose `k` KPIs are independent and spread over a decade."""
    return bank_of(10.0 ** np.random.default_rng(seed).uniform(-1, 0, (count, k)))


def of_pairs(bank, pairs, answers):
    """A record in which the rows `pairs` of the bank are compared, each θ once.

    The first row of a pair is the incumbent; answers are those of `Answer.of`.
    """
    samples, comparisons = [], []
    for (incumbent, challenger), answer in zip(pairs, answers, strict=True):
        index = len(samples)
        samples += [in_cube(bank.thetas[row]) for row in (incumbent, challenger)]
        comparisons += [
            Comparison(index, None, Answer(None)),
            Comparison(index + 1, index, Answer.of(answer)),
        ]
    return History(tuple(samples), tuple(comparisons))


def in_chain(bank, rows, answers):
    """A record in which each of the rows is compared with the row before; one answer fewer."""
    samples = tuple(Sample(tuple(bank.z[r]), tuple(bank.thetas[r])) for r in rows)
    comparisons = [Comparison(0, None, Answer(None))]
    comparisons += [Comparison(k, k - 1, Answer.of(a)) for k, a in enumerate(answers, 1)]
    return History(samples, tuple(comparisons))


def everything(agent: Screening, *, over: bool | None = None) -> Findings:
    """All findings of an agent, part after part."""
    found = findings(agent, over=over)
    while not found.complete:
        found = findings(agent, found, over=over)
    return found
