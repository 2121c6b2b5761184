"""Samples and records that are made by hand."""

from dataclasses import replace

import numpy as np

from prefcal_env.preferences.answer import Answer, Mark
from prefcal_env.preferences.history import History, Sample


def in_cube(z):
    """Return a sample of a space in which θ and its point of the cube are the same."""
    point = tuple(map(float, z))
    return Sample(point, point)


def studied(points, cost=None, *, answers=None, rivals=None, kpis=None, unsafe=()):
    """Return a record of samples at `points`, each compared with the best one before it.

    Args:
        points: Points of the cube.
        cost: Cost of each sample, or a function of a point; the lower one is preferred.
        answers: Answers instead of those by `cost`, as `Answer.of` takes them.
        rivals: Numbers of the samples to compare with instead of the best ones.
        kpis: KPIs of each sample, or a function of a point; None where none are told.
        unsafe: Numbers of the samples that are marked unsafe.
    """
    costs = [cost(z) for z in points] if callable(cost) else cost
    known = [kpis(z) for z in points] if callable(kpis) else kpis
    history = History()
    for k, z in enumerate(points):
        rival = rivals[k] if rivals else history.incumbent
        if answers is None:
            told = Answer(None if rival is None else int(np.sign(costs[k] - costs[rival])))
        else:
            told = Answer.of(answers[k])
        if known is not None and known[k] is not None:
            told = replace(told, outcomes=(known[k], None))
        if k in unsafe:
            told = replace(told, marks=(Mark.CHALLENGER_UNSAFE,))
        history = history.with_pending(in_cube(z)).with_answer(told, rival)
    return history
