"""Run torch and the packages built on it repeatably: seeded, on one thread, without warnings."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from prefcal_agents.support.extras import load
from prefcal_agents.support.global_random import seeded


@contextmanager
def alone() -> Iterator[None]:
    """Limit linear algebra to one thread in the context, and ignore warnings.

    So a proposal has the same digits whatever else the machine does.
    """
    from threadpoolctl import threadpool_limits  # finds libraries that torch loaded

    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


@contextmanager
def torch_seeded(*key: int) -> Iterator[int]:
    """Run torch alone, with all global generators seeded by `key`, then restore these.

    Args:
        key: Integers, each 0 or more, such as a seed and a counter.

    Yields:
        A seed below 2**32 that follows from `key`, for a generator of a library.
    """
    torch = load("torch", "peers")
    with seeded(*key) as seed, torch.random.fork_rng(devices=[]), alone():
        torch.default_generator.manual_seed(seed)
        yield seed
