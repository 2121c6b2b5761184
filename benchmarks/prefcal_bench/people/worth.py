"""The measure of the benchmark: how many random experiments a tuning is worth."""

import numpy as np

from prefcal_env.errors import SettingsError

from .rule import Noticing, Rule
from .runs import Runs


def worth(rule: Rule, pool: Runs, one: Runs) -> float:
    """Return how many random experiments one needs on average to find a θ at least as good.

    With k of the pool's N experiments at least as good, this is (N + 1) / (k + 1): at best N + 1.
    People with eyes need one that is noticeably better: to them a tie is no improvement, so only
    what is noticeably better counts in k.

    Args:
        rule: Rule that compares without errors.
        pool: Experiments of θ drawn at random.
        one: The experiment to judge, a single run.

    Raises:
        SettingsError: If there is no pool, or more or less than one experiment to judge.
    """
    if not len(pool) or len(one) != 1:
        raise SettingsError(
            f"worth needs a pool and one experiment, got {len(pool)} and {len(one)} experiments"
        )
    verdicts = rule.compare(pool, one)
    strict = isinstance(rule, Noticing) and not rule.ties_count
    found = verdicts < 0 if strict else verdicts <= 0
    return (len(pool) + 1) / (int(np.count_nonzero(found)) + 1)


def random_search_worth(
    rule: Rule,
    runs: Runs,
    *,
    experiments: int,
    replays: int,
    rng: np.random.Generator,
    pool: Runs | None = None,
) -> float:
    """Return the geometric mean of the worth of random search after some experiments.

    Each replay draws from `runs` with replacement and keeps the winner of each comparison. If any
    two experiments differ and the rule is transitive, the result is about
    exp(1 + 1/2 + ... + 1/n) after n experiments: 36 after 20, 90 after 50. It is less if `runs`
    are few and also serve as the pool.

    Args:
        rule: Rule that compares without errors.
        runs: Experiments of θ drawn at random.
        experiments: Number of experiments of a search.
        replays: Number of searches.
        rng: Generator of the draws.
        pool: Experiments of other random θ that the worth is measured with; None for `runs`.

    Raises:
        SettingsError: If there are no runs, experiments or replays.
    """
    if not len(runs) or experiments < 1 or replays < 1:
        raise SettingsError(
            "random search needs 1 or more runs, experiments and replays, "
            f"got {len(runs)}, {experiments} and {replays}"
        )
    pool = runs if pool is None else pool
    drawn = rng.integers(len(runs), size=(experiments, replays))
    best = drawn[0]
    for new in drawn[1:]:
        best = np.where(rule.compare(runs.take(new), runs.take(best)) < 0, new, best)
    kept, counts = np.unique(best, return_counts=True)
    logs = [np.log(worth(rule, pool, runs.take(np.array([row])))) for row in kept]
    return float(np.exp(np.average(logs, weights=counts)))
